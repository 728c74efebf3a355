"""Going on where a run stopped: which recordings are already filtered."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.reader import make_reader

from seaclutter_cli.config import Config
from seaclutter_cli.errors import UsageError
from seaclutter_cli.runs.filter_result import FilterOutcome
from seaclutter_cli.runs.labels import LabelFile
from seaclutter_cli.runs.recordings import ReadOptions
from seaclutter_cli.runs.run_record import NAME, RunIdentity, digest_of, digest_of_paths, from_entries
from seaclutter_cli.sinks import McapOptions
from seaclutter_cli.storage.locations import Location
from seaclutter_cli.storage.objects import find_object, open_object

_OF_THE_RUN = ("config", "water", "scene", "record", "method", "is_part")
"""Fields of `McapOptions` that the run fills in."""


def identity_of(
    paths: Sequence[Location],
    config: Config,
    reading: ReadOptions,
    written: McapOptions,
    labels: LabelFile | None,
    *,
    with_scene: bool,
) -> RunIdentity:
    """Return what the filtered file of a recording depends on, given its files or their copies."""
    named = [getattr(config.filter, key, None) for key in ("scene_model", "mask")]
    files = [Path(name) for name in named if name and Path(name).is_file()]
    calibration = reading.calibration
    options = {
        "reading": {**asdict(reading), "calibration": digest_of_paths([calibration]) if calibration else None},
        "written": {
            k: v for k, v in vars(written).items() if k not in ("config", "water", "scene", "record", "method")
        },
        "with_scene": with_scene,
    }
    label_parts = [digest_of_paths([labels.path]), asdict(labels.options)] if labels else []
    return RunIdentity(
        input=digest_of_paths(paths),
        config=digest_of([config.as_dict(), digest_of_paths(files)]),
        options=digest_of(options),
        labels=digest_of(label_parts),
    )


def earlier_run(
    blank: FilterOutcome, identity: Callable[[], RunIdentity], paths: Sequence[Location], *, force: bool
) -> tuple[FilterOutcome | None, str]:
    """Return the outcome of an earlier run whose output is complete; otherwise None, and what differs if there is one.

    Parameters
    ----------
    blank : FilterOutcome
        Outcome without results; those of the earlier run are filled in.
    identity : callable
        Returns what the output depends on.
    paths : sequence of Path or Url
        Files of the recording.
    force : bool
        Whether a file that is not the output of a run may be replaced.

    Raises
    ------
    UsageError
        If there is such a file, and it may not be replaced.
    """
    try:
        record = record_in(blank.output)
    except UsageError:
        if force:
            return None, ""
        raise
    if record is None:
        return None, ""
    difference = identity().difference(record)
    try:
        blank.topics, blank.damage = from_entries(record, paths)
    except ValueError as error:
        difference = difference or str(error)
    blank.skipped = True
    return (None, f"the earlier output is of {difference}") if difference else (blank, "")


def record_in(output: Location) -> Mapping[str, str] | None:
    """Return the record of the run that wrote a file; None if there is no file.

    Raises
    ------
    UsageError
        If the file is not a complete output of this program.
    """
    try:
        with ExitStack() as stack:
            stream: BinaryIO | None = None
            if isinstance(output, Path):
                stream = stack.enter_context(output.open("rb")) if output.exists() else None
            elif stored := find_object(output):
                stream = stack.enter_context(open_object(stored))
            if stream is None:
                return None
            found = [record for record in make_reader(stream).iter_metadata() if record.name == NAME]
    except (McapError, OSError, ValueError, EOFError) as error:
        raise UsageError(f"{output}: not a filtered log, not replaced ({error}); use --force to replace it") from error
    if not found:
        raise UsageError(f"{output}: without a record of its run, not replaced; use --force to replace it")
    return found[-1].metadata
