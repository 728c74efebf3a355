"""Ditches and canals in land that are narrower than squares."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells
from seaclutter_cli.airborne.quantiles import quantile_of_each
from seaclutter_cli.airborne.reflection import CLEARLY_GROUND, LIKE_GROUND, median_of
from seaclutter_cli.grids.elevation import BLOCK, ElevationGrid
from seaclutter_cli.grids.opening import half_window

Cells = NDArray[np.float64]
Values = NDArray[np.float64]
Mask = NDArray[np.bool_]
Groups = NDArray[np.int64]

DITCH_HEIGHT_M = 0.2
"""Height above the water of a ditch, which has no waves, that makes a point of its bank."""
BANK_M = 0.5
"""By how much more the ground in a cell of a ditch, its bank, may rise than elsewhere."""
_WIDTH_M = 9.0
_DEPTH_M, _FLAT_M = 0.25, 0.08
_LENGTH_M, _AREA_M2, _SPREAD_M = 25.0, 40.0, 0.03
_AROUND_M, _LOW_M, _LOW_SHARE = 31.0, 0.15, 0.05
_HIGH_M, _HIGH_SHARE = 3.0, 0.5


def ditch_levels(
    grid: ElevationGrid, lowest: Cells, land: Mask, water: Mask, variation: Callable[[], Cells | None]
) -> Cells:
    """Return the level of the water in the ditches of a tile, shape (S, 256, 256); NaN elsewhere.

    Parameters
    ----------
    grid : ElevationGrid
        The grid, in S blocks.
    lowest : ndarray, shape (S, 256, 256), float64
        Lowest elevations; plus infinity in empty cells.
    land, water : ndarray, shape (S, 256, 256), bool
        Cells of land, and of the squares of bodies of water.
    variation : callable
        Returns the coefficient of variation of the intensities around each cell, shape (S, 256, 256), or None.

    Notes
    -----
    A ditch is less than nine metres wide, a quarter of a metre deep, 25 m long and 40 m² large. Its lowest elevations
    deviate by at most 3 cm: a dry trench or a sunken road is uneven or slopes. Hardly anything within fifteen metres,
    5 % at most, is as low, unlike around an alley or a yard, and half of it rises less than three metres, unlike
    around a gap between crowns. Where intensities distinguish water from land, a ditch does not reflect like ground.
    """
    ditch = _deep_cells(grid, lowest, land)
    if not ditch.any():
        return np.full(ditch.shape, np.nan)
    part, group = joined_cells(ditch, grid.blocks)
    member = np.where(ditch, group[part], -1)
    level, found = _level_groups(grid, member, lowest, len(group))
    if found.any():
        found &= _are_amid_banks(grid, np.where(ditch & found[member], member, -1), lowest, land & ~ditch, level)
    if found.any() and (varies := variation()) is not None and _distinguish(varies, water):
        own = ditch & found[member] & np.isfinite(varies)
        found &= ~(quantile_of_each(varies[own], member[own], len(group), 0.5) <= CLEARLY_GROUND)
    return np.where(ditch & found[member], level[member], np.nan)


def _deep_cells(grid: ElevationGrid, lowest: Cells, land: Mask) -> Mask:
    """Return the cells of land at the bottom of what is narrow and deep: below the closing, and as low as possible."""
    from scipy import ndimage  # slow to import, not needed without land

    half = half_window(_WIDTH_M, grid.cell_m)
    width, deep = 2 * half + 1, np.zeros(land.shape, np.bool_)
    if not land.any() or not half:
        return deep
    inner = (slice(2 * half, 2 * half + BLOCK),) * 2
    for slot, cells, inside in grid.padded(lowest, 2 * half):
        if not land[slot].any():
            continue
        highest = np.full(cells.shape, np.inf)  # only windows inside the grid count, as in `opened`
        highest[inside] = np.where(np.isfinite(cells[inside]), cells[inside], -np.inf)
        dilated = ndimage.maximum_filter(highest, width)
        closed = ndimage.minimum_filter(np.where(np.isfinite(dilated), dilated, np.inf), width)[inner]
        bottom = ndimage.minimum_filter(cells, width)[inner]
        known = land[slot] & np.isfinite(lowest[slot])
        deep[slot][known] = (closed[known] >= lowest[slot][known] + _DEPTH_M) & (
            lowest[slot][known] <= bottom[known] + _FLAT_M
        )
    return deep


def _level_groups(grid: ElevationGrid, member: Groups, lowest: Cells, groups: int) -> tuple[Values, Mask]:
    """Return the level of each group of cells, and whether it is large, long and level."""
    own = member >= 0
    number, elevation = member[own], lowest[own]
    lower, level, upper = (quantile_of_each(elevation, number, groups, share) for share in (0.1587, 0.5, 0.8413))
    size = np.bincount(number, minlength=groups)
    slot, column, row = np.nonzero(own)
    block = np.array(list(grid.blocks), np.int64).reshape(-1, 2)
    length = np.zeros(groups)
    for axis, inside in enumerate((column, row)):
        position = block[slot, axis] * BLOCK + inside
        first, last = np.full(groups, np.iinfo(np.int64).max), np.full(groups, np.iinfo(np.int64).min)
        np.minimum.at(first, number, position)
        np.maximum.at(last, number, position)
        length = np.maximum(length, np.where(size > 0, last.astype(np.float64) - first + 1, 0))
    is_large = (size * grid.cell_m**2 >= _AREA_M2) & (length * grid.cell_m >= _LENGTH_M)
    return level, is_large & (upper - lower <= 2 * _SPREAD_M)


def _are_amid_banks(grid: ElevationGrid, member: Groups, lowest: Cells, land: Mask, level: Values) -> Mask:
    """Return which groups of cells have hardly any land around them that is as low, and not mostly crowns or walls."""
    from scipy import ndimage

    half = half_window(_AROUND_M, grid.cell_m)
    inner = (slice(half, half + BLOCK),) * 2
    count, low, high = (np.zeros(len(level), np.int64) for _ in range(3))
    for slot, cells, _ in grid.padded(np.where(member >= 0, member.astype(np.float64), np.inf), half):
        if not np.isfinite(cells).any():
            continue
        near = ndimage.minimum_filter(cells, 2 * half + 1)[inner]
        used = np.isfinite(near) & land[slot] & np.isfinite(lowest[slot])
        number = near[used].astype(np.int64)
        rise = lowest[slot][used] - level[number]
        count += np.bincount(number, minlength=len(level))
        low += np.bincount(number[rise < _LOW_M], minlength=len(level))
        high += np.bincount(number[rise > _HIGH_M], minlength=len(level))
    return (count > 0) & (low <= _LOW_SHARE * count) & (high <= _HIGH_SHARE * count)


def _distinguish(variation: Cells, water: Mask) -> bool:
    """Return whether intensities distinguish water from land, as far as known water shows."""
    return not water.any() or bool(median_of(variation[water]) >= LIKE_GROUND)
