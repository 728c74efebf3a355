"""Label folders with one file per frame, and the assignment of files to frames."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.labels.boxes import LabelOptions
from seaclutter_cli.text import count
from seaclutter_cli.truth import Truth

_CLOUDS = (".pcd", ".bin", ".ply", ".npy", ".las", ".laz")
_SECONDS = re.compile(r"(?<![\d.])[1-9]\d{9}\.\d+(?![\d.])", re.ASCII)


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
    return sorted(files, key=_natural)


def _natural(file: Path) -> tuple[list[str | int], str]:
    """Return a sort key that orders numbers in names by value: frame2 before frame10."""
    parts = re.split(r"([0-9]+)", file.name)
    return [int(part) if index % 2 else part for index, part in enumerate(parts)], file.name


def _clouds_beside(folder: Path, name: str) -> list[Path]:
    """Return the cloud files of a label folder: in its sibling folder of this name, or in the folder itself."""
    return files_in(folder.parent / name, _CLOUDS) or files_in(folder, _CLOUDS)


@dataclass(frozen=True)
class FrameFiles:
    """Label files by frame number, from 0; a frame without a file is unlabelled, or an error if all must be there."""

    files: Mapping[int, Path]
    complete: bool


def assigned(folder: Path, suffix: str, clouds: str, *, complete: bool) -> FrameFiles:
    """Return the assignment of the label files in a folder to frames.

    If there are clouds, label files belong to those of the same name: `LabelError` if a label file has no cloud or, if
    the labels must be ``complete``, a cloud no label file. Otherwise they are assigned by order; incomplete ones by
    frame numbers in their names, if they are some.
    """
    files, beside = files_in(folder, (suffix,)), _clouds_beside(folder, clouds)
    if beside:
        return _by_name(files, beside, complete=complete)
    return _by_order(files) if complete else _by_number(files)


def _by_name(labels: Sequence[Path], clouds: Sequence[Path], *, complete: bool) -> FrameFiles:
    """Return the assignment of label files to clouds of the same name, in the order of the clouds."""
    named = {label.stem: label for label in labels}
    stems = [cloud.stem for cloud in clouds]
    orphan = next((label for label in labels if label.stem not in set(stems)), None)
    if orphan is not None:
        raise LabelError(f"{orphan}: no frame {orphan.stem} in {clouds[0].parent} ({_counts(labels, clouds)})")
    unlabelled = next((cloud for cloud in clouds if cloud.stem not in named), None)
    if complete and unlabelled is not None:
        raise LabelError(f"{labels[0].parent}: no labels for frame {unlabelled.name} ({_counts(labels, clouds)})")
    return FrameFiles({number: named[stem] for number, stem in enumerate(stems) if stem in named}, complete)


def _counts(labels: Sequence[Path], clouds: Sequence[Path]) -> str:
    return f"{count(len(labels), 'label file')}, {count(len(clouds), 'frame')}"


def _by_order(labels: Sequence[Path]) -> FrameFiles:
    """Return the assignment of label files to frames by order."""
    return FrameFiles(dict(enumerate(labels)), complete=True)


def _by_number(labels: Sequence[Path]) -> FrameFiles:
    """Return the assignment by numeric file names, from frame 0; by order if names cannot be frame numbers."""
    numbers = [int(label.stem) if re.fullmatch("[0-9]{1,18}", label.stem) else -1 for label in labels]
    first, count = min(numbers), len(set(numbers))
    # Consecutive numbers that start above 0 belong to a longer sequence, not to this log.
    consecutive = first > 0 and max(numbers) - first + 1 == count
    if first < 0 or count < len(labels) or consecutive:
        return _by_order(labels)
    return FrameFiles(dict(zip(numbers, labels, strict=True)), complete=False)


class FileLabels:
    """Labels with one file per frame, read on demand.

    ``read`` raises `LabelError` without the name of the file.
    """

    def __init__(
        self, folder: Path, assigned: FrameFiles, read: Callable[[Path, Frame], Truth | None], options: LabelOptions
    ) -> None:
        self._folder = folder
        self._assigned = assigned
        self._read = read
        self._number = options.number
        self._last = -1
        self._labelled = False

    def truth(self, frame: Frame) -> Truth | None:
        """Return the truth from the file of a frame; None if there is no file or it is empty.

        `LabelError` if the file cannot be read, does not fit the frame, or is missing although every frame must have
        one.
        """
        number = self._number(frame)
        self._last = max(self._last, number)
        file = self._assigned.files.get(number)
        if file is None:
            self._check_optional(number)
            return None
        try:
            truth = self._read(file, frame)
        except OSError as error:
            raise LabelError(f"{file}: {error.strerror}") from error
        except LabelError as error:
            raise LabelError(f"{file}: frame {number}: {error}") from error
        self._labelled |= truth is not None
        return truth

    def _check_optional(self, number: int) -> None:
        if self._assigned.complete:
            files = count(len(self._assigned.files), "file")
            raise LabelError(f"{self._folder}: no label file for frame {number} of the log, only {files}")

    def finish(self) -> None:
        """Check that the log contained frames for all label files, and a labelled one; otherwise raise `LabelError`.

        Call this only after the complete log was read without lost frames.
        """
        left = {number: file for number, file in self._assigned.files.items() if number > self._last}
        if left:
            first = min(left)
            raise LabelError(
                f"{self._folder}: the log has no frames for {count(len(left), 'label file')}, from "
                f"{left[first].name} (frame {first}) on; check that the labels belong to this log"
            )
        if not self._labelled:
            raise LabelError(
                f"{self._folder}: no frame of the log is labelled; check that the labels belong to this log"
            )
