"""Folders with one label file a frame: which file is of which frame."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Protocol

from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.labels.options import LabelOptions
from seaclutter_cli.truth import Truth

_CLOUDS = (".pcd", ".bin", ".ply", ".npy", ".las", ".laz")
_SECONDS = re.compile(r"(?<![\d.])[1-9]\d{9}\.\d+(?![\d.])", re.ASCII)


class ReadsFrame(Protocol):
    """Reads the truth of a frame from its label file; `LabelError` without the name of the file."""

    def __call__(self, path: Path, frame: Frame) -> Truth | None:
        """Return the truth, None if the frame is not labelled."""
        ...


def label_folder(path: Path, name: str, suffix: str) -> Path | None:
    """Return the folder of label files that a path means: the one of this name in it, or itself; None if neither."""
    return next((folder for folder in (path / name, path) if files_in(folder, (suffix,))), None)


def files_in(folder: Path, suffixes: Collection[str]) -> list[Path]:
    """Return the files with one of these suffixes in the order in which they are frames; hidden ones are none."""
    if not folder.is_dir():
        return []
    files = [file for file in folder.iterdir() if file.suffix.lower() in suffixes and not file.name.startswith(".")]
    seconds = [_SECONDS.search(file.stem) for file in files]
    if all(seconds):
        # Decimals as Python writes them have no fixed length, and 0.25 s comes before 0.3 s.
        return sorted(files, key=lambda file: Decimal(_SECONDS.findall(file.stem)[0]))
    return sorted(files, key=_natural)


def _natural(file: Path) -> tuple[list[str | int], str]:
    """Sort numbers in names by their value: frame2 before frame10."""
    parts = re.split(r"([0-9]+)", file.name)
    return [int(part) if index % 2 else part for index, part in enumerate(parts)], file.name


def clouds_beside(folder: Path, name: str) -> list[Path]:
    """Return the clouds that label files belong to: in the folder of this name beside theirs, or among them."""
    return files_in(folder.parent / name, _CLOUDS) or files_in(folder, _CLOUDS)


@dataclass(frozen=True)
class Places:
    """Which label file is of which frame.

    Parameters
    ----------
    files : mapping of int to Path
        Label file by number of the frame, from 0.
    complete : bool
        Whether a frame without a file is an error; else it is unlabelled.
    """

    files: Mapping[int, Path]
    complete: bool


def by_name(labels: Sequence[Path], clouds: Sequence[Path], *, complete: bool) -> Places:
    """Give each cloud, in their order, the label file that bears its name.

    Raises
    ------
    LabelError
        If a label file has no cloud, or, if they have to be ``complete``, a cloud no label file.
    """
    named = {label.stem: label for label in labels}
    stems = [cloud.stem for cloud in clouds]
    lost = next((label for label in labels if label.stem not in set(stems)), None)
    if lost is not None:
        raise LabelError(f"{lost}: no frame {lost.stem} in {clouds[0].parent} ({_amounts(labels, clouds)})")
    bare = next((cloud for cloud in clouds if cloud.stem not in named), None)
    if complete and bare is not None:
        raise LabelError(f"{labels[0].parent}: no labels for frame {bare.name} ({_amounts(labels, clouds)})")
    return Places({number: named[stem] for number, stem in enumerate(stems) if stem in named}, complete)


def _amounts(labels: Sequence[Path], clouds: Sequence[Path]) -> str:
    return f"{len(labels)} label files, {len(clouds)} frames"


def by_order(labels: Sequence[Path]) -> Places:
    """Give each frame a label file, in the order of both."""
    return Places(dict(enumerate(labels)), complete=True)


def by_number(labels: Sequence[Path]) -> Places:
    """Take names as numbers of frames, from 0, unless they are none, or count on from another one: then by order."""
    numbers = [int(label.stem) if re.fullmatch("[0-9]{1,18}", label.stem) else -1 for label in labels]
    first, count = min(numbers), len(set(numbers))
    counts_on = first > 0 and max(numbers) - first + 1 == count
    if first < 0 or count < len(labels) or counts_on:
        return by_order(labels)
    return Places(dict(zip(numbers, labels, strict=True)), complete=False)


class FileLabels:
    """Labels of one file a frame, read when the frame comes.

    Parameters
    ----------
    folder : Path
        Folder of the label files.
    places : Places
        Which file is of which frame.
    read : ReadsFrame
        Reads one of them.
    options : LabelOptions
        Tells the number of a frame.
    """

    def __init__(self, folder: Path, places: Places, read: ReadsFrame, options: LabelOptions) -> None:
        self._folder = folder
        self._places = places
        self._read = read
        self._number = options.number
        self._last = -1
        self._labelled = False

    def truth(self, frame: Frame) -> Truth | None:
        """Return what the frame's file says; None if there is none, or nothing in it.

        Raises
        ------
        LabelError
            If the file cannot be read or does not fit the frame, or if there is none where each frame has to have one.
        """
        number = self._number(frame)
        self._last = max(self._last, number)
        file = self._places.files.get(number)
        if file is None:
            self._require_none(number)
            return None
        try:
            truth = self._read(file, frame)
        except OSError as error:
            raise LabelError(f"{file}: {error.strerror}") from error
        except LabelError as error:
            raise LabelError(f"{file}: frame {number}: {error}") from error
        self._labelled |= truth is not None
        return truth

    def _require_none(self, number: int) -> None:
        if self._places.complete:
            count = len(self._places.files)
            raise LabelError(f"{self._folder}: no label file for frame {number} of the log; there are {count}")

    def finish(self) -> None:
        """Check that the log had frames for all label files; only if all of it was read, and none of it lost.

        A caller that took a part of the log, or knows of frames that damage took, does not call this.

        Raises
        ------
        LabelError
            If label files are left behind the last frame, or no frame was labelled at all.
        """
        left = {number: file for number, file in self._places.files.items() if number > self._last}
        if left:
            first = min(left)
            raise LabelError(
                f"{self._folder}: {len(left)} label files of frames that are not in the log, from {left[first].name} "
                f"for frame {first} on; are these the labels of another log?"
            )
        if not self._labelled:
            raise LabelError(f"{self._folder}: no frame of the log is labelled; are these the labels of another log?")
