"""Which of several parameter values is best, and what threshold would have been."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.scores import Summary
from seaclutter_cli.truth import CLUTTER, IGNORED


def best(summaries: Mapping[str, Summary]) -> str | None:
    """Return the name of the best of several summaries; None if none has a labelled frame.

    That is the one with the fewest bad frames, those with a false alarm and those with an omitted one counted alike
    (:math:`N_{FP} + N_{FN}`); among equals the one with the fewest false and omitted alarms; among those the first.
    """
    labelled = {name: summary for name, summary in summaries.items() if summary.frames}
    if not labelled:
        return None
    return min(labelled, key=lambda name: _badness(labelled[name]))


def _badness(summary: Summary) -> tuple[float, float]:
    frames = summary.frames  # rates, since a method may not have been able to use all frames
    return (summary.n_fp + summary.n_fn) / frames, (summary.false_alarms + summary.omitted) / frames


def ideal_threshold(intensity: NDArray[np.float64], points: NDArray[np.int64]) -> float | None:
    """Return the threshold that best separates clutter from targets.

    Parameters
    ----------
    intensity : ndarray, shape (N,), float64
        Intensities of one ring's points.
    points : ndarray, shape (N,), int64
        What they are, as in `Truth.points`.

    Returns
    -------
    float or None
        The lowest threshold T for which the share of clutter below T and the share of target points at or above T have
        the greatest sum; None where the ring has no clutter or no target.

    Notes
    -----
    S0 marks it by hand (Fig. 7). The sum of the two shares is Youden's index plus one; it does not depend on how many
    points clutter and targets have.

    Examples
    --------
    >>> ideal_threshold(np.array([1.0, 2, 3, 9, 4, 8, 20]), np.array([0, 0, 0, 0, 5, 5, 5]))
    4.0
    """
    clutter = np.sort(intensity[points == CLUTTER])
    target = np.sort(intensity[(points != CLUTTER) & (points != IGNORED)])
    if not len(clutter) or not len(target):
        return None
    # Only at a target's intensity can a higher threshold begin to lose.
    thresholds = np.unique(target)
    below = np.searchsorted(clutter, thresholds, side="left") / len(clutter)
    kept = 1 - np.searchsorted(target, thresholds, side="left") / len(target)
    return float(thresholds[np.argmax(np.round(below + kept, 12))])
