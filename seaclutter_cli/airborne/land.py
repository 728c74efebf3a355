"""Land of a tile: what is no body of water, and what rises from its shores."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.ditches import ditch_levels
from seaclutter_cli.airborne.echo_reader import EchoReader
from seaclutter_cli.airborne.echoes import Echoes
from seaclutter_cli.airborne.looks import Look
from seaclutter_cli.airborne.nearest import nearest
from seaclutter_cli.airborne.quarters import LocalWaves
from seaclutter_cli.airborne.reflection import (
    CLEARLY_GROUND,
    DIFFUSE,
    SPECULAR,
    are_foam,
    by_contrast,
    comparable_echoes,
    is_diffuse,
    median_of,
)
from seaclutter_cli.airborne.regions import are_flat, bands_of, connected
from seaclutter_cli.airborne.shoreline import with_ground
from seaclutter_cli.airborne.signs import looks_like_water
from seaclutter_cli.airborne.squares import (
    LEAST_SQUARES,
    Squares,
    SquareWaves,
    by_cell,
    positions,
    squares_in,
    waves_of,
)
from seaclutter_cli.airborne.terrain import are_hills, are_woods, without_banks, without_woods
from seaclutter_cli.airborne.water_bodies import WaterBody, find_bodies
from seaclutter_cli.grids.elevation import ElevationGrid

Cells = NDArray[np.float64]
Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

FIELD_LENGTH_M = 120.0
"""Length of waves over which they may be fields that undulate."""
_EVEN_M = 0.15
_FIELD_M, _SHOWN_SHARE = 0.05, 0.5
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
    ditch_m : ndarray, shape (S, 256, 256), float64
        Level of the water in cells of ditches in that land; NaN elsewhere.
    level_m : ndarray, shape (S, 256, 256), float64
        Level of the nearest body of water; NaN without any.
    bank_m : float
        Height above that level from which a cell beside land belongs to it.
    is_doubtful : bool
        Whether most of the water may be level ground: it is not trusted, does not reflect like a mirror, is not even,
        and has no waves that are higher and shorter than fields undulate.
    """

    bodies: Sequence[WaterBody]
    land: Mask
    ditch_m: Cells
    level_m: Cells
    bank_m: float
    is_doubtful: bool

    @property
    def steps_m(self) -> float:
        """Difference between the highest and the lowest level of the water."""
        levels = [body.level_m for body in self.bodies]
        return max(levels) - min(levels) if levels else 0.0


def shores_of(whole: Look, squares: Squares, reader: EchoReader, top: Cells, local: LocalWaves) -> Shores | None:
    """Return the land and water of a tile; None if no region tells, unless the tile is all hills or woods.

    Parameters
    ----------
    whole : Look
        Grid and opened surface of the tile.
    squares : Squares
        Its squares.
    reader : EchoReader
        Reads its echoes.
    top : ndarray, shape (S, 256, 256), float64
        Elevation up to which echoes of a cell count.
    local : LocalWaves
        Waves of its quarters.

    Notes
    -----
    If no region is water, brightness may distinguish it: dark echoes do not always vary alike.

    Land is what is in a region of land, or in none and at another level than the nearest water. What reflects like
    water, or anything where the water reflects like ground, may be waves up to twice as far from that level. Beside
    water, fewer than six connected squares are no land: the opening takes what is that small for an object. What is not
    connected to a body of water is land, too. In squares beside water that are in no region, or high above it, cells at
    its level are water, unless the squares continue a beach and are clearly ground. Beside water that does not
    reflect like ground, cells that are clearly ground and connected to land are land at any level (`with_ground`).
    Ditches are narrower than squares; they are looked for last, in the land (`ditch_levels`).
    """
    seen, lowest = reader.squares(squares, top), whole.lowest
    lit = by_contrast(squares, seen)
    ground = None if lit is None else lit.variation <= DIFFUSE
    local = without_banks(squares, seen, local)
    waves = without_woods(squares, seen, waves_of(squares, local.centers, local.parts, seen.change_m, ground))
    echoes = lit or comparable_echoes(squares, seen, are_flat(squares, waves.deviation_m), bands_of(waves.deviation_m))
    foam = are_foam(echoes)
    echoes = replace(echoes, variation=np.where(foam, SPECULAR, echoes.variation))
    regions = find_bodies(squares, echoes, waves)
    if not any(region.is_water for region in regions) and (lit := by_contrast(squares, echoes)):
        echoes, regions = lit, find_bodies(squares, lit, waves)  # what does not vary alike may still be dark
    if not regions and not _is_dry(squares, echoes, waves.deviation_m):
        return None
    bodies = [region for region in regions if region.is_water]
    own = np.concatenate([body.squares for body in bodies]) if bodies else np.zeros(0, np.int64)
    water = _cells_of(whole.grid, squares.index[own])
    variation = cache(lambda: reader.cell_variation(top))
    found = _beside_water(squares, echoes, waves, regions) if bodies else _without_water(echoes)
    values = (found.land, found.land & found.is_sure, found.level_m, found.bank_m)
    land, sure, level, bank = _by_cell(whole.grid, squares, values)
    if bodies and found.land.any():
        for slot, (cells, around) in enumerate(zip(lowest, level, strict=True)):
            at_level = np.abs(np.where(np.isfinite(cells), cells, around) - around) <= bank[slot]
            land[slot] &= sure[slot] | ~at_level
        is_known = median_of(echoes.variation[own]) > DIFFUSE
        if is_known and (varies := variation()) is not None:
            is_sure = _cells_of(whole.grid, squares.index[foam | (echoes.known > 0)])
            land = with_ground(whole.grid, land, water, np.where(is_sure, np.nan, varies))
    shown = sum(len(body.squares) for body in bodies if _shows_water(squares, seen, waves, body.squares))
    is_doubtful = shown < _SHOWN_SHARE * sum(len(body.squares) for body in bodies)
    ditches = ditch_levels(whole.grid, lowest, land, water, variation)
    return Shores(bodies, land, ditches, level, _bank(bodies), is_doubtful)


def _shows_water(squares: Squares, echoes: Echoes, waves: SquareWaves, own: NDArray[np.int64]) -> bool:
    """Return whether more than the shape of a body shows that it is water."""
    is_mirror = median_of(echoes.variation[own]) >= SPECULAR
    clear = replace(waves, measured=waves.measured & (waves.length_m <= FIELD_LENGTH_M))
    return bool(echoes.known[own[0]] > 0 or is_mirror) or looks_like_water(squares, own, clear, _FIELD_M)


@dataclass(frozen=True)
class _LandSquares:
    """Which squares are land, and whether all of their cells are; the level of the water near them, and its banks."""

    land: Mask
    is_sure: Mask
    level_m: Values
    bank_m: Values


def _without_water(echoes: Echoes) -> _LandSquares:
    land = echoes.known <= 0
    return _LandSquares(land, land, np.full(len(land), np.nan), np.full(len(land), _BANK_M))


def _beside_water(squares: Squares, echoes: Echoes, waves: SquareWaves, regions: Sequence[WaterBody]) -> _LandSquares:
    bodies = [region for region in regions if region.is_water]
    water = np.concatenate([body.squares for body in bodies])
    level, band = _nearest_levels(squares, bodies), bands_of(waves.deviation_m)
    rise = squares.level_m - level
    of_land = np.zeros(len(level), np.bool_)
    for region in regions:
        of_land[region.squares] = not region.is_water
    crests = (np.abs(rise) <= 2 * band) & (echoes.variation >= SPECULAR)
    like_ground = (echoes.variation <= DIFFUSE) & (not is_diffuse(echoes, water))
    land = (of_land & ~crests) | (np.abs(rise) > np.where(like_ground, band, 2 * band))
    land[water] = False
    land[echoes.known > 0] = False
    own = np.flatnonzero(land)
    part = connected(squares, own)
    land[own] = (np.bincount(part) >= LEAST_SQUARES)[part]
    beach = np.zeros_like(land)
    if land.any():
        own = np.flatnonzero(~land)
        part = connected(squares, own)
        land[own] = (np.bincount(part, np.isin(own, water)) == 0)[part]
        is_free = (rise > _BANK_M) & (waves.deviation_m > 0) & ~(echoes.variation >= SPECULAR)
        beach = _beaches(squares, land, is_free)
        land |= beach
    is_high = rise > 2 * band
    is_inner = np.append(land, True)[squares.neighbor].all(axis=0)
    is_dry_beach = beach & (echoes.variation <= CLEARLY_GROUND)
    land = (land & (echoes.known <= 0)) | (echoes.known < 0)
    bank = _bank(bodies)
    return _LandSquares(
        land,
        (of_land & ~is_high) | is_inner | is_dry_beach | (echoes.known < 0),
        level,
        np.where(is_high & land, max(bank, float(band[water].max())), bank),
    )


def _bank(bodies: Sequence[WaterBody]) -> float:
    """Return the height above the water from which a cell beside land belongs to it."""
    return max([_BANK_M, *(_BANK_DEVIATIONS * body.deviation_m for body in bodies)])


def _beaches(squares: Squares, land: Mask, is_free: Mask) -> Mask:
    """Return the free squares into which land goes on as a plane through two squares of it.

    The foot of a beach is no higher than the waves beside it, but waves do not continue its slope.
    """
    level, grown = np.append(squares.level_m, np.nan), np.append(land, False)
    while True:
        new = np.zeros(len(land), np.bool_)
        for side in squares.neighbor:
            beyond = np.append(side, -1)[side]
            expected = 2 * level[side] - level[beyond]
            new |= grown[side] & grown[beyond] & (np.abs(squares.level_m - expected) <= _EVEN_M)
        new &= is_free & ~grown[:-1]
        if not new.any():
            return grown[:-1] & ~land
        grown[:-1] |= new


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


def _cells_of(grid: ElevationGrid, index: NDArray[np.int64]) -> Mask:
    """Return a mask of the cells of some squares, shape (S, 256, 256)."""
    return by_cell(np.isin(np.arange(squares_in(grid)), index))


def _nearest_levels(squares: Squares, bodies: Sequence[WaterBody]) -> NDArray[np.float64]:
    if len(bodies) == 1:
        return np.full(len(squares.index), bodies[0].level_m)
    own = np.concatenate([body.squares for body in bodies])
    level = np.repeat([body.level_m for body in bodies], [len(body.squares) for body in bodies])
    return np.asarray(level[nearest(squares.xy[:, own], squares.xy)])
