"""Native label format: a CSV file with one box per line, assigned to frames by number or stamp."""

import csv
import io
import math
import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from seaclutter_cli.errors import LabelError, about
from seaclutter_cli.frame import Frame
from seaclutter_cli.labels.boxes import IGNORE, MAX_OBJECTS, Labelled, LabelOptions, checked, truth_of
from seaclutter_cli.labels.point_labels import point_labels
from seaclutter_cli.paths import open_regular
from seaclutter_cli.text import count, printable
from seaclutter_cli.truth import CLUTTER, IGNORED, Truth

_BOX = ("x", "y", "z", "length", "width", "height", "yaw")
COLUMNS = ("frame", "track_id", "class", *_BOX)
PROPOSED = "proposed"
"""Column that is not empty in rows that the program proposed and nobody corrected."""

_KEYS = ("frame", "stamp_ns")
_NONE = "none"
_DISTINCTIVE = {*_KEYS, "track_id", "class", "length", "width", "height"}
_HEAD_BYTES = 4096
_LINE_CHARACTERS = 2**16
_WHOLE = re.compile(r"[0-9]{1,19}(\.0*)?", re.ASCII)
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", re.ASCII)
_RECENT = 16
_FIRST_TOLERANCE_NS = 25_000_000


class _Row(NamedTuple):
    """Line of the file: key of its frame, labelled object (None for class ``none``), line number, and mark."""

    key: int
    labelled: Labelled | None
    line: int
    proposed: bool


def find(path: Path) -> Path | None:
    """Return the path if it is a file that starts with a header that has at least three of the label columns."""
    if not path.is_file():
        return None
    with open_regular(path) as file:
        head = file.read(_HEAD_BYTES).decode("utf-8-sig", "replace")
    return path if len(_DISTINCTIVE.intersection(_names(head.partition("\n")[0]))) >= 3 else None


def _delimiter(header: str) -> str:
    return next((mark for mark in ";\t" if mark in header), ",")


def _names(header: str) -> list[str]:
    return [cell.strip(" \"'\r\n").lower() for cell in header.split(_delimiter(header))]


def _check_header(path: Path, names: Sequence[str]) -> str:
    key = next((key for key in _KEYS if key in names), "")
    missing = [] if key else ["frame (or stamp_ns)"]
    missing += [name for name in COLUMNS[1:] if name not in names]
    if missing:
        raise LabelError(f"{path}: line 1: missing column {', '.join(missing)}; required: {','.join(COLUMNS)}")
    if duplicate := next((name for name in (key, *COLUMNS[1:]) if names.count(name) > 1), None):
        raise LabelError(f"{path}: line 1: duplicate column {duplicate}")
    return key


def _lines(file: TextIO) -> Iterator[str]:
    """Yield the lines of a file; `csv.Error` if one is long."""
    while line := file.readline(_LINE_CHARACTERS + 1):
        if len(line) > _LINE_CHARACTERS:
            raise csv.Error(f"more than {_LINE_CHARACTERS:,} characters")
        yield line


def _rows(path: Path, names: Sequence[str], key: str, lines: Iterator[str], delimiter: str) -> Iterator[_Row]:
    line = 1
    try:
        for line, row in enumerate(csv.reader(lines, delimiter=delimiter, strict=True), 2):
            if any(cell.strip() for cell in row):
                with about(f"{path}: line {line}", LabelError):
                    yield _row(names, key, [cell.strip() for cell in row], line)
    except csv.Error as error:
        raise LabelError(f"{path}: line {line + 1}: {error}") from error


def _row(names: Sequence[str], key: str, cells: Sequence[str], line: int) -> _Row:
    if len(cells) != len(names):
        raise LabelError(f"expected {len(names)} values, got {len(cells)}")
    values = dict(zip(names, cells, strict=True))
    if not _WHOLE.fullmatch(values[key]):
        raise LabelError(f"{key} {_quoted(values[key])} is not a whole number from 0")
    frame_key = int(values[key].partition(".")[0])
    if frame_key >= 2**63:
        raise LabelError(f"{key} {_quoted(values[key])} is too large")
    kind, proposed = values["class"], bool(values.get(PROPOSED))
    if kind.lower() == _NONE:
        return _Row(frame_key, None, line, proposed)
    x, y, z, length, width, height, yaw = (_number(values, name) for name in _BOX)
    labelled = Labelled(values["track_id"], kind, (x, y, z), (length, width, height), yaw, proposed)
    return _Row(frame_key, checked(labelled), line, proposed)


def _number(values: Mapping[str, str], name: str) -> float:
    text = values[name]
    number = float(text) if _NUMBER.fullmatch(text) else math.nan
    if not math.isfinite(number):
        raise LabelError(f"{name} {_quoted(text)} is not a finite number")
    return number


def _quoted(text: str) -> str:
    return printable(repr(text[:40]))


def _by_key(path: Path, rows: Sequence[_Row]) -> dict[int, list[_Row]]:
    frames: dict[int, list[_Row]] = {}
    first_lines: dict[tuple[int, str], int] = {}
    for row in rows:
        same = frames.setdefault(row.key, [])
        same.append(row)
        if len(same) > MAX_OBJECTS:
            raise LabelError(f"{path}: line {row.line}: more than {MAX_OBJECTS:,} labels for the same frame")
        if row.labelled is None or not row.labelled.track or row.labelled.kind.lower() == IGNORE:
            continue
        if (first := first_lines.setdefault((row.key, row.labelled.track), row.line)) != row.line:
            track = _quoted(row.labelled.track)
            raise LabelError(f"{path}: line {row.line}: track {track} is already in line {first} for the same frame")
    return frames


class CsvLabels:
    """Labels of a CSV file, which is read completely; `LabelError` names the line.

    Columns may be in any order; additional columns are ignored. If both ``frame`` and ``stamp_ns`` are present, the
    former is used. Class ``none`` marks a frame as labelled and empty, class ``ignore`` an area to ignore. A target
    without a ``track_id`` gets a new one in each frame.
    """

    def __init__(self, path: Path, _options: LabelOptions) -> None:
        self._path = path
        try:
            with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", newline="") as file:
                lines = _lines(file)
                first = next(lines, "")
                names = _names(first)
                key = _check_header(path, names)
                rows = list(_rows(path, names, key, lines, _delimiter(first)))
        except csv.Error as error:
            raise LabelError(f"{path}: line 1: {error}") from error
        except UnicodeDecodeError as error:
            raise LabelError(f"{path}: not valid UTF-8 text") from error
        self._frames = _by_key(path, rows)
        if not self._frames:
            raise LabelError(f"{path}: contains no labels")
        self._matcher = None if key == "frame" else StampMatcher(self._frames)
        self._last = -1
        self._labelled = False

    def truth(self, frame: Frame) -> Truth | None:
        """Return the boxes of a frame, and labels in its cloud; None without a line, `LabelError` for two frames."""
        if self._matcher is None:
            key: int | None = frame.index
            self._last = max(self._last, frame.index)
        else:
            with about(self._path, LabelError):
                key = self._matcher.match(frame.index, frame.stamp_ns)
        rows = None if key is None else self._frames.get(key)
        if rows is None:
            return None
        self._labelled = True
        truth = truth_of([row.labelled for row in rows if row.labelled is not None])
        points = point_labels(frame)
        if points is not None:  # unless the field has other classes, as a classifier writes them
            tracks = {row.labelled.track for row in rows if row.labelled is not None}
            others = set(np.unique(points).tolist()) - {CLUTTER, IGNORED}
            points = points if tracks.issuperset(map(str, others)) else None
        return replace(truth, points=points, proposed=sum(row.proposed for row in rows))

    @property
    def frames(self) -> Sequence[int] | None:
        """Numbers of the labelled frames; None if stamps stand in for them."""
        return None if self._matcher else sorted(self._frames)

    def finish(self) -> None:
        """Check, after a complete log, that it had all labelled frames; `LabelError` names the first missing ones."""
        hint = "" if self._labelled else "; check that the labels belong to this log"
        left = self._matcher.left if self._matcher else sorted(number for number in self._frames if number > self._last)
        if left:
            named = ", ".join(map(str, left[:3])) + (", …" if len(left) > 3 else "")
            amount = f"the log lacks {len(left)} of {count(len(self._frames), 'labelled frame')}"
            raise LabelError(f"{self._path}: {amount} ({'stamp' if self._matcher else 'frame'} {named}){hint}")
        if not self._labelled:
            raise LabelError(f"{self._path}: no frame of the log is labelled{hint}")


class StampMatcher:
    """Assignment of the label stamp nearest to each frame, within half a frame period.

    Frames arrive in order, one at a time. The period is the shortest time between two of the last 16 frames. It is
    therefore correct after a gap, too, and a label with the exact stamp of a frame never matches another frame. For the
    first frame the period is unknown and the tolerance is 25 ms: half a period at 20 frames per second, a rate that few
    lidars exceed. A label stamp belongs to one frame, and a frame has one label stamp.

    **State**: the stamps of the last 16 frames, and the frame number assigned to each label stamp.
    """

    def __init__(self, stamps_ns: Iterable[int]) -> None:
        self._stamps = np.array(sorted(set(stamps_ns)), np.int64)
        self._owners: dict[int, int] = {}
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RECENT)

    def match(self, number: int, stamp_ns: int) -> int | None:
        """Return the label stamp of a frame; None without one, `LabelError` if it already belongs to another frame.

        The same frame can be requested again. A number lower than the last one restarts the sequence.
        """
        if self._recent and number < self._recent[-1][0]:
            self._recent.clear()
        if not self._recent or number != self._recent[-1][0]:
            self._recent.append((number, stamp_ns))
        index = int(np.searchsorted(self._stamps, stamp_ns))
        around: list[int] = self._stamps[max(index - 1, 0) : index + 1].tolist()
        nearest = min(around, key=lambda stamp: abs(stamp - stamp_ns), default=None)
        gaps = [later - earlier for (_, earlier), (_, later) in pairwise(self._recent) if later > earlier]
        if nearest is None or abs(nearest - stamp_ns) > (min(gaps) // 2 if gaps else _FIRST_TOLERANCE_NS):
            return None
        if (owner := self._owners.setdefault(nearest, number)) != number:
            raise LabelError(f"labels with stamp {nearest} match both frame {owner} and frame {number}")
        return nearest

    @property
    def left(self) -> list[int]:
        """Label stamps not assigned to a frame so far, in order."""
        return [stamp for stamp in self._stamps.tolist() if stamp not in self._owners]
