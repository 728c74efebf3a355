"""Runs that write a log for each recording: what filter, convert and their plans share."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Channel, Metadata
from seaclutter_cli.runs.batch import Work, inputs_of_work
from seaclutter_cli.runs.labels import LabelFile
from seaclutter_cli.runs.log_outcome import LogOutcome, output_size
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import WritingLogs
from seaclutter_cli.runs.output_plan import check_names, first_part, places_of
from seaclutter_cli.runs.outputs import Paths, Root, prepare_outputs, write_manifest
from seaclutter_cli.runs.resume import NAME, RunIdentity, earlier_outcomes, earlier_run, to_entries
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sources import Recording
from seaclutter_cli.threads import in_threads

L = TypeVar("L", bound=LogOutcome)
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
        """Return the outcome of an earlier run whose output is complete, or what differs; see `earlier_run`."""
        blank, paths = self.without_result(None), self.recording.paths
        return earlier_run(blank, self.identity, paths, force=self.options.force)

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

    def finish(self, outcomes: Sequence[LogOutcome]) -> None:
        """Store the sizes of the outputs, and write the manifest."""
        for outcome, size in zip(outcomes, in_threads(output_size, outcomes), strict=True):
            outcome.bytes_out = size
        first = self.works[0]
        recordings = [work.recording for work in self.works]
        write_manifest(first.options.batch.manifest, recordings, outcomes, replace=first.replaces)
