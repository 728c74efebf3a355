"""Filtering of recordings into drop-in logs."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import chain
from textwrap import indent
from time import perf_counter
from typing import IO, TYPE_CHECKING, Any

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.config import Config
from seaclutter_cli.errors import InputError, TopicError, UsageError
from seaclutter_cli.frame import WATER_REASONS, Reason
from seaclutter_cli.interfaces import Labels, Sink, Source
from seaclutter_cli.messages.diagnostics import TOPIC, read_diagnostics
from seaclutter_cli.pipeline import TopicTally, run
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.reporting.palette import reason_names
from seaclutter_cli.runs.checks import FitChecks, warn_if_filtered
from seaclutter_cli.runs.log_work import LogOutcome, LogRun, LogSummary, LogWork
from seaclutter_cli.runs.methods import configured
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options import ReadOptions
from seaclutter_cli.runs.options.logs import FilterOptions
from seaclutter_cli.runs.outputs import PackedRows, may_appear
from seaclutter_cli.runs.recordings import open_recording
from seaclutter_cli.runs.resume import identity_of
from seaclutter_cli.selection import Selection, cloud_channels, every_topic
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.csv import FrameTable
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.text import count, data_size, printable, share, table

if TYPE_CHECKING:
    from seaclutter_cli.suspects.finder import Suspect, SuspectFinder

_MOST = 0.5


@use_case_of(FilterOptions)
def filter_log(options: FilterOptions) -> "FilterSummary":
    """Filter one or several logs into drop-in logs.

    Returns
    -------
    FilterSummary
        Outcome of each recording: frames, points by reason, range rings, damage, seconds.

    Examples
    --------
    >>> import seaclutter
    >>> done = seaclutter.filter_log("samples/sea.mcap", folder / "filtered.mcap", frames=5)
    >>> outcome = done.outcomes[0]
    >>> outcome.frames, outcome.topics["/points"].points_in
    (5, 10304)
    """
    started, observer = perf_counter(), options.watching
    run = filter_run(options, observer)
    works, csv_file, objects_file = run.begin(), options.csv_file, options.objects_file
    with OutputGroup(replace=options.replaces) as files:
        with ExitStack() as stack:
            # A single log appears together with the table, after it. Of several, each appears when it is complete.
            logs = stack.enter_context(OutputGroup(files))
            table = stack.enter_context(AtomicFile(csv_file, files)) if csv_file else None
            objects = stack.enter_context(AtomicFile(objects_file, files)) if objects_file else None
            if table:
                _frame_table(works[0].config, table.stream).write_header()
            if options.runs_here(len(works)):
                works = [replace(works[0], group=logs)]
            outcomes = run.do(works, partial(_append, table), again=bool(csv_file or objects_file))
            if objects and objects_file:
                from seaclutter_cli.sinks.objects import write_objects

                found = (one.objects for one in outcomes if one.objects and not one.error)
                write_objects(objects_file, objects.stream, chain.from_iterable(found))
        if not may_appear([csv_file, objects_file], outcomes, observer):
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
    if options.objects_file:
        from seaclutter_cli.sinks.objects import check_objects_file  # not needed without

        check_objects_file(options.objects_file)
    return LogRun(options, observer, partial(FilterWork, config=configured(options)), ahead=ahead)


@dataclass(kw_only=True)
class FilterOutcome(LogOutcome):
    """Outcome of filtering one recording.

    ``edges`` are those of the range rings of the method in metres, if it has any; ``has_water`` is whether it estimates
    the water; ``notes`` are lines about each topic, ``rows`` and ``objects`` those of the tables of frames and objects,
    if there are any, and ``suspects`` what was removed from each topic and may have been a target, if searched.
    """

    data = f"{LogOutcome.data} topics=sums"

    edges: Sequence[float]
    has_water: bool = False
    notes: dict[str, str] = field(default_factory=dict)
    rows: PackedRows | None = field(default=None, repr=False)
    objects: PackedRows | None = field(default=None, repr=False)
    suspects: Mapping[str, "Sequence[Suspect]"] = field(default_factory=dict, repr=False)

    def amounts(self) -> str:
        """Return frames and the share of the points that were kept."""
        return f"{count(self.frames, 'frame')}, {share(self.points_out, self.points_in)} of the points kept"

    @property
    def sums(self) -> dict[str, dict[str, Any]]:
        """Sums of each topic as JSON-compatible data."""
        found = {topic: {"suspects": len(suspects)} for topic, suspects in self.suspects.items()}
        return {topic: self._sums(tally) | found.get(topic, {}) for topic, tally in self.topics.items()}

    def as_text(self) -> str:
        """Return the outcome as human-readable text."""
        pace = f" ({self.frames / self.seconds:.0f} frames/s)" if self.frames and not self.skipped else ""
        last = self.figures() if self.skipped else f"{count(self.frames, 'frame')} in {self.seconds:.1f} s{pace}"
        topics = [self._topic_text(topic, tally) for topic, tally in self.topics.items()]
        return "\n".join((printable(f"{self.recording} -> {self.output}"), *topics, last))

    def _sums(self, tally: TopicTally) -> dict[str, Any]:
        """Return the sums of a topic as JSON-compatible data; thresholds of range rings are means over the frames."""
        water, rings = tally.mean_water, tally.rings
        reasons = [reason for reason in Reason if reason and (reason not in WATER_REASONS or self.has_water)]
        points, kept = rings.beyond.tolist() if rings else (0, 0)
        columns: dict[str, Any] = {}
        if rings:
            columns = {name: getattr(rings, name).tolist() for name in ("points", "low_intensity", "outliers")}
            columns = {"start_m": self.edges[:-1], "end_m": self.edges[1:], **columns}
            columns["mean_threshold"] = (rings.thresholds / tally.frames).round(6).tolist()
        undecided = dict(zip(("points_removed", "points_kept"), tally.undecided[:, 1].tolist(), strict=True))
        return {
            "frames": tally.frames,
            "points_in": tally.points_in,
            "points_out": int(tally.counts[Reason.KEPT]),
            **{reason.name.lower(): int(tally.counts[reason]) for reason in reasons},
            **({"water_frames": tally.water_frames, "undecided": undecided} if self.has_water else {}),
            **({"water": {name: round(value, 4) for name, value in asdict(water).items()}} if water else {}),
            "rings": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
            **({"beyond": {"start_m": self.edges[-1], "points": points, "kept": kept}} if rings else {}),
            **({"scenes": dict(sorted(tally.scenes.items()))} if tally.scenes else {}),
            "filter_ms": round(1000 * tally.filter_s / max(tally.frames, 1), 3),
        }

    def _topic_text(self, topic: str, tally: TopicTally) -> str:
        sums, names, size = self._sums(tally), reason_names(self.edges), tally.points_in
        kept = f"{sums['points_out']:,} out ({share(sums['points_out'], size)})"
        blocks = [f"{printable(topic)}: {count(tally.frames, 'frame')}, {count(size, 'point')} in, {kept}"]
        removed = {reason: int(tally.counts[reason]) for reason in Reason if reason and tally.counts[reason]}
        if removed:
            rows = [(names[reason], f"{points:,}", share(points, size)) for reason, points in removed.items()]
            blocks.append(table(("reason", "removed", "share"), rows))
        if (near := removed.get(Reason.NEAR)) and self.edges[0]:
            lower = "; if own ship ends sooner, use filter.start_m: auto" if near > _MOST * size else ""
            blocks.append(f"{share(near, sum(removed.values()))} of the removed points are {names[Reason.NEAR]}{lower}")
        if sums["rings"]:
            others = "other reasons" if self.has_water else "outliers"
            blocks.append(_ring_table(sums["rings"], sums["beyond"], others))
        if self.has_water:
            blocks += _water_texts(tally)
        blocks += filter(None, [self.notes.get(topic)])
        if tally.scenes:
            scenes = (f"{printable(name)} {number:,}" for name, number in tally.scenes.items())
            blocks.append(f"frames by scene: {', '.join(scenes)}")
        if topic in self.suspects:
            blocks.append("nothing removed that looks like a target")
            if found := self.suspects[topic]:
                place = f"{count(found[0].points, 'point')} at {found[0].range_m:.0f} m in frame {found[0].frame}"
                number = f"removed, and may have been targets: {count(len(found), 'suspect')}"
                blocks[-1] = f"{number}; first {place} (see: seaclutter suspects)"
        return indent("\n".join(blocks), "  ")


def _ring_table(rings: Sequence[Mapping[str, float]], beyond: Mapping[str, float], others: str) -> str:
    rows = []
    for ring in rings:
        points, low, outliers = (ring[name] for name in ("points", "low_intensity", "outliers"))
        span, kept = f"{ring['start_m']:g} to {ring['end_m']:g} m", share(points - low - outliers, points)
        rows.append((span, f"{points:,}", f"{low:,}", f"{outliers:,}", kept, f"{ring['mean_threshold']:.2f}"))
    start, points = f"{beyond['start_m']:g} m on", beyond["points"]
    removed = f"{points - beyond['kept']:,}" if points > beyond["kept"] else "-"
    rows.append((start, f"{points:,}", "-", removed, share(beyond["kept"], points), "-"))
    return table(("range ring", "points", "low intensity", others, "kept", "mean threshold"), rows)


def _water_texts(tally: TopicTally) -> list[str]:
    water, without = tally.mean_water, tally.frames - tally.water_frames
    lines = ["no water seen"]
    if water is not None:
        height = f"significant wave height {water.significant_wave_height_m:.2f} m"
        missing = f"; none in {count(without, 'frame')}" if without else ""
        lines = [
            f"water {-water.level_m:.2f} ± {water.level_deviation_m:.2f} m below the lidar, {height} (means){missing}"
        ]
    (removed, removed_points), (kept, kept_points) = tally.undecided.tolist()
    if removed + kept:
        parts = f"removed {count(removed, 'time')} ({count(removed_points, 'point')}), kept {count(kept, 'time')}"
        lines.append(f"objects that evidence does not decide: {parts} ({kept_points:,})")
    return lines


class FilterSummary(LogSummary[FilterOutcome]):
    """Outcomes of filtering several recordings."""

    def totals(self) -> str:
        """Return how the recordings ended, sizes, and pace."""
        read = sum(one.bytes_in for one in self.outcomes)
        return super().totals() + (f"; {data_size(read / self.seconds * 60)}/min" if self.seconds else "")


def _append(table: AtomicFile | None, outcome: FilterOutcome) -> None:
    """Append the rows of a recording to the table, unless they are there already."""
    if table and outcome.rows and not outcome.error:
        table.stream.writelines(outcome.rows)
    outcome.rows = None


def _frame_table(config: Config, rows: "PackedRows | IO[bytes]") -> FrameTable:
    return FrameTable(
        rows.write, len(config.ring_edges[1:]), scenes=config.kind.has_scenes, water=config.kind.has_water
    )


@dataclass(frozen=True)
class FilterWork(LogWork[FilterOutcome, FilterOptions]):
    """Filtering of one recording with a configuration; of a ``complete`` output, only rows of the table are read."""

    config: Config

    def run(self, observer: Observer) -> FilterOutcome:
        """Filter the recording, unless its output is complete and has the diagnostics that the table needs."""
        if self.complete:
            self.complete.rows = PackedRows()
            if self.options.objects_file:
                observer.note("filtered again, for the table of objects")
            elif _read_rows(self.complete, _frame_table(self.config, self.complete.rows)):
                return self.complete
            else:
                observer.note("filtered again; the output lacks the diagnostics that the table needs")
        return super().run(observer)

    def clouds(self, source: Source) -> list[Channel]:
        """Return the channels of the clouds to filter."""
        return cloud_channels(source, self._chosen(source, self.options.reading.selection).topics)

    def _chosen(self, source: Source, selection: Selection) -> Selection:
        """Return a selection; of one of several recordings, by default all topics, if the output has room for them."""
        every = self.is_one_of_several and OUTPUT_FORMATS[self.form].has_topics
        return every_topic(source, selection) if every else selection

    def without_result(self, reason: str | None) -> FilterOutcome:
        """Return an outcome without frames."""
        return FilterOutcome(
            recording=self.recording.name,
            output=self.output,
            edges=self.config.ring_edges,
            has_water=self.config.kind.has_water,
            bytes_in=self.input_bytes,
            error=reason,
        )

    def stream(
        self, source: Source, selection: Selection, outcome: FilterOutcome, sink: Sink, observer: Observer
    ) -> int:
        """Filter the frames of the recording."""
        clouds, selection = self.clouds(source), self._chosen(source, selection)
        topics = list(dict.fromkeys(channel.topic for channel in clouds))
        if self.labels and len(topics) > 1:
            raise TopicError(f"{source.name}: labels apply to one topic; choose one with -t")
        warn_if_filtered(source, selection.topics, self.config, observer)
        named = printable(", ".join(channel.topic for channel in clouds))
        observer.note(f"{source.name}: {source.format}, method {self.config.method} on {named}", detail=True)
        checks = {topic: FitChecks(self.config, source, topic, observer) for topic in topics}
        outcome.rows = PackedRows() if self.options.csv_file else None
        tables: list[Sink] = [_frame_table(self.config, outcome.rows)] if outcome.rows else []
        if self.options.objects_file:
            from seaclutter_cli.runs.objects import follower_of
            from seaclutter_cli.sinks.objects import ObjectTable

            outcome.objects = PackedRows()
            tables.append(ObjectTable(outcome.objects.write, follower_of(self.config)))
        finders: dict[str, SuspectFinder] = {}
        if self.options.suspects:
            from seaclutter_cli.runs.suspects import finder_for  # not needed without

            finders = {topic: finder_for(self.config) for topic in topics}
        every = run(source, self.config.make_filter, [sink, *tables], selection, outcome.topics)
        for result in self.stepped(every, source, observer, clouds):
            topic = result.frame.topic
            checks[topic].see(result)
            if finders:
                finders[topic].add(result.frame, [result])
        for topic in outcome.topics:
            if note := checks[topic].end():
                outcome.notes[topic] = note
        outcome.suspects = {topic: finder.finish()["removed"] for topic, finder in finders.items()}
        return outcome.frames

    def identity(self) -> Mapping[str, str]:
        """Return what the filtered file depends on."""
        kind = {} if self.form == "mcap" else {"to": self.form}
        return identity_of(self, self.options.written, self.config, with_scene=self.options.with_scene, **kind)

    def sink_options(self, options: McapOptions, labels: Labels | None) -> McapOptions:
        """Return the options of the output with those that depend on the configuration."""
        config = self.config
        options = replace(options, config=config.to_yaml(), water=config.kind.has_water, method=config.method)
        if not self.options.with_scene:
            return options
        from seaclutter_cli.reporting.sample import scene_updates
        from seaclutter_cli.runs.objects import follower_of
        from seaclutter_cli.sinks.objects import LiveObjects

        live = LiveObjects(follower_of(config))
        return replace(options, objects=live, scene=scene_updates(config.evaluation, labels, live.tracks))


def _read_rows(complete: FilterOutcome, table: FrameTable) -> bool:
    """Write rows from the diagnostics in a complete output; return whether these are of all frames."""
    found = Counter[str]()
    try:
        with closing(open_recording(Recording((complete.output,)), ReadOptions())) as source:
            for record in source.records():
                if not isinstance(record, Message) or record.channel.topic != TOPIC:
                    continue
                one = read_diagnostics(record)
                table.write_row(complete.recording, one)
                found[one.topic] += 1
    except InputError:
        return False
    return found == Counter({topic: tally.frames for topic, tally in complete.topics.items()})
