"""The surface of rough water, which follows the waves, and what rises out of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells, smoothed, touching
from seaclutter_cli.airborne.grid import ElevationGrid
from seaclutter_cli.airborne.waves import Waves

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ITERATIONS = 3
_LENGTHS = 12
_WIDTHS_M = 2.0, 6.0
_LOCAL_M, _AROUND_M = 10.0, 12.0
_OUTLIERS = 3.5
_RISES = {"grow": (3.0, 0.2), "bright": (5.0, 0.25), "object": (10.0, 0.4)}
"""Height above the surface in local standard deviations and, at least, in metres: of what belongs to an object beside
it, of a bright object, and of any object."""
_BRIGHT = 2.5, 2.0
"""Standard deviations of the brightness: of cells that may not be water, and of the mean of a bright object."""
_BRIGHT_CELLS = 5


@dataclass(frozen=True)
class CellDetails:
    """What rough water needs to know about each cell beside its lowest elevation.

    Parameters
    ----------
    highest : ndarray, shape (S, 256, 256), float64
        Highest elevation; not finite in empty cells.
    brightness : ndarray, shape (S, 256, 256), float64, or None
        Logarithm of the highest intensity; not finite in empty cells.
    """

    highest: Cells
    brightness: Cells | None


@dataclass(frozen=True)
class FollowedSurface:
    """Surface of rough water.

    Parameters
    ----------
    surface : ndarray, shape (S, 256, 256), float64
        Elevation of the surface; the level of the water on land.
    limit : ndarray, shape (S, 256, 256), float64
        Height above the surface, over which points are non-sea points.
    lowest_object_m : float
        Median height from which an object stands out from the waves by height alone.
    """

    surface: Cells
    limit: Cells
    lowest_object_m: float


def follow_waves(
    grid: ElevationGrid, lowest: Cells, land: Mask, waves: Waves, above: Cells, details: CellDetails
) -> FollowedSurface:
    r"""Return the surface of rough water.

    Parameters
    ----------
    grid : ElevationGrid
        Grid of the tile.
    lowest : ndarray, shape (S, 256, 256), float64
        Lowest elevations without pits; plus infinity in empty cells.
    land : ndarray, shape (S, 256, 256), bool
        Land cells.
    waves : Waves
        Waves of the tile.
    above : ndarray, shape (S, 256, 256), float64
        Height of the lowest elevations above the opened surface.
    details : CellDetails
        Highest elevations and intensities.

    Notes
    -----
    The surface is the mean of the water around each cell, weighted by a Gaussian of a twelfth of the wave length. It
    begins with the cells below the crests. Then cells more than 3.5 standard deviations from the surface are left out,
    and the mean is repeated. The deviation is local, since waves come in groups, and since two strips that overlap
    show the water at two moments; it is computed from cells below the surface, where no objects are.

    Cells are joined that are more than 3 deviations above the surface. A group is an object if the lowest echo of one
    of its cells is above 10 deviations, or its highest above 5 if the group is also much brighter than the water around
    and has at least five cells. Bright cells do not contribute to the surface, but only their height makes them
    objects.
    """
    cell_m, known = grid.cell_m, np.isfinite(lowest)
    width_m = float(np.clip(waves.length_m / _LENGTHS, *_WIDTHS_M))
    crest = np.full((len(lowest), 1, 1), waves.crest_m)
    crest[[part.slot for part in waves.parts], 0, 0] = [part.crest_m for part in waves.parts]
    water = known & ~land & (above <= crest)
    contrast = None if details.brightness is None else _contrast(grid, details.brightness, water)
    usable = known & ~land
    if contrast is not None:
        usable &= ~_patches(grid, contrast > _BRIGHT[0])
    water &= usable
    for _ in range(_ITERATIONS):
        rise = lowest - smoothed(grid, lowest, water, width_m / cell_m)
        low, middle = np.nanquantile(rise[water], (0.1587, 0.5)) if water.any() else (0.0, 0.0)
        rise -= middle
        below = known & ~land & (rise < 0) & (rise > -10 * (middle - low))
        square = np.where(below, rise, 0) ** 2
        deviation = np.fmax(np.sqrt(smoothed(grid, square, below, _LOCAL_M / cell_m)), middle - low)
        water = usable & (np.abs(rise) <= _OUTLIERS * deviation)
    surface = smoothed(grid, lowest, water, width_m / cell_m)
    missing = np.isnan(surface)
    if missing.any():
        surface[missing] = smoothed(grid, lowest, water, 3 * width_m / cell_m)[missing]
    surface[land | np.isnan(surface)] = waves.level_m
    low, high = (np.where(known, values, -np.inf) - surface for values in (lowest, details.highest))
    return _limited(grid, (low, high), surface, deviation, land, contrast)


def _limited(
    grid: ElevationGrid,
    rises: tuple[Cells, Cells],
    surface: Cells,
    deviation: Cells,
    land: Mask,
    contrast: Cells | None,
) -> FollowedSurface:
    """Return the surface with the limits of objects, and of what touches them.

    ``rises`` are the heights of the lowest and the highest echoes above the surface.
    """
    lowest, highest = rises
    grow, bright, high = (np.maximum(times * deviation, least) for times, least in _RISES.values())
    raised = lowest > grow
    shining = np.zeros(raised.shape, np.bool_) if contrast is None else (highest > bright) & (contrast > _BRIGHT[1])
    number, group = joined_cells(raised | shining | land, grid.blocks)
    cell_group, groups = group[number], len(group)
    seeds = np.bincount(cell_group[land | (lowest > high)], minlength=groups) > 0
    if contrast is not None:
        cells = np.bincount(cell_group.reshape(-1), minlength=groups)
        total = np.bincount(cell_group.reshape(-1), np.where(number > 0, contrast, 0).reshape(-1), groups)
        risen = np.bincount(cell_group[highest > bright], minlength=groups) > 0
        seeds |= risen & (cells >= _BRIGHT_CELLS) & (total > _BRIGHT[1] * cells)
    seeds[0] = False
    limit = np.where(touching(grid, seeds[cell_group]), grow, high)
    used = np.isfinite(lowest) & ~land
    return FollowedSurface(surface, limit, float(np.median(high[used])) if used.any() else 0.0)


def _contrast(grid: ElevationGrid, brightness: Cells, water: Mask) -> Cells:
    """Return the brightness in standard deviations above that of the water around, averaged over a cell's width."""
    known = np.isfinite(brightness)
    around = smoothed(grid, brightness, water, _AROUND_M / grid.cell_m)
    difference = np.where(known & np.isfinite(around), brightness, 0) - np.where(known, np.nan_to_num(around), 0)
    difference = np.where(known, smoothed(grid, difference, known, 1.0), 0)
    if not water.any():
        return difference
    middle, upper = np.quantile(difference[water], (0.5, 0.8413))
    return np.where(known, (difference - middle) / max(float(upper - middle), 1e-9), 0)


def _patches(grid: ElevationGrid, mask: Mask) -> Mask:
    """Return the parts of a mask that are three cells wide, with a cell around them."""
    inner = ~touching(grid, ~mask)
    return touching(grid, touching(grid, inner))
