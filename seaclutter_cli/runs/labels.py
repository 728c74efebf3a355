"""The labels of recordings: which belong to which recording."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from seaclutter_cli.errors import UsageError
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.sources import Recording
from seaclutter_cli.sources.frame_files.folder import is_frame_folder
from seaclutter_cli.sources.rosbag2.folder import is_rosbag2_folder

LABEL_SUFFIX = ".labels.csv"


@dataclass(frozen=True, kw_only=True)
class LabelSources:
    """Where labels are, and how they are read.

    Parameters
    ----------
    paths : tuple of Path
        As many as there are recordings, in their order; or one folder that holds a file for each; or none.
    clutter_ids, ignore_ids : tuple of int or None
        Classes of per-point labels that are clutter, and that are neither clutter nor targets; None: the usual ones.
    """

    paths: tuple[Path, ...] = ()
    clutter_ids: tuple[int, ...] | None = None
    ignore_ids: tuple[int, ...] | None = None

    def open(self, recordings: Sequence[Recording]) -> list[Labels | None]:
        """Return the labels of each recording, None for all where no paths are given.

        Raises
        ------
        UsageError
            If it is not clear which labels belong to which recording, or some are not there.
        LabelError
            If labels cannot be read.
        """
        if not self.paths:
            return [None] * len(recordings)
        from seaclutter_cli.labels import LabelOptions, open_labels  # a filter run has none

        usual = LabelOptions()
        chosen = LabelOptions(
            clutter_ids=usual.clutter_ids if self.clutter_ids is None else self.clutter_ids,
            ignore_ids=usual.ignore_ids if self.ignore_ids is None else self.ignore_ids,
        )
        found = zip(recordings, find_labels(recordings, self.paths), strict=True)
        return [open_labels(path, replace(chosen, by_sequence=_are_frames(recording))) for recording, path in found]


def _are_frames(recording: Recording) -> bool:
    """Tell whether a recording is a folder of frames; there, a damaged file keeps its number."""
    path = recording.paths[0]
    return len(recording.paths) == 1 and path.is_dir() and not is_rosbag2_folder(path) and is_frame_folder(path)


def find_labels(recordings: Sequence[Recording], paths: Sequence[Path]) -> list[Path]:
    """Return the path of each recording's labels; `UsageError` if that is not clear, or one is not there."""
    if len(paths) == 1 and paths[0].is_dir() and (found := _in_folder(recordings, paths[0])):
        return found
    if len(paths) != len(recordings):
        raise UsageError(
            f"{len(paths)} --labels for {len(recordings)} recordings: give one for each, in their order, "
            f"or a folder that holds RECORDING{LABEL_SUFFIX} for each"
        )
    for path in paths:
        if not path.exists():
            raise UsageError(f"{path}: there are no such labels")
    return list(paths)


def _in_folder(recordings: Sequence[Recording], folder: Path) -> list[Path]:
    """Return the labels in a folder; none if it is itself the labels of a single recording."""
    named = [folder / f"{recording.name}{LABEL_SUFFIX}" for recording in recordings]
    missing = [path for path in named if not path.is_file()]
    if missing and len(recordings) == 1:
        return []
    if missing:
        raise UsageError(f"{folder}: has no labels for all recordings; missing: {', '.join(p.name for p in missing)}")
    if len(set(named)) < len(named):
        raise UsageError(f"{folder}: two recordings have the same name, and so the same labels: give --labels for each")
    return named
