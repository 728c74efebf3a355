"""Check of labels against the points of recordings."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from seaclutter_cli.buckets import on_paths
from seaclutter_cli.config import load_config
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.label_check import Finding, LabelCheck
from seaclutter_cli.evaluation.matching import targets_of
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.options import function_of
from seaclutter_cli.pipeline import run_each
from seaclutter_cli.runs.batch import RecordingWork, prepared, run_all, without_labels
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import LabelCheckOptions
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult
from seaclutter_cli.text import UNKNOWN, count, printable, table
from seaclutter_cli.truth import Truth

_LINE_CHARACTERS = 80
_MEANS = ("length_m", "width_m", "height_m", "points")


@function_of(LabelCheckOptions)
@on_paths
def check_labels(options: LabelCheckOptions) -> "LabelCheckResult":
    """Compare labels with the points of logs, and return probable mistakes with their remedies.

    Examples
    --------
    >>> import seaclutter
    >>> (checked,) = seaclutter.check_labels("samples/sea.mcap", "samples/sea.labels.csv").outcomes
    >>> checked.boxes, checked.visible, checked.findings
    (120, 120, [])
    """
    observer = options.watching
    pairs = prepared(options.logs, options, {}, observer)
    works = [_LabelCheckWork(options.reading, *each) for each in pairs]
    return LabelCheckResult(run_all(works, options.batch, observer, earlier=without_labels(works, observer)))


@dataclass(kw_only=True)
class CheckedLabels(Outcome):
    """Outcome of the check of the labels of one recording: its boxes of targets by class, and probable mistakes.

    Of each box, there are length, width and height in metres, the number of points inside, and whether they are enough.
    """

    data = (
        "recording labels error damage frames=labelled unlabelled_frames=unlabelled boxes visible "
        "areas_to_ignore=areas frames_with_labelled_points=point_frames classes=sizes findings"
    )

    labels: str
    labelled: int = 0
    unlabelled: int = 0
    classes: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    areas: int = 0
    point_frames: int = 0
    findings: list[Finding] = field(default_factory=list)

    @property
    def boxes(self) -> int:
        """Number of boxes of targets."""
        return sum(map(len, self.classes.values()))

    @property
    def visible(self) -> int:
        """Number of boxes with enough points."""
        return int(sum(one["visible"] for one in self.sizes.values()))

    @property
    def sizes(self) -> dict[str, dict[str, float]]:
        """Number of boxes, visible ones, and means of the other columns for each class."""
        return {
            kind: {
                "boxes": len(rows),
                "visible": sum(bool(visible) for *_, visible in rows),
                **dict(zip(_MEANS, np.mean(rows, axis=0).tolist(), strict=False)),
            }
            for kind, rows in self.classes.items()
        }

    def add(self, frame: Frame, truth: Truth | None, params: EvaluationParams) -> None:
        """Count a frame."""
        if truth is None:
            self.unlabelled += 1
            return
        self.labelled += 1
        self.areas += len(truth.ignored)
        self.point_frames += truth.points is not None
        if boxes := truth.targets:
            members = targets_of(frame, truth, params).members
            for kind, size_m, inside in zip(boxes.classes, boxes.sizes, map(len, members), strict=True):
                row = (*size_m.tolist(), inside, inside >= params.min_visible_points)
                self.classes.setdefault(kind, []).append(row)

    def figures(self) -> str:
        """Return the main figures, for a line about the outcome."""
        found = count(len(self.findings), "probable mistake") if self.findings else "no mistake found"
        return f"{count(self.labelled, 'labelled frame')}, {count(self.boxes, 'box')}: {found}"

    def as_text(self) -> str:
        """Return the outcome as human-readable text."""
        frames = f"{count(self.labelled, 'labelled frame')}, {self.unlabelled:,} unlabelled"
        more = [f"{count(self.areas, 'area')} to ignore"] if self.areas else []
        more += [f"labels of points in {count(self.point_frames, 'frame')}"] if self.point_frames else []
        first = [f"{printable(self.recording)} with {printable(self.labels)}", frames, "; ".join(more)]
        blocks = ["\n".join(filter(None, first))]
        if self.classes:
            lines = []
            for kind, (boxes, visible, *sizes_m, points) in ((kind, one.values()) for kind, one in self.sizes.items()):
                cells = [*(f"{size_m:.2f}" for size_m in sizes_m), f"{points:.0f}" if visible else UNKNOWN]
                lines.append((kind, boxes, visible, *cells))
            blocks.append(table(("class", "boxes", "visible", "length m", "width m", "height m", "points"), lines))
        found = [textwrap.fill(f"* {one.text}", _LINE_CHARACTERS, subsequent_indent="  ") for one in self.findings]
        blocks.append("\n".join(["Probable mistakes:", *found]) if found else "No mistake found.")
        return "\n\n".join(blocks)


@dataclass(frozen=True)
class _LabelCheckWork(RecordingWork[CheckedLabels]):
    """Check of the labels of one recording."""

    def without_result(self, reason: str | None) -> CheckedLabels:
        path = str(self.labels.path) if self.labels else ""
        return CheckedLabels(recording=self.recording.name, labels=path, error=reason)

    def study(self, source: Source, labels: Labels | None, outcome: CheckedLabels, observer: Observer) -> None:
        unfiltered = load_config(None, method="none")
        check = LabelCheck(unfiltered.evaluation)
        with self.progress(source, observer) as step:
            for frame, *_ in run_each(source, [unfiltered.make_filter()], self.reading.selection):
                truth = labels.truth(frame) if labels else None
                outcome.add(frame, truth, unfiltered.evaluation)
                if truth:
                    check.add(frame, truth)
                step()
        self.finish(source, labels, outcome.labelled + outcome.unlabelled)
        outcome.findings = check.findings(outcome.boxes, outcome.visible)


@dataclass(frozen=True)
class LabelCheckResult(RecordingsResult):
    """Result of the check of the labels of several recordings."""

    data = "recordings=outcomes"

    outcomes: Sequence[CheckedLabels]

    @property
    def failed(self) -> bool:
        """Whether any labels have a probable mistake, or any recording could not be read."""
        return any(outcome.error or outcome.findings for outcome in self.outcomes)

    def as_text(self) -> str:
        """Return the result as human-readable text."""
        return self.details()
