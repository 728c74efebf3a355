"""Where output goes, what it must not overwrite, and writing it."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from seaclutter_cli.errors import UsageError
from seaclutter_cli.sinks.atomic import AtomicFile
from seaclutter_cli.sources import Recording


def is_folder(output: Path, outputs: int) -> bool:
    """Tell whether a path stands for a folder of outputs rather than for the only one."""
    return outputs > 1 or output.is_dir() or str(output).endswith((os.sep, "/"))


def plan_outputs(recordings: Sequence[Recording], output: Path) -> list[Path]:
    """Return the file for each recording: ``output`` itself for one, files in it for several.

    Raises
    ------
    UsageError
        If two recordings would get the same file.
    """
    if not is_folder(output, len(recordings)):
        return [output]
    if output.exists() and not output.is_dir():
        raise UsageError(f"{output}: is a file, {len(recordings)} recordings need a folder")
    targets: dict[Path, Recording] = {}
    for recording in recordings:
        target = output / f"{recording.name}.mcap"
        if target in targets:
            first = targets[target].paths[0]
            raise UsageError(f"{first} and {recording.paths[0]} would both become {target}: filter them one by one")
        targets[target] = recording
    return list(targets)


def inputs_of(recordings: Iterable[Recording]) -> list[Path]:
    """Return the files and folders of recordings."""
    return [path for recording in recordings for path in recording.paths]


def check_outputs(
    targets: Iterable[Path | None], inputs: Iterable[Path | None], labels: Iterable[Path] = (), *, force: bool
) -> None:
    """Check where output goes before any is written.

    Parameters
    ----------
    targets : iterable of Path or None
        Files that a run writes; None for one that was not asked for.
    inputs : iterable of Path or None
        Files and folders that it reads: recordings, configurations, models. Nothing new goes into such a folder either.
    labels : iterable of Path, optional
        Files of labels, and folders whose files are labels.
    force : bool
        Whether existing files may be replaced.

    Raises
    ------
    UsageError
        If two targets are the same file, or one is an input, lies in one, is a folder, or may not be replaced.
    """
    read, labelled = ({path.resolve() for path in paths if path} for paths in (inputs, labels))
    written: set[Path] = set()
    for target in targets:
        if target is None:
            continue
        file = target.resolve()
        if file in written:
            raise UsageError(f"{target}: is named for two outputs")
        written.add(file)
        parents = set(file.parents)
        if file in read | labelled or read & parents or (labelled & parents and target.exists()):
            raise UsageError(f"{target}: is part of the input; choose another output")
        if target.is_dir():
            raise UsageError(f"{target}: is a folder")
        if target.exists() and not force:
            raise UsageError(f"{target}: exists already; --force replaces it")


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files, each complete or not at all; `OutputError` if one cannot be written."""
    for path, data in files.items():
        with AtomicFile(path) as file:
            file.stream.write(data)
