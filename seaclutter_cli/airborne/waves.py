"""Waves in windows of a tile, and of its water: height, length and oscillation of the lowest echo of each cell."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Ints, Mask
from seaclutter_cli.grids.elevation import BLOCK, Cells

SQUARES = BLOCK // 8
"""Number of squares along each side of a block."""
_FEW_CELLS, _MANY_CELLS = 600, 4096
_DEVIATIONS = 4.0
_MOST_M = 1.5
_ROUGHEST, _LEAST_DEPTH = 0.75, 0.15
_CRESTS = 4.0
_LENGTH_M = 30.0
_MAX_TILT = 0.5
"""Deviation of a plane through waves, at most, relative to that of the waves."""
_REACH_CELLS = 64
_REACH = np.r_[0 : _REACH_CELLS + 1]
_LAGS = np.r_[_REACH, -_REACH[:0:-1]]
_SPARSE, _CERTAIN = 0.5, 5.0


class WindowWaves:
    """Waves in the window around each of N squares; NaN if unknown.

    They are made from looks, as in `windows_of`, and the indices of the squares among those of all blocks.

    ``level_m``, ``deviation_m``, shape (N,): median and standard deviation of the elevation, from the median downwards:
    objects stand above the water; ``depth``, ``length_m``, shape (N,): depth of the minimum of the autocovariance
    relative to the variance, 0 without any, and wave length; ``tilt``, shape (N,): deviation of a plane relative to
    that of the elevations; ``skew``, ``tail``, shape (N,): upper by lower quartile distance, and lower quartile
    distance by deviation: of waves 1 and 0.67.
    """

    def __init__(self, looks: Iterable[Cells], cell_m: float, index: Ints) -> None:
        slot, inside = np.divmod(index, SQUARES**2)
        row, column = (place // (SQUARES // 2) for place in np.divmod(inside, SQUARES))
        found = windows_of(looks, cell_m)[0][:, 4 * slot + 2 * row + column]
        self.level_m, self.deviation_m, self.depth, self.length_m, self.tilt, self.skew, self.tail = found

    def features(self, level_m: Floats) -> dict[str, Floats]:
        """Return the features of squares with these levels."""
        named = {**vars(self), "above": np.abs(level_m - self.level_m) / (self.deviation_m + 0.02)}
        del named["level_m"]
        return {f"waves: {name.removesuffix('_m')}": values for name, values in named.items()}


def windows_of(looks: Iterable[Cells], cell_m: float) -> tuple[Floats, Ints]:
    """Return what `WindowWaves` has of the quarters of S blocks, shape (7, 4 S), and their number of cells, (4 S,).

    ``looks`` are the lowest elevations of each look, shape (S, 256, 256); the one with most cells in a window counts.
    """
    found, most = np.empty((7, 0)), np.empty(0, np.int64)
    for lowest in looks:
        if not most.size:
            found, most = np.full((7, 4 * len(lowest)), np.nan), np.zeros(4 * len(lowest), np.int64)
        for number, part in enumerate(_quarters(lowest)):
            cells = int(np.isfinite(part).sum())
            if cells >= _FEW_CELLS and cells > most[number]:
                most[number], found[:, number] = cells, _waves(part, cell_m)
    return found, most


def _quarters(cells: Cells) -> Iterator[Cells]:
    """Yield the quarters of blocks, windows of 128 by 128 cells, column by column."""
    yield from (half for block in cells for side in np.split(block, 2) for half in np.split(side, 2, axis=1))


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
    middle = _quantile(deviation, weight, 0.5)
    clear = (depth >= _LEAST_DEPTH) & (deviation >= middle / 2)
    long = _quantile(length[clear], weight[clear], 0.5) if clear.any() else _LENGTH_M
    crest, size = _crests(np.where(water, above, np.inf))
    return Waves(float(np.median(level_m[water])), middle, long, _quantile(crest, size, _ROUGHEST))


def _crests(above: Cells) -> Floats:
    """Return the height of crests above the opened surface in each quarter of the blocks, and its number of cells."""
    found = []
    for cells in _quarters(above):
        part = cells[::2, ::2][np.isfinite(cells[::2, ::2])]
        low, middle = np.quantile(part, (0.1587, 0.5)) if len(part) else (0.0, 0.0)
        found.append((middle + _CRESTS * (middle - low), len(part)))
    return np.array(found).T


def _quantile(values: Floats, weight: Floats | Ints, share: float) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, share * total[-1])])


def oscillation(elevation: Cells, water: Mask, step: int = 1) -> tuple[float, float]:
    """Return the wave length in cells, and the depth of the minimum of the autocovariance relative to the variance.

    ``elevation``, shape (n, m): elevations above the level of the water; ``water``, shape (n, m): cells of the water;
    the others do not count; ``step``: every so many cells are in the arrays.

    Sums of products of pairs are not divided by the number of pairs, so that of many minima the nearest is the deepest.
    A sparse grid has few pairs: there, each sum is scaled to the pairs that a full grid would have, and a minimum needs
    a depth of 5 standard errors.
    """
    covariance = _products(np.where(water, elevation, 0))
    correlation = covariance / max(float(covariance[0, 0]), 1e-12)
    beside = water[1:][water[:-1]]  # whether the neighbours of cells are known
    if len(beside) and beside.mean() < _SPARSE:
        pairs = np.maximum(_products(water), 1)
        rows, columns = (1 - np.abs(lags) / side for lags, side in zip((_REACH, _LAGS), water.shape, strict=True))
        correlation *= rows[:, None] * columns * pairs[0, 0] / pairs
        correlation[-correlation < _CERTAIN / np.sqrt(pairs)] = 0
    i, j = np.unravel_index(np.argmin(correlation), correlation.shape)
    if max(_REACH[i], abs(_LAGS[j])) == _REACH_CELLS:
        # Over more than half of its width, or in part of a block, a slope has a minimum, too.
        slope = tilt(np.where(water, elevation, np.inf)) if water.any() else np.inf
        if len(elevation) < 4 * _REACH_CELLS or slope > _MAX_TILT * float(elevation[water].std()):
            return 0.0, 0.0
        return oscillation(elevation[::2, ::2], water[::2, ::2], 2 * step)
    return 2 * step * float(np.hypot(_REACH[i], _LAGS[j])), -float(correlation[i, j])


def _products(values: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Return the sums of products of pairs of cells, by lag in half of all directions: shape (65, 129)."""
    shape = [side + _REACH_CELLS for side in values.shape]
    spectrum = np.fft.rfft2(values.astype(np.float32), shape)
    power = spectrum.real**2 + spectrum.imag**2
    return np.fft.irfft2(power, shape)[_REACH][:, _LAGS]  # the other half is the same, mirrored


def tilt(lowest: Cells) -> float:
    """Return the standard deviation of a plane through the finite cells: large on slopes, small on waves."""
    known = np.isfinite(lowest)
    place = np.stack(np.nonzero(known)).astype(np.float64)
    place -= place.mean(axis=1, keepdims=True)
    slope = place @ (lowest[known] - lowest[known].mean()) / (place**2).sum(axis=1)
    return float((slope @ place).std())
