"""Assignment of labels to recordings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from seaclutter_cli.buckets import fetch, mirror_of
from seaclutter_cli.errors import UsageError
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.options import Options
from seaclutter_cli.runs.options import LabelSources
from seaclutter_cli.sources import Recording
from seaclutter_cli.text import count

if TYPE_CHECKING:
    from seaclutter_cli.labels import LabelOptions

LABEL_SUFFIX = ".labels.csv"


def assign_labels(sources: Options, recordings: Sequence[Recording]) -> list["LabelFile | None"]:
    """Return the labels of each recording, not yet read; None for all recordings if there are no paths.

    Raise `UsageError` if they cannot be assigned to the recordings, or some do not exist.
    """
    if not isinstance(sources, LabelSources) or not sources.labels:
        return [None] * len(recordings)
    from seaclutter_cli.labels import LabelOptions  # not needed otherwise

    defaults = LabelOptions()
    chosen = LabelOptions(
        clutter_ids=defaults.clutter_ids if sources.clutter_ids is None else sources.clutter_ids,
        ignore_ids=defaults.ignore_ids if sources.ignore_ids is None else sources.ignore_ids,
    )
    for path in sources.labels:
        if mirror := mirror_of(path):
            mirror.know(path)
    found = zip(recordings, find_labels(recordings, sources.labels), strict=True)
    return [LabelFile(path, replace(chosen, by_sequence=one.is_frame_folder)) for one, path in found]


@dataclass(frozen=True)
class LabelFile:
    """Labels of one recording, a file or a folder, and how they are read."""

    path: Path
    options: "LabelOptions"

    def open(self) -> Labels:
        """Return the labels; raise `LabelError` if they cannot be read."""
        from seaclutter_cli.labels import open_labels

        fetch(self.path)
        return open_labels(self.path, self.options)


def find_labels(recordings: Sequence[Recording], paths: Sequence[Path]) -> list[Path]:
    """Return the path of each recording's labels; raise `UsageError` if one is ambiguous or missing."""
    if len(paths) == 1 and paths[0].is_dir() and (found := _in_folder(recordings, paths[0])):
        return found
    if len(paths) != len(recordings):
        raise UsageError(
            f"{len(paths)} --labels for {count(len(recordings), 'recording')}: give one for each, in the same order, "
            f"or a folder with RECORDING{LABEL_SUFFIX} for each"
        )
    for path in paths:
        if not path.exists():
            raise UsageError(f"{path}: no such file or folder of labels")
    return list(paths)


def _in_folder(recordings: Sequence[Recording], folder: Path) -> list[Path]:
    """Return the labels in a folder; an empty list if the folder itself is the labels of a single recording."""
    named = [folder / f"{recording.name}{LABEL_SUFFIX}" for recording in recordings]
    missing = [path for path in named if not path.is_file()]
    if missing and len(recordings) == 1:
        return []
    if missing:
        raise UsageError(f"{folder}: labels of some recordings are missing: {', '.join(p.name for p in missing)}")
    if len(set(named)) < len(named):
        raise UsageError(f"{folder}: two recordings have the same name and would share labels; give --labels for each")
    return named
