"""What stands still in rough water: strips, minutes apart, show it at the same height, while waves move."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells, smoothed
from seaclutter_cli.airborne.gridded import NOWHERE, GriddedPoints
from seaclutter_cli.airborne.waves import Waves
from seaclutter_cli.grids.elevation import ElevationGrid

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

_WIDTH_M = 1.0
_PIT = 4.0
_ALIKE, _SAME_MOMENT = 0.7, 0.5
_SURE, _GROWN = 3.5, 2.0
_HIGH, _HIGH_M, _HIGH_GROWN, _HIGH_CELLS = 6.0, 0.5, 4.0, 4


def standing_elevations(points: GriddedPoints, strip: NDArray[np.uint8], waves: Waves) -> Cells | None:
    """Return the lowest elevation of cells that strips show alike, shape (S, 256, 256); minus infinity elsewhere.

    None if strips do not show the water at several moments.

    Parameters
    ----------
    points : GriddedPoints
        The N points of a tile.
    strip : ndarray, shape (N,), uint8
        Strip of each point.
    waves : Waves
        Waves of the tile.

    Notes
    -----
    Elevations are means over a metre around each cell. They are alike if they differ by less than 0.7 standard
    deviations of the waves. Strips whose elevations differ by less than half of one in most cells are of one moment:
    they were recorded by one scanner with several lasers.
    """
    shape = points.grid.lowest.shape
    low, high, strips = np.full(shape, np.inf), np.full(shape, -np.inf), np.zeros(shape, np.uint8)
    for number in np.unique(strip).tolist():
        lowest = _lowest(points, strip == number)
        known = np.isfinite(lowest) & (lowest > waves.level_m - _PIT * waves.deviation_m)
        above = np.where(known, lowest - waves.level_m, 0)
        mean = waves.level_m + smoothed(points.grid, above, known, _WIDTH_M / points.grid.cell_m)[0]
        np.minimum(low, mean, out=low, where=known)
        np.maximum(high, mean, out=high, where=known)
        strips += known
    several = strips > 1
    change = high[several] - low[several]
    if not len(change) or np.median(change) < _SAME_MOMENT * waves.deviation_m:
        return None
    several[several] = change < _ALIKE * waves.deviation_m
    return np.where(several, low, -np.inf)


def _lowest(points: GriddedPoints, own: Mask) -> Cells:
    """Return the lowest elevation of some of the points in each cell; plus infinity in empty cells."""
    lowest = np.full(points.grid.lowest.size, np.inf)
    start = 0
    for z, cell in points:
        used = own[start : start + len(cell)] & (cell != NOWHERE)
        np.minimum.at(lowest, cell[used], z[used])
        start += len(cell)
    return lowest.reshape(points.grid.lowest.shape)


def standing_objects(grid: ElevationGrid, above: Cells, alike: Cells, deviation: Cells) -> Mask:
    """Return the cells of objects that are higher than waves, or that strips show alike, shape (S, 256, 256).

    Parameters
    ----------
    grid : ElevationGrid
        Grid of the points of one strip.
    above : ndarray, shape (S, 256, 256), float64
        Height of the lowest elevations above the level of the water; plus infinity in empty cells.
    alike : ndarray, shape (S, 256, 256), float64
        The same of what strips show alike; minus infinity elsewhere.
    deviation : ndarray, shape (S, 256, 256), float64
        Standard deviation of the waves.

    Notes
    -----
    No wave is higher than six standard deviations: four connected cells that are, and 0.5 m, are of an object, to which
    cells belong from four on. Two strips show crests of 3.5 standard deviations at the same place once in ten thousand
    tiles. What they show alike belongs to such an object from two on; lower crests of long swell often meet.
    """
    own = np.where(np.isfinite(above), above, -np.inf)
    high = own > np.maximum(_HIGH * deviation, _HIGH_M)
    sure = alike > _SURE * deviation
    if not (high | sure).any():
        return sure
    part, group = joined_cells((alike > _GROWN * deviation) | (own > _HIGH_GROWN * deviation), grid.blocks)
    objects = np.bincount(group[part[high]], minlength=len(group)) >= _HIGH_CELLS
    objects[group[part[sure]]] = True
    return np.asarray((part > 0) & objects[group[part]])
