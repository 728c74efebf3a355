"""Evaluation of several methods against labels, in one pass over the recordings."""

import json
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

from seaclutter_cli.errors import LabelError
from seaclutter_cli.evaluation.label_check import LabelCheck
from seaclutter_cli.evaluation.scores import Summary, score_frame
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.pipeline import run_each
from seaclutter_cli.reporting.history import FrameListener
from seaclutter_cli.runs.batch import BatchOptions, Work, inputs_of_work, run_batch
from seaclutter_cli.runs.checks import Checks
from seaclutter_cli.runs.comparison import Comparison, Evaluated
from seaclutter_cli.runs.frame_table import FrameRows, FrameTable
from seaclutter_cli.runs.labels import LabelFile, LabelSources
from seaclutter_cli.runs.manifest import manifest_of
from seaclutter_cli.runs.methods import MethodOptions, Variant
from seaclutter_cli.runs.observer import SILENT, Observer
from seaclutter_cli.runs.outputs import inputs_of, may_appear, prepare_outputs, write_files
from seaclutter_cli.runs.recordings import (
    Logs,
    ReadOptions,
    expand,
    expected_frames,
    finish_labels,
    opened,
    require_frames,
    require_selected,
    storing_errors,
)
from seaclutter_cli.selection import cloud_channels, filtered_by, first_frame, was_filtered
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sources import Recording
from seaclutter_cli.storage.locations import Location
from seaclutter_cli.storage.scratch import copies_removed
from seaclutter_cli.text import printable


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """Options of an evaluation: methods, labels, input and output files.

    Parameters
    ----------
    labels : LabelSources
        Labels of the recordings.
    methods : MethodOptions
        Methods to compare.
    clustering : {"euclidean", "dbscan"} or None
        Clustering algorithm; None: that of the configuration.
    reading : ReadOptions
        Part of each recording to read, and how.
    frames_file : Path, Url or None
        File for a table with a row for each frame and method (CSV).
    summary_file : Path, Url or None
        File for all results (JSON).
    force : bool
        Replace existing files.
    batch : BatchOptions
        How several recordings are processed.
    """

    labels: LabelSources
    methods: MethodOptions = field(default_factory=MethodOptions)
    clustering: Literal["euclidean", "dbscan"] | None = None
    reading: ReadOptions = field(default_factory=ReadOptions)
    frames_file: Location | None = None
    summary_file: Location | None = None
    force: bool = False
    batch: BatchOptions = field(default_factory=BatchOptions)


@copies_removed()
def evaluate_logs(logs: Logs, options: EvaluateOptions, observer: Observer = SILENT) -> Comparison:
    """Filter recordings, cluster the points that are left, and count false alarms and missed targets against labels.

    Parameters
    ----------
    logs : path, or sequence of paths
        Files, folders or globs.
    options : EvaluateOptions
        Methods, labels, input and output files.
    observer : Observer, optional
        Receives progress and warnings.

    Raises
    ------
    SeaclutterError
        If the run cannot start or continue; an error in a single recording is stored in its outcome.
    """
    overrides = [f"evaluation.clustering={options.clustering}"] if options.clustering else []
    variants = options.methods.variants(*overrides)
    recordings = expand(logs, options.reading, observer)
    targets = {"-o": options.frames_file, "--summary": options.summary_file}
    manifest = options.batch.manifest
    inputs = inputs_of(recordings, options.reading, options.methods.file, [one.config for one in variants])
    outputs = {**targets, "--manifest": manifest}
    prepare_outputs(outputs, inputs, options.labels.paths, force=options.force, observer=observer)
    labels = options.labels.assign(recordings)
    tabulated = options.frames_file is not None
    pairs = zip(recordings, labels, strict=True)
    works = [EvaluateWork(variants, options.reading, *each, tabulated=tabulated) for each in pairs]
    with OutputGroup(replace=options.force) as files:
        with ExitStack() as stack:
            table = stack.enter_context(FrameTable(options.frames_file, files)) if options.frames_file else None
            summary = stack.enter_context(AtomicFile(options.summary_file, files)) if options.summary_file else None
            if options.batch.runs_here(len(works)):
                outcomes = [works[0].run(observer, [table] if table else [])]
            else:
                outcomes = run_batch(works, options.batch, observer, partial(_append, table))
            require_selected(outcomes)
            comparison = Comparison(variants, outcomes)
            if summary:
                summary.stream.write(json.dumps(comparison.as_dict(), indent=2).encode() + b"\n")
        if not may_appear(targets.values(), comparison.outcomes, observer):
            files.discard()
    if manifest:
        write_files(manifest_of(manifest, recordings, outcomes), replace=options.force)
    return comparison


def _append(table: FrameRows | None, outcome: Evaluated) -> None:
    """Append the rows of a recording to the table."""
    if table and outcome.rows and not outcome.error:
        table.append(outcome.rows)
    outcome.rows = None


@dataclass(frozen=True)
class EvaluateWork(Work[Evaluated]):
    """Evaluation of one recording.

    Parameters
    ----------
    variants : sequence of Variant
        Methods to compare.
    reading : ReadOptions
        Part of the recording to read, and how.
    recording : Recording
        The recording.
    labels : LabelFile or None
        Its labels.
    tabulated : bool
        Whether there is a table with a row for each frame and method.
    """

    variants: Sequence[Variant]
    reading: ReadOptions
    recording: Recording
    labels: LabelFile | None
    tabulated: bool = False

    @property
    def reads(self) -> Sequence[Location]:
        """Files and folders that the work reads."""
        return inputs_of_work(self.recording, self.reading, self.labels)

    def run(
        self, observer: Observer, tables: Sequence[FrameRows] = (), listeners: Sequence[FrameListener] = ()
    ) -> Evaluated:
        """Evaluate the recording; store an error in the outcome.

        Parameters
        ----------
        observer : Observer
            Receives progress and warnings.
        tables : sequence of FrameRows, optional
            Tables for the rows of the frames; by default they are stored in the outcome if they are needed.
        listeners : sequence of FrameListener, optional
            Receive every frame.
        """
        outcome = self.without_result(None)
        evaluator = Evaluator(self.variants, self.reading, observer)
        with storing_errors(outcome, observer):
            labels = self.labels.open() if self.labels else None
            if tables or not self.tabulated:
                return evaluator.run(self.recording, labels, tables, listeners)
            with FrameRows() as own:
                outcome = evaluator.run(self.recording, labels, [own], listeners)
                outcome.rows = own.packed()
        return outcome

    def without_result(self, reason: str | None) -> Evaluated:
        """Return an outcome without frames."""
        methods = {variant.name: Summary() for variant in self.variants}
        return Evaluated(recording=self.recording.name, methods=methods, error=reason)


@dataclass(frozen=True)
class Evaluator:
    """Evaluation of several methods, recording by recording.

    Parameters
    ----------
    variants : sequence of Variant
        Methods to compare.
    reading : ReadOptions
        Part of each recording to read, and how.
    observer : Observer
        Receives progress and warnings.
    """

    variants: Sequence[Variant]
    reading: ReadOptions
    observer: Observer

    def compare(
        self,
        recordings: Sequence[Recording],
        labels: Sequence[Labels | None],
        *,
        tables: Sequence[FrameRows] = (),
        listeners: Sequence[FrameListener] = (),
    ) -> Comparison:
        """Evaluate the recordings one after another."""
        pairs = zip(recordings, labels, strict=True)
        return Comparison(self.variants, [self.run(one, own, tables, listeners) for one, own in pairs])

    def run(
        self,
        recording: Recording,
        labels: Labels | None,
        tables: Sequence[FrameRows] = (),
        listeners: Sequence[FrameListener] = (),
    ) -> Evaluated:
        """Evaluate one recording; without labels, only count clusters."""
        methods = {variant.name: Summary() for variant in self.variants}
        outcome = Evaluated(recording=recording.name, methods=methods)
        for listener in listeners:
            listener.begin(recording.name)
        with storing_errors(outcome, self.observer), opened(recording, self.reading, self.observer, outcome) as source:
            begun = [table.begin(recording.name) for table in tables]
            scorer = _FrameScorer(self, source, labels, outcome, begun, listeners)
            self._stream(source, scorer)
            self._check(source, labels, outcome)
            scorer.finish()
            for table in tables:
                table.end()
        return outcome

    def _stream(self, source: Source, scorer: "_FrameScorer") -> None:
        selection = self.reading.selection
        clouds = cloud_channels(source, selection.topics)
        filtering = any(variant.config.method != "none" for variant in self.variants)
        if filtering and was_filtered(source, selection.topics):
            by = filtered_by(source, selection.topics)
            text = "this run only filters the remaining points, and lost targets count as not visible"
            self.observer.warn(f"{source.name}: already filtered{by}; {text}")
        methods = ", ".join(variant.name for variant in self.variants)
        self.observer.note(f"{source.name}: {source.format}, {methods} on {printable(clouds[0].topic)}", detail=True)
        filters = [variant.config.make_filter() for variant in self.variants]
        with self.observer.progress(source.name, expected_frames(source, clouds, selection)) as step:

            def on_frame(frame: Frame, results: Sequence[FilterResult | None], seconds: Sequence[float]) -> None:
                scorer.add(frame, results, seconds)
                step()

            run_each(source, filters, selection, on_frame)

    def _check(self, source: Source, labels: Labels | None, outcome: Evaluated) -> None:
        """Check that frames could be read, and that they match the labels."""
        require_frames(source, outcome.frames, self.reading.selection)
        finish_labels(labels, source, self.reading.selection)
        if labels and outcome.frames and not any(summary.frames for summary in outcome.methods.values()):
            first = first_frame(source, self.reading.topics)
            if first:
                text = f"it is a part of a recording, with frames from {first} on"
                raise LabelError(f"{source.name}: no frame is labelled; {text}")
            self.observer.warn(f"{source.name}: no frame is labelled; check that the labels belong to this recording")


class _FrameScorer:
    """Comparison of the frames of one recording with its labels."""

    def __init__(
        self,
        evaluator: Evaluator,
        source: Source,
        labels: Labels | None,
        outcome: Evaluated,
        tables: Sequence[FrameRows],
        listeners: Sequence[FrameListener],
    ) -> None:
        self._variants, self._observer = evaluator.variants, evaluator.observer
        self._labels, self._outcome = labels, outcome
        self._tables, self._listeners = tables, listeners
        # The threshold of a method that derives it from the log itself always fits.
        given = [variant for variant in self._variants if not variant.config.make_filter().needs_first_pass]
        filtered = was_filtered(source, evaluator.reading.selection.topics)
        self._checks = {variant.name: Checks(variant.config, source.facts, filtered=filtered) for variant in given}
        self._label_check = LabelCheck(self._variants[0].config.evaluation)
        self._warned: set[str] = set()

    def add(self, frame: Frame, results: Sequence[FilterResult | None], seconds: Sequence[float]) -> None:
        """Score a frame for every method that could use it."""
        truth = self._labels.truth(frame) if self._labels else None
        scores = score_frame(frame, results, truth, self._variants[0].config.evaluation)
        if truth:
            self._label_check.add(frame, truth)
        for listener in self._listeners:
            listener.add_frame(frame, results, truth, scores)
        for variant, result, found, spent in zip(self._variants, results, scores, seconds, strict=True):
            if result is None or found is None:
                continue
            self._outcome.methods[variant.name].add(found, spent)
            for table in self._tables:
                table.write(variant.name, frame, found)
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
