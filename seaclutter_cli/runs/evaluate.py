"""Evaluation of several methods against labels, in one pass over the recordings."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from seaclutter_cli.buckets import shown, use_case_of
from seaclutter_cli.config import Config
from seaclutter_cli.errors import InputError, LabelError, UsageError
from seaclutter_cli.evaluation import IDEAL
from seaclutter_cli.evaluation.label_check import LabelCheck
from seaclutter_cli.evaluation.scores import FrameScore, Parts, Summary, ideal, score_frame
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import Filtered, run_each
from seaclutter_cli.reporting.collector import FrameListener, ScoredFrame
from seaclutter_cli.runs import score_tables as tables
from seaclutter_cli.runs.batch import RecordingWork, prepared, run_all, without_labels
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.runs.methods import Variant, bases, note_left_out, with_ideal
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import EvaluateOptions
from seaclutter_cli.runs.outputs import Contents, PackedRows, write_files, write_manifest
from seaclutter_cli.runs.recordings import RecordingsResult, data_of
from seaclutter_cli.runs.topic_statistics import Described
from seaclutter_cli.selection import (
    cloud_channels,
    filtered_by,
    lacks_points,
    main_topics,
    recorded_of,
    removed_topic,
    studied,
)
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.text import count, json_text, printable, table
from seaclutter_cli.truth import Truth


@use_case_of(EvaluateOptions)
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
    {'joint': (14, 8), 'none': (60, 0), 'ideal': (0, 0)}
    """
    observer = options.watching
    if not options.labels and not options.without_labels:
        raise UsageError("Missing option '--labels'; --without-labels shows indications that need none")
    if options.labels and options.without_labels:
        raise UsageError("--without-labels: leave out --labels")
    note_left_out(options, observer)
    settings = [f"evaluation.clustering={options.clustering}"] if options.clustering else []
    chosen = [one.variant() for one in bases(options, *settings)]
    chosen = chosen if options.without_labels else with_ideal(chosen)
    pairs = prepared(options, observer, [one.config for one in chosen])
    make = partial(EvaluateWork, tabulated=bool(options.frames_file), indicated=options.without_labels)
    works = [make(options.reading, *each, chosen) for each in pairs]
    earlier = None if options.without_labels else without_labels(works, observer)
    outcomes = run_all(works, options, observer, earlier=earlier)
    comparison = Comparison(outcomes, chosen)
    rows = [one.rows for one in outcomes if one.rows and not one.error]
    points_known = any(summary.points for summary in comparison.totals().values())
    files: Contents = {
        options.frames_file: lambda it: it.stream.writelines(tables.frame_table(rows, points_known=points_known)),
        options.summary_file: json_text(shown(comparison.as_dict())).encode() + b"\n",
    }
    write_files(files, replace=options.force, outcomes=outcomes, observer=observer)
    write_manifest(options.manifest, [recording for recording, _ in pairs], outcomes, replace=options.force)
    return comparison


if TYPE_CHECKING:
    from seaclutter_cli.suspects.indications import Indications

_MAX_ROWS = 40
_AS_PROPOSED = (
    "labels: some are as `labels propose` made them; until a person has corrected them, the method judges itself"
)


@dataclass(kw_only=True)
class Evaluated(Described):
    """Sums over the frames of one recording for each variant; its rows and the scores of its parts, if wanted."""

    data = "recording status reason error damage seconds=rounded_s methods=known"

    methods: Mapping[str, Summary]
    rows: PackedRows | None = field(default=None, repr=False)
    parts: Parts | None = field(default=None, repr=False)
    indications: "Indications | None" = field(default=None, repr=False)

    @property
    def frames(self) -> int:
        """Number of frames that at least one method could use, labelled or not."""
        return max((summary.frames + summary.unlabelled for summary in self.methods.values()), default=0)

    def add(self, method: str, frame: Frame, score: FrameScore, seconds: float | None) -> None:
        """Add a frame to the sums and rows of a method."""
        self.methods[method].add(score, seconds)
        if self.rows:
            self.rows.write(csv_line((self.recording, method, frame.index, frame.stamp_ns, *score.cells())))

    def figures(self) -> str:
        """Return frames and rates of the first method, for a line about the outcome."""
        name, first = next(iter(self.methods.items()))
        rates = ", ".join(column.figure(first) for column in (tables.R_FP, tables.R_FN))
        return f"{count(first.frames, 'labelled frame')}, {name}: {rates}, {self.seconds:.1f} s"

    @property
    def known(self) -> Mapping[str, Summary]:
        """The sums for each variant; empty if the recording failed or is skipped."""
        return {} if self.error or self.has_nothing else self.methods

    def manifest_rows(self) -> list[dict[str, Any]]:
        """Return the main figures of each method; a single row without, if there are none."""
        figures = "frames false_alarms missed_targets=missed N_FP=n_fp N_FN=n_fn R_FP=r_fp R_FN=r_fn"
        rows = [{"method": name, **data_of(one, f"{figures} F1=f1")} for name, one in self.known.items()]
        return rows or [{}]


@dataclass(frozen=True)
class EvaluateWork(RecordingWork[Evaluated]):
    """Evaluation of one recording; without labels, clusters are only counted.

    Listeners receive every frame in this process. ``tabulated`` and ``in_parts`` are what the outcome has besides sums.
    """

    variants: Sequence[Variant]
    listeners: Sequence[FrameListener] = ()
    tabulated: bool = False
    in_parts: bool = False
    indicated: bool = False

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
        """Filter the recording with every method, and score each frame; warn once of each doubt."""
        outcome.rows = PackedRows() if self.tabulated else None
        warn = cache(observer.warn)
        for text in self._scored(source, labels, outcome, observer):
            warn(f"{outcome.recording}: {text}")

    def filtered(
        self, source: Source, outcome: Evaluated, observer: Observer
    ) -> tuple[Iterable[Filtered], Mapping[str, Checks]]:
        """Return the frames with the result of every method, and the checks of methods by name."""
        selection = studied(source, self.reading.selection)
        clouds, by = cloud_channels(source, selection.topics), filtered_by(source, selection.topics)
        for other in set(main_topics(source)) - {clouds[0].topic} if selection != self.reading.selection else ():
            if removed_topic(source, other):
                observer.note(f"{source.name}: raw clouds are evaluated; what an earlier run left of them: -t {other}")
        topic = clouds[0].topic
        removed = None if by is None else self._removed(source, topic, by, observer)
        methods = ", ".join(variant.name for variant in self.variants)
        observer.note(f"{source.name}: {source.format}, {methods} on {printable(topic)}", detail=True)
        filters = [variant.config.make_filter() for variant in self.variants]
        # The threshold of a method that derives it from the log itself always fits.
        given = [variant for variant, method in zip(self.variants, filters, strict=True) if not method.needs_first_pass]
        given = [variant for variant in given if variant.name != IDEAL]
        checks = {variant.name: Checks(variant.config, source.facts, filtered=by is not None) for variant in given}
        every = run_each(source, filters, selection, removed)
        if self.indicated:
            every = self._indicated(every, source, outcome)
        return self.stepped(every, source, observer, clouds), checks

    def _removed(self, source: Source, topic: str, by: str, observer: Observer) -> str | None:
        """Return the topic of what an earlier run removed; `InputError` if that is lost. Warn of a second filter."""
        text, removed = f"{source.name}: already filtered{by}", removed_topic(source, topic)
        if (self.labels or self.indicated) and lacks_points(source, topic):
            remedy = "evaluate the raw log, or one that was filtered with --with-removed"
            raise InputError(f"{text}, without the removed points, so missed targets cannot be counted; {remedy}")
        if self.labels and removed and self.labels.is_by_order:
            raise InputError(f"{text}, which changes the order of the points, as these labels have it; use the raw log")
        if any(variant.config.method != "none" for variant in self.variants):
            also = "; what the earlier one removed is counted, too" if removed else ""
            observer.warn(f"{text}; this run only filters the remaining points{also}")
        return removed

    def _scored(self, source: Source, labels: Labels | None, outcome: Evaluated, observer: Observer) -> Iterator[str]:
        """Score frames for every method that could use them; yield warnings about settings and labels."""
        every, checks = self.filtered(source, outcome, observer)
        evaluation = self.variants[0].config.evaluation
        label_check = LabelCheck(evaluation)
        for frame, filtered, seconds in every:
            outcome.note(frame)
            truth = labels.truth(frame) if labels else None
            results = self._with_ideal(filtered, frame, truth)
            scores = score_frame(frame, results, truth, evaluation)
            if truth:
                label_check.add(frame, truth)
                if truth.proposed:
                    yield _AS_PROPOSED
                if outcome.parts:
                    outcome.parts.add(scores)
            for listener in self.listeners:
                listener.add(ScoredFrame(frame, results, truth, scores))
            for variant, result, found, spent in zip(self.variants, results, scores, seconds, strict=True):
                if result is None or found is None:
                    continue
                outcome.add(variant.name, frame, found, None if variant.name == IDEAL else spent)
                if variant.name in checks:
                    yield from checks[variant.name].add(result)
        self.end(source, labels, outcome, observer)
        for check in checks.values():  # even after only a few frames
            yield from check.finish()
        most = max(outcome.methods.values(), key=attrgetter("frames"))
        yield from (f"labels: {finding.text}" for finding in label_check.findings(most.targets, most.visible))

    def _with_ideal(
        self, results: Sequence[FilterResult | None], frame: Frame, truth: Truth | None
    ) -> Sequence[FilterResult | None]:
        """Return the results with that of `IDEAL`, if it is compared, in place of that of its stand-in."""
        if truth is None or self.variants[-1].name != IDEAL:
            return results
        return [*results[:-1], ideal(frame, truth, self.variants[0].config.evaluation)]

    def end(self, source: Source, labels: Labels | None, outcome: Evaluated, observer: Observer) -> None:
        """Raise `LabelError` or warn if the frames and the labels do not match."""
        self.finish(source, labels, outcome.frames)
        if labels and outcome.frames and not any(summary.frames for summary in outcome.methods.values()):
            recorded = recorded_of(source, self.reading.selection.topics)
            if first := min((one.first_frame for one in recorded), default=0):
                text = f"it is a part of a recording, with frames from {first} on"
                raise LabelError(f"{source.name}: no frame is labelled; {text}")
            observer.warn(f"{source.name}: no frame is labelled; check that the labels belong to this recording")

    def _indicated(self, every: Iterable[Filtered], source: Source, outcome: Evaluated) -> Iterator[Filtered]:
        from seaclutter_cli.runs.objects import mounting_of, recorded_configs  # not needed with labels
        from seaclutter_cli.suspects.finder import SuspectFinder

        configs = [variant.config for variant in self.variants]
        finder = SuspectFinder(len(configs), mounting_of(*configs, *recorded_configs(source)))
        for frame, results, seconds in every:
            finder.indicate(frame, results)
            yield frame, results, seconds
        finder.finish()
        outcome.indications = finder.tally


@dataclass(frozen=True)
class Comparison(RecordingsResult[Evaluated]):
    """Result of the evaluation of several recordings: the methods that were compared, and each recording's outcome."""

    data = "methods=totals recordings=outcomes configs"

    variants: Sequence[Variant]

    def totals(self) -> dict[str, Summary]:
        """Return the sums over all recordings without an error."""
        totals = {variant.name: Summary() for variant in self.variants}
        for outcome in self.outcomes:
            for name, summary in outcome.known.items():
                totals[name].update(summary)
        return totals

    def as_dict(self) -> Any:
        """Return JSON-compatible data, with indications if there are any."""
        found = self.indications()
        return super().as_dict() if found is None else {**super().as_dict(), "indications": found}

    def configs(self) -> dict[str, Config]:
        """Return the configuration of each method."""
        return {variant.name: variant.config for variant in self.variants if variant.name != IDEAL}

    def indications(self) -> dict[str, dict[str, Any]] | None:
        """Return what indicates the quality of each method without labels; None if that was not asked for."""
        found = [outcome.indications for outcome in self.outcomes if outcome.indications and outcome.known]
        if not found:
            return None
        from seaclutter_cli.suspects.indications import Indications  # not needed with labels

        total = Indications(len(self.variants))
        for one in found:
            total.update(one)
        return {variant.name: total.of_method(m) for m, variant in enumerate(self.variants)}

    def as_text(self) -> str:
        """Return the comparison as human-readable text; for DBSCAN clusters, include the measures of [Bi]."""
        if not any(outcome.known for outcome in self.outcomes):
            return ""
        if (found := self.indications()) is not None:
            frames = sum(outcome.frames for outcome in self.outcomes)
            return tables.indications_text(found, f"{count(frames, 'frame')} without labels")
        totals = self.totals()
        points_known = any(summary.points for summary in totals.values())
        groups = [tables.ALARMS, (*(tables.POINTS if points_known else ()), *tables.TIMES)]
        if self.variants[0].config.evaluation.clustering == "dbscan":
            groups.insert(1, tables.OBJECTS)
        text = "\n\n".join(tables.score_table(totals, columns) for columns in groups) + self._by_recording(_MAX_ROWS)
        foot = tables.score_legend(text, (column for columns in groups for column in columns))
        return f"{self._title(totals)}\n\n{text}\n\n{foot}"

    def details(self) -> str:
        """Return the scores of each recording, if not all are in the text."""
        every = self._by_recording(None)
        return "" if every == self._by_recording(_MAX_ROWS) else every.lstrip()

    def _by_recording(self, most: int | None) -> str:
        """Return the scores of each of several recordings; of many, those with most errors of the first method."""
        known = [(outcome.recording, outcome.known) for outcome in self.outcomes if outcome.known]
        if len(known) < 2:
            return ""
        shown = len(known) if most is None else max(most // len(self.variants), 1)
        errors = [first.n_fp + first.n_fn for first in (next(iter(one.values())) for _, one in known)]
        worst = sorted(sorted(range(len(known)), key=lambda k: -errors[k])[:shown])
        rows = []
        for recording, summaries in (known[k] for k in worst):
            cells = tables.score_cells(summaries, (tables.FRAMES, *tables.FRAME_ERRORS))
            rows += [(printable(recording), name, *cells[name]) for name in summaries]
        heads = (column.head for column in (tables.FRAMES, *tables.FRAME_ERRORS))
        left = len(known) - len(worst)
        more = f"\nworst of {len(known):,} recordings; all with -v, --manifest or --summary" if left else ""
        return f"\n\n{table(('recording', 'method', *heads), rows)}{more}"

    def _title(self, totals: Mapping[str, Summary]) -> str:
        done = sum(bool(outcome.known) for outcome in self.outcomes)
        skipped = sum(outcome.has_nothing for outcome in self.outcomes)
        first = max(totals.values(), key=lambda summary: summary.frames)
        least = self.variants[0].config.evaluation.min_visible_points
        frames = f"{count(first.frames, 'labelled frame')}, {first.unlabelled:,} unlabelled"
        visible = f"{first.visible:,} visible (at least {count(least, 'point')})"
        part = "" if done == len(self.outcomes) else f"{done:,} of "
        recordings = f"{part}{count(len(self.outcomes), 'recording')}{f', {skipped:,} skipped' if skipped else ''}"
        lines = [f"{recordings}; {frames}", f"{count(first.targets, 'target')}, {visible}"]
        if points := first.points:
            lines.append(f"{count(points.target_in, 'target point')}, {count(points.clutter_in, 'clutter point')}")
        return "\n".join(lines)
