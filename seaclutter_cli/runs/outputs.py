"""Paths of output files: planning, checking and writing."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from seaclutter_cli.errors import UsageError
from seaclutter_cli.sinks.atomic import AtomicFile
from seaclutter_cli.sources import Recording


def is_folder(output: Path, outputs: int) -> bool:
    """Return whether a path denotes a folder for outputs and not a single output file."""
    return outputs > 1 or output.is_dir() or str(output).endswith((os.sep, "/"))


def plan_outputs(recordings: Sequence[Recording], output: Path) -> list[Path]:
    """Return the output file of each recording: ``output`` itself for one, files in it for several.

    Raises
    ------
    UsageError
        If several recordings need a folder but ``output`` is a file, or two recordings would get the same file.
    """
    if not is_folder(output, len(recordings)):
        return [output]
    if output.exists() and not output.is_dir():
        raise UsageError(f"{output}: is a file, but {len(recordings)} recordings need a folder")
    targets: dict[Path, Recording] = {}
    for recording in recordings:
        target = output / f"{recording.name}.mcap"
        if target in targets:
            first = targets[target].paths[0]
            raise UsageError(f"{first} and {recording.paths[0]} would both become {target}; filter them separately")
        targets[target] = recording
    return list(targets)


def inputs_of(recordings: Iterable[Recording]) -> list[Path]:
    """Return the files and folders of recordings."""
    return [path for recording in recordings for path in recording.paths]


def check_outputs(
    targets: Iterable[Path | None], inputs: Iterable[Path | None], labels: Iterable[Path] = (), *, force: bool
) -> None:
    """Check the paths of output files before anything is written.

    Parameters
    ----------
    targets : iterable of Path or None
        Files that a run writes; None for a file that is not requested.
    inputs : iterable of Path or None
        Files and folders that the run reads: recordings, configurations, models. New files in such folders are
        refused, too.
    labels : iterable of Path, optional
        Files of labels, and folders whose files are labels.
    force : bool
        Whether existing files may be replaced.

    Raises
    ------
    UsageError
        If two targets are the same file, or a target is an input, is inside an input folder, is a folder, or exists
        and may not be replaced.
    """
    read, labelled = ({path.resolve() for path in paths if path} for paths in (inputs, labels))
    written: set[Path] = set()
    for target in targets:
        if target is None:
            continue
        file = target.resolve()
        if file in written:
            raise UsageError(f"{target}: is given for two outputs")
        written.add(file)
        parents = set(file.parents)
        if file in read | labelled or read & parents or (labelled & parents and target.exists()):
            raise UsageError(f"{target}: is part of the input; choose another output")
        if target.is_dir():
            raise UsageError(f"{target}: is a folder")
        if target.exists() and not force:
            raise UsageError(f"{target}: already exists; use --force to replace it")


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write files, each completely or not at all; raise `OutputError` if one cannot be written."""
    for path, data in files.items():
        with AtomicFile(path) as file:
            file.stream.write(data)
