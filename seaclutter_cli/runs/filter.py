"""Filtering of recordings into drop-in logs."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from gzip import GzipFile
from io import BytesIO
from shutil import copyfileobj
from time import perf_counter

from seaclutter_cli.buckets import on_paths
from seaclutter_cli.config import Config
from seaclutter_cli.errors import InputError, UsageError
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.interfaces import Labels, Sink, Source
from seaclutter_cli.messages.diagnostics import TOPIC, read_diagnostics
from seaclutter_cli.messages.pointcloud2 import rewrapped
from seaclutter_cli.options import function_of
from seaclutter_cli.pipeline import TopicTally, run
from seaclutter_cli.records import Channel, Message, Metadata
from seaclutter_cli.reporting.palette import reason_names
from seaclutter_cli.runs.batch import input_bytes
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.runs.filter_result import FilterOutcome, FilterSummary
from seaclutter_cli.runs.log_work import LogRun, LogWork, log_run, warn_of_losses, warn_of_patterns
from seaclutter_cli.runs.methods import configured
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options import ReadOptions
from seaclutter_cli.runs.options.logs import FilterOptions
from seaclutter_cli.runs.outputs import may_appear
from seaclutter_cli.runs.recordings import expected_frames, open_recording, require_frames, require_selected
from seaclutter_cli.runs.resume import RunIdentity, identity_of
from seaclutter_cli.selection import cloud_channels, filtered_by, was_filtered
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.csv import FrameTable
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.text import count, printable, share


@function_of(FilterOptions)
@on_paths
def filter_log(options: FilterOptions) -> FilterSummary:
    """Filter one or several logs into drop-in logs.

    Returns
    -------
    FilterSummary
        Outcome of each recording: frames, points by reason, range rings, damage, seconds.

    Examples
    --------
    >>> import seaclutter
    >>> first = seaclutter.ReadOptions(frames=5)
    >>> done = seaclutter.filter_log("samples/sea.mcap", folder / "filtered.mcap", reading=first)
    >>> outcome = done.outcomes[0]
    >>> outcome.frames, outcome.topics["/points"].points_in
    (5, 10304)
    """
    started, observer = perf_counter(), options.watching
    run = filter_run(options, observer)
    begun, csv_file = run.begin(observer), options.csv_file
    with OutputGroup(replace=run.works[0].replaces) as files:
        with ExitStack() as stack:
            # A single log appears together with the table, after it. Of several, each appears when it is complete.
            logs = stack.enter_context(OutputGroup(files))
            table = stack.enter_context(AtomicFile(csv_file, files)) if csv_file else None
            if table:
                write = table.stream.write
                _frame_table(run.works[0].config, write).write_header()
                earlier = [one if isinstance(one, FilterOutcome) else None for one in begun]
                pairs = zip(run.works, earlier, strict=True)
                begun = [replace(work, complete=one, write=write if run.is_alone else None) for work, one in pairs]
            outcomes = run.do(begun, observer, logs, partial(_append, table))
            require_selected(outcomes)
        if not may_appear([csv_file], outcomes, observer):
            files.discard()
    run.list_outputs(outcomes)
    return FilterSummary(outcomes, perf_counter() - started)


def filter_run(options: FilterOptions, observer: Observer, *, ahead: bool = True) -> "LogRun[FilterWork]":
    """Return the work on each recording, without checks of the output files.

    Recordings in object storage are fetched ahead, if ``ahead``. Raise `SeaclutterError` if the configuration is not
    valid, there are no recordings, or options do not fit them.
    """
    if options.labels and not options.with_scene:
        raise UsageError("--labels: only used for the boxes of --with-scene; add that option or leave out --labels")
    return log_run(options, observer, partial(FilterWork, config=configured(options)), ahead=ahead)


def _append(table: AtomicFile | None, outcome: FilterOutcome) -> None:
    """Append the rows of a recording to the table, unless they are there already."""
    if table and outcome.rows:
        with GzipFile(fileobj=BytesIO(outcome.rows)) as rows:
            copyfileobj(rows, table.stream)
    outcome.rows = b""


def _frame_table(config: Config, write: Callable[[bytes], object]) -> FrameTable:
    """Return the table for the frames of a recording, whose lines a function receives."""
    return FrameTable(write, len(config.ring_edges[1:]), scenes=config.has_scenes, water=config.has_water)


@contextmanager
def _packed_rows(outcome: FilterOutcome) -> Iterator[Callable[[bytes], object]]:
    """Yield a function that receives lines of the table, which are then in an outcome, compressed."""
    packed = BytesIO()
    with GzipFile(fileobj=packed, mode="wb") as rows:
        yield rows.write
    outcome.rows = packed.getvalue()


@dataclass(frozen=True)
class FilterWork(LogWork[FilterOutcome, FilterOptions]):
    """Filtering of one recording with a configuration; of a ``complete`` output, only rows of the table are read.

    ``write`` receives the rows of the table as they come; by default they are in the outcome.
    """

    config: Config
    complete: FilterOutcome | None = None
    write: Callable[[bytes], object] | None = None

    def run(self, observer: Observer, group: OutputGroup | None = None) -> FilterOutcome:
        """Filter the recording, unless its output is complete and has the diagnostics that the table needs."""
        if self.complete:
            with _packed_rows(self.complete) as write:
                has_all = _read_rows(self.complete, _frame_table(self.config, write))
            if has_all:
                return self.complete
            observer.note("filtered again; the output lacks the diagnostics that the table needs")
        return super().run(observer, group)

    def clouds(self, source: Source) -> list[Channel]:
        """Return the channels of the clouds to filter."""
        return cloud_channels(source, self.options.reading.selection.topics)

    def without_result(self, reason: str | None) -> FilterOutcome:
        """Return an outcome without frames."""
        return FilterOutcome(
            recording=self.recording.name,
            output=self.output,
            edges=self.config.ring_edges,
            has_water=self.config.has_water,
            bytes_in=input_bytes(self.recording),
            error=reason,
        )

    def stream(self, source: Source, outcome: FilterOutcome, observer: Observer, group: OutputGroup) -> None:
        """Filter the frames of the recording."""
        selection = replace(self.options.reading.selection, latched=self.options.written.latched)
        clouds = cloud_channels(source, selection.topics)
        warn_of_patterns(source, self.options.written, observer)
        topics = list(dict.fromkeys(channel.topic for channel in clouds))
        labels = self.labels.open() if self.labels else None
        if labels and len(topics) > 1:
            raise UsageError(f"{source.name}: labels apply to one topic; choose one with -t")
        if self.config.method != "none" and was_filtered(source, selection.topics):
            by = filtered_by(source, selection.topics)
            observer.warn(f"{source.name}: already filtered{by}; this run only filters the remaining points")
        named = printable(", ".join(channel.topic for channel in clouds))
        observer.note(f"{source.name}: {source.format}, method {self.config.method} on {named}", detail=True)
        fit = _FitWarnings(self.config, source, topics, observer)
        with (
            self._table(outcome) as tables,
            observer.progress(source.name, expected_frames(source, clouds, selection)) as step,
            OUTPUT_FORMATS[self.form].make_sink(
                self.target, self._written(labels, partial(self.record, source, outcome)), group
            ) as sink,
        ):

            def on_result(result: FilterResult) -> None:
                step()
                fit.add(result)

            run(source, self.config.make_filter, [sink, *tables], selection, on_result, outcome.topics)
            require_frames(source, outcome.frames, selection)
        warn_of_losses(self.output, self.form, sink.lost, observer)
        fit.finish(outcome.topics)

    @contextmanager
    def _table(self, outcome: FilterOutcome) -> Iterator[Sequence[Sink]]:
        """Yield the table, if there is one."""
        if self.write:
            yield [_frame_table(self.config, self.write)]
        elif self.options.csv_file:
            with _packed_rows(outcome) as write:
                yield [_frame_table(self.config, write)]
        else:
            yield []

    def identity(self) -> RunIdentity:
        """Return what the filtered file depends on."""
        options, paths = self.options, self.recording.paths
        kind = {"with_scene": options.with_scene, **({} if self.form == "mcap" else {"to": self.form})}
        return identity_of(paths, self.config, options.reading, options.written, self.labels, **kind)

    def _written(self, labels: Labels | None, record: Callable[[], Metadata]) -> McapOptions:
        written = replace(
            self.options.written,
            config=self.config.to_yaml(),
            water=self.config.has_water,
            record=record,
            method=self.config.method,
            is_part=not self.options.reading.selection.is_whole,
        )
        if not self.options.with_scene:
            return written
        from seaclutter_cli.reporting.sample import scene_updates

        return replace(written, scene=scene_updates(self.config.evaluation, labels))


def _read_rows(complete: FilterOutcome, table: FrameTable) -> bool:
    """Write rows from the diagnostics in a complete output; return whether these are of all frames."""
    found = Counter[str]()
    try:
        with closing(open_recording(Recording((complete.output,)), ReadOptions())) as source:
            for record in source.records():
                if not isinstance(record, Message) or record.channel.topic != TOPIC:
                    continue
                name = record.channel.schema.name if record.channel.schema else ""
                one = read_diagnostics(record.data, record.channel.message_encoding, name)
                place = one.topic, one.numbers["frame"], one.stamp_ns, one.numbers["points_in"]
                table.write_row(complete.recording, place, one.counts, one.rings, one.scene, one.water)
                found[one.topic] += 1
    except InputError:
        return False
    return found == Counter({topic: tally.frames for topic, tally in complete.topics.items()})


_FEW_WATER = 0.05


class _FitWarnings:
    """Warnings about settings that do not fit the frames of a recording."""

    def __init__(self, config: Config, source: Source, topics: Sequence[str], observer: Observer) -> None:
        self._config, self._observer = config, observer
        self._written_anew: set[str] = set()
        self._checks = {topic: Checks(config, source.facts, filtered=was_filtered(source, [topic])) for topic in topics}

    def add(self, result: FilterResult) -> None:
        """Check a frame."""
        for warning in self._checks[result.frame.topic].add(result):
            self._warn(result.frame.topic, warning)
        if result.frame.topic not in self._written_anew and (change := rewrapped(result.frame.cloud)):
            self._written_anew.add(result.frame.topic)
            self._warn(result.frame.topic, change)

    def finish(self, tallies: Mapping[str, TopicTally]) -> None:
        """Check the sums over all frames."""
        for topic, tally in tallies.items():
            for warning in self._checks[topic].finish() or (self._of_sums(tally) if tally.points_in else ()):
                self._warn(topic, warning)

    def _of_sums(self, tally: TopicTally) -> Iterator[str]:
        """Yield a warning if no point was kept, or nearly all frames are without the water that the method needs."""
        most, without = Reason(int(tally.counts.argmax())), tally.frames - tally.water_frames
        if not tally.counts[Reason.KEPT]:
            removed = f"{share(int(tally.counts[most]), tally.points_in)} were removed"
            yield f"no points are left; {removed}: {reason_names(self._config.ring_edges)[most]}"
        elif self._config.has_water and tally.water_frames <= _FEW_WATER * tally.frames:
            frames = f"{without:,} of {count(tally.frames, 'frame')}"
            yield f"no water seen in {frames}; heights are then unknown, and every object that stays is kept"

    def _warn(self, topic: str, text: str) -> None:
        self._observer.warn(f"{topic}: {text}")
