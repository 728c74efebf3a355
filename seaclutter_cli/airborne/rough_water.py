"""The surface of rough water, which follows the waves, and what rises out of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.waves import Waves
from seaclutter_cli.arrays import Ints, Mask
from seaclutter_cli.grids.cells import joined_cells, number_around, smoothed, touching
from seaclutter_cli.grids.elevation import Cells, ElevationGrid

FINEST_M = 1.0
"""Width of the finest mean, as standard deviation; waves of eight times that length are followed."""
_LENGTHS, _WIDEST_M = 6, (3.0, 12.0)
_PASSES = 2
_LOCAL_M, _AROUND_M = 10.0, 12.0
_OUTLIERS = 3.5
_FEW, _HALF = 0.1, 0.5
_UNEVEN = 1.5
_CREST = 1.5
_ALONE, _ALONE_M = 6.0, 0.3
_IF_BRIGHT, _IF_BRIGHT_M = 4.0, 0.25
_BESIDE, _BESIDE_M = 3.0, 0.2
"""Heights in deviations of the water, and in metres: of a cell alone, of its highest echo, and beside an object."""
_BRIGHT, _BRIGHTEST, _BRIGHT_ECHO = 2.0, 4.0, 1.5
_OF_BRIGHT, _OF_BRIGHTEST = 1.0, 0.0
_MEAN_RISE, _STANDARD_ERRORS = 0.7, 4.0
_INDEPENDENT_M = 2 * FINEST_M
_MANY_ECHOES, _LEAST_CELLS = 30, 50
_ON_CREST, _FOAM_ALONE = 0.5, 0.1


@dataclass(frozen=True)
class FollowedSurface:
    """Surface of rough water, and the standard deviation of the water from it, each of shape (S, 256, 256).

    The level of the water on land. Brightness of each cell, and mean brightness around it, in standard deviations
    above those of the water; 0 without intensities. Crests are more than 1.5 standard deviations of the waves above
    their level.
    """

    surface: Cells
    deviation: Cells
    brightness: Cells
    contrast: Cells
    crests: Mask


def follow_waves(
    grid: ElevationGrid, lowest: Cells, land: Mask, waves: Waves, above: Cells, brightness: Cells | None
) -> FollowedSurface:
    r"""Return the surface of rough water.

    ``grid``: grid of the points of one strip; ``lowest``, shape (S, 256, 256): lowest elevations without pits; plus
    infinity in empty cells; ``land``, shape (S, 256, 256): land cells; ``waves``: waves of the tile; ``above``, shape
    (S, 256, 256): height of the lowest elevations above the opened surface; ``brightness``, shape (S, 256, 256):
    logarithm of the highest intensities, not finite in empty cells; None without intensities.

    The surface is a sum, from coarse to fine: the level of the water, plus the mean of what remains around each cell,
    weighted over a sixth of the wave length, plus the mean of what still remains over half that width, and so on down
    to a metre. Each mean counts by the share of its weight that lies on water.

    It begins with the cells below the crests. Cells more than 3.5 standard deviations from the surface are left out,
    and the mean is repeated. Bright patches do not contribute. The deviation is computed from cells below the surface,
    where no objects are, and locally, since waves come in groups. Where it is more than 1.5 times its median, an object
    is among the cells: they are left out from 3.5 times that on.
    """
    known = np.isfinite(lowest)
    usable = known & ~land
    water = usable & (above <= waves.crest_m)
    own = contrast = np.zeros(lowest.shape)
    if brightness is not None:
        own, contrast = _contrast(grid, brightness, water)
    excluded = _patches(grid, contrast > _BRIGHT, known) & ~land
    usable &= ~excluded
    water &= usable
    flat = np.full(lowest.shape, waves.level_m), np.full(lowest.shape, waves.deviation_m**2)
    widths = [float(np.clip(waves.length_m / _LENGTHS, *_WIDEST_M))]
    while widths[-1] > FINEST_M:
        widths.append(max(widths[-1] / 2, FINEST_M))
    widths = [width / grid.cell_m for width in widths]
    coarser = flat
    for width in widths:
        for _ in range(_PASSES):
            surface, variance = _finer(grid, lowest, water, width, coarser)
            most = _UNEVEN**2 * float(np.median(variance[water])) if water.any() else np.inf
            rise = np.where(known, lowest - surface, 0) / np.sqrt(np.minimum(variance, most))
            risen = _patches(grid, rise > _OUTLIERS, known) & ~land
            water = usable & (np.abs(rise) <= _OUTLIERS) & ~risen
        coarser = surface, variance
    surface, variance = flat
    for width in widths:
        surface, variance = _finer(grid, lowest, water, width, (surface, variance))
    surface[land] = waves.level_m
    crests = surface - waves.level_m > _CREST * waves.deviation_m
    return FollowedSurface(surface, np.sqrt(variance), own, contrast, crests)


def _finer(
    grid: ElevationGrid, lowest: Cells, water: Mask, width: float, coarser: tuple[Cells, Cells]
) -> tuple[Cells, Cells]:
    """Return the surface and the variance of the water, with the mean over one more width."""
    surface, variance = coarser
    mean, share = smoothed(grid, np.where(water, lowest - surface, 0), water, width)
    counts = share / (share + _FEW)
    surface = surface + counts * mean
    rest = np.where(water, lowest - surface, 0)
    low, middle = np.quantile(rest[water], (0.1587, 0.5)) if water.any() else (0.0, 0.0)
    surface += middle * counts
    rest -= middle * counts
    local, _ = smoothed(grid, rest**2, water & (rest < 0), _LOCAL_M / grid.cell_m)
    seen = np.minimum(share / (1 - _FEW), 1)
    own = np.maximum(local, (middle - low) ** 2)
    return surface, own + (1 - seen) * np.maximum(variance - own, 0)


def _contrast(grid: ElevationGrid, brightness: Cells, water: Mask) -> tuple[Cells, Cells]:
    """Return the brightness in standard deviations above that of the water around: of each cell, and of cells' means.

    The mean is over the width of a cell, as the brightness of the water differs from echo to echo.
    """
    known = np.isfinite(brightness)
    around, share = smoothed(grid, brightness, water & known, _AROUND_M / grid.cell_m)
    own = np.where(known & (share > 0), brightness - around, 0)
    mean = smoothed(grid, own, known, 1.0)[0]
    return _standard(own, known, water), _standard(mean, known, water)


def _standard(values: Cells, known: Mask, water: Mask) -> Cells:
    if not water.any():
        return np.where(known, values, 0)
    middle, upper = np.quantile(values[water], (0.5, 0.8413))
    return np.where(known, (values - middle) / max(float(upper - middle), 1e-9), 0)


def _patches(grid: ElevationGrid, mask: Mask, known: Mask) -> Mask:
    """Return the parts of a mask that are three cells wide, with a cell around them.

    Cells without points do not count, unless they are more than half of the nine.
    """
    inner = (number_around(grid, known & ~mask) == 0) & (number_around(grid, mask) > _HALF * 9)
    return touching(grid, touching(grid, inner))


def height_limits(
    grid: ElevationGrid, lowest: Cells, land: Mask, sea: FollowedSurface, highest: Cells, echoes: Ints
) -> tuple[Cells, float]:
    r"""Return the heights above the surface of rough water that make an object, by cell, and that of a single cell.

    ``grid``: grid of the points of one strip; ``lowest``, shape (S, 256, 256): lowest elevations without pits; plus
    infinity in empty cells; ``land``, shape (S, 256, 256): land cells; ``sea``: surface, deviation of the water from
    it, and brightness; ``highest``, ``echoes``, shape (S, 256, 256): highest elevations, and numbers of echoes.

    Heights and brightness are in standard deviations of the water. Cells that are risen (3) or bright (2) are joined. A
    group is an object if

    * the lowest echo of one of its cells is above 6, as no wave of a tile is; or its highest is above 4, the cell is
      bright, and both together, as the root of the sum of squares, are above 6; or
    * it is bright as a whole and has a mean rise that chance does not explain: at least 0.7, and 4 times its standard
      error. Deviations of the water are alike within about two metres, so every four square metres are one sample.
      Foam is as bright, but no higher than the water around it.

    Waves break at their crests, where foam is higher than the surface, too: a bright group, half of which is on crests
    and a tenth of which at most is that high, is no object.

    What touches an object belongs to it from 3 deviations on, and its bright echoes from the surface on. The deviation
    is large where an object hides the water: in its bright cells, no more counts than what a single cell needs.

    The surface is that of the lowest echoes; the other echoes from the water of a cell are higher. The more there are,
    the higher is the highest: the median range of cells with as many echoes is subtracted from it. The median of all
    cells is added to the heights that make an object.
    """
    known = np.isfinite(lowest)
    used = known & ~land
    ranges = _ranges(highest - lowest, echoes, used)
    low_m, high_m = (np.where(known, values, -np.inf) - sea.surface for values in (lowest, highest - ranges))
    low, high = low_m / sea.deviation, high_m / sea.deviation
    bright = sea.contrast > _BRIGHT
    both = np.hypot(np.maximum(high, 0), np.clip(sea.contrast, 0, _BRIGHTEST))
    sure = (low > _ALONE) & (low_m > _ALONE_M)
    sure |= bright & (both > _ALONE) & (high > _IF_BRIGHT) & (high_m > _IF_BRIGHT_M)
    part, group = joined_cells(grid, (low > _BESIDE) | (bright & (high > 0)) | land)
    member, found = part > 0, group[part]
    certain = sure | land
    inside = member & _are_objects(found, member, certain, sea, low, grid.cell_m)[found]
    alone = np.maximum(_ALONE * sea.deviation, _ALONE_M)
    limit = np.where(touching(grid, inside), np.maximum(_BESIDE * sea.deviation, _BESIDE_M), alone)
    common, range_m = (float(np.median(values[used])) if used.any() else 0.0 for values in (alone, ranges))
    covered = inside & ~land & bright
    limit[covered] = np.minimum(limit[covered], common)
    shining = covered & (sea.brightness > _BRIGHT_ECHO)
    limit[shining] = (np.where(sea.contrast > _BRIGHTEST, _OF_BRIGHTEST, _OF_BRIGHT) * sea.deviation)[shining]
    return limit + range_m, common + range_m


def _ranges(range_m: Cells, echoes: Ints, water: Mask) -> Cells:
    """Return the median height of the highest above the lowest echo of water, of cells with as many echoes as each."""
    number = np.minimum(echoes, _MANY_ECHOES)
    own, range_m, found = number[water], range_m[water], np.zeros(_MANY_ECHOES + 1)
    for many in range(2, len(found)):
        alike = range_m[own == many]
        found[many] = np.median(alike) if len(alike) >= _LEAST_CELLS else found[many - 1]
    return found[number]


def _are_objects(
    group: NDArray[np.int32], member: Mask, sure: Mask, sea: FollowedSurface, rise: Cells, cell_m: float
) -> Mask:
    own, groups = group[member], int(group.max(initial=0)) + 1
    cells, certain, shine, height, crests = (
        np.bincount(own, weights, groups)
        for weights in (None, *(values[member] for values in (sure, sea.contrast, rise, sea.crests)))
    )
    cells = np.maximum(cells, 1)
    error = 1 / np.sqrt(cells * (cell_m / _INDEPENDENT_M) ** 2)
    bright = shine > _BRIGHT * cells
    foam = bright & (crests > _ON_CREST * cells) & (certain < _FOAM_ALONE * cells)
    risen = height > np.maximum(_MEAN_RISE, _STANDARD_ERRORS * error) * cells
    return np.asarray(((certain > 0) | (bright & risen)) & ~foam)
