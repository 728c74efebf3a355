"""Squares of eight by eight cells: their level, flatness, neighbours and waves, which distinguish water from land."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.grid import BLOCK, ElevationGrid
from seaclutter_cli.airborne.waves import PART_CELLS, PartWaves

Values = NDArray[np.float64]
Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]
Value = TypeVar("Value", bound=np.generic)

SIDE = 8
"""Width of a square in cells."""
LEAST_SQUARES = 6
"""Squares that make a region; the opening takes what is smaller for an object."""
_PER_BLOCK = BLOCK // SIDE
_LEAST_CELLS = 6
_STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
_FAR = 1 << 31
_AT_LEVEL, _NEAR_LEVEL_M = 4.0, 0.2


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
    measured : ndarray, shape (N,), bool
        Whether the waves were measured there, not only beside it.
    """

    level_m: Values
    deviation_m: Values
    measured: Mask


def waves_of(squares: Squares, centers: Values, parts: Sequence[PartWaves], ground: Mask | None = None) -> SquareWaves:
    """Return the waves in squares: those of the nearest part at their level. Still parts have none.

    ``centers`` are those of the parts in cells, shape (2, P). Squares of ``ground``, shape (N,), have no waves, nor do
    parts of which they are most.
    """
    level, deviation = squares.level_m.copy(), np.zeros(len(squares.index))
    distance, measured = np.full(len(level), np.inf), np.zeros(len(level), np.bool_)
    free = np.ones(len(level), np.bool_) if ground is None else ~ground
    for center, part in zip(centers.T / SIDE, parts, strict=True):
        away = squares.xy + 0.5 - center[:, None]
        inside = np.abs(away).max(axis=0) < PART_CELLS / 2 / SIDE
        if np.count_nonzero(inside & free) < np.count_nonzero(inside) / 2:
            continue
        apart = (away**2).sum(axis=0)
        own = part.deviation_m if part.is_sea else 0.0
        near = np.abs(squares.level_m - part.level_m) <= _AT_LEVEL * own + _NEAR_LEVEL_M
        closer = near & (apart < distance) & free
        level[closer] = part.level_m if part.is_sea else squares.level_m[closer]
        deviation[closer], distance[closer] = own, apart[closer]
        measured[closer] = part.is_sea & inside[closer]
    return SquareWaves(level, deviation, measured)
