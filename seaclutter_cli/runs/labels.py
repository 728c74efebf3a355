"""Check of labels against the points of recordings, and comparison of labels before and after their correction."""

import textwrap
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.buckets import use_case_of
from seaclutter_cli.config import load_config
from seaclutter_cli.errors import LabelError
from seaclutter_cli.evaluation import EvaluationParams
from seaclutter_cli.evaluation.label_check import Finding, LabelCheck
from seaclutter_cli.evaluation.matching import overlaps, targets_of
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels, Source
from seaclutter_cli.labels import open_labels
from seaclutter_cli.labels.point_labels import find_semantickitti
from seaclutter_cli.pipeline import run_each
from seaclutter_cli.runs.batch import RecordingWork, prepared, run_all, without_labels
from seaclutter_cli.runs.observer import Observer
from seaclutter_cli.runs.options.logs import CompareOptions, LabelCheckOptions
from seaclutter_cli.runs.recordings import Outcome, RecordingsResult, Result
from seaclutter_cli.text import UNKNOWN, count, printable, share, table
from seaclutter_cli.truth import Boxes, Truth

_LINE_CHARACTERS = 80
_SAME_M, _SAME_RAD = 0.01, 0.001
_GOOD = 0.5
_ARRAYS = ("centers", "sizes", "yaws")
_MEANS = ("length_m", "width_m", "height_m", "points")


@use_case_of(LabelCheckOptions)
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
    works = [_LabelCheckWork(options.reading, *each) for each in prepared(options, observer)]
    return LabelCheckResult(run_all(works, options, observer, earlier=without_labels(works, observer)))


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
        frames = run_each(source, [unfiltered.make_filter()], self.reading.selection)
        for frame, *_ in self.stepped(frames, source, observer):
            truth = labels.truth(frame) if labels else None
            outcome.add(frame, truth, unfiltered.evaluation)
            if truth:
                check.add(frame, truth)
        self.finish(source, labels, outcome.labelled + outcome.unlabelled)
        outcome.findings = check.findings(outcome.boxes, outcome.visible)


class LabelCheckResult(RecordingsResult[CheckedLabels]):
    """Result of the check of the labels of several recordings."""

    data = "recordings=outcomes"

    @property
    def failed(self) -> bool:
        """Whether any labels have a probable mistake, or any recording could not be read."""
        return any(outcome.error or outcome.findings for outcome in self.outcomes)


@use_case_of(CompareOptions)
def compare_labels(options: CompareOptions) -> "LabelComparison":
    """Return what differs between two labels of the same frames, and how good the first were.

    Examples
    --------
    >>> import seaclutter
    >>> labels = "samples/sea.labels.csv"
    >>> same = seaclutter.compare_labels(labels, labels)
    >>> same.changes["unchanged"], same.good
    (180, 180)
    """
    before, numbers_before = _opened(options.proposed)
    after, numbers_after = _opened(options.corrected)
    result = LabelComparison(len(numbers_before - numbers_after), len(numbers_after - numbers_before))
    for number in sorted(numbers_after):
        first = _boxes(before, number) if number in numbers_before else Boxes()
        result.add(first, _boxes(after, number))
    return result


def _opened(path: Path) -> tuple[Labels, set[int]]:
    """Return labels and the numbers of their frames; `LabelError` if these are not known."""
    labels = open_labels(path)
    numbers: Sequence[int] | None = getattr(labels, "frames", None)
    if numbers is None or (path.is_dir() and find_semantickitti(path)):
        raise LabelError(f"{path}: labels of points, or by stamps, cannot be compared; use boxes by frames")
    return labels, set(numbers)


def _boxes(labels: Labels, number: int) -> Boxes:
    truth = labels.truth(Frame.of_arrays(np.empty((0, 3)), index=number))
    parts = [Boxes(), *((truth.targets or Boxes(), truth.ignored) if truth else ())]
    tracks, classes = (tuple(chain(*(getattr(part, name) for part in parts))) for name in ("tracks", "classes"))
    centers, sizes, yaws = (np.concatenate([getattr(one, name) for one in parts]) for name in _ARRAYS)
    return Boxes(tracks, classes, centers, sizes, yaws)


@dataclass
class LabelComparison(Result):
    """Differences of labels: boxes by what was done to them, and the overlap of those that belong together.

    ``changes`` count boxes ``unchanged``, ``moved`` (or turned or resized), with another ``class``, ``added`` and
    ``deleted``. Of the ``frames`` of the second labels, ``only_after`` are not in the first, and ``only_before`` the
    reverse.
    """

    data = (
        "frames only_before only_after boxes_before boxes_after changes good precision recall mean_overlap ids_changed"
    )

    only_before: int = 0
    only_after: int = 0
    frames: int = 0
    boxes_before: int = 0
    boxes_after: int = 0
    changes: Counter[str] = field(default_factory=Counter)
    good: int = 0
    total_overlap: float = 0.0
    _names: dict[str, set[str]] = field(default_factory=dict)

    def add(self, first: Boxes, second: Boxes) -> None:
        """Add a frame."""
        self.frames += 1
        pairs = list(_pairs(overlaps(first, second)))
        for m, k, overlap in pairs:
            self.good += overlap >= _GOOD
            self.total_overlap += overlap
            self._names.setdefault(second.tracks[k], set()).add(first.tracks[m])
            apart_m = np.abs([first.centers[m] - second.centers[k], first.sizes[m] - second.sizes[k]]).max()
            turned = abs((first.yaws[m] - second.yaws[k] + np.pi) % (2 * np.pi) - np.pi)
            moved = bool(apart_m > _SAME_M or turned > _SAME_RAD)
            self.changes["moved"] += moved
            self.changes["class"] += first.classes[m] != second.classes[k]
            self.changes["unchanged"] += not moved and first.classes[m] == second.classes[k]
        self.changes["deleted"] += len(first) - len(pairs)
        self.changes["added"] += len(second) - len(pairs)
        self.boxes_before += len(first)
        self.boxes_after += len(second)

    @property
    def precision(self) -> float | None:
        """Share of the boxes of the first labels that overlap one of the second by at least half of both."""
        return self.good / self.boxes_before if self.boxes_before else None

    @property
    def recall(self) -> float | None:
        """Share of the boxes of the second labels that were found so."""
        return self.good / self.boxes_after if self.boxes_after else None

    @property
    def mean_overlap(self) -> float | None:
        """Mean intersection over union of boxes that belong together."""
        pairs = self.boxes_after - self.changes["added"]
        return self.total_overlap / pairs if pairs else None

    @property
    def ids_changed(self) -> int:
        """Number of objects in the second labels that had several ids in the first."""
        return sum(len(names) > 1 for names in self._names.values())

    def as_text(self) -> str:
        """Return what was corrected, and how good the first labels were."""
        whole = dict.fromkeys(("unchanged", "moved", "class", "added"), self.boxes_after)
        whole["deleted"] = self.boxes_before
        rows = [(kind, f"{self.changes[kind]:,}", share(self.changes[kind], of)) for kind, of in whole.items()]
        overlap = UNKNOWN if self.mean_overlap is None else f"{self.mean_overlap:.2f}"
        recall, precision = (share(self.good, boxes) for boxes in (self.boxes_after, self.boxes_before))
        ids = count(self.ids_changed, "object")
        lines = [
            f"{count(self.frames, 'frame')}: {count(self.boxes_before, 'box')} before, {self.boxes_after:,} after",
            table(("boxes", "number", "share"), rows),
            f"found before: {recall} of the boxes after, with an overlap (IoU) of at least 0.5",
            f"right before: {precision} of the boxes before, with the same overlap",
            f"mean overlap of boxes that belong together: {overlap}",
            f"{ids} had several ids before",
        ]
        if self.only_before:
            lines.append(f"{count(self.only_before, 'frame')} of the labels before have none after, and were left out")
        if self.only_after:
            frames = count(self.only_after, "frame")
            lines.append(f"{frames} of the labels after had none before; their boxes count as added")
        return "\n".join(lines)


def _pairs(overlap: NDArray[np.float64]) -> Iterator[tuple[int, int, float]]:
    """Yield the boxes that belong together, and their overlap: those with the greatest first."""
    rows, columns = np.nonzero(overlap)
    order = np.argsort(-overlap[rows, columns], kind="stable")
    taken: tuple[set[int], set[int]] = (set(), set())
    for m, k in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if m not in taken[0] and k not in taken[1]:
            taken[0].add(m)
            taken[1].add(k)
            yield m, k, float(overlap[m, k])
