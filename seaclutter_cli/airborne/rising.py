"""What rises out of rough water: objects by their height, brightness and extent."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.following import FINEST_M, CellDetails, FollowedSurface
from seaclutter_cli.grids.cells import joined_cells, touching
from seaclutter_cli.grids.elevation import ElevationGrid

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SURE, _SURE_M = 6.0, 0.3
_SEEN, _SEEN_M = 4.0, 0.25
_GROWN, _GROWN_M = 3.0, 0.2
_BRIGHT, _BRIGHTEST, _BRIGHT_ECHO = 2.0, 4.0, 1.5
_OF_BRIGHT, _OF_BRIGHTEST = 1.0, 0.0
_RISE, _EVIDENCE = 0.7, 4.0
_INDEPENDENT_M = 2 * FINEST_M
_MANY_ECHOES, _LEAST_CELLS = 30, 50
_ON_CREST, _FOAM_SURE = 0.5, 0.1


@dataclass(frozen=True)
class HeightLimits:
    """Heights above the surface of rough water that make an object.

    ``limit``, shape (S, 256, 256): height over which a point of the cell is a non-sea point; ``alone_m``: median height
    from which a single cell stands out from the waves by height alone.
    """

    limit: Cells
    alone_m: float


def height_limits(
    grid: ElevationGrid, lowest: Cells, land: Mask, sea: FollowedSurface, details: CellDetails
) -> HeightLimits:
    r"""Return the heights above the surface of rough water that make an object.

    ``grid``: grid of the points of one strip; ``lowest``, shape (S, 256, 256): lowest elevations without pits; plus
    infinity in empty cells; ``land``, shape (S, 256, 256): land cells; ``sea``: surface, deviation of the water from
    it, and brightness; ``details``: highest elevations, and numbers of echoes.

    Notes
    -----
    Heights and brightness are in standard deviations of the water. Cells that are risen (3) or bright (2) are joined. A
    group is an object if

    * the lowest echo of one of its cells is above 6, as no wave of a tile is; or its highest is above 4, the cell is
      bright, and both together, as the root of the sum of squares, are above 6; or
    * it is bright as a whole and has a mean rise that chance does not explain: at least 0.7, and 4 times its standard
      error. Deviations of the water are alike within about two metres, so every four square metres are one sample.
      Foam is as bright, but no higher than the water around it.

    Waves break at their crests, where foam is higher than the surface, too: a bright group, half of which is on crests
    and a tenth of which at most is that high, is no object.

    What touches an object belongs to it from 3 deviations on, and its bright echoes from the surface on.

    The surface is that of the lowest echoes; the other echoes from the water of a cell are higher. The more there are,
    the higher is the highest: the median range of cells with as many echoes is subtracted from it. The median of all
    cells is added to the heights that make an object.
    """
    known = np.isfinite(lowest)
    used = known & ~land
    ranges = _ranges(details, lowest, used)
    low_m, high_m = (np.where(known, values, -np.inf) - sea.surface for values in (lowest, details.highest - ranges))
    low, high = low_m / sea.deviation, high_m / sea.deviation
    bright = sea.contrast > _BRIGHT
    both = np.hypot(np.maximum(high, 0), np.clip(sea.contrast, 0, _BRIGHTEST))
    sure = (low > _SURE) & (low_m > _SURE_M)
    sure |= bright & (both > _SURE) & (high > _SEEN) & (high_m > _SEEN_M)
    part, group = joined_cells((low > _GROWN) | (bright & (high > 0)) | land, grid.blocks)
    member, found = part > 0, group[part]
    certain = sure | land
    inside = member & _are_objects(found, member, certain, sea, low, grid.cell_m)[found]
    alone = np.maximum(_SURE * sea.deviation, _SURE_M)
    limit = np.where(touching(grid, inside), np.maximum(_GROWN * sea.deviation, _GROWN_M), alone)
    echoes = inside & ~land & bright & (sea.brightness > _BRIGHT_ECHO)
    limit[echoes] = (np.where(sea.contrast > _BRIGHTEST, _OF_BRIGHTEST, _OF_BRIGHT) * sea.deviation)[echoes]
    if not used.any():
        return HeightLimits(limit, 0.0)
    range_m = float(np.median(ranges[used]))
    return HeightLimits(limit + range_m, float(np.median(alone[used])) + range_m)


def _ranges(details: CellDetails, lowest: Cells, water: Mask) -> Cells:
    """Return the median height of the highest above the lowest echo of water, of cells with as many echoes as each."""
    number = np.minimum(details.echoes, _MANY_ECHOES)
    own, range_m = number[water], details.highest[water] - lowest[water]
    found = np.zeros(_MANY_ECHOES + 1)
    for echoes in range(2, len(found)):
        alike = range_m[own == echoes]
        found[echoes] = np.median(alike) if len(alike) >= _LEAST_CELLS else found[echoes - 1]
    return found[number]


def _are_objects(
    group: NDArray[np.int32], member: Mask, sure: Mask, sea: FollowedSurface, rise: Cells, cell_m: float
) -> Mask:
    """Return whether each group of cells is an object."""
    own, groups = group[member], int(group.max(initial=0)) + 1
    cells, certain, shine, height, crests = (
        np.bincount(own, weights, groups)
        for weights in (None, *(values[member] for values in (sure, sea.contrast, rise, sea.crests)))
    )
    cells = np.maximum(cells, 1)
    error = 1 / np.sqrt(cells * (cell_m / _INDEPENDENT_M) ** 2)
    bright = shine > _BRIGHT * cells
    foam = bright & (crests > _ON_CREST * cells) & (certain < _FOAM_SURE * cells)
    risen = height > np.maximum(_RISE, _EVIDENCE * error) * cells
    return np.asarray(((certain > 0) | (bright & risen)) & ~foam)
