"""Indications of the quality of methods without labels: bodies lost, doubtful clusters kept, agreement, water kept."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.suspects.bodies import Bodies

RANGES_M = (0.0, 15.0, 30.0, 60.0, np.inf)
HEIGHTS_M = (-np.inf, 0.0, 0.25, 0.5)
"""Edges of the ranges and heights above the water by which points of the water are counted."""
_SHAPE = len(HEIGHTS_M) - 1, len(RANGES_M) - 1


class Indications:
    """Sums over the frames of recordings for M methods, shape (M,), and what they indicate.

    They count the looks at bodies that are likely targets: ``lost`` and ``found`` are those in which they are lost and
    kept; in neither, the configuration removes them, such as own ship. ``changes`` are those between kept and not,
    within ``seconds``, the times from first to last look at those that are ever lost or kept. ``doubtful`` are the
    looks of unlikely bodies that are kept, and clusters of kept points near the water. ``kept_score`` and
    ``lost_score`` are sums of the scores of all bodies over the looks in which they are kept or lost.

    ``water`` are the points of the water by height and range, shape (H, R), ``water_kept`` those kept, shape (M, H, R);
    ``same``, shape (M, M), the points that two methods treat alike, of all ``points``.
    """

    def __init__(self, methods: int) -> None:
        self.lost, self.found, self.changes, self.doubtful = np.zeros((4, methods), np.int64)
        self.kept_looks, self.lost_looks = np.zeros((2, methods), np.int64)
        self.kept_score, self.lost_score, self.seconds = np.zeros((3, methods))
        self.water, self.water_kept = np.zeros(_SHAPE, np.int64), np.zeros((methods, *_SHAPE), np.int64)
        self.same = np.zeros((methods, methods), np.int64)
        self.frames = self.points = 0

    def update(self, other: "Indications") -> None:
        """Add the frames of another recording, of the same methods."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def add(self, frame: Frame, results: Sequence[FilterResult], bodies: Bodies) -> None:
        """Add a frame with its results and bodies to all but what counts looks at bodies."""
        self.frames += 1
        valid = np.flatnonzero(frame.valid)
        kept = np.array([np.equal(one.reason, Reason.KEPT)[valid] for one in results])
        self.points += len(valid)
        for m, own in enumerate(kept):
            self.same[m] += np.count_nonzero(kept == own, axis=1)
        height = bodies.height_m[valid]
        water = np.flatnonzero(height < HEIGHTS_M[-1])  # false for NaN
        row = np.searchsorted(HEIGHTS_M, height[water], side="right") - 1
        column = np.searchsorted(RANGES_M, frame.range_m[valid[water]], side="right") - 1
        np.add.at(self.water, (row, column), 1)
        for counts, own in zip(self.water_kept, kept[:, water], strict=True):
            np.add.at(counts, (row[own], column[own]), 1)

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
