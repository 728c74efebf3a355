"""The program's own form: a CSV file with a line a box."""

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.labels.boxes import IGNORE, Labelled, checked, truth_of
from seaclutter_cli.labels.in_cloud import point_labels
from seaclutter_cli.labels.options import LabelOptions
from seaclutter_cli.labels.stamps import StampMatcher
from seaclutter_cli.text import printable
from seaclutter_cli.truth import Truth

BOX = ("x", "y", "z", "length", "width", "height", "yaw")
COLUMNS = ("frame", "track_id", "class", *BOX)
_KEYS = ("frame", "stamp_ns")
_NONE = "none"
_TELLING = {*_KEYS, "track_id", "class", "length", "width", "height"}
_HEAD_BYTES = 4096
_WHOLE = re.compile(r"[0-9]{1,19}(\.0*)?", re.ASCII)
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?", re.ASCII)


class _Row(NamedTuple):
    """A line: whose it is, what it says, and its number in the file. ``labelled`` is None for class ``none``."""

    key: int
    labelled: Labelled | None
    line: int


def matches(path: Path) -> bool:
    """Tell whether a file starts with a header in which at least three columns are those of labels."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES).decode("utf-8-sig", "replace")
    names = _names(head.partition("\n")[0])
    return len(_TELLING.intersection(names)) >= 3


def open_csv(path: Path, options: LabelOptions) -> "CsvLabels":
    """Read a file of labels, all of it.

    Columns come in any order, others are not looked at. Where both ``frame`` and ``stamp_ns`` are there, the former
    counts and the latter is not looked at. A class ``none`` marks a frame as labelled and empty, ``ignore`` an area to
    ignore. A target without a ``track_id`` gets one of its own in each frame.

    Raises
    ------
    LabelError
        If it cannot be read; names the line.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            first = file.readline()
            names = _names(first)
            reader = csv.reader(file, delimiter=_delimiter(first), strict=True)
            key = _check_header(path, names)
            rows = list(_rows(path, names, key, reader))
    except OSError as error:
        raise LabelError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise LabelError(f"{path}: no UTF-8 text") from error
    frames = _by_key(path, rows)
    if not frames:
        raise LabelError(f"{path}: no labels in it")
    return (CsvLabels if key == "frame" else _StampedLabels)(path, frames, options)


def _delimiter(header: str) -> str:
    return next((mark for mark in ";\t" if mark in header), ",")


def _names(header: str) -> list[str]:
    return [cell.strip(" \"'\r\n").lower() for cell in header.split(_delimiter(header))]


def _check_header(path: Path, names: Sequence[str]) -> str:
    """Return the column that says whose a line is."""
    key = next((key for key in _KEYS if key in names), None)
    missing = [name for name in COLUMNS[1:] if name not in names]
    if key is None:
        missing.insert(0, "frame (or stamp_ns)")
    if key is None or missing:
        raise LabelError(f"{path}: line 1: no column {', '.join(missing)}; needed are {','.join(COLUMNS)}")
    twice = next((name for name in (key, *COLUMNS[1:]) if names.count(name) > 1), None)
    if twice is not None:
        raise LabelError(f"{path}: line 1: two columns {twice}")
    return key


def _rows(path: Path, names: Sequence[str], key: str, cells: Iterator[list[str]]) -> Iterator[_Row]:
    line = 1
    try:
        for line, row in enumerate(cells, 2):
            if any(cell.strip() for cell in row):
                yield _row(names, key, [cell.strip() for cell in row], line)
    except csv.Error as error:
        raise LabelError(f"{path}: line {line + 1}: {error}") from error
    except LabelError as error:
        raise LabelError(f"{path}: line {line}: {error}") from error


def _row(names: Sequence[str], key: str, cells: Sequence[str], line: int) -> _Row:
    if len(cells) != len(names):
        raise LabelError(f"{len(cells)} values for {len(names)} columns")
    values = dict(zip(names, cells, strict=True))
    if not _WHOLE.fullmatch(values[key]):
        raise LabelError(f"{key} {_quoted(values[key])} is no whole number from 0")
    whose = int(values[key].partition(".")[0])
    if whose >= 2**63:
        raise LabelError(f"{key} {_quoted(values[key])} is beyond all measure")
    kind = values["class"]
    if kind.lower() == _NONE:
        return _Row(whose, None, line)
    x, y, z, length, width, height, yaw = (_number(values, name) for name in BOX)
    labelled = Labelled(values["track_id"], kind, (x, y, z), (length, width, height), yaw)
    return _Row(whose, checked(labelled), line)


def _number(values: Mapping[str, str], name: str) -> float:
    text = values[name]
    number = float(text) if _NUMBER.fullmatch(text) else math.nan
    if not math.isfinite(number):
        raise LabelError(f"{name} {_quoted(text)} is no number")
    return number


def _quoted(text: str) -> str:
    return printable(repr(text[:40]))


def _by_key(path: Path, rows: Sequence[_Row]) -> dict[int, list[_Row]]:
    frames: dict[int, list[_Row]] = {}
    taken: dict[tuple[int, str], int] = {}
    for row in rows:
        frames.setdefault(row.key, []).append(row)
        if row.labelled is None or not row.labelled.track or row.labelled.kind.lower() == IGNORE:
            continue
        first = taken.setdefault((row.key, row.labelled.track), row.line)
        if first != row.line:
            track = _quoted(row.labelled.track)
            raise LabelError(f"{path}: line {row.line}: track {track} is in line {first} for the same frame")
    return frames


class CsvLabels:
    """Labels by the number of their frame.

    Parameters
    ----------
    path : Path
        The file.
    frames : mapping of int to list of rows
        What it says of each frame.
    options : LabelOptions
        Tells the number of a frame.
    """

    def __init__(self, path: Path, frames: Mapping[int, list[_Row]], options: LabelOptions) -> None:
        self._path = path
        self._frames = frames
        self._number = options.number
        self._last = -1
        self._labelled = False

    def truth(self, frame: Frame) -> Truth | None:
        """Return the boxes of a frame, None if no line is of it.

        If the cloud holds labels of its points as the simulator writes them, they come with the boxes.

        Raises
        ------
        LabelError
            If labels by stamp fit two frames.
        """
        key = self._key(frame)
        rows = None if key is None else self._frames.get(key)
        if rows is None:
            return None
        self._labelled = True
        truth = truth_of([row.labelled for row in rows if row.labelled is not None])
        return replace(truth, points=point_labels(frame))

    def _key(self, frame: Frame) -> int | None:
        number = self._number(frame)
        self._last = max(self._last, number)
        return number

    def finish(self) -> None:
        """Check that the log had all labelled frames; only if all of it was read, and none of it lost.

        A caller that took a part of the log, or knows of frames that damage took, does not call this.

        Raises
        ------
        LabelError
            If labels are left; names the first.
        """
        left = self._left()
        whose = "" if self._labelled else "; are these the labels of another log?"
        if left:
            named = ", ".join(map(str, left[:3])) + (", …" if len(left) > 3 else "")
            amount = f"{len(left)} of {len(self._frames)} labelled frames are not in the log"
            raise LabelError(f"{self._path}: {amount} ({self._unit} {named}){whose}")
        if not self._labelled:
            raise LabelError(f"{self._path}: no frame of the log is labelled{whose}")

    _unit = "frame"

    def _left(self) -> list[int]:
        return sorted(number for number in self._frames if number > self._last)


class _StampedLabels(CsvLabels):
    """Labels by the stamp of their frame."""

    _unit = "stamp"

    def __init__(self, path: Path, frames: Mapping[int, list[_Row]], options: LabelOptions) -> None:
        super().__init__(path, frames, options)
        self._matcher = StampMatcher(frames)

    def _key(self, frame: Frame) -> int | None:
        try:
            return self._matcher.match(frame.index, frame.stamp_ns)
        except LabelError as error:
            raise LabelError(f"{self._path}: {error}") from error

    def _left(self) -> list[int]:
        return self._matcher.left
