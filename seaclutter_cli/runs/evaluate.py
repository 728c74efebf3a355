"""Evaluation of several methods against labels, in one pass over the recordings, and tables of their scores."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import chain
from operator import attrgetter, methodcaller
from tempfile import TemporaryFile
from typing import IO, Literal, TypeVar

from seaclutter_cli.buckets import on_paths, shown
from seaclutter_cli.config import Config
from seaclutter_cli.errors import LabelError
from seaclutter_cli.evaluation.label_check import LabelCheck
from seaclutter_cli.evaluation.scores import ALARM_COLUMNS, POINT_COLUMNS, FrameScore, Parts, Summary, score_frame
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import Filter, Labels, Source
from seaclutter_cli.options import function_of
from seaclutter_cli.pipeline import run_each
from seaclutter_cli.reporting.collector import FrameListener, ScoredFrame
from seaclutter_cli.runs.batch import RecordingWork, prepared, run_all
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.runs.methods import Variant, note_left_out, variants
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import EvaluateOptions
from seaclutter_cli.runs.outputs import PackedRows, may_appear, write_manifest
from seaclutter_cli.runs.recordings import RecordingsResult
from seaclutter_cli.runs.topic_statistics import Described
from seaclutter_cli.selection import cloud_channels, filtered_by, recorded_of
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.text import UNKNOWN, count, legend, printable, table


@function_of(EvaluateOptions)
@on_paths
def evaluate(options: EvaluateOptions) -> "Comparison":
    """Count false alarms and missed targets of one or several methods against labels, in one pass over the logs.

    Returns
    -------
    Comparison
        ``totals()``, a `Summary` for each method; ``as_text()``, the tables of the command line.

    Examples
    --------
    >>> import seaclutter
    >>> result = seaclutter.evaluate("samples/sea.mcap", "samples/sea.labels.csv", methods=["joint", "none"])
    >>> {name: (summary.n_fp, summary.n_fn) for name, summary in result.totals().items()}
    {'joint': (14, 8), 'none': (60, 0)}
    """
    observer = options.watching
    note_left_out(options, observer)
    chosen = variants(options, *([f"evaluation.clustering={options.clustering}"] if options.clustering else []))
    targets = {"-o": options.frames_file, "--summary": options.summary_file}
    outputs, configs = {**targets, "--manifest": options.batch.manifest}, [one.config for one in chosen]
    pairs = prepared(options.logs, options, outputs, observer, configs)
    works = [EvaluateWork(options.reading, *each, chosen, tabulated=bool(options.frames_file)) for each in pairs]
    with OutputGroup(replace=options.force) as files:
        with ExitStack() as stack:
            table, summary = (stack.enter_context(AtomicFile(it, files)) if it else None for it in targets.values())
            if table and options.batch.runs_here(len(works)):
                works = [replace(works[0], spool=stack.enter_context(TemporaryFile(dir=table.part.parent)))]
            outcomes = run_all(works, options.batch, observer)
            comparison = Comparison(chosen, outcomes)
            if table:
                table.stream.writelines(frame_table([one.rows for one in outcomes if one.rows and not one.error]))
            if summary:
                summary.stream.write(json.dumps(shown(comparison.as_dict()), indent=2).encode() + b"\n")
        if not may_appear(targets.values(), outcomes, observer):
            files.discard()
    write_manifest(options.batch.manifest, [recording for recording, _ in pairs], outcomes, replace=options.force)
    return comparison


K = TypeVar("K")
BASELINE = "none"
"""Method that is never marked as the best: it loses no target and takes no time, because it does not filter."""

_MARK = "*"
_UNKNOWN_POINTS = b"," * len(POINT_COLUMNS) + b"\n"


@dataclass(frozen=True)
class Column:
    """Column of a table of scores: its score is None if there is nothing to count, and ``best`` if none is good."""

    head: str
    meaning: str
    score: Callable[[Summary], float | None]
    digits: int = 0
    unit: str = ""
    best: Literal["low", "high"] | None = "low"

    def value(self, summary: Summary) -> float | None:
        """Return the value of a method, in percent if the column says so."""
        found = self.score(summary)
        return 100 * found if found is not None and "%" in self.head + self.unit else found

    def cell(self, summary: Summary) -> str:
        """Return the value of a method as text."""
        value = self.value(summary)
        return UNKNOWN if value is None else f"{value:.{self.digits}f}{self.unit}"

    def figure(self, summary: Summary) -> str:
        """Return head and value for running text, such as ``R_FP 6.63 %``."""
        head = self.head.removesuffix(" %")
        unit = self.head[len(head) :] if self.value(summary) is not None else ""
        return f"{head} {self.cell(summary)}{unit}"

    def best_in(self, summaries: Mapping[K, Summary]) -> set[K]:
        """Return the names of the best methods, as far as the digits show; empty if all methods are alike."""
        filters = {name: summary for name, summary in summaries.items() if name != BASELINE}
        known = {name: value for name, one in filters.items() if (value := self.value(one)) is not None}
        if self.best is None or len({self.cell(summaries[name]) for name in known}) < 2:
            return set()
        best = self.cell(summaries[(min if self.best == "low" else max)(known, key=lambda name: known[name])])
        return {name for name in known if self.cell(summaries[name]) == best}


def _of_points(name: str) -> Callable[[Summary], float | None]:
    return lambda summary: None if summary.points is None else getattr(summary.points, name)


_F1 = "harmonic mean of precision (detected targets among all alarms) and recall (detected among visible targets)"
FRAMES = Column("frames", "labelled frames", attrgetter("frames"), best=None)
N_FP = Column("N_FP", "frames with a false alarm, a cluster where there is no target", attrgetter("n_fp"))
N_FN = Column("N_FN", "frames with a missed target, one that is visible but not detected", attrgetter("n_fn"))
R_FP = Column("R_FP %", "N_FP in percent of the labelled frames", attrgetter("r_fp"), 2)
R_FN = Column("R_FN %", "N_FN in percent of the labelled frames", attrgetter("r_fn"), 2)
F1 = Column("F1", _F1, attrgetter("f1"), 3, best="high")
FALSE_ALARMS = Column("false/frame", "false alarms per labelled frame", attrgetter("false_alarms_per_frame"), 2)
P50 = Column("ms p50", "median time to filter a frame, in milliseconds", methodcaller("milliseconds", 0.5), 2)

FRAME_ERRORS = (N_FP, N_FN, R_FP, R_FN, F1)
ALARMS = (FRAMES, *FRAME_ERRORS, FALSE_ALARMS)
POINTS = (
    Column("clutter removed", "share of the clutter points removed", _of_points("clutter_removal"), 2, " %", "high"),
    Column("target lost", "share of the points of targets removed", _of_points("target_loss"), 2, " %"),
    Column("R_c", "share of clutter among the points that are left", _of_points("clutter_share"), 2, " %"),
)
TIMES = (P50, Column("ms p99", "99th percentile of that time", methodcaller("milliseconds", 0.99), 2))
OBJECTS = (
    Column("precision %", "detected targets among all alarms", attrgetter("precision"), 1, best="high"),
    Column("recall %", "detected among visible targets", attrgetter("recall"), 1, best="high"),
    F1,
    Column("noise", "false alarms per labelled frame", attrgetter("false_alarms_per_frame"), 2),
    Column("unclustered", "points per labelled frame in no cluster", attrgetter("unclustered_per_frame"), 1),
    P50,
)
"""Measures of [Bi] for clusters by density."""


def score_table(summaries: Mapping[str, Summary], columns: Sequence[Column]) -> str:
    """Return a table with a row for each method; an asterisk marks the best values of each column."""
    rows = [(name, *cells) for name, cells in score_cells(summaries, columns).items()]
    return table(("method", *(column.head for column in columns)), rows)


def score_cells(summaries: Mapping[K, Summary], columns: Sequence[Column]) -> dict[K, list[str]]:
    """Return the cells of each method, with an asterisk before the best values of each column."""
    cells: dict[K, list[str]] = {name: [] for name in summaries}
    for column in columns:
        best = column.best_in(summaries)
        for name, summary in summaries.items():
            cells[name].append(f"{_MARK if name in best else ''}{column.cell(summary)}")
    return cells


def score_legend(text: str, columns: Iterable[Column], others: Mapping[str, str] | None = None) -> str:
    """Return what the columns of tables, which are given as text, mean; with their marks if there are any."""
    lines = {column.head: column.meaning for column in columns} | dict(others or {})
    if "@" in text:
        lines["@0.80"] = "a threshold that removes 80 % of the points of a recording"
    if _MARK in text:
        lines[_MARK] = "best of the filters in this column"
    if UNKNOWN in text:
        lines[UNKNOWN] = "nothing to count"
    return legend(lines)


class FrameRows(PackedRows):
    """Rows of the frames of one recording, and whether the labels of points are known for any."""

    def __init__(self, recording: str, packed: IO[bytes] | None = None) -> None:
        super().__init__(packed)
        self._recording, self.points_known = recording, False

    def add(self, method: str, frame: Frame, score: FrameScore) -> None:
        """Add the row of a method; cells are empty for what the labels of the frame do not tell."""
        self.points_known |= score.points is not None
        self.write(csv_line((self._recording, method, frame.index, frame.stamp_ns, *score.cells())))


def frame_table(recordings: Sequence[FrameRows]) -> Iterator[bytes]:
    """Yield the lines of a table (CSV); it has columns for points if their labels are known for any frame."""
    points_known = any(rows.points_known for rows in recordings)
    columns = (*ALARM_COLUMNS, *(POINT_COLUMNS if points_known else ()))
    yield csv_line(("recording", "method", "frame", "stamp_ns", *columns))
    for line in chain.from_iterable(recordings):
        yield line if points_known else line.replace(_UNKNOWN_POINTS, b"\n")


@dataclass(kw_only=True)
class Evaluated(Described):
    """Sums over the frames of one recording for each variant; its rows and the scores of its parts, if wanted."""

    data = "recording error damage seconds=rounded_s methods=known"
    listed = "frames=first.frames false_alarms=first.false_alarms missed_targets=first.missed"

    methods: Mapping[str, Summary]
    rows: FrameRows | None = field(default=None, repr=False)
    parts: Parts | None = field(default=None, repr=False)

    @property
    def frames(self) -> int:
        """Number of frames that at least one method could use, labelled or not."""
        return max((summary.frames + summary.unlabelled for summary in self.methods.values()), default=0)

    def add(self, method: str, frame: Frame, score: FrameScore, seconds: float | None) -> None:
        """Add a frame to the sums and rows of a method."""
        self.methods[method].add(score, seconds)
        if self.rows:
            self.rows.add(method, frame, score)

    def figures(self) -> str:
        """Return frames and rates of the first method, for a line about the outcome."""
        rates = ", ".join(column.figure(self.first) for column in (R_FP, R_FN))
        frames, name = count(self.first.frames, "labelled frame"), next(iter(self.methods))
        return f"{frames}, {name}: {rates}, {self.seconds:.1f} s"

    @property
    def known(self) -> Mapping[str, Summary]:
        """The sums for each variant; empty after an error."""
        return {} if self.error else self.methods

    @property
    def first(self) -> Summary:
        """The sums for the first variant."""
        return next(iter(self.methods.values()))


Filtered = tuple[Frame, Sequence[FilterResult | None], Sequence[float | None]]
"""A frame, its result of each method, and the seconds that each took, as far as known."""


@dataclass(frozen=True)
class EvaluateWork(RecordingWork[Evaluated]):
    """Evaluation of one recording; without labels, clusters are only counted.

    Listeners receive every frame in this process. ``tabulated`` and ``in_parts`` are what the outcome has besides sums;
    the rows of its table are in memory unless there is a file for them, ``spool``.
    """

    variants: Sequence[Variant]
    listeners: Sequence[FrameListener] = ()
    tabulated: bool = False
    in_parts: bool = False
    spool: IO[bytes] | None = None

    def without_result(self, reason: str | None) -> Evaluated:
        """Return an outcome without frames."""
        methods = {variant.name: Summary() for variant in self.variants}
        parts = Parts(len(methods)) if self.in_parts else None
        return Evaluated(recording=self.recording.name, methods=methods, parts=parts, error=reason)

    def run(self, observer: Observer) -> Evaluated:
        """Evaluate the recording, also for the listeners; store an error in the outcome."""
        for listener in self.listeners:
            listener.begin(self.recording.name)
        return super().run(observer)

    def study(self, source: Source, labels: Labels | None, outcome: Evaluated, observer: Observer) -> None:
        """Filter the recording with every method, and score each frame."""
        outcome.rows = FrameRows(self.recording.name, self.spool) if self.tabulated else None
        selection = self.reading.selection
        by = filtered_by(source, selection.topics)
        if by is not None and any(variant.config.method != "none" for variant in self.variants):
            text = "this run only filters the remaining points, and lost targets count as not visible"
            observer.warn(f"{source.name}: already filtered{by}; {text}")
        methods = ", ".join(variant.name for variant in self.variants)
        topic = printable(cloud_channels(source, selection.topics)[0].topic)
        observer.note(f"{source.name}: {source.format}, {methods} on {topic}", detail=True)
        filters = [variant.config.make_filter() for variant in self.variants]
        # The threshold of a method that derives it from the log itself always fits.
        given = [variant for variant, method in zip(self.variants, filters, strict=True) if not method.needs_first_pass]
        checks = {variant.name: Checks(variant.config, source.facts, filtered=by is not None) for variant in given}
        frames = self._filtered(source, filters, labels, outcome, observer)
        warn_once(observer, outcome, self.scored(frames, labels, outcome, checks))

    def _filtered(
        self, source: Source, filters: Sequence[Filter], labels: Labels | None, outcome: Evaluated, observer: Observer
    ) -> Iterator[Filtered]:
        """Yield the frames of the recording; then raise `LabelError` or warn if they and the labels do not match."""
        with self.progress(source, observer) as step:
            for filtered in run_each(source, filters, self.reading.selection):
                yield filtered
                step()
        self.finish(source, labels, outcome.frames)
        if labels and outcome.frames and not any(summary.frames for summary in outcome.methods.values()):
            recorded = recorded_of(source, self.reading.selection.topics)
            if first := min((one.first_frame for one in recorded), default=0):
                text = f"it is a part of a recording, with frames from {first} on"
                raise LabelError(f"{source.name}: no frame is labelled; {text}")
            observer.warn(f"{source.name}: no frame is labelled; check that the labels belong to this recording")

    def scored(
        self, frames: Iterable[Filtered], labels: Labels | None, outcome: Evaluated, checks: Mapping[str, Checks]
    ) -> Iterator[str]:
        """Score frames for every method that could use them; yield warnings about settings and labels."""
        evaluation = self.variants[0].config.evaluation
        label_check = LabelCheck(evaluation)
        for frame, results, seconds in frames:
            outcome.note(frame)
            truth = labels.truth(frame) if labels else None
            scores = score_frame(frame, results, truth, evaluation)
            if truth:
                label_check.add(frame, truth)
            if truth is not None and outcome.parts:
                outcome.parts.add(scores)
            for listener in self.listeners:
                listener.add(ScoredFrame(frame, results, truth, scores))
            for variant, result, found, spent in zip(self.variants, results, scores, seconds, strict=True):
                if result is None or found is None:
                    continue
                outcome.add(variant.name, frame, found, spent)
                if variant.name in checks:
                    yield from checks[variant.name].add(result)
        for check in checks.values():  # even after only a few frames
            yield from check.finish()
        most = max(outcome.methods.values(), key=attrgetter("frames"))
        yield from (f"labels: {finding.text}" for finding in label_check.findings(most.targets, most.visible))


def warn_once(observer: Observer, outcome: Evaluated, texts: Iterable[str]) -> None:
    """Warn of each text when it comes first."""
    warned = set[str]()
    for text in texts:
        if text not in warned:
            warned.add(text)
            observer.warn(f"{outcome.recording}: {text}")


@dataclass(frozen=True)
class Comparison(RecordingsResult):
    """Result of the evaluation of several recordings: the methods that were compared, and each recording's outcome."""

    data = "methods=totals recordings=outcomes configs"

    variants: Sequence[Variant]
    outcomes: Sequence[Evaluated]

    def totals(self) -> dict[str, Summary]:
        """Return the sums over all recordings without an error."""
        totals = {variant.name: Summary() for variant in self.variants}
        for outcome in self.outcomes:
            for name, summary in outcome.known.items():
                totals[name].update(summary)
        return totals

    def configs(self) -> dict[str, Config]:
        """Return the configuration of each method."""
        return {variant.name: variant.config for variant in self.variants}

    def as_text(self) -> str:
        """Return the comparison as human-readable text; for DBSCAN clusters, include the measures of [Bi]."""
        if all(outcome.error for outcome in self.outcomes):
            return ""
        totals = self.totals()
        points_known = any(summary.points for summary in totals.values())
        groups = [ALARMS, (*(POINTS if points_known else ()), *TIMES)]
        if self.variants[0].config.evaluation.clustering == "dbscan":
            groups.insert(1, OBJECTS)
        tables = "\n\n".join(score_table(totals, columns) for columns in groups)
        foot = score_legend(tables, (column for columns in groups for column in columns))
        return f"{self._title(totals)}\n\n{tables}\n\n{foot}"

    def _title(self, totals: Mapping[str, Summary]) -> str:
        """Return what was compared: recordings, frames, targets and, where they are labelled, points."""
        done = sum(not outcome.error for outcome in self.outcomes)
        first = max(totals.values(), key=lambda summary: summary.frames)
        least = self.variants[0].config.evaluation.min_visible_points
        frames = f"{count(first.frames, 'labelled frame')}, {first.unlabelled:,} unlabelled"
        visible = f"{first.visible:,} visible (at least {count(least, 'point')})"
        part = "" if done == len(self.outcomes) else f"{done:,} of "
        recordings = f"{part}{count(len(self.outcomes), 'recording')}"
        lines = [f"{recordings}; {frames}", f"{count(first.targets, 'target')}, {visible}"]
        if points := first.points:
            lines.append(f"{count(points.target_in, 'target point')}, {count(points.clutter_in, 'clutter point')}")
        return "\n".join(lines)
