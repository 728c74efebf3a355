"""Squares of eight by eight cells: their level, flatness, neighbours and waves, which distinguish water from land."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.part_waves import PART_CELLS, PartWaves
from seaclutter_cli.grids.elevation import BLOCK, ElevationGrid

Values = NDArray[np.float64]
Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]
Value = TypeVar("Value", bound=np.generic)

SIDE = 8
"""Width of a square in cells."""
LEAST_SQUARES = 6
"""Squares that make a region; the opening takes what is smaller for an object."""
RELIEF_M = 0.03
"""Deviation of levels from which they are relief if two strips show them alike."""
_PER_BLOCK = BLOCK // SIDE
_LEAST_CELLS = 6
_STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
_FAR = 1 << 31
_AT_LEVEL, _NEAR_LEVEL_M = 4.0, 0.2
_LEAST_SHARED, _LEAST_RELIEF = 16, 0.5
_CLEAR_CHANGE = 0.05
_LEAST_AROUND, _LEAST_MOVING_M = 6, 0.05


@dataclass(frozen=True)
class Squares:
    """The N squares of a tile in which enough cells have points.

    Parameters
    ----------
    index : ndarray, shape (N,), int64
        Index of each square among those of all blocks.
    xy : ndarray, shape (2, N), int64
        Column and row.
    level_m, spread_m : ndarray, shape (N,), float64
        Median of the lowest elevations, and half the distance between their 16th and 84th percentile; of the cells on
        the opened surface, if there are enough.
    open_share : ndarray, shape (N,), float64
        Share of these cells among those with points.
    top_m : ndarray, shape (N,), float64
        The highest of the lowest elevations of all cells.
    sill_m : ndarray, shape (2, N), float64
        Height that all ways across reach, from column to column and from row to row: that of a wall, not of a tree.
    neighbor : ndarray, shape (4, N), int64
        Index of the square on each side; -1 for none.
    side_m : float
        Width of a square.
    """

    index: NDArray[np.int64]
    xy: NDArray[np.int64]
    level_m: Values
    spread_m: Values
    open_share: Values
    top_m: Values
    sill_m: Values
    neighbor: NDArray[np.int64]
    side_m: float


def squares_of(grid: ElevationGrid, lowest: Cells, on_surface: Mask) -> Squares:
    """Return the squares of a grid.

    Parameters
    ----------
    grid : ElevationGrid
        The grid, in S blocks.
    lowest : ndarray, shape (S, 256, 256), float64
        Lowest elevations; plus infinity in empty cells.
    on_surface : ndarray, shape (S, 256, 256), bool
        Cells whose lowest echo is on the opened surface.
    """
    known, low = (_by_square(values) for values in (on_surface, lowest))
    filled = np.isfinite(low).sum(axis=1)
    index = np.flatnonzero(filled >= _LEAST_CELLS)
    known, low, filled = known[index], low[index], filled[index]
    share = known.sum(axis=1) / np.maximum(filled, 1)
    enough = known.sum(axis=1) >= _LEAST_CELLS
    used = np.where(enough[:, None], known, np.isfinite(low))
    ordered = np.sort(np.where(used, low, np.inf), axis=1)
    last, row = used.sum(axis=1) - 1, np.arange(len(index))
    lower, level, upper = (ordered[row, np.rint(part * last).astype(np.int64)] for part in (0.1587, 0.5, 0.8413))
    cells = np.where(np.isfinite(low), low, -np.inf).reshape(-1, SIDE, SIDE)
    sill = np.stack([cells.max(axis=way).min(axis=1) for way in (1, 2)])
    share, xy = np.where(enough, share, 0), positions(grid, index)
    top, neighbor = cells.max(axis=(1, 2)), _neighbors(xy)
    return Squares(index, xy, level, (upper - lower) / 2, share, top, sill, neighbor, SIDE * grid.cell_m)


def _by_square(values: NDArray[Value]) -> NDArray[Value]:
    split = values.reshape(-1, _PER_BLOCK, SIDE, _PER_BLOCK, SIDE)
    return split.transpose(0, 1, 3, 2, 4).reshape(-1, SIDE * SIDE)


def by_cell(values: NDArray[Value]) -> NDArray[Value]:
    """Return values of all squares of S blocks, shape (S * 32 * 32,), for all cells, shape (S, 256, 256)."""
    blocks = values.reshape(-1, _PER_BLOCK, _PER_BLOCK)
    return np.repeat(np.repeat(blocks, SIDE, axis=1), SIDE, axis=2)


def squares_in(grid: ElevationGrid) -> int:
    """Return the number of squares of all blocks."""
    return len(grid.blocks) * _PER_BLOCK**2


def square_of(cell: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the square of each cell, both as indices."""
    # Columns are counted through all blocks; sides are powers of two, for which this is much faster than `np.divmod`.
    return np.asarray(cell // (BLOCK * SIDE) * _PER_BLOCK + (cell & (BLOCK - 1)) // SIDE)


def positions(grid: ElevationGrid, index: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return column and row of squares, shape (2, N), from their indices."""
    block = np.array(list(grid.blocks), np.int64).reshape(-1, 2)
    slot, inside = np.divmod(index, _PER_BLOCK**2)
    return np.asarray(block[slot].T * _PER_BLOCK + np.stack(np.divmod(inside, _PER_BLOCK)))


def _neighbors(xy: NDArray[np.int64]) -> NDArray[np.int64]:
    key = xy[0] * _FAR + xy[1]
    order = np.argsort(key)
    found = np.full((len(_STEPS), len(key)), -1, np.int64)
    for own, (dx, dy) in zip(found, _STEPS, strict=True):
        wanted = key + dx * _FAR + dy
        at = np.minimum(np.searchsorted(key[order], wanted), max(len(key) - 1, 0))
        if len(key):
            hit = key[order][at] == wanted
            own[hit] = order[at[hit]]
    return found


@dataclass(frozen=True)
class SquareWaves:
    """Waves in each of N squares.

    Parameters
    ----------
    level_m, deviation_m : ndarray, shape (N,), float64
        Level of the water around the waves, and their standard deviation; the level of the square, and 0, if there are
        none.
    length_m : ndarray, shape (N,), float64
        Length of the waves; 0 without waves.
    measured : ndarray, shape (N,), bool
        Whether the waves were measured there, not only beside it.
    """

    level_m: Values
    deviation_m: Values
    length_m: Values
    measured: Mask


def waves_of(
    squares: Squares, centers: Values, parts: Sequence[PartWaves], change_m: Values, ground: Mask | None = None
) -> SquareWaves:
    """Return the waves in squares: those of the nearest part at their level. Still parts have none.

    Parameters
    ----------
    squares : Squares
        The N squares of a tile.
    centers : ndarray, shape (2, P), float64
        Centres of the parts in cells.
    parts : sequence of PartWaves
        Their waves.
    change_m : ndarray, shape (N,), float64
        By how much the level of each square differs between two strips; NaN if unknown.
    ground : ndarray, shape (N,), bool, optional
        Squares without waves, as are parts of which they are most.

    Notes
    -----
    Waves move, so strips show them in other places. What two strips show alike is relief, and no waves. If this is so
    wherever there are two strips, parts at such a level that one strip shows have none either.
    """
    level, deviation, length = squares.level_m.copy(), np.zeros(len(squares.index)), np.zeros(len(squares.index))
    distance, measured = np.full(len(level), np.inf), np.zeros(len(level), np.bool_)
    free = np.ones(len(level), np.bool_) if ground is None else ~ground
    offsets = [squares.xy + 0.5 - center[:, None] for center in centers.T / SIDE]
    inside = [np.abs(offset).max(axis=0) < PART_CELLS / 2 / SIDE for offset in offsets]
    used = _which_count(squares, parts, inside, change_m, free)
    for offset, own, part, counts in zip(offsets, inside, parts, used, strict=True):
        if not counts:
            continue
        apart = (offset**2).sum(axis=0)
        waves_m = part.deviation_m if part.is_sea else 0.0
        near = _are_near(squares.level_m, part.level_m, waves_m)
        closer = near & (apart < distance) & free
        level[closer] = part.level_m if part.is_sea else squares.level_m[closer]
        deviation[closer], distance[closer] = waves_m, apart[closer]
        length[closer] = part.length_m if part.is_sea else 0.0
        measured[closer] = part.is_sea & own[closer]
    return SquareWaves(level, deviation, length, measured)


def _which_count(
    squares: Squares, parts: Sequence[PartWaves], inside: Sequence[Mask], change_m: Values, free: Mask
) -> Sequence[bool]:
    """Return which parts count: those of which at least half is free, and whose waves are no relief."""
    stays = [_stays(squares, change_m, part, own) for part, own in zip(parts, inside, strict=True)]
    relief = [part for part, stay in zip(parts, stays, strict=True) if stay and False not in stays]
    counts = []
    for own, part, stay in zip(inside, parts, stays, strict=True):
        is_free = np.count_nonzero(own & free) >= np.count_nonzero(own) / 2
        is_field = stay or any(_are_near(part.level_m, field.level_m, field.deviation_m) for field in relief)
        counts.append(bool(is_free and not (part.is_sea and is_field)))
    return counts


def _are_near(level_m: Values | float, part_m: float, waves_m: float) -> Mask:
    """Return whether levels may be those of a part with waves of some deviation."""
    return np.asarray(np.abs(level_m - part_m) <= _AT_LEVEL * waves_m + _NEAR_LEVEL_M)


def _stays(squares: Squares, change_m: Values, part: PartWaves, inside: Mask) -> bool | None:
    """Return whether two strips show the same elevations in a part with waves; None if that is not known."""
    if not part.is_sea:
        return None
    near = np.abs(squares.level_m - part.level_m) <= _AT_LEVEL * part.deviation_m
    return is_relief(squares, change_m, inside & near, max(_LEAST_RELIEF * part.deviation_m, RELIEF_M))


def is_relief(squares: Squares, change_m: Values, own: Mask | NDArray[np.int64], least_m: float) -> bool | None:
    """Return whether two strips show the same elevations in some squares.

    None if fewer than 16 tell, or if the deviation of their levels is less than ``least_m``. The variance of what the
    strips differ in is at most half of that of the levels; that of waves is twice as large. Half of ``least_m`` is
    enough if it is at most a twentieth.
    """
    known = np.isfinite(change_m[own])
    if np.count_nonzero(known) < _LEAST_SHARED:
        return None
    level, change = (_deviation(values[own][known]) for values in (squares.level_m, change_m))
    if level >= least_m / 2 and change**2 <= _CLEAR_CHANGE * level**2:
        return True
    return change**2 <= level**2 / 2 if level >= least_m else None


def are_moving(squares: Squares, change_m: Values) -> Mask:
    """Return which squares rise and fall from strip to strip, as waves do, shape (N,).

    The changes of the three by three squares around one deviate by 5 cm, and more than their levels: 1.4 times as much
    where waves are elsewhere in each strip, but less where relief is. Six of them must be in two strips. These are few
    squares, so one is moving, too, if most of them are.
    """
    known = np.isfinite(change_m)
    if not known.any():
        return known
    number = _around(squares, known.astype(np.float64))

    def deviation(values: Values) -> Values:
        own = np.where(known, values - np.median(values[known]), 0)
        mean, power = (_around(squares, part) / np.maximum(number, 1) for part in (own, own**2))
        return np.asarray(np.sqrt(np.maximum(power - mean**2, 0)))

    change = deviation(change_m)
    moving = known & (number >= _LEAST_AROUND) & (change >= _LEAST_MOVING_M) & (change > deviation(squares.level_m))
    return moving | (known & (2 * _around(squares, moving.astype(np.float64)) > number))


def _around(squares: Squares, values: Values) -> Values:
    """Return the sum of values over three by three squares."""
    for sides in (squares.neighbor[::2], squares.neighbor[1::2]):
        values = values + np.append(values, 0)[sides].sum(axis=0)
    return values


def _deviation(values: Values) -> float:
    """Return the standard deviation of values, without outliers."""
    low, high = np.quantile(values, (0.1587, 0.8413))
    return float(high - low) / 2
