"""Islands by level: what the opening leaves standing above the water."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells
from seaclutter_cli.grids.elevation import ElevationGrid

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]


def island_cells(
    grid: ElevationGrid,
    opened: Cells,
    level_m: float | Cells,
    height_m: float | Cells,
    island_m: float | Cells,
    also: Mask | None = None,
) -> Mask:
    """Return a mask of the cells of islands, shape (S, 256, 256).

    Parameters
    ----------
    grid : ElevationGrid
        The grid, in S blocks.
    opened : ndarray, shape (S, 256, 256), float64
        Opened surface.
    level_m : float or ndarray, shape (S, 256, 256), float64
        Level of the water.
    height_m, island_m : float or ndarray, shape (S, 256, 256) or (S,), float64
        Height above that level from which a cell may belong to an island, and that one cell of it must exceed.
    also : ndarray, shape (S, 256, 256), bool, optional
        Cells that make an island of those that touch them.
    """
    levels, heights, islands_m = (np.broadcast_to(value, opened.shape) for value in (level_m, height_m, island_m))
    land, high = (np.zeros(opened.shape, np.bool_) for _ in range(2))
    for slot, (lowest, surface) in enumerate(zip(grid.lowest, opened, strict=True)):
        known, above = np.isfinite(lowest), levels[slot] + heights[slot]
        land[slot] = (surface > above) | (known & (lowest > above))
        highest = np.where(known, np.maximum(surface, lowest), surface)
        high[slot] = (surface > above) & (highest > levels[slot] + islands_m[slot])
        if also is not None:
            land[slot] |= also[slot]
            high[slot] |= also[slot]
    if not high.any():
        return high
    number, group = joined_cells(land, grid.blocks)
    islands = np.zeros(len(group), np.bool_)
    islands[group[number[high]]] = True
    for slot, inside in enumerate(number):
        land[slot] = islands[group[inside]]
    return land


def commonest_level(grid: ElevationGrid, opened: Cells, step_m: float) -> float:
    """Return the sea level: the median of the opened surface in its most frequent elevation step."""
    known = opened[np.isfinite(grid.lowest)]
    step = np.floor(known / step_m)
    values, counts = np.unique(step, return_counts=True)
    return float(np.median(known[step == values[np.argmax(counts)]]))
