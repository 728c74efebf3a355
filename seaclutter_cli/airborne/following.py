"""The surface of rough water, which follows the waves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.waves import Waves
from seaclutter_cli.grids.cells import smoothed, touching
from seaclutter_cli.grids.elevation import ElevationGrid

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

FINEST_M = 1.0
"""Width of the finest mean, as standard deviation; waves of eight times that length are followed."""
_LENGTHS, _WIDEST_M = 6, (3.0, 12.0)
_PASSES = 2
_LOCAL_M, _AROUND_M = 10.0, 12.0
_OUTLIERS = 3.5
_BRIGHT = 2.5
_FEW, _HALF = 0.1, 0.5
_UNEVEN = 1.5
_CREST = 1.5


@dataclass(frozen=True)
class CellDetails:
    """What rough water needs to know about each cell beside its lowest elevation, each of shape (S, 256, 256).

    The highest elevation and the logarithm of the highest intensity, not finite in empty cells; the latter is None
    without intensities. The number of echoes.
    """

    highest: Cells
    brightness: Cells | None
    echoes: NDArray[np.int64]


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
    grid: ElevationGrid, lowest: Cells, land: Mask, waves: Waves, above: Cells, details: CellDetails
) -> FollowedSurface:
    r"""Return the surface of rough water.

    ``grid``: grid of the points of one strip; ``lowest``, shape (S, 256, 256): lowest elevations without pits; plus
    infinity in empty cells; ``land``, shape (S, 256, 256): land cells; ``waves``: waves of the tile; ``above``, shape
    (S, 256, 256): height of the lowest elevations above the opened surface; ``details``: highest elevations,
    intensities, and numbers of echoes.

    Notes
    -----
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
    brightness = contrast = np.zeros(lowest.shape)
    if details.brightness is not None:
        brightness, contrast = _contrast(grid, details.brightness, water)
    excluded = _patches(grid, contrast > _BRIGHT, known) & ~land
    usable &= ~excluded
    water &= usable
    flat = np.full(lowest.shape, waves.level_m), np.full(lowest.shape, waves.deviation_m**2)
    widths = [width / grid.cell_m for width in _widths(waves.length_m)]
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
    return FollowedSurface(surface, np.sqrt(variance), brightness, contrast, crests)


def _widths(length_m: float) -> Sequence[float]:
    widths = [float(np.clip(length_m / _LENGTHS, *_WIDEST_M))]
    while widths[-1] > FINEST_M:
        widths.append(max(widths[-1] / 2, FINEST_M))
    return widths


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
    from scipy import ndimage

    inner = ~touching(grid, known & ~mask)
    for slot, cells, _ in grid.padded(mask.astype(np.float64), 1):
        share = ndimage.uniform_filter(np.where(np.isfinite(cells), cells, 0), 3)
        inner[slot] &= share[1:-1, 1:-1] > _HALF
    return touching(grid, touching(grid, inner))
