"""Filtering recordings into drop-in MCAP files."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from seaclutter_cli.errors import UsageError
from seaclutter_cli.filters.fit import IntensityFit
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.interfaces import Labels, Sink, Source
from seaclutter_cli.pipeline import TopicTally, cloud_channels, run, was_filtered
from seaclutter_cli.runs.filter_result import FilterOutcome, FilterSummary
from seaclutter_cli.runs.labels import LabelSources
from seaclutter_cli.runs.methods import ConfigOptions
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import check_outputs, inputs_of, plan_outputs
from seaclutter_cli.runs.recordings import (
    Logs,
    ReadOptions,
    expand,
    expected_frames,
    keeping_errors,
    opened,
    require_frames,
)
from seaclutter_cli.runs.sensor_match import mismatches
from seaclutter_cli.sinks import CsvSink, McapOptions, McapSink
from seaclutter_cli.sources import Recording
from seaclutter_cli.text import printable, share


@dataclass(frozen=True, kw_only=True)
class FilterOptions:
    """How recordings are filtered, and what is written.

    Parameters
    ----------
    config : ConfigOptions
        The method and its parameters.
    reading : ReadOptions
        What is read.
    written : McapOptions
        What goes into the filtered files; their configuration is filled in.
    with_scene : bool
        Write boxes around the clusters of what is kept to ``/seaclutter/scene``.
    labels : LabelSources
        Labels whose boxes are drawn too; for ``with_scene`` only.
    csv_file : Path or None
        Table with a line for each frame.
    force : bool
        Replace existing files.
    """

    config: ConfigOptions = field(default_factory=ConfigOptions)
    reading: ReadOptions = field(default_factory=ReadOptions)
    written: McapOptions = field(default_factory=McapOptions)
    with_scene: bool = False
    labels: LabelSources = field(default_factory=LabelSources)
    csv_file: Path | None = None
    force: bool = False


def filter_logs(logs: Logs, output: Path, options: FilterOptions, observer: Observer = SILENT) -> FilterSummary:
    """Filter every recording into an MCAP file.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    output : Path
        File for one recording, folder for several.
    options : FilterOptions
        How, and what is written.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If nothing can be done at all; what goes wrong with one recording is kept in its outcome.
    """
    one = RecordingFilter(options, observer)
    recordings = expand(logs)
    if options.labels.paths and not options.with_scene:
        raise UsageError("--labels: a filter run needs none; they are for the boxes of --with-scene")
    targets = plan_outputs(recordings, output)
    labels = options.labels.open(recordings)
    check_outputs([*targets, options.csv_file], inputs_of(recordings), options.labels.paths, force=options.force)
    with ExitStack() as stack:
        tables = [stack.enter_context(one.table(options.csv_file))] if options.csv_file else []
        chosen = zip(recordings, targets, labels, strict=True)
        return FilterSummary([one.run(recording, target, tables, truth) for recording, target, truth in chosen])


class RecordingFilter:
    """Filters one recording after the other by the same options.

    Parameters
    ----------
    options : FilterOptions
        How, and what is written.
    observer : Observer
        Receives progress and warnings.
    """

    def __init__(self, options: FilterOptions, observer: Observer) -> None:
        self._options, self._config, self._observer = options, options.config.load(), observer

    def table(self, path: Path) -> CsvSink:
        """Return a table of the frames of all recordings."""
        return CsvSink(path, len(self._config.ring_edges[1:]), scenes=self._config.has_scenes)

    def run(
        self, recording: Recording, target: Path, tables: Sequence[Sink] = (), labels: Labels | None = None
    ) -> FilterOutcome:
        """Filter a recording into a file; an error of its own goes into the outcome."""
        outcome = FilterOutcome(recording=recording.name, output=target, edges=self._config.ring_edges)
        with (
            keeping_errors(outcome, self._observer),
            opened(recording, self._options.reading, self._observer, outcome) as source,
        ):
            self._stream(source, outcome, tables, labels)
        return outcome

    def _stream(self, source: Source, outcome: FilterOutcome, tables: Sequence[Sink], labels: Labels | None) -> None:
        selection = self._options.reading.selection
        clouds = cloud_channels(source, selection.topics)
        topics = list(dict.fromkeys(channel.topic for channel in clouds))
        if labels and len(topics) > 1:
            raise UsageError(f"{source.name}: labels are of one topic; choose one with -t")
        if self._config.method != "none" and was_filtered(source, selection.topics):
            self._observer.warn(f"{source.name}: was filtered already; this filters what was left of it")
        named = printable(", ".join(channel.topic for channel in clouds))
        self._observer.note(f"{source.name}: {source.format}, method {self._config.method} on {named}", detail=True)
        fits = {topic: IntensityFit() for topic in topics}
        with (
            self._observer.progress(source.name, expected_frames(source, clouds, selection)) as step,
            McapSink(outcome.output, self._written(labels)) as sink,
        ):
            look = self._onlooker(fits, step)
            outcome.topics = run(source, self._config.make_filter, [sink, *tables], selection, look)
            require_frames(source, outcome.frames)
        for text in mismatches(self._config.sensor, source):
            self._observer.warn(text)
        for topic, fit in fits.items():
            self._warn(topic, fit.verdict() or _nothing_left(outcome.topics[topic]))

    def _onlooker(self, fits: Mapping[str, IntensityFit], step: Callable[[], object]) -> Callable[[FilterResult], None]:
        def look(result: FilterResult) -> None:
            step()
            self._warn(result.frame.topic, fits[result.frame.topic].add(result))

        return look

    def _written(self, labels: Labels | None) -> McapOptions:
        written = replace(self._options.written, config=self._config.to_yaml())
        if not self._options.with_scene:
            return written
        from seaclutter_cli.reporting.scene import scene_maker

        return replace(written, scene=scene_maker(self._config.evaluation, labels))

    def _warn(self, topic: str, text: str | None) -> None:
        if text:
            self._observer.warn(f"{topic}: {text}")


def _nothing_left(tally: TopicTally) -> str | None:
    """Return a warning if not one point of a topic was kept."""
    most = Reason(int(tally.counts.argmax()))
    if not tally.points_in or tally.counts[Reason.KEPT]:
        return None
    what = most.name.lower().replace("_", " ")
    return f"no point is left; {share(int(tally.counts[most]), tally.points_in)} were removed as {what}"
