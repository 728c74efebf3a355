"""Choice of the best parameter values, and the ideal threshold of a range ring."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.scores import Summary
from seaclutter_cli.truth import CLUTTER, IGNORED


def best(summaries: Mapping[str, Summary]) -> str | None:
    """Return the name of the best summary; None without labelled frames.

    The best summary has the lowest rate of frames with a false alarm plus frames with a missed target
    (:math:`N_{FP} + N_{FN}`). Ties are resolved by the rate of false alarms plus missed targets, then by order.
    """
    labelled = {name: summary for name, summary in summaries.items() if summary.frames}
    if not labelled:
        return None
    return min(labelled, key=lambda name: _error_rates(labelled[name]))


def _error_rates(summary: Summary) -> tuple[float, float]:
    frames = summary.frames  # rates, since a method may be unable to process some frames
    return (summary.n_fp + summary.n_fn) / frames, (summary.false_alarms + summary.missed) / frames


def ideal_threshold(intensity: NDArray[np.float64], points: NDArray[np.int64]) -> float | None:
    """Return the intensity threshold that best separates clutter from targets.

    Parameters
    ----------
    intensity : ndarray, shape (N,), float64
        Intensities of the points of one range ring.
    points : ndarray, shape (N,), int64
        Labels of the points, as in `Truth.points`.

    Returns
    -------
    float or None
        Lowest target intensity T that maximises the sum of the share of clutter below T and the share of target points
        at or above T; None if there are no clutter points or no target points.

    Notes
    -----
    [Li2023] marks it by hand (Fig. 7). The sum of the two shares is Youden's index plus one; it does not depend on the
    numbers of clutter and target points.

    Examples
    --------
    >>> ideal_threshold(np.array([1.0, 2, 3, 9, 4, 8, 20]), np.array([0, 0, 0, 0, 5, 5, 5]))
    4.0
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
