"""Labelled objects, options of the readers, the truth of a frame that they become, and folders of label files."""

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seaclutter_cli.errors import LabelError, about, opening
from seaclutter_cli.frame import Frame
from seaclutter_cli.paths import natural_order
from seaclutter_cli.text import count, printable
from seaclutter_cli.truth import Boxes, Truth

IGNORE = "ignore"
MAX_OBJECTS = 10_000
"""Maximum number of labelled objects and areas in a frame."""
_HINT = "check that the labels belong to this log"
_CLOUDS = (".pcd", ".bin", ".ply", ".npy", ".las", ".laz")
_SECONDS = re.compile(r"(?<![\d.])[1-9]\d{9}\.\d+(?![\d.])", re.ASCII)


class Labelled(NamedTuple):
    """Labelled object or area; in metres and radians, with sizes along the axes x, y and z of the box.

    It is ``proposed`` if the program labelled it and nobody corrected it.
    """

    track: str
    kind: str
    center: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw: float
    proposed: bool = False


class Proposal(NamedTuple):
    """Labelled object of a frame as the program proposes it; ``mark`` says whether it is ``sure`` or ``doubtful``."""

    frame: int
    labelled: Labelled
    score: float
    mark: str


def checked(labelled: Labelled) -> Labelled:
    """Return a labelled object; `LabelError` if a size is negative."""
    if negative := [size for size in labelled.size if size < 0]:
        raise LabelError(f"box size must not be negative, got {negative[0]:g} m")
    return labelled


def truth_of(objects: Sequence[Labelled]) -> Truth:
    """Return the truth of a frame: areas of class ``ignore``, and targets; `LabelError` above `MAX_OBJECTS`."""
    if len(objects) > MAX_OBJECTS:
        raise LabelError(f"{len(objects):,} labels in one frame, more than {MAX_OBJECTS:,}")
    ignored = [labelled for labelled in objects if labelled.kind.lower() == IGNORE]
    targets = [labelled for labelled in objects if labelled.kind.lower() != IGNORE]
    return Truth(_boxes(targets), _boxes(ignored), proposed=sum(labelled.proposed for labelled in objects))


def _boxes(objects: Sequence[Labelled]) -> Boxes:
    return Boxes(
        _distinct([printable(labelled.track) for labelled in objects]),
        tuple(printable(labelled.kind) for labelled in objects),
        np.array([labelled.center for labelled in objects], np.float64).reshape(-1, 3),
        np.array([labelled.size for labelled in objects], np.float64).reshape(-1, 3),
        np.array([labelled.yaw for labelled in objects], np.float64),
    )


def _distinct(tracks: Sequence[str]) -> tuple[str, ...]:
    """Return unique tracks: objects with no track, or with one already used in the frame, get a new one."""
    names: dict[str, None] = {}
    given = set(tracks)
    for number, track in enumerate(tracks):
        name = track or f"#{number}"
        while name in names or (name != track and name in given):
            name += f"#{number}"
        names[name] = None
    return tuple(names)


@dataclass(frozen=True, kw_only=True)
class LabelOptions:
    """Settings of the label readers: classes of per-point labels that are clutter, or else neither that nor targets.

    Label files are in the order of the frames: by the ``index`` of frames or, if ``by_sequence``, by the ``sequence``
    of their messages, which counts from 0 in a folder that is a part of a recording, too.
    """

    clutter_ids: tuple[int, ...] = (110,)
    ignore_ids: tuple[int, ...] = (0, 99)
    by_sequence: bool = False

    def number(self, frame: Frame) -> int:
        """Return the number of the label file of a frame, from 0."""
        return frame.message.sequence if self.by_sequence and frame.message else frame.index


def label_folder(path: Path, name: str, suffix: str) -> Path | None:
    """Return the folder of label files: the subfolder of this name or the path itself; None if neither has any."""
    return next((folder for folder in (path / name, path) if files_in(folder, (suffix,))), None)


def files_in(folder: Path, suffixes: Collection[str]) -> list[Path]:
    """Return the files with one of the suffixes, in frame order; hidden files are left out."""
    if not folder.is_dir():
        return []
    files = [file for file in folder.iterdir() if file.suffix.lower() in suffixes and not file.name.startswith(".")]
    seconds = [_SECONDS.search(file.stem) for file in files]
    if all(seconds):
        # Fractions printed by Python vary in length, and 0.25 s comes before 0.3 s.
        return sorted(files, key=lambda file: Decimal(_SECONDS.findall(file.stem)[0]))
    return sorted(files, key=natural_order)


def _assigned(files: Sequence[Path], clouds: Sequence[Path], *, complete: bool) -> tuple[dict[int, Path], bool]:
    """Return label files by the number of their frame, and whether every frame must have one.

    If there are clouds, label files belong to those of the same name: `LabelError` if a label file has no cloud or, if
    the labels must be ``complete``, a cloud no label file. Otherwise they are assigned by order; incomplete ones by
    frame numbers in their names, if they are some.
    """
    if clouds:
        return _by_name(files, clouds, complete=complete), complete
    numbers = [_number(file) for file in files]
    # Consecutive numbers that start above 0 belong to a longer sequence, not to this log.
    consecutive = min(numbers) > 0 and max(numbers) - min(numbers) + 1 == len(set(numbers))
    if complete or min(numbers) < 0 or len(set(numbers)) < len(files) or consecutive:
        return dict(enumerate(files)), True
    return dict(zip(numbers, files, strict=True)), False


def _number(file: Path) -> int:
    """Return the number in the name of a file; -1 if the name is not a number."""
    return int(file.stem) if re.fullmatch("[0-9]{1,18}", file.stem) else -1


def _by_name(labels: Sequence[Path], clouds: Sequence[Path], *, complete: bool) -> dict[int, Path]:
    """Return the assignment of label files to clouds of the same name, in the order of the clouds."""
    named = {label.stem: label for label in labels}
    stems = [cloud.stem for cloud in clouds]
    counts = f"{count(len(labels), 'label file')}, {count(len(clouds), 'frame')}"
    if orphan := next((label for label in labels if label.stem not in set(stems)), None):
        raise LabelError(f"{orphan}: no frame {orphan.stem} in {clouds[0].parent} ({counts})")
    if complete and (unlabelled := next((cloud for cloud in clouds if cloud.stem not in named), None)):
        raise LabelError(f"{labels[0].parent}: no labels for frame {unlabelled.name} ({counts})")
    return {number: named[stem] for number, stem in enumerate(stems) if stem in named}


class FileLabels:
    """Labels with one file per frame in a folder, read on demand; errors of ``read`` need not name the file."""

    def __init__(
        self,
        folder: Path,
        suffix: str,
        clouds: str,
        read: Callable[[Path, Frame], Truth | None],
        options: LabelOptions,
        *,
        complete: bool,
    ) -> None:
        self._folder, self._read = folder, read
        beside = files_in(folder.parent / clouds, _CLOUDS) or files_in(folder, _CLOUDS)
        self._files, self._complete = _assigned(files_in(folder, (suffix,)), beside, complete=complete)
        self._number = options.number
        self._clouds = [] if options.by_sequence else beside
        self._last = -1
        self._labelled = False

    def truth(self, frame: Frame) -> Truth | None:
        """Return the truth from the file of a frame; None without content, `LabelError` if it does not fit."""
        number = self._number(frame)
        self._last = max(self._last, number)
        file = self._files.get(number)
        if self._clouds and number >= len(self._clouds) and _number(self._clouds[0]) > 0:
            amount = f"{count(len(self._clouds), 'cloud')} from number {_number(self._clouds[0])} on"
            raise LabelError(f"{self._folder}: labels of {amount}, a part of a log; use their folder as the log")
        if file is None:
            if self._complete:
                files = count(len(self._files), "file")
                raise LabelError(f"{self._folder}: no label file for frame {number} of the log, only {files}")
            return None
        with opening(file, LabelError), about(f"{file}: frame {number}", LabelError):
            truth = self._read(file, frame)
        self._labelled |= truth is not None
        return truth

    @property
    def frames(self) -> Sequence[int]:
        """Numbers of the frames that have files."""
        return sorted(self._files)

    def finish(self) -> None:
        """Check, after a complete log, that it had frames for all files, and a labelled one; or raise `LabelError`."""
        if left := sorted(number for number in self._files if number > self._last):
            first = f"{self._files[left[0]].name} (frame {left[0]})"
            files = count(len(left), "label file")
            raise LabelError(f"{self._folder}: the log has no frames for {files}, from {first} on; {_HINT}")
        if not self._labelled:
            raise LabelError(f"{self._folder}: no frame of the log is labelled; {_HINT}")
