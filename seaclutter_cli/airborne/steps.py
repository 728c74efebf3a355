"""Objects in rough water by their edges: there is a step all around them, where waves only slope."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells
from seaclutter_cli.grids.elevation import BLOCK, ElevationGrid

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEVELS_M = 0.3, 0.45, 0.7, 1.0, 1.5
_LEAST_CELLS, _LEAST_PAIRS = 8, 12
_STEP_M, _STEPS, _STEEP_SHARE = 0.15, 3.0, 0.75
_NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal variable."""
_SIDES = (0, 1), (2, 1), (1, 0), (1, 2)


def with_steps(grid: ElevationGrid, lowest: Cells, used: Mask, above: Cells) -> Mask:
    """Return the cells of objects that have a step all around, shape (S, 256, 256).

    Parameters
    ----------
    grid : ElevationGrid
        Grid of the points of one strip.
    lowest : ndarray, shape (S, 256, 256), float64
        Lowest elevations; plus infinity in empty cells.
    used : ndarray, shape (S, 256, 256), bool
        Cells with points that may be water.
    above : ndarray, shape (S, 256, 256), float64
        Height of the lowest elevations above the opened surface.

    Notes
    -----
    A raft may be lower than the crests of waves, and a barge wider than what a smooth surface bridges. The edge of both
    is a step, while the slope of a wave continues. Candidates are eight or more connected cells that are more than 0.3,
    0.45, 0.7, 1.0 or 1.5 m above the opened surface: at one of these heights, no crest connects the object with others.
    At three quarters of the sides where a known cell outside touches one inside, the step must be 0.15 m, and three
    times the standard deviation of the steps between neighbouring cells of the tile.
    """
    step_m = max(_STEP_M, _STEPS * _typical_step(grid, np.where(used, lowest, np.inf)))
    found = np.zeros(lowest.shape, np.bool_)
    for least_m in _LEVELS_M:
        part, group = joined_cells(used & (above > least_m), grid.blocks)
        member = group[part]
        found |= _are_steep(grid, lowest, used, member, step_m)[member]
    return found


def mean_edge(grid: ElevationGrid, lowest: Cells, used: Mask, member: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the mean height of the edge of each group of cells above the cells beside it; those above it count as 0.

    Infinite where nothing is known beside it; 0 is no group.
    """
    groups = int(member.max(initial=0)) + 1
    pairs, total = np.zeros(groups), np.zeros(groups)
    for own, height in _edges(grid, lowest, used, member):
        pairs += np.bincount(own, minlength=groups)
        total += np.bincount(own, np.maximum(height, 0), groups)
    return np.asarray(np.divide(total, pairs, out=np.full(groups, np.inf), where=pairs > 0))


def _are_steep(grid: ElevationGrid, lowest: Cells, used: Mask, member: NDArray[np.int32], step_m: float) -> Mask:
    """Return whether each group of cells is large, and has steps along its edge; 0 is no group."""
    groups = int(member.max(initial=0)) + 1
    pairs, steep = np.zeros(groups), np.zeros(groups)
    for own, height in _edges(grid, lowest, used, member):
        pairs += np.bincount(own, minlength=groups)
        steep += np.bincount(own, height > step_m, groups)
    large = np.bincount(member.reshape(-1), minlength=groups) >= _LEAST_CELLS
    return np.asarray(large & (pairs >= _LEAST_PAIRS) & (steep >= _STEEP_SHARE * pairs))


def _edges(
    grid: ElevationGrid, lowest: Cells, used: Mask, member: NDArray[np.int32]
) -> Iterator[tuple[NDArray[np.int32], NDArray[np.float64]]]:
    """Yield the groups that known cells outside touch, and their heights above these, side by side."""
    outside = np.where(used & (member == 0), lowest, np.inf)
    for slot, beside in _besides(grid, outside):
        inside = (member[slot] > 0) & np.isfinite(beside)
        yield member[slot][inside], lowest[slot][inside] - beside[inside]


def _typical_step(grid: ElevationGrid, lowest: Cells) -> float:
    """Return the standard deviation of the steps between neighbouring cells, from their median; 0 without any."""
    steps = []
    for slot, beside in _besides(grid, lowest, _SIDES[::2]):  # the others are the same steps again
        known = np.isfinite(beside) & np.isfinite(lowest[slot])
        steps.append(np.abs(beside[known] - lowest[slot][known]))
    every = np.concatenate(steps)
    return float(np.median(every)) / _NORMAL_MEDIAN if len(every) else 0.0


def _besides(
    grid: ElevationGrid, values: Cells, sides: Sequence[tuple[int, int]] = _SIDES
) -> Iterator[tuple[int, Cells]]:
    """Yield the index of each block, and the values beside its cells, on each side."""
    for slot, cells, _ in grid.padded(values, 1):
        for row, column in sides:
            yield slot, cells[row : row + BLOCK, column : column + BLOCK]
