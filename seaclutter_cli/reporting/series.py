"""Reduction of many frames to what a screen can show: bins over time, density over range and intensity."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.frame import Reason
from seaclutter_cli.reporting.sample import Sample

Series = NDArray[np.float32]
MAX_BINS = 600
_COLUMNS, _ROWS = 120, 64


def bin_starts(frames: int) -> NDArray[np.int64]:
    """Return the first frame of each bin, shape (B,), int64; all bins but the last have the same length."""
    size = max(1, -(-frames // MAX_BINS))
    return np.arange(0, frames, size)


def binned(values: Series, starts: NDArray[np.int64]) -> tuple[Series, Series, Series]:
    """Return mean, minimum and maximum of each of B bins, shape (B, K) each; NaN for bins without known values.

    The series, shape (frames, K), are NaN where unknown; a bin begins at each of the frames ``starts``.

    Examples
    --------
    >>> mean, low, high = binned(np.array([[1.0], [3], [np.nan]], np.float32), np.array([0, 2]))
    >>> mean.ravel(), low.ravel(), high.ravel()
    (array([ 2., nan], dtype=float32), array([ 1., nan], dtype=float32), array([ 3., nan], dtype=float32))
    """
    if not len(starts):
        empty = np.empty((0, values.shape[1]), np.float32)
        return empty, empty, empty
    known = np.isfinite(values)
    count = np.add.reduceat(known, starts, axis=0, dtype=np.int64)
    total = np.add.reduceat(np.where(known, values, 0).astype(np.float64), starts, axis=0)
    mean = np.where(count, total / np.maximum(count, 1), np.nan)
    low, high = (
        np.where(count, reduce.reduceat(np.where(known, values, neutral), starts, axis=0), np.nan)
        for reduce, neutral in ((np.minimum, np.inf), (np.maximum, -np.inf))
    )
    return mean.astype(np.float32), low.astype(np.float32), high.astype(np.float32)


@dataclass(frozen=True)
class Density:
    """Mean number of points per frame for each `Reason`, shape (8, rows, columns), in cells of equal size.

    Columns begin at a range of 0, rows between the intensities ``low`` and ``high``.
    """

    reach_m: float
    low: float
    high: float
    counts: NDArray[np.float32]


def density_of(samples: Sequence[Sample], method: int, edges: Sequence[float], threshold: float) -> Density | None:
    """Return the density of the points of several frames by the reasons of a method; None without intensities.

    The rows extend above the highest threshold; there are no edges without range rings.
    """
    if not samples:
        return None
    range_m = np.concatenate([sample.range_m for sample in samples])
    intensity = np.concatenate([sample.intensity for sample in samples]).astype(np.float64)
    weight = np.concatenate([sample.weight for sample in samples]) / len(samples)
    reason = np.concatenate([sample.reasons[method] for sample in samples])
    known = np.isfinite(intensity)
    if not known.any():
        return None
    reach_m = 1.15 * edges[-1] if edges else float(np.quantile(range_m[known], 0.98))
    shown = known & (range_m < reach_m)
    within = intensity[shown & (range_m >= (edges[0] if edges else 0.0))]
    low = min(0.0, float(np.quantile(within, 0.01))) if len(within) else 0.0
    high = max(float(np.quantile(within, 0.985)) if len(within) else 0.0, 1.5 * threshold)
    high = high if high > low else low + 1.0
    whole = bool((intensity[known] == np.floor(intensity[known])).all())
    rows = min(_ROWS, max(int(np.ceil(high - low)), 1)) if whole else _ROWS
    if whole:  # rows of fractional height would leave empty rows between the values
        high = low + rows * float(np.ceil((high - low) / rows))
    bins = ((0, len(Reason)), (low, high), (0, max(reach_m, 1e-3)))
    points = np.stack((reason[shown], intensity[shown], range_m[shown]), axis=1)
    counts, _ = np.histogramdd(points, (len(Reason), rows, _COLUMNS), bins, weights=weight[shown])
    return Density(reach_m, low, high, counts.astype(np.float32))
