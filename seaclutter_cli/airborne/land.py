"""Land of a tile: what is no body of water, and what rises from its shores."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.grid import ElevationGrid
from seaclutter_cli.airborne.nearest import nearest
from seaclutter_cli.airborne.squares import Echoes, Squares, SquareWaves, by_cell, positions, squares_in
from seaclutter_cli.airborne.water_bodies import (
    DIFFUSE,
    SPECULAR,
    WaterBody,
    are_hills,
    are_woods,
    bands_of,
    connected,
    find_bodies,
    without_woods,
)

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAST_SQUARES = 6
_BANK_M, _BANK_DEVIATIONS = 0.2, 4.0


@dataclass(frozen=True)
class Shores:
    """Land and water of a tile.

    Parameters
    ----------
    bodies : sequence of WaterBody
        Bodies of water.
    land : ndarray, shape (S, 256, 256), bool
        Cells of land squares.
    level_m : ndarray, shape (S, 256, 256), float64
        Level of the nearest body of water; NaN without any.
    bank_m : float
        Height above that level from which a cell beside land belongs to it.
    """

    bodies: Sequence[WaterBody]
    land: Mask
    level_m: Cells
    bank_m: float

    @property
    def steps_m(self) -> float:
        """Difference between the highest and the lowest level of the water."""
        levels = [body.level_m for body in self.bodies]
        return max(levels) - min(levels) if levels else 0.0


def shores_of(
    grid: ElevationGrid, lowest: Cells, squares: Squares, echoes: Echoes, waves: SquareWaves
) -> Shores | None:
    """Return the land and water of a tile; None if no region tells, unless the tile is all hills or woods.

    Notes
    -----
    Land is what is in a region of land, or in none and at another level than the nearest water. What reflects like
    water, or does not tell, may be waves up to twice as far from that level. Beside water, fewer than six connected
    squares are no land: the opening takes what is that small for an object. What is not connected to a body of water
    is land, too. In squares beside water that are in no region, cells at its level are water.
    """
    waves = without_woods(squares, echoes, waves)
    regions = find_bodies(squares, echoes, waves)
    if not regions and not _is_dry(squares, echoes, waves.deviation_m):
        return None
    bodies = [region for region in regions if region.is_water]
    land = sure = np.ones(len(squares.index), np.bool_)
    level = np.full(len(squares.index), np.nan)
    if bodies:
        level = _nearest_levels(squares, bodies)
        band = bands_of(waves.deviation_m)
        rise = squares.level_m - level
        of_land = np.zeros(len(land), np.bool_)
        for region in regions:
            of_land[region.squares] = not region.is_water
        crests = (np.abs(rise) <= 2 * band) & (echoes.variation >= SPECULAR)
        land = (of_land & ~crests) | (np.abs(rise) > np.where(echoes.variation <= DIFFUSE, band, 2 * band))
        for body in bodies:
            land[body.squares] = False
        wet = np.zeros(len(land) + 1, np.bool_)
        wet[np.concatenate([body.squares for body in bodies])] = True
        sure = of_land | ~wet[squares.neighbor].any(axis=0)
    land[echoes.known > 0] = False
    if bodies:
        own = np.flatnonzero(land)
        part = connected(squares, own)
        land[own] = (np.bincount(part) >= _LEAST_SQUARES)[part]
    if bodies and land.any():
        own = np.flatnonzero(~land)
        part = connected(squares, own)
        wet = np.isin(own, np.concatenate([body.squares for body in bodies]))
        land[own] = (np.bincount(part, wet) == 0)[part]
    land = (land & (echoes.known <= 0)) | (echoes.known < 0)
    sure = sure | (echoes.known < 0)
    bank = max([_BANK_M, *(_BANK_DEVIATIONS * body.deviation_m for body in bodies)])
    of_cells, certain, levels = _by_cell(grid, squares, (land, land & sure, level))
    if bodies and land.any():
        for slot, (cells, water) in enumerate(zip(lowest, levels, strict=True)):
            at_level = np.abs(np.where(np.isfinite(cells), cells, water) - water) <= bank
            of_cells[slot] &= certain[slot] | ~at_level
    return Shores(bodies, of_cells, levels, bank)


def _is_dry(squares: Squares, echoes: Echoes, deviation_m: NDArray[np.float64]) -> bool:
    """Return whether a tile without known regions is all land."""
    still = deviation_m == 0
    return are_hills(squares, deviation_m) or (bool(still.all()) and are_woods(squares, echoes, still))


def _by_cell(grid: ElevationGrid, squares: Squares, values: tuple[NDArray[Any], ...]) -> list[NDArray[Any]]:
    """Return values by cell; squares with too few cells take those of the nearest square."""
    same = [len(np.unique(value)) == 1 for value in values]
    own = None if all(same) else nearest(squares.xy, positions(grid, np.arange(squares_in(grid))))
    shape = grid.lowest.shape
    return [np.broadcast_to(value[0], shape) if own is None else by_cell(value[own]) for value in values]


def _nearest_levels(squares: Squares, bodies: Sequence[WaterBody]) -> NDArray[np.float64]:
    if len(bodies) == 1:
        return np.full(len(squares.index), bodies[0].level_m)
    own = np.concatenate([body.squares for body in bodies])
    level = np.repeat([body.level_m for body in bodies], [len(body.squares) for body in bodies])
    return np.asarray(level[nearest(squares.xy[:, own], squares.xy)])
