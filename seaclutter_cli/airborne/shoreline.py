"""The shoreline by cell: ground reflects in all directions, also below the crests of waves."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells
from seaclutter_cli.airborne.reflection import CLEARLY_GROUND, LIKE_GROUND, median_of
from seaclutter_cli.grids.elevation import ElevationGrid

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]


def with_ground(grid: ElevationGrid, land: Mask, water: Mask, variation: Cells) -> Mask:
    """Return land with the cells that are clearly ground, and connected to it through others that are.

    Parameters
    ----------
    grid : ElevationGrid
        The grid, in S blocks.
    land, water : ndarray, shape (S, 256, 256), bool
        Cells of land, and of the squares of bodies of water.
    variation : ndarray, shape (S, 256, 256), float64
        Coefficient of variation of the intensities around each cell; NaN if unknown.

    Notes
    -----
    Squares along a shore contain both, and the foot of a beach is lower than the crests of waves. But ground varies by
    0.33 at most, and cells of water hardly ever do, unless half of them vary by less than 0.525: such water is
    not distinguished. A cell without points belongs to land if what is around it does.
    """
    if not median_of(variation[water]) >= LIKE_GROUND:
        return land
    part, group = joined_cells(land | (variation <= CLEARLY_GROUND), grid.blocks)
    grown = np.zeros(len(group), np.bool_)
    grown[group[part[land]]] = True
    return np.asarray(land | grown[group[part]])
