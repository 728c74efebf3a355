"""Where output goes, and what it must not overwrite."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from seaclutter_cli.errors import UsageError

if TYPE_CHECKING:
    from seaclutter_cli.sources import Recording


def plan_outputs(recordings: "Sequence[Recording]", output: Path) -> list[Path]:
    """Return the file for each recording: ``output`` itself for one, files in it for several.

    Raises
    ------
    UsageError
        If two recordings would get the same file.
    """
    into_folder = len(recordings) > 1 or output.is_dir() or str(output).endswith((os.sep, "/"))
    if not into_folder:
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


def refuse_overwriting(targets: Iterable[Path], recordings: "Sequence[Recording]", *, force: bool) -> None:
    """Raise `UsageError` if a target is an input, or exists and may not be replaced."""
    refuse_replacing(targets, [path for recording in recordings for path in recording.paths], force=force)


def refuse_twice(targets: Sequence[Path]) -> None:
    """Raise `UsageError` if two targets are the same file."""
    files = [target.resolve() for target in targets]
    for number, target in enumerate(targets):
        if files[number] in files[:number]:
            raise UsageError(f"{target}: is named for two outputs")


def refuse_replacing(targets: Iterable[Path], paths: Iterable[Path], *, force: bool) -> None:
    """Raise `UsageError` if a target is one of the input's paths, or exists and may not be replaced."""
    inputs = {path.resolve() for path in paths}
    for target in targets:
        file = target.resolve()
        if file in inputs or inputs & set(file.parents):
            raise UsageError(f"{target}: is part of the input; choose another output")
        if target.is_dir():
            raise UsageError(f"{target}: is a folder")
        if target.exists() and not force:
            raise UsageError(f"{target}: exists already; --force replaces it")
