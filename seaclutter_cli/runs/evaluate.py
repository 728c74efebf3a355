"""Evaluation of several methods against labels, in one pass over the recordings."""

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

from seaclutter_cli.buckets import on_paths, shown
from seaclutter_cli.errors import LabelError
from seaclutter_cli.evaluation.label_check import LabelCheck
from seaclutter_cli.evaluation.scores import Summary, score_frame
from seaclutter_cli.evaluation.tuning import Parts
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.options import function_of
from seaclutter_cli.pipeline import run_each
from seaclutter_cli.reporting.history import FrameListener, ScoredFrame
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.runs.methods import Variant, variants
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.studies import EvaluateOptions
from seaclutter_cli.runs.outputs import may_appear, write_manifest
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult
from seaclutter_cli.runs.score_tables import (
    ALARMS,
    OBJECTS,
    POINTS,
    R_FN,
    R_FP,
    TIMES,
    FrameRows,
    frame_table,
    score_legend,
    score_table,
)
from seaclutter_cli.runs.studies import StudyWork, frame_progress, prepared, study_all
from seaclutter_cli.selection import cloud_channels, filtered_by, first_frame, was_filtered
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.text import count, printable


@function_of(EvaluateOptions)
@on_paths
def evaluate(options: EvaluateOptions) -> "Comparison":
    """Count false alarms and missed targets of one or several methods against labels, in one pass over the logs.

    Returns
    -------
    Comparison
        ``totals()``, a `Summary` for each method; ``as_text()``, the tables of the command line.

    Raises
    ------
    SeaclutterError
        If a log or its labels cannot be used; see its subclasses.

    Examples
    --------
    >>> import seaclutter
    >>> result = seaclutter.evaluate("samples/sea.mcap", "samples/sea.labels.csv", methods=["joint", "none"])
    >>> {name: (summary.n_fp, summary.n_fn) for name, summary in result.totals().items()}
    {'joint': (14, 8), 'none': (60, 0)}
    """
    observer = options.watching
    overrides = [f"evaluation.clustering={options.clustering}"] if options.clustering else []
    chosen = variants(options, *overrides)
    targets = {"-o": options.frames_file, "--summary": options.summary_file}
    manifest = options.batch.manifest
    outputs, configs = {**targets, "--manifest": manifest}, [one.config for one in chosen]
    pairs = prepared(options.logs, options, outputs, observer, configs)
    tabulated = options.frames_file is not None
    works = [EvaluateWork(options.reading, *each, chosen, tabulated=tabulated) for each in pairs]
    with OutputGroup(replace=options.force) as files:
        with ExitStack() as stack:
            table, summary = (stack.enter_context(AtomicFile(it, files)) if it else None for it in targets.values())
            outcomes = study_all(works, options.batch, observer)
            comparison = Comparison(chosen, outcomes)
            if table:
                table.stream.writelines(frame_table([one.rows for one in outcomes if one.rows and not one.error]))
            if summary:
                summary.stream.write(json.dumps(shown(comparison.as_dict()), indent=2).encode() + b"\n")
        if not may_appear(targets.values(), outcomes, observer):
            files.discard()
    write_manifest(manifest, [recording for recording, _ in pairs], outcomes, replace=options.force)
    return comparison


@dataclass(kw_only=True)
class Evaluated(Outcome):
    """Sums over the frames of one recording for each variant.

    If they are wanted, with the rows of the table of frames, and the scores of consecutive parts, of which some may be
    held out.
    """

    methods: Mapping[str, Summary]
    rows: FrameRows | None = field(default=None, repr=False)
    parts: Parts | None = field(default=None, repr=False)

    @property
    def frames(self) -> int:
        """Number of frames that at least one method could use, labelled or not."""
        return max((summary.frames + summary.unlabelled for summary in self.methods.values()), default=0)

    def figures(self) -> str:
        """Return frames and rates of the first method, for a line about the outcome."""
        name, summary = next(iter(self.methods.items()))
        rates = ", ".join(column.figure(summary) for column in (R_FP, R_FN))
        return f"{count(summary.frames, 'labelled frame')}, {name}: {rates}, {self.seconds:.1f} s"

    def counts(self) -> dict[str, Any]:
        """Return further columns of the manifest of a run, with the alarms of the first method."""
        first = next(iter(self.methods.values()))
        return {
            "frames": first.frames,
            "false_alarms": first.false_alarms,
            "missed_targets": first.visible - first.detected,
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as JSON-compatible data."""
        return {
            **super().as_dict(),
            "seconds": round(self.seconds, 3),
            "methods": {} if self.error else {name: summary.as_dict() for name, summary in self.methods.items()},
        }


@dataclass(frozen=True)
class EvaluateWork(StudyWork[Evaluated]):
    """Evaluation of one recording; without labels, clusters are only counted.

    Listeners receive every frame in this process. ``tabulated`` and ``in_parts`` are what the outcome has besides sums.
    """

    variants: Sequence[Variant]
    listeners: Sequence[FrameListener] = ()
    tabulated: bool = False
    in_parts: bool = False

    def without_result(self, reason: str | None) -> Evaluated:
        """Return an outcome without frames."""
        methods = {variant.name: Summary() for variant in self.variants}
        parts = Parts(len(methods)) if self.in_parts else None
        rows = FrameRows(self.recording.name) if self.tabulated else None
        return Evaluated(recording=self.recording.name, methods=methods, rows=rows, parts=parts, error=reason)

    def run(self, observer: Observer) -> Evaluated:
        """Evaluate the recording, also for the listeners; store an error in the outcome."""
        for listener in self.listeners:
            listener.begin(self.recording.name)
        return super().run(observer)

    def study(self, source: Source, labels: Labels | None, outcome: Evaluated, observer: Observer) -> None:
        """Filter the recording with every method, and score each frame."""
        selection = self.reading.selection
        topic = cloud_channels(source, selection.topics)[0].topic
        filtered = was_filtered(source, selection.topics)
        if filtered and any(variant.config.method != "none" for variant in self.variants):
            by = filtered_by(source, selection.topics)
            text = "this run only filters the remaining points, and lost targets count as not visible"
            observer.warn(f"{source.name}: already filtered{by}; {text}")
        methods = ", ".join(variant.name for variant in self.variants)
        observer.note(f"{source.name}: {source.format}, {methods} on {printable(topic)}", detail=True)
        filters = [variant.config.make_filter() for variant in self.variants]
        # The threshold of a method that derives it from the log itself always fits.
        pairs = zip(self.variants, filters, strict=True)
        given = [variant for variant, method in pairs if not method.needs_first_pass]
        checks = {variant.name: Checks(variant.config, source.facts, filtered=filtered) for variant in given}
        scorer = _FrameScorer(self, labels, outcome, checks, observer)
        with frame_progress(source, selection, observer) as step:

            def on_frame(frame: Frame, results: Sequence[FilterResult | None], seconds: Sequence[float]) -> None:
                scorer.add(frame, results, seconds)
                step()

            run_each(source, filters, selection, on_frame)
        self.finish(source, labels, outcome.frames)
        if labels and outcome.frames and not any(summary.frames for summary in outcome.methods.values()):
            if first := first_frame(source, self.reading.topics):
                text = f"it is a part of a recording, with frames from {first} on"
                raise LabelError(f"{source.name}: no frame is labelled; {text}")
            observer.warn(f"{source.name}: no frame is labelled; check that the labels belong to this recording")
        scorer.finish()


class _FrameScorer:
    """Comparison of the frames of one recording with its labels."""

    def __init__(
        self,
        work: EvaluateWork,
        labels: Labels | None,
        outcome: Evaluated,
        checks: Mapping[str, Checks],
        observer: Observer,
    ) -> None:
        self._work, self._labels, self._outcome = work, labels, outcome
        self._checks, self._observer = checks, observer
        self._evaluation = work.variants[0].config.evaluation
        self._label_check = LabelCheck(self._evaluation)
        self._warned: set[str] = set()

    def add(self, frame: Frame, results: Sequence[FilterResult | None], seconds: Sequence[float]) -> None:
        """Score a frame for every method that could use it."""
        truth = self._labels.truth(frame) if self._labels else None
        scores = score_frame(frame, results, truth, self._evaluation)
        if truth:
            self._label_check.add(frame, truth)
        if truth is not None and self._outcome.parts:
            self._outcome.parts.add(scores)
        for listener in self._work.listeners:
            listener.add(ScoredFrame(frame, results, truth, scores, lambda: results))
        for variant, result, found, spent in zip(self._work.variants, results, scores, seconds, strict=True):
            if result is None or found is None:
                continue
            self._outcome.methods[variant.name].add(found, spent)
            if self._outcome.rows:
                self._outcome.rows.write(variant.name, frame, found)
            if variant.name in self._checks:
                self._warn(self._checks[variant.name].add(result))

    def finish(self) -> None:
        """Warn about settings and labels that do not fit, even after only a few frames."""
        for checks in self._checks.values():
            self._warn(checks.finish())
        found = max(self._outcome.methods.values(), key=lambda summary: summary.frames)
        findings = self._label_check.findings(found.targets, found.visible)
        self._warn(f"labels: {finding.text}" for finding in findings)

    def _warn(self, texts: Iterable[str]) -> None:
        for text in texts:
            if text not in self._warned:
                self._warned.add(text)
                self._observer.warn(f"{self._outcome.recording}: {text}")


@dataclass(frozen=True)
class Comparison(RecordingsResult):
    """Result of the evaluation of several recordings.

    Parameters
    ----------
    variants : sequence of Variant
        Methods that were compared.
    outcomes : sequence of Evaluated
        Outcome of each recording.
    """

    variants: Sequence[Variant]
    outcomes: Sequence[Evaluated]

    def totals(self) -> dict[str, Summary]:
        """Return the sums over all recordings without an error."""
        totals = {variant.name: Summary() for variant in self.variants}
        for outcome in self.outcomes:
            for name, summary in outcome.methods.items() if not outcome.error else ():
                totals[name].update(summary)
        return totals

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as JSON-compatible data."""
        return {
            "methods": {name: summary.as_dict() for name, summary in self.totals().items()},
            "recordings": [outcome.as_dict() for outcome in self.outcomes],
            "configs": {variant.name: variant.config.as_dict() for variant in self.variants},
        }

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
        lines = [
            f"{part}{count(len(self.outcomes), 'recording')}; {frames}",
            f"{count(first.targets, 'target')}, {visible}",
        ]
        if points := first.points:
            lines.append(f"{count(points.target_in, 'target point')}, {count(points.clutter_in, 'clutter point')}")
        return "\n".join(lines)
