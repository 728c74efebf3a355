"""Runs that write a log for each recording: what filter, convert and their plans share."""

import re
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from seaclutter_cli.buckets import mirror_of
from seaclutter_cli.errors import UsageError
from seaclutter_cli.frame import Reason
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.messages.metadata import RUN
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.records import Channel, Metadata
from seaclutter_cli.runs import resume
from seaclutter_cli.runs.batch import RecordingWork, run_all, size_of
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import WritingLogs
from seaclutter_cli.runs.outputs import Paths, inputs_of, is_folder, outputs_in, prepare_outputs, write_manifest
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, assign_labels, expand, require_frames, statuses
from seaclutter_cli.selection import Selection
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS, check_options, format_of, format_of_suffix
from seaclutter_cli.sinks.options import McapOptions, matches, part_path, parts_after
from seaclutter_cli.sources.formats import is_log_name
from seaclutter_cli.sources.frame_files import FRAME_READERS
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.text import count, data_size, listed, named_folder, printable
from seaclutter_cli.threads import in_threads
from seaclutter_cli.urls import PathLike

if TYPE_CHECKING:
    from seaclutter_cli.sinks.frames import FrameSink
    from seaclutter_cli.sinks.log import LogSink

    OutputSink: TypeAlias = FrameSink | LogSink

L = TypeVar("L", bound="LogOutcome")
O = TypeVar("O", bound=WritingLogs)  # noqa: E741 - options

_MAX_LOSSES = 8
_SUFFIX = re.compile(r"\.(?!v\d)[a-z]\w*")
"""What is meant as a suffix: not the end of ``trial.2`` or ``trial.v2``."""


def plan_outputs(recordings: Sequence[Recording], output: PathLike, to: str | None = None) -> tuple[str, list[Path]]:
    """Return the format and the output of each recording: ``output`` for one, files or folders in it for several.

    ``to`` names the format; by default it is that of the name of ``output``, or MCAP. Raise `UsageError` if several
    recordings need a folder but ``output`` is a file, or two recordings would get the same file.
    """
    path = Path(output)
    if len(recordings) == 1 and not named_folder(output):
        form = format_of(path, to)
        if not is_folder(output, 1, OUTPUT_FORMATS[form].marker):
            return form, [path]
    form = to or "mcap"
    suffix = "" if OUTPUT_FORMATS[form].is_folder else OUTPUT_FORMATS[form].suffix
    names = (Path(*one.inside, one.name + suffix) for one in recordings)
    inputs = [one.paths[0] for one in recordings]
    return form, outputs_in(path, names, inputs, "recording", "filter them separately")


@dataclass(frozen=True)
class LogWork(RecordingWork[L], resume.RecordedWork[L], Generic[L, O]):
    """Work on one recording: its output, and the name of the output's format.

    The output of a single recording appears with the files of a ``group``, others by themselves. ``complete`` is the
    outcome of an earlier run that is resumed.
    """

    options: O
    target: Path
    form: str
    group: OutputGroup | None = field(default=None, kw_only=True)
    complete: L | None = field(default=None, kw_only=True)
    is_one_of_several: bool = field(default=False, kw_only=True)

    @property
    def output(self) -> Path:
        """The output, or the first of its parts."""
        return part_path(self.target, 0) if self.has_parts else self.target

    @property
    def has_parts(self) -> bool:
        """Whether the output is written in parts, each a file."""
        return self.options.written.split is not None and not OUTPUT_FORMATS[self.form].is_folder

    @property
    def writes(self) -> Sequence[Path]:
        """The output."""
        return (self.output,)

    def study(self, source: Source, labels: Labels | None, outcome: L, observer: Observer) -> None:
        """Write the output; warn of what it cannot keep of the recording, and of patterns that match no topic."""
        options = self.options.written
        for option, patterns in (("--include", options.include), ("--exclude", options.exclude)):
            for pattern in patterns:
                if not any(matches(pattern, channel.topic) for channel in source.channels):
                    observer.warn(f"{source.name}: {option} {pattern} matches no topic")
        selection = replace(self.reading.selection, latched=options.latched)
        common = replace(options, record=partial(self.record, source, outcome), is_part=not selection.is_whole)
        made = OUTPUT_FORMATS[self.form]
        with (
            resume.same_output_accepted(self),
            OutputGroup(self.group, replace=self.options.replaces) as files,
            made.make_sink(self.target, self.sink_options(common, labels), files) as sink,
        ):
            frames = self.stream(source, selection, outcome, sink, observer)
            require_frames(source, frames, selection)
        outcome.lost = list(sink.lost)
        if outcome.lost:
            observer.warn(f"{self.output}: {made.title} cannot keep: {listed(outcome.lost, _MAX_LOSSES)}")

    def sink_options(self, options: McapOptions, labels: Labels | None) -> McapOptions:  # noqa: ARG002 - for subclasses
        """Return the options of the output, given those that all outputs have."""
        return options

    @abstractmethod
    def stream(
        self, source: Source, selection: Selection, outcome: L, sink: "LogSink | FrameSink", observer: Observer
    ) -> int:
        """Pass the recording to a sink; return the number of frames, or of messages if there are no clouds."""

    @abstractmethod
    def clouds(self, source: Source) -> list[Channel]:
        """Return the channels whose frames count."""

    def records(self) -> Sequence[Mapping[str, Any]]:
        """Return the records of runs in the output."""
        return [one.entries for one in resume.metadata_in(self.output) if one.name == RUN]

    def restore(self, outcome: L, record: Mapping[str, Any]) -> None:
        """Store the sums and the damage that a record has."""
        outcome.topics, outcome.damage = resume.from_entries(record, self.recording.paths)

    def record(self, source: Source, outcome: L) -> Metadata:
        """Return the metadata record of the run."""
        return Metadata(RUN, {**self.identity(), **resume.outcome_entry(outcome.topics, source.damage)})


W = TypeVar("W", bound=LogWork[Any, Any])


class LogRun(Generic[W]):
    """Work on each recording of a run, as a function makes it, and the files that the run reads and writes, by option.

    Recordings in object storage are fetched ahead, if ``ahead``. Raise `SeaclutterError` if there are no recordings, or
    options do not fit them.
    """

    def __init__(self, options: WritingLogs, observer: Observer, make: Callable[..., W], *, ahead: bool = True) -> None:
        recordings = expand(options, observer, ahead=ahead)
        form, targets = plan_outputs(recordings, options.output, options.to)
        check_options(form, options.written, with_scene=getattr(options, "with_scene", False))
        each = zip(recordings, assign_labels(options, recordings), targets, strict=True)
        self.options, self.observer = options, observer
        several = len(recordings) > 1
        self.works = [
            make(options.reading, *pair, options, target, form, is_one_of_several=several) for *pair, target in each
        ]
        configs = [work.config for work in self.works[:1] if hasattr(work, "config")]
        self.inputs = inputs_of(recordings, options, configs)
        self.marker = OUTPUT_FORMATS[form].marker

    def prepare(self, *, dry: bool = False) -> None:
        """Check the names of the outputs, and prepare their folders, unless ``dry``; see `prepare_outputs`."""
        force = dry or self.options.replaces
        earlier = [part for work in self.works if work.has_parts for part in parts_after(work.target, 0)]
        outputs: Paths = {"-o": [*(work.output for work in self.works), *earlier], **self.options.outputs}
        kept: dict[str, Any] = {"force": force, "observer": self.observer, "marker": self.marker, "dry": dry}
        prepare_outputs(outputs, self.inputs, root=Path(self.options.output), **kept)
        check_names((work.target for work in self.works), self.options.to)

    def begin(self) -> list[W]:
        """Prepare the outputs; return the work on each recording, with its outcome of a run that is resumed."""
        self.prepare()
        if not self.options.resume:
            return self.works
        pairs = zip(self.works, resume.earlier_outcomes(self.works, self.observer), strict=True)
        return [replace(work, complete=outcome) for work, outcome in pairs]

    def do(
        self, works: Sequence[W], in_order: Callable[[Any], object] = lambda _: None, *, again: bool = False
    ) -> list[Any]:
        """Do the work that is left, as `run_all` does, and return all outcomes; an interrupted run has a manifest.

        With ``again``, the work on complete recordings is done, too, to read their rows for a table.
        """
        outcomes: list[Any] = [None if again else work.complete for work in works]
        try:
            return run_all(works, self.options, self.observer, in_order, earlier=outcomes)
        except KeyboardInterrupt:
            if None not in outcomes:  # it did not come before the first recording
                self.list_outputs(outcomes)
            raise

    def list_outputs(self, outcomes: "Sequence[LogOutcome]") -> None:
        """Store the sizes of the outputs, and write the manifest."""
        for outcome, size in zip(outcomes, in_threads(_output_size, outcomes), strict=True):
            outcome.bytes_out = size
        recordings = [work.recording for work in self.works]
        write_manifest(self.options.manifest, recordings, outcomes, replace=self.options.replaces)


def check_names(outputs: Iterable[Path], to: str | None) -> None:
    """Raise `UsageError` if the name of an output is that of a format that can only be read, or tells no format."""
    for output in outputs:
        suffix = output.suffix.lower()
        if format_of_suffix(suffix):
            continue
        if is_log_name(suffix) or suffix in FRAME_READERS:
            raise UsageError(f"{output}: this format can only be read; choose a name such as {output.stem}.mcap")
        if to is None and _SUFFIX.fullmatch(suffix):
            kinds = [kind for kind in OUTPUT_FORMATS.values() if kind.suffix]
            known = [kind.suffix for kind in kinds if not (kind.is_folder and kind.has_topics)]
            raise UsageError(
                f"{output}: no format has the suffix {output.suffix}; use {', '.join(known[:-1])} or {known[-1]}, "
                "or name the format with --to"
            )


def _output_size(outcome: "LogOutcome") -> int:
    if outcome.error:
        return 0
    mirror = mirror_of(outcome.output)
    return sum(one.size for one in mirror.look_below(outcome.output)) if mirror else size_of(outcome.output)


@dataclass(kw_only=True)
class LogOutcome(Outcome):
    """Outcome of work on one recording, with a log as output, or the first of its parts.

    ``topics`` are sums over the frames of each cloud topic; ``lost`` is what the log cannot keep, in words.
    ``bytes_in`` and ``bytes_out`` are the sizes of recording and log.
    """

    data = "recording status output=written_to error damage seconds=rounded_s"
    listed = "output=written_to frames points_in points_out bytes_in bytes_out"

    output: Path
    topics: dict[str, TopicTally] = field(default_factory=dict)
    lost: list[str] = field(default_factory=list)
    bytes_in: int = 0
    bytes_out: int = 0

    @property
    def written_to(self) -> Path | None:
        """The output; None after an error."""
        return None if self.error else self.output

    @property
    def frames(self) -> int:
        """Number of frames of all topics."""
        return sum(tally.frames for tally in self.topics.values())

    @property
    def points_in(self) -> int:
        """Number of points of all topics."""
        return sum(tally.points_in for tally in self.topics.values())

    @property
    def points_out(self) -> int:
        """Number of points kept."""
        return sum(int(tally.counts[Reason.KEPT]) for tally in self.topics.values())

    @abstractmethod
    def amounts(self) -> str:
        """Return what was written in words."""

    def figures(self) -> str:
        """Return what was written and the duration, for a line about the outcome."""
        if self.skipped:
            return f"{count(self.frames, 'frame')}; skipped, the output was complete"
        return f"{self.amounts()}, {self.seconds:.1f} s -> {printable(str(self.output))}"


@dataclass(frozen=True)
class LogSummary(RecordingsResult[L]):
    """Outcomes of work on several recordings with logs as outputs, and the duration of the run in seconds."""

    is_summary = True

    seconds: float = 0.0

    def as_text(self) -> str:
        """Return the outcome of one recording, or the totals of several, as human-readable text."""
        return self.details() if len(self.outcomes) == 1 else self.totals()

    def totals(self) -> str:
        """Return how the recordings ended, and sizes."""
        read, written = (sum(getattr(one, name) for one in self.outcomes) for name in ("bytes_in", "bytes_out"))
        return f"{statuses(self.outcomes)}; {data_size(read)} in, {data_size(written)} out"
