"""Indications of the quality of methods without labels: bodies lost, doubtful clusters kept, agreement, water kept."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np

from seaclutter_cli.arrays import Ints
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.suspects.finder import SuspectFinder, Tally
from seaclutter_cli.water import Mounting

RANGES_M = (0.0, 15.0, 30.0, 60.0, np.inf)
HEIGHTS_M = (-np.inf, 0.0, 0.25, 0.5)
"""Edges of the ranges and heights above the water by which points of the water are counted."""
_SHAPE = len(HEIGHTS_M) - 1, len(RANGES_M) - 1


@dataclass
class Indications(Tally):
    """Sums over the frames of recordings for M methods, and what they indicate.

    ``water`` are the points of the water by height and range, shape (H, R), ``water_kept`` those kept, shape (M, H, R);
    ``same``, shape (M, M), the points that two methods treat alike, of all ``points``.
    """

    frames: int = 0
    points: int = 0
    water: Ints = field(default_factory=lambda: np.zeros(_SHAPE, np.int64))
    water_kept: Ints = field(default_factory=lambda: np.zeros((0, *_SHAPE), np.int64))
    same: Ints = field(default_factory=lambda: np.zeros((0, 0), np.int64))

    @classmethod
    def of(cls, methods: int) -> Self:
        """Return the sums over no frame."""
        sums = super().of(methods)
        sums.water_kept = np.zeros((methods, *_SHAPE), np.int64)
        sums.same = np.zeros((methods, methods), np.int64)
        return sums

    def update(self, other: "Indications") -> None:
        """Add the frames of another recording, of the same methods."""
        for item in fields(self):
            setattr(self, item.name, getattr(self, item.name) + getattr(other, item.name))

    def of_method(self, m: int) -> dict[str, Any]:
        """Return what the sums indicate for a method; None where there is nothing to count."""
        lost, found, doubtful = (int(one[m]) for one in (self.lost, self.found, self.doubtful))
        others = [self.same[m, k] for k in range(len(self.lost)) if k != m]
        return {
            "targets_lost": _ratio(lost, lost + found),
            "doubtful_per_frame": _ratio(doubtful, self.frames),
            "f1": _ratio(2 * found, (lost + found) and 2 * found + lost + doubtful),
            "changes_per_minute": _ratio(60 * self.changes[m], self.seconds[m]),
            "score_of_kept": _ratio(self.kept_score[m], self.kept_looks[m]),
            "score_of_removed": _ratio(self.lost_score[m], self.lost_looks[m]),
            "water_kept": _ratio(self.water_kept[m].sum(), self.water.sum()),
            "water_kept_by_height_and_range": [
                [_ratio(kept, points) for kept, points in zip(*row, strict=True)]
                for row in zip(self.water_kept[m], self.water, strict=True)
            ],
            "agreement": _ratio(sum(others), self.points * len(others)),
        }


def _ratio(part: float, whole: float) -> float | None:
    return float(part / whole) if whole else None


class Indicator:
    """Collector of the indications of a recording for several methods."""

    def __init__(self, methods: int, mounting: Mounting | None = None) -> None:
        self._sums = Indications.of(methods)
        self._finder = SuspectFinder(methods, mounting, self._sums)

    def add(self, frame: Frame, results: Sequence[FilterResult | None]) -> None:
        """Add a frame with its results; one that a method could not use, which has None, counts for none."""
        if None in results:
            return
        bodies, sums = self._finder.add(frame, results), self._sums
        sums.frames += 1
        valid = np.flatnonzero(frame.valid)
        kept = np.array([np.equal(one.reason, Reason.KEPT)[valid] for one in results if one])
        sums.points += len(valid)
        for m, own in enumerate(kept):
            sums.same[m] += np.count_nonzero(kept == own, axis=1)
        height = bodies.height_m[valid]
        water = np.flatnonzero(height < HEIGHTS_M[-1])  # false for NaN
        row = np.searchsorted(HEIGHTS_M, height[water], side="right") - 1
        column = np.searchsorted(RANGES_M, frame.range_m[valid[water]], side="right") - 1
        np.add.at(sums.water, (row, column), 1)
        for counts, own in zip(sums.water_kept, kept[:, water], strict=True):
            np.add.at(counts, (row[own], column[own]), 1)

    def finish(self) -> Indications:
        """Return the sums."""
        self._finder.finish()
        return self._sums
