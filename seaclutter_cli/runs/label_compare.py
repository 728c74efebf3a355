"""Comparison of labels before and after a person corrected them."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.buckets import on_paths
from seaclutter_cli.errors import LabelError
from seaclutter_cli.evaluation.overlap import overlaps
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.labels import open_labels
from seaclutter_cli.options import function_of
from seaclutter_cli.runs.options.objects import CompareOptions
from seaclutter_cli.runs.recordings import Result
from seaclutter_cli.text import UNKNOWN, count, share, table
from seaclutter_cli.truth import Boxes

_SAME_M, _SAME_RAD = 0.01, 0.001
_GOOD = 0.5


@function_of(CompareOptions)
@on_paths
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
    result = LabelComparison(only_before=len(numbers_before - numbers_after))
    for number in sorted(numbers_after):
        first = _boxes(before, number) if number in numbers_before else Boxes()
        result.add(first, _boxes(after, number))
    return result


def _opened(path: Path) -> tuple[Labels, set[int]]:
    """Return labels and the numbers of their frames; `LabelError` if these are not known."""
    labels = open_labels(path)
    numbers: Sequence[int] | None = getattr(labels, "frames", None)
    if numbers is None:
        raise LabelError(f"{path}: labels of points, or by stamps, cannot be compared; use boxes by frames")
    return labels, set(numbers)


def _boxes(labels: Labels, number: int) -> Boxes:
    """Return the boxes of a frame, targets and areas to ignore."""
    truth = labels.truth(Frame.of_arrays(np.empty((0, 3)), index=number))
    parts = [part for part in (truth.targets, truth.ignored) if part is not None] if truth else []
    return Boxes(
        tuple(name for part in parts for name in part.tracks),
        tuple(name for part in parts for name in part.classes),
        np.concatenate([np.empty((0, 3)), *(part.centers for part in parts)]),
        np.concatenate([np.empty((0, 3)), *(part.sizes for part in parts)]),
        np.concatenate([np.empty(0), *(part.yaws for part in parts)]),
    )


@dataclass
class LabelComparison(Result):
    """Differences of labels: boxes by what was done to them, and the overlap of those that belong together.

    ``changes`` count boxes ``unchanged``, ``moved`` (or turned or resized), with another ``class``, ``added`` and
    ``deleted``. Of ``frames`` of the second labels, ``only_before`` are missing.
    """

    data = "frames only_before boxes_before boxes_after changes good precision recall mean_overlap ids_changed"

    only_before: int = 0
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
            moved = not _same(first, m, second, k)
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
        kinds = ("unchanged", "moved", "class", "added")
        rows = [(kind, self.changes[kind], share(self.changes[kind], self.boxes_after)) for kind in kinds]
        rows.append(("deleted", self.changes["deleted"], share(self.changes["deleted"], self.boxes_before)))
        overlap = UNKNOWN if self.mean_overlap is None else f"{self.mean_overlap:.2f}"
        recall, precision = (share(self.good, boxes) for boxes in (self.boxes_after, self.boxes_before))
        ids = count(self.ids_changed, "object")
        lines = [
            f"{count(self.frames, 'frame')}: {count(self.boxes_before, 'box')} before, {self.boxes_after:,} after",
            table(("boxes", "number", "share"), rows),
            f"found before: {recall} of the boxes after, with an overlap (IoU) of at least 0.5",
            f"right before: {precision} of the boxes before, with the same overlap",
            f"mean overlap of boxes that belong together: {overlap}; {ids} had several ids before",
        ]
        if self.only_before:
            lines.append(f"{count(self.only_before, 'frame')} of the labels before have none after, and were left out")
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


def _same(first: Boxes, m: int, second: Boxes, k: int) -> bool:
    near = np.abs(first.centers[m] - second.centers[k]).max() <= _SAME_M
    turned = abs((first.yaws[m] - second.yaws[k] + np.pi) % (2 * np.pi) - np.pi)
    return bool(near and np.abs(first.sizes[m] - second.sizes[k]).max() <= _SAME_M and turned <= _SAME_RAD)
