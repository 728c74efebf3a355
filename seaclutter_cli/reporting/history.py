"""Statistics of a method for every frame, who receives them, and their reduction to what a screen can show."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.evaluation.scores import FrameScore
from seaclutter_cli.frame import WATER_COLUMNS, FilterResult, Frame, Reason
from seaclutter_cli.reporting.sample import Sample
from seaclutter_cli.truth import Truth

Series = NDArray[np.float32]


class History:
    """Statistics of one method with K range rings, or none, for every frame: a few hundred bytes each.

    Columns by name, float32, NaN where unknown: ``counts`` for each `Reason`, shape (frames, 8); ``missed`` and
    ``false_alarms``, shape (frames,); ``water``, shape (frames, 4), in the order of `WATER_COLUMNS`; ``thresholds`` and
    ``corrections``, shape (frames, K).
    """

    def __init__(self, rings: int) -> None:
        sizes = {"counts": len(Reason), "water": len(WATER_COLUMNS), "thresholds": rings, "corrections": rings}
        arrays = [(name, np.float32, (size,)) for name, size in sizes.items()]
        self._type = np.dtype([*arrays, ("missed", np.float32), ("false_alarms", np.float32)])
        self._rows: list[NDArray[np.void]] = []
        self._scenes: list[str] = []

    def add(self, result: FilterResult | None, score: FrameScore | None) -> None:
        """Add a frame; unknown values become NaN."""
        row = np.full((), np.nan, self._type)
        if result is not None:
            row["counts"] = result.counts
            if result.water is not None:
                row["water"] = astuple(result.water)
            if result.rings is not None and row["thresholds"].size:
                row["thresholds"] = result.rings.thresholds
                row["corrections"] = result.rings.corrections
        if score is not None and score.alarms is not None:
            row["missed"], row["false_alarms"] = score.alarms.missed, score.alarms.false_alarms
        self._rows.append(row)
        self._scenes.append((result.scene if result else None) or "")

    def __getitem__(self, name: str) -> Series:
        """Return a column."""
        return np.array(self._rows, self._type)[name]

    @property
    def scenes(self) -> dict[str, NDArray[np.bool_]]:
        """Masks of the frames of each class of scene, shape (frames,), by its name; empty if no class is known."""
        names = np.array(self._scenes, object)
        return {name: names == name for name in sorted(set(self._scenes) - {""})}


@dataclass(frozen=True)
class ScoredFrame:
    """A frame of an evaluation or of a filtered log, with its truth, and result and score by each method."""

    frame: Frame
    results: Sequence[FilterResult | None]
    truth: Truth | None
    scores: Sequence[FrameScore | None]


class FrameListener(ABC):
    """A listener for the frames of an evaluation, or for those that are read back from filtered logs."""

    @abstractmethod
    def begin(self, recording: str) -> None:
        """Start a recording."""

    @abstractmethod
    def add(self, scored: ScoredFrame) -> None:
        """Take a frame."""


MAX_BINS = 600
_COLUMNS, _ROWS = 120, 64


def bin_starts(frames: int) -> NDArray[np.int64]:
    """Return the first frame of each bin, shape (B,), int64; all bins but the last have the same length."""
    size = max(1, -(-frames // MAX_BINS))
    return np.arange(0, frames, size)


def binned(values: Series, starts: NDArray[np.int64]) -> tuple[Series, Series, Series]:
    """Return mean, minimum and maximum of each of B bins, shape (B, K) each; NaN for bins without known values.

    The series, shape (frames, K), are NaN where unknown; a bin begins at each of the frames ``starts``.
    """
    if not len(starts):
        empty = np.empty((0, values.shape[1]), np.float32)
        return empty, empty, empty
    known = np.isfinite(values)
    count = np.add.reduceat(known, starts, axis=0, dtype=np.int64)
    total = np.add.reduceat(np.where(known, values, 0).astype(np.float64), starts, axis=0)
    mean = np.where(count, total / np.maximum(count, 1), np.nan)
    low, high = (reduce.reduceat(values, starts, axis=0) for reduce in (np.fmin, np.fmax))  # where known
    return mean.astype(np.float32), low, high


def density_of(samples: Sequence[Sample], method: int, edges: Sequence[float], threshold: float) -> "Density | None":
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
    return reach_m, low, high, counts.astype(np.float32)


Density = tuple[float, float, float, NDArray[np.float32]]
"""Mean number of points per frame for each `Reason`, shape (8, rows, columns), in cells of equal size.

Columns go from 0 to the range that comes first, rows from the least to the greatest intensity.
"""
