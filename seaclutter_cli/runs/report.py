"""What shows the effect of a filter: a page that opens offline, figures for print, and the Rerun viewer."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from seaclutter_cli import __version__
from seaclutter_cli.buckets import shown, use_case_of
from seaclutter_cli.config import parse_config
from seaclutter_cli.errors import ConfigError, InputError, UsageError
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import Filtered
from seaclutter_cli.plots.report import FIGURES, draw_figures
from seaclutter_cli.reporting.collector import Collector, FrameListener, Method, ScoredFrame
from seaclutter_cli.reporting.page import render_page, report_data
from seaclutter_cli.reporting.replay import filtered_topics, replay
from seaclutter_cli.runs.batch import prepared
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.runs.evaluate import Comparison, Evaluated, EvaluateWork
from seaclutter_cli.runs.methods import Variant, bases, is_default, note_left_out, with_ideal
from seaclutter_cli.runs.objects import follower_of
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options import MethodOptions, ReadOptions
from seaclutter_cli.runs.options.logs import ReportOptions, ViewOptions
from seaclutter_cli.runs.outputs import may_appear, write_files
from seaclutter_cli.runs.recordings import LabelFile, open_recording, require_frames
from seaclutter_cli.runs.suspects import finder_for
from seaclutter_cli.selection import filtered_by
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sources.recordings import Recording
from seaclutter_cli.text import UNKNOWN, count, printable
from seaclutter_cli.viewing import FrameStream, check_target, require_rerun, viewer

_NANO = 1_000_000_000
_FIRST_YEAR = 1990
_MAX_LISTED = 200
_MAX_SUSPECTS = 5


@use_case_of(ReportOptions)
def report(options: ReportOptions) -> "ReportResult":
    """Write a page that shows the effect of a filter on logs and, with labels, its quality.

    Examples
    --------
    >>> import seaclutter
    >>> done = seaclutter.report("samples/sea.mcap", folder / "report.html", frames=20)
    >>> done.frames, len(done.sizes)
    (20, 1)
    """
    observer, folder = options.watching, options.figure_folder
    note_left_out(options, observer)
    figures = [folder / f"{name}.{options.figure_format}" for name in FIGURES] if folder else []
    pairs = prepared(options, observer, others={"--figures": figures})
    make = partial(_Studied, options=options)
    comparison, studied = filter_or_replay(pairs, options, options.reading, observer, make)
    collected, suspects = studied.collector, studied.finish()
    found = {one.item.frame for one in collected.chosen if one.why == "picked"}
    if missing := sorted(set(options.picks) - found):
        observer.warn(f"no log has frame {', '.join(map(str, missing))}; --pick counts from 0")
    files: dict[Path, bytes] = {}
    if may_appear([options.output, *figures], comparison.outcomes, observer):
        origin = _provenance([recording for recording, _ in pairs], comparison.outcomes, options)
        files[options.output] = _page(comparison, collected, suspects, origin)
        if folder:
            drawn = draw_figures(collected, options.figure_format)
            files |= {folder / name: content for name, content in drawn.items()}
    write_files(files, replace=options.force)
    sizes = {path: len(content) for path, content in files.items()}
    return ReportResult(comparison.outcomes, comparison.variants, collected, sizes)


class _Studied(FrameListener):
    """Listener with all that a report shows: a collector, and the suspects of the first method in each recording."""

    def __init__(self, variants: Sequence[Variant], options: ReportOptions) -> None:
        methods = [Method(one.name, one.config.ring_edges, one.config.to_yaml()) for one in variants]
        self._config, labelled = variants[0].config, bool(options.labels)
        params, frames, picks = self._config.evaluation, options.shown, options.picks
        self.collector = Collector(
            methods, params, follower_of(self._config), labelled=labelled, frames=frames, picks=picks
        )
        self._recording, self._finder = "", finder_for(self._config)
        self._found: list[dict[str, Any]] = []

    def begin(self, recording: str) -> None:
        self.finish()
        self._recording, self._finder = recording, finder_for(self._config)
        self.collector.begin(recording)

    def add(self, scored: ScoredFrame) -> None:
        self.collector.add(scored)
        self._finder.add(scored.frame, scored.results[:1])

    def finish(self) -> list[dict[str, Any]]:
        """Return the first suspects of each kind in each recording so far, as data of the page."""
        for found in self._finder.finish().values():
            first = found[:_MAX_SUSPECTS]
            self._found += [{"recording": self._recording, **vars(one), "of": len(found)} for one in first]
        return self._found[:_MAX_LISTED]


def _page(
    comparison: Comparison, collected: Collector, suspects: Sequence[Mapping[str, Any]], origin: Mapping[str, Any]
) -> bytes:
    """Return the page, without processing times: the same input must give the same bytes."""
    summaries = {name: one.as_dict(timed=False) for name, one in comparison.totals().items()}
    recordings = [
        {
            "recording": one.recording,
            "methods": [{"name": name, "summary": found.as_dict(timed=False)} for name, found in one.known.items()],
        }
        for one in comparison.outcomes[:_MAX_LISTED]
        if one.known and collected.labelled
    ]
    outcomes = comparison.outcomes
    notes = [f"{outcome.recording} is left out: {outcome.error}" for outcome in outcomes if outcome.error]
    notes += [f"Damaged: {item}" for outcome in outcomes for item in outcome.damage[:20]]
    more = {"by_recording": recordings, "suspects": suspects, "provenance": origin}
    return render_page({**report_data(collected, summaries, notes), **more})


@dataclass(frozen=True)
class ReportResult(Comparison):
    """Content of a report besides the scores: statistics of all frames, points of those shown; its files' sizes."""

    is_summary = True
    data = f"files frames shown {Comparison.data}"

    collected: Collector
    sizes: Mapping[Path, int]

    @property
    def frames(self) -> int:
        """Number of frames of all recordings."""
        return len(self.collected.timeline)

    def shown(self) -> list[dict[str, Any]]:
        """Return the frames whose points are shown, and why."""
        timeline, names, chosen = self.collected.timeline, self.collected.recordings, self.collected.chosen
        places = [(names[timeline[one.row][0]], one) for one in chosen]
        return [{"recording": name, "frame": one.item.frame, "why": one.why} for name, one in places]

    def files(self) -> list[dict[str, Any]]:
        """Return the written files."""
        return [{"path": path, "bytes": size} for path, size in self.sizes.items()]

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        lines = []
        for path, size in self.sizes.items():
            amount = f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{max(round(size / 1e3), 1)} kB"
            lines.append(f"{printable(str(path))}: {amount}")
        lines.append(f"{count(self.frames, 'frame')}, {len(self.collected.chosen)} of them shown with points")
        return "\n".join(lines)


@use_case_of(ViewOptions)
def view_logs(options: ViewOptions) -> "ViewResult":
    """Show recordings in the Rerun viewer, or write a file for it; by default, filtered logs are read back.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.view_logs("samples/sea.mcap", target=folder / "trial.rrd").target.name  # doctest: +SKIP
    'trial.rrd'
    """
    observer = options.watching
    require_rerun()
    if options.target:
        check_target(options.target)
    pairs = prepared(options, observer)
    methods = MethodOptions(config=options.config, methods=options.method or (), settings=options.settings)
    with OutputGroup(replace=options.force) as files, ExitStack() as stack:

        def open_stream(variants: Sequence[Variant]) -> FrameStream:
            if options.target:
                part = stack.enter_context(AtomicFile(options.target, files)).part
                return FrameStream(variants[0].config.evaluation, lambda recording: recording.save(part))
            return FrameStream(variants[0].config.evaluation, stack.enter_context(viewer(options.port)))

        comparison, stream = filter_or_replay(pairs, methods, options.reading, observer, open_stream)
        stream.finish()
        if all(outcome.error for outcome in comparison.outcomes):
            raise InputError("nothing to show: no recording could be read")
        stack.close()
        if not may_appear([options.target], comparison.outcomes, observer):
            files.discard()
    return ViewResult(comparison.outcomes, comparison.variants, options.target)


@dataclass(frozen=True)
class ViewResult(Comparison):
    """Scores of recordings that were shown, and the file that was written, if it is not the viewer that showed them."""

    is_summary = True
    data = f"output=target {Comparison.data}"

    target: Path | None

    def as_text(self) -> str:
        """Return the file and its size as text; empty for the viewer."""
        return printable(f"{self.target}: {self.target.stat().st_size / 1e6:.1f} MB") if self.target else ""


def _recorded(times_ns: Sequence[int]) -> str:
    try:
        first, last = (datetime.fromtimestamp(time_ns // _NANO, UTC) for time_ns in times_ns)
    except (OverflowError, ValueError, OSError):  # there are none, or no such dates
        return UNKNOWN
    if first.year < _FIRST_YEAR:
        return UNKNOWN
    return f"{first:%Y-%m-%d %H:%M:%S} to {f'{last:%Y-%m-%d %H:%M:%S}'.removeprefix(f'{first:%Y-%m-%d} ')} UTC"


def _provenance(
    recordings: Sequence[Recording], outcomes: Sequence[Evaluated], options: ReportOptions
) -> dict[str, Any]:
    """Return where a report comes from, as data of its page; the same for the same input and command line."""
    rows = []
    for recording, outcome in zip(recordings, outcomes, strict=True):
        first, *others = map(str, recording.paths)
        path = f"{first} and {count(len(others), 'more file')}" if others else first
        sensors = [sensor.described for sensor in outcome.recognised.values()]
        rows.append({"path": path, "recorded": _recorded(outcome.times_ns), "sensor": (sensors or [UNKNOWN])[-1]})
    return shown(
        {
            "version": __version__,
            "command": options.command,
            "labels": [str(path) for path in options.labels][:_MAX_LISTED],
            "recordings": rows[:_MAX_LISTED],
            "left_out": max(len(rows) - _MAX_LISTED, 0),
        }
    )


L = TypeVar("L", bound=FrameListener)


def filter_or_replay(
    pairs: Sequence[tuple[Recording, LabelFile | None]],
    methods: MethodOptions,
    reading: ReadOptions,
    observer: Observer,
    make_listener: Callable[[Sequence[Variant]], L],
) -> tuple[Comparison, L]:
    """Filter recordings, or read filtered ones back if no method is chosen, and pass every frame to a listener.

    Raise `UsageError` if filtered logs differ in their configuration, or a topic has to be chosen; `InputError` if the
    recorded configuration is not valid, or a filtered log lacks the removed points.
    """
    recordings = [recording for recording, _ in pairs]
    variant, topics = _recorded_run(recordings, reading) if is_default(methods) else (None, ())
    variants = [variant] if variant else [one.variant() for one in bases(methods, configured_first=True)]
    variants = with_ideal(variants) if any(labels for _, labels in pairs) and not variant else variants
    listener = make_listener(variants)
    works = [EvaluateWork(reading, *pair, variants, [listener]) for pair in pairs]
    if variant:
        replayed = zip(pairs, topics, strict=True)
        works = [_ReplayWork(reading, *pair, variants, [listener], topic=topic) for pair, topic in replayed]
    return Comparison([work.run(observer) for work in works], variants), listener


def _recorded_run(recordings: Sequence[Recording], reading: ReadOptions) -> tuple[Variant | None, Sequence[str]]:
    """Return the method of filtered logs, and the raw topic of each; None for raw logs."""
    runs = [_recorded_in(recording, reading) for recording in recordings]
    if not (known := [run for run in runs if run]):
        return None, ()
    for recording, run in zip(recordings, runs, strict=True):
        if run is None or run[1] != known[0][1]:
            text = "not filtered in the same way as the other logs; process each one alone"
            raise UsageError(f"{recording.name}: {text}")
    try:
        config = parse_config(known[0][1], f"{recordings[0].name}, recorded configuration")
    except ConfigError as error:
        raise InputError(str(error)) from error
    return Variant(config.method, config), [topic for topic, _ in known]


def _recorded_in(recording: Recording, reading: ReadOptions) -> tuple[str, str] | None:
    """Return the raw topic and the configuration of a filtered log; None for a raw log."""
    with closing(open_recording(recording, reading)) as source:
        topics = [topic for topic in filtered_topics(source) if not reading.topics or topic in reading.topics]
        if not topics:
            if filtered_by(source, reading.topics) is not None:
                raise InputError(
                    f"{source.name}: already filtered, and the log lacks the removed points; use the raw log or one "
                    "filtered with --keep-raw --with-removed, or show the remaining points with -m none"
                )
            return None
        if len(topics) > 1:
            raise UsageError(f"{source.name}: several filtered topics; choose from: -t {' -t '.join(topics)}")
        run = next((one.entries for one in source.metadata if one.name == "seaclutter"), {})
        return topics[0], run.get("config") or ""


@dataclass(frozen=True)
class _ReplayWork(EvaluateWork):
    """Reading of a filtered log for a listener, and comparison with its labels if there are any."""

    topic: str = ""

    def filtered(
        self, source: Source, _: Evaluated, observer: Observer
    ) -> tuple[Iterable[Filtered], Mapping[str, Checks]]:
        clouds = [channel for channel in source.channels if channel.topic == self.topic]
        results = self.stepped(replay(source, self.topic, self.reading.selection), source, observer, clouds)
        return ((one.frame, [one], [None]) for one in results), {}

    def end(self, source: Source, labels: Labels | None, outcome: Evaluated, _: Observer) -> None:
        if not outcome.frames:
            require_frames(source, 0, self.reading.selection)
            missing = f"no frame of {self.topic} has removed points and diagnostics"
            raise InputError(f"{source.name}: nothing to show; {source.damage[0] if source.damage else missing}")
        self.finish(source, labels, outcome.frames)
