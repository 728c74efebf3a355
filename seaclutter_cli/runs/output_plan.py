"""Which outputs the recordings of a run get, in which format."""

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import truediv
from pathlib import Path

from seaclutter_cli.buckets import look
from seaclutter_cli.errors import UsageError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.outputs import is_file
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS, format_of
from seaclutter_cli.sinks.options import McapOptions, Split, parse_split, part_path, parts_after
from seaclutter_cli.sources import SOURCES, Recording
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.text import count, named_folder
from seaclutter_cli.urls import PathLike

__all__ = [
    "PlannedOutputs",
    "check_names",
    "first_part",
    "is_folder",
    "parse_split",
    "places_of",
    "plan_outputs",
    "warn_of_losses",
    "warn_of_patterns",
]

_MAX_LOSSES = 8
_SUFFIX = re.compile(r"\.(?!v\d)[a-z]\w*")
"""What is meant as a suffix: not the end of ``trial.2`` or ``trial.v2``."""
_READ = {suffix for kind in SOURCES.values() for suffix in kind.suffixes} | set(FRAME_READERS)
_ONLY_READ = _READ - {kind.suffix for kind in OUTPUT_FORMATS.values()}


def is_folder(output: PathLike, outputs: int, marker: str = "") -> bool:
    """Return whether a path denotes a folder for outputs, and not a single output; a slash at its end means a folder.

    An output that is a folder is recognised by the file ``marker``.
    """
    if outputs > 1 or named_folder(output):
        return True
    place = Path(output)
    look(place)
    if marker and (place / marker).exists():
        return False
    return os.path.isdir(place)  # noqa: PTH112 - false if the name is too long


@dataclass(frozen=True)
class PlannedOutputs:
    """The output of each recording, and the name of their format."""

    form: str
    targets: list[Path]


def plan_outputs(recordings: Sequence[Recording], output: PathLike, to: str | None = None) -> PlannedOutputs:
    """Return the output of each recording: ``output`` itself for one, files or folders in it for several.

    ``to`` names the format; by default it is that of the name of ``output``, or MCAP. Raise `UsageError` if several
    recordings need a folder but ``output`` is a file, or two recordings would get the same file.
    """
    path, several = Path(output), len(recordings) > 1 or named_folder(output)
    form = to or "mcap" if several else format_of(path, to)
    kind = OUTPUT_FORMATS[form]
    if not is_folder(output, len(recordings), kind.marker):
        return PlannedOutputs(form, [path])
    form = to or "mcap"
    kind = OUTPUT_FORMATS[form]
    if is_file(path):
        raise UsageError(f"{path}: is a file, but {count(len(recordings), 'recording')} need a folder")
    targets: dict[Path, Recording] = {}
    for recording in recordings:
        name = recording.name + ("" if kind.is_folder else kind.suffix)
        target = reduce(truediv, recording.inside, path) / name
        if target in targets:
            first = targets[target].paths[0]
            raise UsageError(f"{first} and {recording.paths[0]} would both become {target}; filter them separately")
        targets[target] = recording
    return PlannedOutputs(form, list(targets))


def check_names(outputs: Iterable[Path], to: str | None) -> None:
    """Raise `UsageError` if the name of an output is that of a format that can only be read, or tells no format."""
    kinds = [kind for kind in OUTPUT_FORMATS.values() if kind.suffix]
    known = [kind.suffix for kind in kinds if not (kind.is_folder and kind.has_topics)]
    for output in outputs:
        suffix = output.suffix.lower()
        if suffix in _ONLY_READ:
            raise UsageError(f"{output}: this format can only be read; choose a name such as {output.stem}.mcap")
        if to is None and suffix not in known and _SUFFIX.fullmatch(suffix):
            raise UsageError(
                f"{output}: no format has the suffix {output.suffix}; use {', '.join(known[:-1])} or {known[-1]}, "
                "or name the format with --to"
            )


def first_part(target: Path, form: str, split: Split | None) -> Path:
    """Return the file or folder of an output, or of its first part."""
    return target if split is None or OUTPUT_FORMATS[form].is_folder else part_path(target, 0)


def places_of(targets: Iterable[Path], form: str, split: Split | None) -> list[Path]:
    """Return the files and folders that outputs occupy, with the parts of earlier runs."""
    if split is None or OUTPUT_FORMATS[form].is_folder:
        return list(targets)
    places: list[Path] = []
    for target in targets:
        places += [part_path(target, 0), *parts_after(target, 0)]
    return places


def warn_of_patterns(source: Source, options: McapOptions, observer: Observer) -> None:
    """Warn of patterns for other topics that match no topic of a recording."""
    for option, patterns in (("--include", options.include), ("--exclude", options.exclude)):
        for pattern in patterns:
            if not any(re.search(pattern, channel.topic) for channel in source.channels):
                observer.warn(f"{source.name}: {option} {pattern} matches no topic")


def warn_of_losses(output: Path, form: str, lost: Sequence[str], observer: Observer) -> None:
    """Warn of what an output cannot keep of its recording."""
    if lost:
        more = f" and {len(lost) - _MAX_LOSSES} more" if len(lost) > _MAX_LOSSES else ""
        observer.warn(f"{output}: {OUTPUT_FORMATS[form].title} cannot keep: {', '.join(lost[:_MAX_LOSSES])}{more}")
