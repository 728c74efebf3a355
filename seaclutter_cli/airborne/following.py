"""The surface of rough water, which follows the waves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import smoothed, touching
from seaclutter_cli.airborne.decks import decks
from seaclutter_cli.airborne.prediction import predict_under
from seaclutter_cli.airborne.reflection import DIFFUSE, SPECULAR
from seaclutter_cli.airborne.steps import with_steps
from seaclutter_cli.airborne.waves import Waves
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
_PATCH_CELLS, _LEAST_ECHOES = 1.5, 20
_CREST = 1.5


@dataclass(frozen=True)
class CellDetails:
    """What rough water needs to know about each cell beside its lowest elevation.

    Parameters
    ----------
    highest : ndarray, shape (S, 256, 256), float64
        Highest elevation; not finite in empty cells.
    brightness : ndarray, shape (S, 256, 256), float64, or None
        Logarithm of the highest intensity; not finite in empty cells.
    intensity, squared : ndarray, shape (S, 256, 256), float64, or None
        Sum of the intensities, and that of their squares.
    echoes : ndarray, shape (S, 256, 256), int64
        Number of echoes.
    standing : ndarray, shape (S, 256, 256), bool
        Cells of objects that other strips show, too (`standing_objects`).
    may_mix : bool
        Whether cells may show several moments: nothing tells strips apart.
    """

    highest: Cells
    brightness: Cells | None
    intensity: Cells | None
    squared: Cells | None
    echoes: NDArray[np.int64]
    standing: Mask
    may_mix: bool


@dataclass(frozen=True)
class FollowedSurface:
    """Surface of rough water.

    Parameters
    ----------
    surface : ndarray, shape (S, 256, 256), float64
        Elevation of the surface; the level of the water on land.
    deviation : ndarray, shape (S, 256, 256), float64
        Standard deviation of the water from that surface.
    brightness, contrast : ndarray, shape (S, 256, 256), float64
        Brightness of each cell, and mean brightness around it, in standard deviations above those of the water; where
        intensities vary less than those of water, by more of its standard deviations, that instead; 0 without
        intensities.
    decks : ndarray, shape (S, 256, 256), bool
        Cells of even surfaces above the water, and of what has a step all around.
    crests : ndarray, shape (S, 256, 256), bool
        Cells where the surface is more than 1.5 standard deviations of the waves above their level.
    """

    surface: Cells
    deviation: Cells
    brightness: Cells
    contrast: Cells
    decks: Mask
    crests: Mask


def follow_waves(
    grid: ElevationGrid, lowest: Cells, land: Mask, waves: Waves, above: Cells, details: CellDetails
) -> FollowedSurface:
    r"""Return the surface of rough water.

    Parameters
    ----------
    grid : ElevationGrid
        Grid of the points of one strip.
    lowest : ndarray, shape (S, 256, 256), float64
        Lowest elevations without pits; plus infinity in empty cells.
    land : ndarray, shape (S, 256, 256), bool
        Land cells.
    waves : Waves
        Waves of the tile.
    above : ndarray, shape (S, 256, 256), float64
        Height of the lowest elevations above the opened surface.
    details : CellDetails
        Highest elevations, intensities, numbers of echoes, and what stands still.

    Notes
    -----
    The surface is a sum, from coarse to fine: the level of the water, plus the mean of what remains around each cell,
    weighted over a sixth of the wave length, plus the mean of what still remains over half that width, and so on down
    to a metre. Each mean counts by the share of its weight that lies on water.

    It begins with the cells below the crests. Cells more than 3.5 standard deviations from the surface are left out,
    and the mean is repeated. Bright cells, cells that reflect like ground amid water like a mirror, decks, what has a
    step all around (`with_steps`), and what stands still do not contribute. The deviation is computed from cells below
    the surface, where no objects are, and locally, since waves come in groups. Where it is more than 1.5 times its
    median, an object is among the cells: they are left out from 3.5 times that on.

    Under objects that are three cells wide, the surface is predicted from the water around them (`predict_under`).
    """
    known = np.isfinite(lowest)
    crest = np.full((len(lowest), 1, 1), waves.crest_m)
    for part in waves.parts:
        if part.block in grid.blocks:
            crest[grid.blocks[part.block]] = part.crest_m
    usable = known & ~land
    water = usable & (above <= crest)
    brightness = contrast = np.zeros(lowest.shape)
    if details.brightness is not None:
        diffuse = _diffuse(grid, details, water)
        brightness, contrast = (np.maximum(own, diffuse) for own in _contrast(grid, details.brightness, water))
    even = decks(grid, lowest, usable, waves) | with_steps(grid, lowest, usable, above)
    objects = excluded = (_patches(grid, contrast > _BRIGHT, known) & ~land) | even | touching(grid, details.standing)
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
            objects = excluded | risen
            water = usable & (np.abs(rise) <= _OUTLIERS) & ~risen
        coarser = surface, variance
    surface, variance = flat
    for width in widths:
        surface, variance = _finer(grid, lowest, water, width, (surface, variance))
    if objects.any() and water.any():
        cells, under, error = predict_under(grid, lowest, water, objects, waves.level_m)
        surface.reshape(-1)[cells] = under
        variance.reshape(-1)[cells] = error + np.median(variance[water])
    surface[land] = waves.level_m
    crests = surface - waves.level_m > _CREST * waves.deviation_m
    return FollowedSurface(surface, np.sqrt(variance), brightness, contrast, even, crests)


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


def _diffuse(grid: ElevationGrid, details: CellDetails, water: Mask) -> Cells:
    """Return by how many standard deviations intensities vary less than those of water that reflects like a mirror.

    0 where they vary more than those of ground, where there are few echoes, and if the water does not reflect so.
    """
    none = np.zeros(water.shape)
    if details.intensity is None or details.squared is None:
        return none
    seen = details.echoes > 0
    number, share = smoothed(grid, details.echoes.astype(np.float64), seen, _PATCH_CELLS)
    one, two = (smoothed(grid, values, seen, _PATCH_CELLS)[0] for values in (details.intensity, details.squared))
    known = (one > 0) & (number * share * 4 * np.pi * _PATCH_CELLS**2 >= _LEAST_ECHOES)
    mean = np.divide(one, number, out=none.copy(), where=known)
    spread = np.sqrt(np.maximum(np.divide(two, number, out=none.copy(), where=known) - mean**2, 0))
    variation = np.divide(spread, mean, out=np.full(water.shape, np.inf), where=known)
    if not (known & water).any():
        return none
    low, middle = np.quantile(variation[known & water], (0.1587, 0.5))
    if middle < SPECULAR:
        return none
    return np.where(variation <= DIFFUSE, (middle - variation) / max(float(middle - low), 1e-9), 0)


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
