"""Runs that write a log for each recording: what filter, convert and their plans share."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from seaclutter_cli.buckets import mirror_of
from seaclutter_cli.errors import UsageError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.records import Channel, Metadata
from seaclutter_cli.runs.batch import Work, inputs_of_work, size_of
from seaclutter_cli.runs.labels import LabelFile
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import WritingLogs
from seaclutter_cli.runs.output_plan import check_names, first_part, places_of
from seaclutter_cli.runs.outputs import Paths, Root, prepare_outputs, write_manifest
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, statuses
from seaclutter_cli.runs.resume import NAME, RunIdentity, earlier_outcomes, from_entries, record_in, to_entries
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sources import Recording
from seaclutter_cli.text import data_size
from seaclutter_cli.threads import in_threads

L = TypeVar("L", bound="LogOutcome")
O = TypeVar("O", bound=WritingLogs)  # noqa: E741 - options


@dataclass(frozen=True)
class LogWork(Work[L], Generic[L, O]):
    """Work on one recording: its output, and the name of the output's format."""

    options: O
    recording: Recording
    target: Path
    form: str
    labels: LabelFile | None

    @property
    def output(self) -> Path:
        """The output, or the first of its parts."""
        return first_part(self.target, self.form, self.options.written.split)

    @property
    def reads(self) -> Sequence[Path]:
        """Files and folders that the work reads."""
        return inputs_of_work(self.recording, self.options.reading, self.labels)

    @property
    def writes(self) -> Sequence[Path]:
        """The output."""
        return (self.output,)

    @property
    def replaces(self) -> bool:
        """Whether an output may be replaced."""
        return self.options.force or self.options.batch.resume

    @abstractmethod
    def clouds(self, source: Source) -> list[Channel]:
        """Return the channels whose frames count."""

    @abstractmethod
    def without_result(self, reason: str | None) -> L:
        """Return an outcome without frames."""

    @abstractmethod
    def identity(self) -> RunIdentity:
        """Return what the output depends on."""

    def earlier(self) -> tuple[L | None, str]:
        """Return the outcome of an earlier run whose output is complete; otherwise None, and what differs if any.

        Raise `UsageError` if the output is not that of a run, and may not be replaced.
        """
        try:
            record = record_in(self.output)
        except UsageError:
            if self.options.force:
                return None, ""
            raise
        if record is None:
            return None, ""
        outcome, difference = self.without_result(None), self.identity().difference(record)
        try:
            outcome.topics, outcome.damage = from_entries(record, self.recording.paths)
        except ValueError as error:
            difference = difference or str(error)
        outcome.skipped = True
        return (None, f"the earlier output is of {difference}") if difference else (outcome, "")

    def record(self, source: Source, outcome: L) -> Metadata:
        """Return the metadata record of the run."""
        return Metadata(NAME, to_entries(self.identity(), outcome.topics, source.damage))


W = TypeVar("W", bound=LogWork[Any, Any])


@dataclass(frozen=True)
class LogRun(Generic[W]):
    """Work on each recording of a run, and the files that the run reads and writes, by option."""

    works: list[W]
    inputs: Paths
    others: Paths
    """Outputs beside the logs."""
    labels: Sequence[Path] = ()

    @property
    def root(self) -> Root:
        """Folder of the outputs, or the only one."""
        first = self.works[0]
        return Root(Path(first.options.output), OUTPUT_FORMATS[first.form].marker)

    @property
    def outputs(self) -> Paths:
        """All outputs."""
        first = self.works[0]
        places = places_of([work.target for work in self.works], first.form, first.options.written.split)
        return {"-o": places, **self.others, "--manifest": first.options.batch.manifest}

    def prepare(self, observer: Observer) -> None:
        """Check the names of the outputs, and prepare their folders; see `prepare_outputs`."""
        first = self.works[0]
        prepare_outputs(self.outputs, self.inputs, self.labels, force=first.replaces, observer=observer, root=self.root)
        check_names((work.target for work in self.works), first.options.to)

    def earlier(self, observer: Observer) -> list[Any]:
        """Return the outcomes of an earlier run; None for each recording that must be done."""
        resumes = self.works[0].options.batch.resume
        return earlier_outcomes(self.works, observer) if resumes else [None] * len(self.works)

    def finish(self, outcomes: "Sequence[LogOutcome]") -> None:
        """Store the sizes of the outputs, and write the manifest."""
        for outcome, size in zip(outcomes, in_threads(_output_size, outcomes), strict=True):
            outcome.bytes_out = size
        first = self.works[0]
        recordings = [work.recording for work in self.works]
        write_manifest(first.options.batch.manifest, recordings, outcomes, replace=first.replaces)


def _output_size(outcome: "LogOutcome") -> int:
    if outcome.error:
        return 0
    mirror = mirror_of(outcome.output)
    return mirror.size(outcome.output) if mirror else size_of(outcome.output)


@dataclass(kw_only=True)
class LogOutcome(Outcome):
    """Outcome of work on one recording, with a log as output, or the first of its parts.

    ``topics`` are sums over the frames of each cloud topic; ``bytes_in`` and ``bytes_out`` are the sizes of recording
    and log.
    """

    output: Path
    topics: dict[str, TopicTally] = field(default_factory=dict)
    bytes_in: int = 0
    bytes_out: int = 0

    @property
    def frames(self) -> int:
        """Number of frames of all topics."""
        return sum(tally.frames for tally in self.topics.values())

    @property
    def points_in(self) -> int:
        """Number of points of all topics."""
        return sum(tally.points_in for tally in self.topics.values())

    def counts(self) -> dict[str, Any]:
        """Return further columns of the manifest of a run."""
        return {
            "output": None if self.error else str(self.output),
            "frames": self.frames,
            "points_in": self.points_in,
            "bytes_in": self.bytes_in,
            "bytes_out": self.bytes_out,
        }


@dataclass(frozen=True)
class LogSummary(RecordingsResult):
    """Outcomes of work on several recordings with logs as outputs, and the duration of the run in seconds."""

    is_summary = True

    outcomes: Sequence[LogOutcome]
    seconds: float = 0.0

    def as_text(self) -> str:
        """Return the outcome of one recording, or the totals of several, as human-readable text."""
        return self.details() if len(self.outcomes) == 1 else self.totals()

    def totals(self) -> str:
        """Return how the recordings ended, and sizes."""
        read, written = (sum(getattr(one, name) for one in self.outcomes) for name in ("bytes_in", "bytes_out"))
        return f"{statuses(self.outcomes)}; {data_size(read)} in, {data_size(written)} out"
