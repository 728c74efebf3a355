"""Going on where a run stopped: which recordings are already filtered."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, TypeVar

from mcap.exceptions import McapError
from mcap.reader import make_reader

from seaclutter_cli.errors import InputError, OutputError, UsageError
from seaclutter_cli.jobs.together import in_threads
from seaclutter_cli.records import Metadata
from seaclutter_cli.runs.labels import LabelFile
from seaclutter_cli.runs.log_outcome import LogOutcome
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.outputs import existing
from seaclutter_cli.runs.recordings import Outcome, ReadOptions, expand
from seaclutter_cli.runs.run_record import NAME, RunIdentity, digest_of, digest_of_paths, from_entries
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.sources import Recording
from seaclutter_cli.storage.locations import Location
from seaclutter_cli.storage.objects import find_object, is_folder_of_objects, open_object

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
    paths: Sequence[Location],
    config: "Config | None",
    reading: ReadOptions,
    written: McapOptions,
    labels: LabelFile | None,
    **others: Any,
) -> RunIdentity:
    """Return what the output of a recording depends on, given its files or their copies; ``others`` are options."""
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
    def output(self) -> Location:
        """The output, or the first of its parts."""
        ...

    def earlier(self) -> tuple[O_co | None, str]:
        """Return the outcome of an earlier run whose output is complete, or what differs; see `earlier_run`."""
        ...


def earlier_outcomes(works: Sequence[ResumableWork[O]], observer: Observer, verb: str = "filtered") -> list[O | None]:
    """Return the outcomes of earlier runs whose outputs are complete; None for recordings that must be done again.

    Notes say that these are ``verb`` again.
    """
    present = existing(work.output for work in works)
    found = in_threads(lambda work: work.earlier() if work.output in present else (None, ""), works)
    for work, (outcome, difference) in zip(works, found, strict=True):
        if difference:
            observer.note(f"{work.recording.name}: {verb} again; {difference}")
        if outcome is not None:
            observer.damage(outcome.damage)
    return [outcome for outcome, _ in found]


@contextmanager
def same_output_accepted(work: ResumableWork[O]) -> Iterator[None]:
    """Accept an output that another process has completed, which died or was given up before its answer came."""
    try:
        yield
    except OutputError:
        with suppress(UsageError, OSError):  # not an output of a run, or none at all
            if isinstance(work.output, Path) and work.earlier()[0] is not None:
                return
        raise


def earlier_run(
    blank: L, identity: Callable[[], RunIdentity], paths: Sequence[Location], *, force: bool
) -> tuple[L | None, str]:
    """Return the outcome of an earlier run whose output is complete; otherwise None, and what differs if there is one.

    Parameters
    ----------
    blank : LogOutcome
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
        records = _metadata_in(output)
    except (McapError, InputError, OSError, ValueError, EOFError) as error:
        raise UsageError(f"{output}: not a filtered log, not replaced ({error}); use --force to replace it") from error
    if records is None:
        return None
    found = [record for record in records if record.name == NAME]
    if not found:
        raise UsageError(f"{output}: without a record of its run, not replaced; use --force to replace it")
    return found[-1].entries


def _metadata_in(output: Location) -> Sequence[Metadata] | None:
    """Return the metadata records in an output; None if there is none. Of an MCAP file, only the end is read."""
    if output.suffix.lower() != ".mcap" or (isinstance(output, Path) and output.is_dir()):
        return _metadata_of_log(output)
    with ExitStack() as stack:
        stream: BinaryIO | None = None
        if isinstance(output, Path):
            stream = stack.enter_context(output.open("rb")) if output.exists() else None
        elif stored := find_object(output):
            stream = stack.enter_context(open_object(stored))
        if stream is None:
            return None
        return [Metadata(record.name, record.metadata) for record in make_reader(stream).iter_metadata()]


def _metadata_of_log(output: Location) -> Sequence[Metadata] | None:
    if isinstance(output, Path):
        if not output.exists():
            return None
        recording = Recording((output,))
    elif find_object(output) or is_folder_of_objects(output):
        recording = expand(str(output), ahead=False)[0]
    else:
        return None
    with closing(ReadOptions().open(recording)) as source:
        return list(source.metadata)
