"""Conversion of recordings to other formats."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter

from seaclutter_cli.buckets import on_paths
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import find_codec
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.reading import read
from seaclutter_cli.records import Channel, Metadata
from seaclutter_cli.runs.batch import BatchOptions, Work, input_bytes, inputs_of_work, run_batch
from seaclutter_cli.runs.convert_result import ConvertOutcome, ConvertSummary
from seaclutter_cli.runs.log_outcome import output_size
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.output_plan import (
    check_names,
    first_part,
    places_of,
    plan_outputs,
    warn_of_losses,
    warn_of_patterns,
)
from seaclutter_cli.runs.outputs import Root, inputs_of, prepare_outputs, write_manifest
from seaclutter_cli.runs.planned_works import PlannedWorks
from seaclutter_cli.runs.recordings import (
    Logs,
    PathLike,
    ReadOptions,
    expand,
    expected_frames,
    opened,
    require_frames,
    require_selected,
    storing_errors,
)
from seaclutter_cli.runs.resume import (
    NAME,
    RunIdentity,
    earlier_outcomes,
    earlier_run,
    identity_of,
    same_output_accepted,
    to_entries,
)
from seaclutter_cli.selection import Selection, cloud_channels
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS, check_options
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.sources import Recording
from seaclutter_cli.threads import in_threads


@dataclass(frozen=True, kw_only=True)
class ConvertOptions:
    """Options of a conversion.

    Parameters
    ----------
    reading : ReadOptions
        Part of each recording to read, and how.
    written : McapOptions
        How logs are written: compression, parts, other topics.
    to : str or None
        Name of the format of the outputs, a key of `OUTPUT_FORMATS`; None: by the name of the output, or MCAP.
    force : bool
        Replace existing files.
    batch : BatchOptions
        How several recordings are processed.
    """

    reading: ReadOptions = field(default_factory=ReadOptions)
    written: McapOptions = field(default_factory=McapOptions)
    to: str | None = None
    force: bool = False
    batch: BatchOptions = field(default_factory=BatchOptions)


@on_paths
def convert_logs(logs: Logs, output: PathLike, options: ConvertOptions, observer: Observer = SILENT) -> ConvertSummary:
    """Convert every recording to another format.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    output : path
        Output of one recording; folder for those of several, or if it is a `str` that ends in a slash.
    options : ConvertOptions
        Format, input and output files.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If the run cannot start or continue; an error in a single recording is stored in its outcome.
    """
    started, plan, batch = perf_counter(), plan_conversions(logs, output, options, observer), options.batch
    works, replaces = plan.works, options.force or batch.resume
    prepare_outputs(plan.outputs, plan.inputs, force=replaces, observer=observer, root=plan.root)
    check_names((work.target for work in works), options.to)
    earlier = earlier_outcomes(works, observer) if batch.resume else [None] * len(works)
    todo = [work for work, outcome in zip(works, earlier, strict=True) if outcome is None]
    done = iter([todo[0].run(observer)] if batch.runs_here(len(works)) and todo else run_batch(todo, batch, observer))
    outcomes = [outcome or next(done) for outcome in earlier]
    require_selected(outcomes)
    for outcome, size in zip(outcomes, in_threads(output_size, outcomes), strict=True):
        outcome.bytes_out = size
    write_manifest(batch.manifest, [work.recording for work in works], outcomes, replace=replaces)
    return ConvertSummary(outcomes, perf_counter() - started)


def plan_conversions(
    logs: Logs, output: PathLike, options: ConvertOptions, observer: Observer = SILENT, *, ahead: bool = True
) -> "PlannedWorks[ConvertWork]":
    """Return the work on each recording, without checks of the output files; `convert_logs` describes the parameters.

    Recordings in object storage are fetched ahead, if ``ahead``.

    Raises
    ------
    SeaclutterError
        If there are no recordings, or options do not fit them.
    """
    recordings = expand(logs, options.reading, observer, ahead=ahead)
    planned = plan_outputs(recordings, output, options.to)
    check_options(planned.form, options.written)
    return PlannedWorks(
        [ConvertWork(options, *one, planned.form) for one in zip(recordings, planned.targets, strict=True)],
        inputs_of(recordings, options.reading),
        {
            "-o": places_of(planned.targets, planned.form, options.written.split),
            "--manifest": options.batch.manifest,
        },
        Root(Path(output), OUTPUT_FORMATS[planned.form].marker),
    )


@dataclass(frozen=True)
class ConvertWork(Work[ConvertOutcome]):
    """Conversion of one recording.

    Parameters
    ----------
    options : ConvertOptions
        Format, input and output files.
    recording : Recording
        The recording.
    target : Path
        Its output.
    form : str
        Name of the format.
    """

    options: ConvertOptions
    recording: Recording
    target: Path
    form: str

    @property
    def output(self) -> Path:
        """The output, or the first of its parts."""
        return first_part(self.target, self.form, self.options.written.split)

    @property
    def reads(self) -> Sequence[Path]:
        """Files and folders that the work reads."""
        return inputs_of_work(self.recording, self.options.reading, None)

    @property
    def writes(self) -> Sequence[Path]:
        """The output."""
        return (self.output,)

    def run(self, observer: Observer) -> ConvertOutcome:
        """Convert the recording; store an error in the outcome."""
        outcome, options = self.without_result(None), self.options
        with storing_errors(outcome, observer), same_output_accepted(self), ExitStack() as stack:
            source = stack.enter_context(opened(self.recording, options.reading, observer, outcome))
            group = stack.enter_context(OutputGroup(replace=options.force or options.batch.resume))
            self._stream(source, outcome, observer, group)
        return outcome

    def sample(self, target: Path, frames: int) -> ConvertOutcome:
        """Convert the first frames into another output."""
        options = self.options
        reading = replace(options.reading, frames=min(options.reading.frames or frames, frames))
        fewer = replace(options, reading=reading, written=replace(options.written, split=None))
        return replace(self, options=fewer, target=target).run(SILENT)

    def clouds(self, source: Source) -> list[Channel]:
        """Return the channels of the clouds that are converted as frames, and counted."""
        return self._clouds(source, self.options.reading.selection)

    def earlier(self) -> tuple[ConvertOutcome | None, str]:
        """Return the outcome of an earlier run whose output is complete, or what differs; see `earlier_run`."""
        return earlier_run(self.without_result(None), self.identity, self.recording.paths, force=self.options.force)

    def without_result(self, reason: str | None) -> ConvertOutcome:
        """Return an outcome without frames."""
        size = input_bytes(self.recording)
        return ConvertOutcome(
            recording=self.recording.name, output=self.output, form=self.form, bytes_in=size, error=reason
        )

    def identity(self) -> RunIdentity:
        """Return what the output depends on."""
        return identity_of(
            self.recording.paths, None, self.options.reading, self.options.written, None, convert_to=self.form
        )

    def _stream(self, source: Source, outcome: ConvertOutcome, observer: Observer, group: OutputGroup) -> None:
        selection = replace(self.options.reading.selection, latched=self.options.written.latched)
        warn_of_patterns(source, self.options.written, observer)
        clouds = self._clouds(source, selection)
        outcome.topics |= {channel.topic: TopicTally() for channel in clouds}
        record = partial(self._record, source, outcome)
        written = replace(self.options.written, record=record, is_part=not selection.is_whole)
        with (
            observer.progress(source.name, expected_frames(source, clouds, selection)) as step,
            OUTPUT_FORMATS[self.form].make_sink(self.target, written, group, as_is=True) as sink,
        ):
            sink.begin(source, clouds)
            for item, frame in read(source, clouds, selection, with_latched=True):
                if frame is None:
                    sink.copy(item)
                    continue
                sink.keep(frame)
                _count(frame, outcome.topics[frame.topic])
                step()
            sink.end()
            outcome.messages = sink.messages
            require_frames(source, outcome.frames if clouds else outcome.messages, selection)
        outcome.lost = list(sink.lost)
        warn_of_losses(self.output, self.form, sink.lost, observer)

    def _clouds(self, source: Source, selection: Selection) -> list[Channel]:
        """Return the channels of the clouds that are converted as frames, and counted."""
        if selection.topics or selection.frames or not OUTPUT_FORMATS[self.form].has_topics:
            names = {channel.topic for channel in source.channels if find_codec(channel)}
            every = OUTPUT_FORMATS[self.form].has_topics and not selection.topics
            return cloud_channels(source, names if every else selection.topics)
        takes = self.options.written.takes
        return [channel for channel in source.channels if find_codec(channel) and takes(channel.topic)]

    def _record(self, source: Source, outcome: ConvertOutcome) -> Metadata:
        return Metadata(NAME, to_entries(self.identity(), outcome.topics, source.damage))


def _count(frame: Frame, tally: TopicTally) -> None:
    tally.frames += 1
    tally.points_in += frame.size
    tally.counts[0] += frame.size
