"""Going on where a run stopped: which recordings are already filtered."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from mcap.exceptions import McapError
from mcap.reader import make_reader

from seaclutter_cli.buckets import copies_removed, mirror_of
from seaclutter_cli.errors import InputError, OutputError, UsageError
from seaclutter_cli.records import Metadata
from seaclutter_cli.runs.labels import LabelFile
from seaclutter_cli.runs.log_outcome import LogOutcome
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.recordings import Outcome, ReadOptions
from seaclutter_cli.runs.run_record import NAME, RunIdentity, digest_of, digest_of_paths, from_entries
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.sources import Recording
from seaclutter_cli.threads import in_threads

if TYPE_CHECKING:  # imports all filters, which tiles do not need
    from seaclutter_cli.config import Config

O = TypeVar("O", bound=Outcome)  # noqa: E741 - an outcome
O_co = TypeVar("O_co", bound=Outcome, covariant=True)
L = TypeVar("L", bound=LogOutcome)

_OF_THE_RUN = ("config", "water", "scene", "record", "method", "is_part")
"""Fields of `McapOptions` that the run fills in."""

_LATER = ("split", "include", "exclude")
"""Fields that count only if they are set, so that the records of earlier versions stay valid."""


def identity_of(
    paths: Sequence[Path],
    config: "Config | None",
    reading: ReadOptions,
    written: McapOptions,
    labels: LabelFile | None,
    **others: Any,
) -> RunIdentity:
    """Return what the output of a recording depends on, given its files; ``others`` are options."""
    named = [getattr(config.filter, key, None) for key in ("scene_model", "mask")] if config else []
    files = [Path(name) for name in named if name and Path(name).is_file()]
    calibration = reading.calibration
    options = {
        "reading": {**asdict(reading), "calibration": digest_of_paths([calibration]) if calibration else None},
        "written": {
            k: v
            for k, v in vars(written).items()
            if k not in ("config", "water", "scene", "record", "method") and (v or k not in _LATER)
        },
        **others,
    }
    label_parts = [digest_of_paths([labels.path]), asdict(labels.options)] if labels else []
    return RunIdentity(
        input=digest_of_paths(paths),
        config=digest_of([config.as_dict(), digest_of_paths(files)] if config else []),
        options=digest_of(options),
        labels=digest_of(label_parts),
    )


class ResumableWork(Protocol[O_co]):
    """Work on a recording whose output contains the record of its run."""

    @property
    def recording(self) -> Recording:
        """The recording."""
        ...

    @property
    def output(self) -> Path:
        """The output, or the first of its parts."""
        ...

    def earlier(self) -> tuple[O_co | None, str]:
        """Return the outcome of an earlier run whose output is complete, or what differs; see `earlier_run`."""
        ...


def earlier_outcomes(works: Sequence[ResumableWork[O]], observer: Observer, verb: str = "filtered") -> list[O | None]:
    """Return the outcomes of earlier runs whose outputs are complete; None for recordings that must be done again.

    Notes say that these are ``verb`` again.
    """
    found = in_threads(_earlier, works)
    for work, (outcome, difference) in zip(works, found, strict=True):
        if difference:
            observer.note(f"{work.recording.name}: {verb} again; {difference}")
        if outcome is not None:
            observer.damage(outcome.damage)
    return [outcome for outcome, _ in found]


def _earlier(work: ResumableWork[O]) -> tuple[O | None, str]:
    with copies_removed():
        return work.earlier() if os.path.lexists(work.output) else (None, "")


@contextmanager
def same_output_accepted(work: ResumableWork[O]) -> Iterator[None]:
    """Accept an output that another process has completed, which died or was given up before its answer came."""
    try:
        yield
    except OutputError:
        with suppress(UsageError, OSError):  # not an output of a run, or none at all
            if not mirror_of(work.output) and work.earlier()[0] is not None:
                return
        raise


def earlier_run(
    blank: L, identity: Callable[[], RunIdentity], paths: Sequence[Path], *, force: bool
) -> tuple[L | None, str]:
    """Return the outcome of an earlier run whose output is complete; otherwise None, and what differs if there is one.

    Parameters
    ----------
    blank : LogOutcome
        Outcome without results; those of the earlier run are filled in.
    identity : callable
        Returns what the output depends on.
    paths : sequence of Path
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


def record_in(output: Path) -> Mapping[str, str] | None:
    """Return the record of the run that wrote a file; None if there is no file.

    Raises
    ------
    UsageError
        If the file is not a complete output of this program.
    """
    try:
        records = _metadata_in(output)
    except (McapError, InputError, OSError, ValueError, EOFError) as error:
        raise UsageError(f"{output}: not a filtered log, not replaced ({error}); use --force to replace it") from error
    if records is None:
        return None
    found = [record for record in records if record.name == NAME]
    if not found:
        raise UsageError(f"{output}: without a record of its run, not replaced; use --force to replace it")
    return found[-1].entries


def _metadata_in(output: Path) -> Sequence[Metadata] | None:
    """Return the metadata records in an output; None if there is none. Of an MCAP file, only the end is read."""
    if not output.exists():
        return None
    if output.suffix.lower() != ".mcap" or output.is_dir():
        with closing(ReadOptions().open(Recording((output,)))) as source:
            return list(source.metadata)
    mirror = mirror_of(output)
    with mirror.open(output) if mirror else output.open("rb") as stream:
        return [Metadata(record.name, record.metadata) for record in make_reader(stream).iter_metadata()]
