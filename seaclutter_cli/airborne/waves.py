"""Waves in windows of a tile, and of its water: height, length and oscillation of the lowest echo of each cell."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.oscillation import oscillation, tilt
from seaclutter_cli.grids.elevation import BLOCK

Cells = NDArray[np.float64]
Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

SQUARES = BLOCK // 8
"""Number of squares along each side of a block."""
WINDOW = BLOCK // 2
"""Width of a window in cells."""
_FEW_CELLS, _MANY_CELLS = 600, 4096
_DEVIATIONS = 4.0
_MOST_M = 1.5
_ROUGHEST, _LEAST_DEPTH = 0.75, 0.15
_CRESTS, _HIGHEST = 4.0, 1.25
_LENGTH_M = 30.0


@dataclass(frozen=True)
class WindowWaves:
    """Waves in the window around each of N squares; NaN if unknown.

    ``level_m``, ``deviation_m``, shape (N,): median and standard deviation of the elevation, from the median downwards:
    objects stand above the water; ``depth``, ``length_m``, shape (N,): depth of the minimum of the autocovariance
    relative to the variance, 0 without any, and wave length; ``tilt``, shape (N,): deviation of a plane relative to
    that of the elevations; ``skew``, ``tail``, shape (N,): upper by lower quartile distance, and lower quartile
    distance by deviation: of waves 1 and 0.67.
    """

    level_m: Values
    deviation_m: Values
    depth: Values
    length_m: Values
    tilt: Values
    skew: Values
    tail: Values

    def features(self, level_m: Values) -> dict[str, Values]:
        """Return the features of squares with these levels."""
        return {
            "waves: deviation": self.deviation_m,
            "waves: depth": self.depth,
            "waves: length": self.length_m,
            "waves: tilt": self.tilt,
            "waves: skew": self.skew,
            "waves: tail": self.tail,
            "waves: above": np.abs(level_m - self.level_m) / (self.deviation_m + 0.02),
        }


def window_waves(looks: Iterable[Cells], cell_m: float, index: NDArray[np.int64]) -> WindowWaves:
    """Return the waves around squares with these indices among those of all blocks, of looks as in `windows_of`."""
    found, _ = windows_of(looks, cell_m)
    slot, inside = np.divmod(index, SQUARES**2)
    row, column = (place // (SQUARES // 2) for place in np.divmod(inside, SQUARES))
    return WindowWaves(*found[:, 4 * slot + 2 * row + column])


def windows_of(looks: Iterable[Cells], cell_m: float) -> tuple[Values, NDArray[np.int64]]:
    """Return what `WindowWaves` has of the quarters of S blocks, shape (7, 4 S), and their number of cells, (4 S,).

    ``looks`` are the lowest elevations of each look, shape (S, 256, 256); the one with most cells in a window counts.
    """
    found, most = np.empty((7, 0)), np.empty(0, np.int64)
    for lowest in looks:
        if not most.size:
            found, most = np.full((7, 4 * len(lowest)), np.nan), np.zeros(4 * len(lowest), np.int64)
        for number, (slot, row, column) in enumerate(np.ndindex(len(lowest), 2, 2)):
            part = lowest[slot, row * WINDOW : (row + 1) * WINDOW, column * WINDOW : (column + 1) * WINDOW]
            cells = int(np.isfinite(part).sum())
            if cells >= _FEW_CELLS and cells > most[number]:
                most[number], found[:, number] = cells, _waves(part, cell_m)
    return found, most


def _waves(lowest: Cells, cell_m: float) -> tuple[float, ...]:
    known = np.isfinite(lowest)
    step = (int(known.sum()) // _MANY_CELLS) | 1
    low, lower, level, upper = np.quantile(lowest[known][::step], (0.1587, 0.25, 0.5, 0.75)).tolist()
    deviation = level - low
    length = depth = 0.0
    if deviation <= _MOST_M:
        near = known & (np.abs(np.where(known, lowest, level) - level) <= _DEVIATIONS * deviation)
        length, depth = oscillation(lowest - level, near)
    slope = tilt(lowest) / (deviation + 0.01)
    skew, tail = (upper - level) / (level - lower + 0.01), (level - lower) / (deviation + 0.01)
    return level, deviation, depth, length * cell_m, slope, skew, tail


@dataclass(frozen=True)
class Waves:
    """Waves of a tile, as a quarter of its water exceeds them.

    ``level_m``, ``deviation_m``: level of the water, and standard deviation of its elevation; ``length_m``: length of
    the highest waves; ``crest_m``: height of the crests above the opened surface.
    """

    level_m: float
    deviation_m: float
    length_m: float
    crest_m: float

    @property
    def height_m(self) -> float:
        """Significant wave height."""
        return 4 * self.deviation_m

    @property
    def highest_m(self) -> float:
        """Height that the highest crests may reach above the opened surface, which lies in the troughs."""
        return max(self.crest_m, _HIGHEST * self.height_m)


def estimate_waves(looks: Iterable[Cells], above: Cells, level_m: Cells, water: Mask, cell_m: float) -> Waves | None:
    """Return the waves of a tile; None without enough water.

    ``looks``, shape (S, 256, 256): lowest elevations that each look of the tile shows; ``above``, shape (S, 256, 256):
    height of the lowest elevations of all looks above the opened surface; ``level_m``, shape (S, 256, 256): level of
    the water around each cell; ``water``, shape (S, 256, 256): cells of water; ``cell_m``: width of a cell.
    """
    windows, cells = windows_of((np.where(water, lowest - level_m, np.inf) for lowest in looks), cell_m)
    known = np.flatnonzero(cells)
    if not len(known):
        return None
    _, deviation, depth, length = windows[:4, known]
    weight = cells[known]
    clear = (depth >= _LEAST_DEPTH) & (deviation >= _quantile(deviation, weight, 0.5) / 2)
    long = _quantile(length[clear], weight[clear], 0.5) if clear.any() else _LENGTH_M
    crests, sizes = zip(*(_crest(part) for part in _quarters(np.where(water, above, np.inf))), strict=True)
    crest = _quantile(np.array(crests), np.array(sizes), _ROUGHEST)
    return Waves(float(np.median(level_m[water])), _quantile(deviation, weight, 0.5), long, crest)


def _quarters(cells: Cells) -> Iterable[Values]:
    """Yield the finite values of each quarter of the blocks."""
    half = cells.shape[1] // 2
    for slot, row, column in np.ndindex(len(cells), 2, 2):
        part = cells[slot, row * half : (row + 1) * half : 2, column * half : (column + 1) * half : 2]
        yield part[np.isfinite(part)]


def _crest(above: Values) -> tuple[float, int]:
    """Return the height of the crests of water, from heights above the opened surface, and the number of cells."""
    if not len(above):
        return 0.0, 0
    low, middle = np.quantile(above, (0.1587, 0.5))
    return float(middle + _CRESTS * (middle - low)), len(above)


def _quantile(values: Values, weight: Values | NDArray[np.int64], share: float) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, share * total[-1])])
