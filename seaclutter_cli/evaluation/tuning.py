"""Choice of parameter values: scores of the parts of a recording, the best values, ideal thresholds."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.scores import FrameScore, Summary
from seaclutter_cli.truth import CLUTTER, IGNORED

K = TypeVar("K")
_MAX_PARTS = 64


def best(summaries: Mapping[K, Summary]) -> K | None:
    """Return the name of the best summary; None without labelled frames.

    The best summary has the lowest rate of frames with a false alarm plus frames with a missed target
    (:math:`N_{FP} + N_{FN}`). Ties are resolved by the rate of false alarms plus missed targets, then by order.
    """
    labelled = {name: summary for name, summary in summaries.items() if summary.frames}
    # Rates, since a method may be unable to process some frames.
    errors = {
        name: ((one.n_fp + one.n_fn) / one.frames, (one.false_alarms + one.missed) / one.frames)
        for name, one in labelled.items()
    }
    return min(errors, key=lambda name: errors[name], default=None)


def ideal_threshold(intensity: NDArray[np.float64], points: NDArray[np.int64]) -> float | None:
    """Return the intensity threshold that best separates clutter from targets in one range ring.

    It is the lowest target intensity T that maximises the sum of the share of clutter below T and the share of target
    points at or above T, which is Youden's index plus one; None without clutter or without target points. [Li2023]
    marks it by hand (Fig. 7). The labels of the points are those of `Truth.points`; both arrays have shape (N,).
    """
    clutter = np.sort(intensity[points == CLUTTER])
    target = np.sort(intensity[(points != CLUTTER) & (points != IGNORED)])
    if not len(clutter) or not len(target):
        return None
    # A higher threshold loses a target point only above its intensity, so target intensities are the candidates.
    thresholds = np.unique(target)
    below = np.searchsorted(clutter, thresholds, side="left") / len(clutter)
    kept = 1 - np.searchsorted(target, thresholds, side="left") / len(target)
    return float(thresholds[np.argmax(np.round(below + kept, 12))])


class Parts:
    """Scores of several methods in consecutive parts of a recording, in bounded memory, to hold out its end.

    All parts but the last have the same number of labelled frames: one, until there are 64 parts; then every two parts
    are joined.
    """

    def __init__(self, methods: int) -> None:
        self._methods = methods
        self._parts: list[list[Summary]] = []
        self._part_frames, self._frames_in_last = 1, 1

    def add(self, scores: Sequence[FrameScore | None]) -> None:
        """Add a labelled frame: the score of each method, None for a method that could not use it."""
        if self._frames_in_last == self._part_frames or not self._parts:
            if len(self._parts) == _MAX_PARTS:
                self._parts = [self._sums(self._parts[k : k + 2]) for k in range(0, _MAX_PARTS, 2)]
                self._part_frames *= 2
            self._parts.append(self._sums([]))
            self._frames_in_last = 0
        self._frames_in_last += 1
        for summary, score in zip(self._parts[-1], scores, strict=True):
            if score is not None:
                summary.add(score, None)

    def split(self, share: float) -> tuple[list[Summary], list[Summary]]:
        """Return the sums of the frames before the end, and of a share of the frames at the end, for each method.

        With a share between 0 and 1, both sums have a frame if there are two.
        """
        end = round(share * len(self._parts))
        if 0 < share < 1:
            end = min(max(end, 1), len(self._parts) - 1)
        first = len(self._parts) - end
        return self._sums(self._parts[:first]), self._sums(self._parts[first:])

    def _sums(self, parts: Sequence[Sequence[Summary]]) -> list[Summary]:
        sums = [Summary() for _ in range(self._methods)]
        for part in parts:
            for total, summary in zip(sums, part, strict=True):
                total.update(summary)
        return sums
