"""Decks, rafts and sandbanks in rough water: higher than the water around them, and more even than waves."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells, smoothed
from seaclutter_cli.airborne.steps import mean_edge
from seaclutter_cli.airborne.waves import Waves
from seaclutter_cli.grids.elevation import ElevationGrid

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

_HIGH, _EDGE = 2.0, 1.0
_EVEN, _STRAIGHT = 0.3, 0.7
_LEAST_KNOWN, _LEAST_LINES, _LEAST_CELLS = 6, 3, 8
_REACH_CELLS, _THICK_M = 3.0, 0.1
_SUM, _SECOND_DIFFERENCE = (1.0, 1.0, 1.0), (1.0, -2.0, 1.0)


def decks(grid: ElevationGrid, lowest: Cells, used: Mask, waves: Waves) -> Mask:
    """Return the cells of even surfaces above the level of rough water, shape (S, 256, 256).

    Parameters
    ----------
    grid : ElevationGrid
        Grid of the points of one strip.
    lowest : ndarray, shape (S, 256, 256), float64
        Lowest elevations; plus infinity in empty cells.
    used : ndarray, shape (S, 256, 256), bool
        Cells with points that may be water.
    waves : Waves
        Waves of the tile.

    Notes
    -----
    A deck as high as the crests looks like one, but is more even: eight or more connected cells are higher than two
    standard deviations of the waves, and the three by three cells around each deviate by less than 0.3 of the median.
    Crests of smooth swell are level, too, but they are curved more than the water beside them: second differences along
    both axes must be less than 0.7 of their median. Cells around that are within 0.1 m of a deck are a part of it. Its
    edge must be one standard deviation of the waves above the cells beside it, on average; beside the top of a crest is
    the rest of the crest.
    """
    deviation, curvature = _unevenness(grid, np.where(used, lowest, np.inf))
    known = used & np.isfinite(deviation) & np.isfinite(curvature)
    if not known.any():
        return known
    even = known & (lowest - waves.level_m > _HIGH * waves.deviation_m)
    for values, most in ((deviation, _EVEN), (curvature, _STRAIGHT)):
        even &= values < most * np.median(values[known])
    part, group = joined_cells(even, grid.blocks)
    even &= (np.bincount(group[part[even]], minlength=len(group)) >= _LEAST_CELLS)[group[part]]
    if not even.any():
        return even
    level, share = smoothed(grid, np.where(even, lowest, 0), even, _REACH_CELLS)
    beside = used & (share > 0) & (np.abs(np.where(used, lowest, np.inf) - level) <= _THICK_M)
    part, group = joined_cells(even | beside, grid.blocks)
    member = group[part]
    deck = np.zeros(int(member.max()) + 1, np.bool_)
    deck[member[even]] = True
    deck &= mean_edge(grid, lowest, used, member) > _EDGE * waves.deviation_m
    return np.asarray(deck[member])


def _unevenness(grid: ElevationGrid, lowest: Cells) -> tuple[Cells, Cells]:
    """Return the deviation of the three by three cells around each, and their second difference; infinite if unknown.

    The second difference is the root of the mean square along the three rows and the three columns.
    """
    deviation, curvature = (np.full(lowest.shape, np.inf) for _ in range(2))
    for slot, cells, _ in grid.padded(lowest, 1):
        known = np.isfinite(cells)
        if not known.any():
            continue
        above = np.where(known, cells - np.median(cells[known]), 0)
        number, total, power = (_around(values) for values in (known, above, above**2))
        lines, bends = np.zeros(cells.shape), np.zeros(cells.shape)
        for axis in (0, 1):
            whole = _along(known, axis) == len(_SUM)
            bend = np.where(whole, _along(above, axis, _SECOND_DIFFERENCE), 0)
            lines += _along(whole, 1 - axis)
            bends += _along(bend**2, 1 - axis)
        variance = power / np.maximum(number, 1) - (total / np.maximum(number, 1)) ** 2
        inner = slice(1, -1), slice(1, -1)
        deviation[slot] = np.where(number >= _LEAST_KNOWN, np.sqrt(np.maximum(variance, 0)), np.inf)[inner]
        curvature[slot] = np.where(lines >= _LEAST_LINES, np.sqrt(bends / np.maximum(lines, 1)), np.inf)[inner]
    return deviation, curvature


def _around(values: NDArray[np.generic]) -> Cells:
    """Return the sum over the three by three cells around each."""
    return _along(_along(values, 0), 1)


def _along(values: NDArray[np.generic], axis: int, weights: Sequence[float] = _SUM) -> Cells:
    """Return the weighted sum over each cell and both beside it along an axis."""
    from scipy import ndimage  # slow to import, not needed on calm water

    return np.asarray(ndimage.correlate1d(values.astype(np.float64), weights, axis, mode="constant"))
