"""Filtering of recordings into drop-in MCAP files."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

from seaclutter_cli.errors import UsageError
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.interfaces import Labels, Sink, Source
from seaclutter_cli.pipeline import TopicTally, run
from seaclutter_cli.runs.checks import Check, checks_of
from seaclutter_cli.runs.filter_result import FilterOutcome, FilterSummary
from seaclutter_cli.runs.labels import LabelSources
from seaclutter_cli.runs.methods import ConfigOptions
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import inputs_of, may_appear, plan_outputs, prepare_outputs
from seaclutter_cli.runs.recordings import (
    Logs,
    PathLike,
    ReadOptions,
    expand,
    expected_frames,
    opened,
    require_frames,
    storing_errors,
)
from seaclutter_cli.runs.sensor_match import mismatches
from seaclutter_cli.selection import cloud_channels, was_filtered
from seaclutter_cli.sinks import CsvSink, McapOptions, McapSink
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sources import Recording
from seaclutter_cli.storage.locations import Location
from seaclutter_cli.storage.scratch import copies_removed
from seaclutter_cli.text import count, printable, share

_FEW_WATER = 0.05


@dataclass(frozen=True, kw_only=True)
class FilterOptions:
    """Options of a filter run: method, input and output files.

    Parameters
    ----------
    config : ConfigOptions
        Method and parameters.
    reading : ReadOptions
        Part of each recording to read, and how.
    written : McapOptions
        Content of the filtered files; the run fills in its ``config``.
    with_scene : bool
        Write boxes around the clusters of kept points to ``/seaclutter/scene``.
    labels : LabelSources
        Labels whose boxes are also written; only with ``with_scene``.
    csv_file : Path, Url or None
        File for a table with a row for each frame.
    force : bool
        Replace existing files.
    """

    config: ConfigOptions = field(default_factory=ConfigOptions)
    reading: ReadOptions = field(default_factory=ReadOptions)
    written: McapOptions = field(default_factory=McapOptions)
    with_scene: bool = False
    labels: LabelSources = field(default_factory=LabelSources)
    csv_file: Location | None = None
    force: bool = False


@copies_removed()
def filter_logs(logs: Logs, output: PathLike, options: FilterOptions, observer: Observer = SILENT) -> FilterSummary:
    """Filter every recording into an MCAP file.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    output : path
        File for one recording, folder for several or if it is a `str` that ends in a slash.
    options : FilterOptions
        Method, input and output files.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If the run cannot start or continue; an error in a single recording is stored in its outcome.
    """
    one = RecordingFilter(options, observer)
    recordings = expand(logs)
    if options.labels.paths and not options.with_scene:
        raise UsageError("--labels: only used for the boxes of --with-scene; add that option or leave out --labels")
    targets = plan_outputs(recordings, output)
    inputs = inputs_of(recordings, options.reading, options.config.file, [one.config])
    outputs = {"-o": targets, "--csv": options.csv_file}
    prepare_outputs(outputs, inputs, options.labels.paths, force=options.force, observer=observer)
    labels = options.labels.open(recordings)
    with OutputGroup() as files:
        with ExitStack() as stack:
            # A single log appears together with the table. Of several, each appears when it is complete.
            logs_written = stack.enter_context(OutputGroup(files)) if len(targets) == 1 else None
            tables = [stack.enter_context(one.table(options.csv_file, files))] if options.csv_file else []
            chosen = zip(recordings, targets, labels, strict=True)
            outcomes = [one.run(*each, tables, logs_written) for each in chosen]
        if not may_appear([options.csv_file], outcomes, observer):
            files.discard()
    return FilterSummary(outcomes)


class RecordingFilter:
    """Filter run over one recording after another, with the same options.

    Parameters
    ----------
    options : FilterOptions
        Method, input and output files.
    observer : Observer
        Receives progress and warnings.
    """

    def __init__(self, options: FilterOptions, observer: Observer) -> None:
        self._options, self.config, self._observer = options, options.config.load(), observer

    def table(self, path: Location, group: OutputGroup | None = None) -> CsvSink:
        """Return a table for the frames of all recordings."""
        config = self.config
        rings = len(config.ring_edges[1:])
        return CsvSink(path, rings, scenes=config.has_scenes, water=config.has_water, group=group)

    def run(
        self,
        recording: Recording,
        target: Location,
        labels: Labels | None = None,
        tables: Sequence[Sink] = (),
        group: OutputGroup | None = None,
    ) -> FilterOutcome:
        """Filter a recording into a file, which appears with a group or by itself; store an error in the outcome."""
        config = self.config
        outcome = FilterOutcome(
            recording=recording.name, output=target, edges=config.ring_edges, has_water=config.has_water
        )
        with (
            storing_errors(outcome, self._observer),
            opened(recording, self._options.reading, self._observer, outcome) as source,
        ):
            self._stream(source, outcome, tables, labels, group)
        return outcome

    def _stream(
        self,
        source: Source,
        outcome: FilterOutcome,
        tables: Sequence[Sink],
        labels: Labels | None,
        group: OutputGroup | None,
    ) -> None:
        selection = self._options.reading.selection
        clouds = cloud_channels(source, selection.topics)
        topics = list(dict.fromkeys(channel.topic for channel in clouds))
        if labels and len(topics) > 1:
            raise UsageError(f"{source.name}: labels apply to one topic; choose one with -t")
        if self.config.method != "none" and was_filtered(source, selection.topics):
            self._observer.warn(f"{source.name}: already filtered; this run only filters the remaining points")
        named = printable(", ".join(channel.topic for channel in clouds))
        self._observer.note(f"{source.name}: {source.format}, method {self.config.method} on {named}", detail=True)
        checks = {topic: checks_of(self.config) for topic in topics}
        with (
            self._observer.progress(source.name, expected_frames(source, clouds, selection)) as step,
            McapSink(outcome.output, self._written(labels), group) as sink,
        ):
            on_result = self._result_callback(checks, step)
            outcome.topics = run(source, self.config.make_filter, [sink, *tables], selection, on_result)
            require_frames(source, outcome.frames)
        for text in mismatches(self.config.sensor, source):
            self._observer.warn(text)
        for topic, tally in outcome.topics.items():
            unfit = [check.warning() for check in checks[topic]]
            for warning in unfit if any(unfit) else [_nothing_left(tally) or self._no_water(tally)]:
                self._warn(topic, warning)

    def _result_callback(
        self, checks: Mapping[str, Sequence[Check]], step: Callable[[], object]
    ) -> Callable[[FilterResult], None]:
        def on_result(result: FilterResult) -> None:
            step()
            for check in checks[result.frame.topic]:
                self._warn(result.frame.topic, check.add(result))

        return on_result

    def _written(self, labels: Labels | None) -> McapOptions:
        written = replace(self._options.written, config=self.config.to_yaml(), water=self.config.has_water)
        if not self._options.with_scene:
            return written
        from seaclutter_cli.reporting.scene import scene_maker

        return replace(written, scene=scene_maker(self.config.evaluation, labels))

    def _no_water(self, tally: TopicTally) -> str | None:
        """Return a warning if nearly all frames of a topic are without the water that the method needs."""
        if not (self.config.has_water and tally.points_in) or tally.water_frames > _FEW_WATER * tally.frames:
            return None
        without = f"{tally.frames - tally.water_frames:,} of {count(tally.frames, 'frame')}"
        return f"no water seen in {without}; heights are then unknown, and every object that stays is kept"

    def _warn(self, topic: str, text: str | None) -> None:
        if text:
            self._observer.warn(f"{topic}: {text}")


def _nothing_left(tally: TopicTally) -> str | None:
    """Return a warning if no point of a topic was kept."""
    most = Reason(int(tally.counts.argmax()))
    if not tally.points_in or tally.counts[Reason.KEPT]:
        return None
    reason = most.name.lower().replace("_", " ")
    return f"no points are left; {share(int(tally.counts[most]), tally.points_in)} were removed as {reason}"
