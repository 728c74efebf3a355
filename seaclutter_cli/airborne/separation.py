"""Separation of tiles into sea and non-sea points."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.rough_water import follow_waves, height_limits
from seaclutter_cli.airborne.shores import Shores, WaterModel, commonest_level, island_cells, shores_of
from seaclutter_cli.airborne.squares import Column, SquareEchoes, Squares, square_table
from seaclutter_cli.airborne.strips import looks_of, strip_levels, strips_of
from seaclutter_cli.airborne.surface import CALM_M, NEVER, OTHER, SeparationParams, Surface
from seaclutter_cli.airborne.waves import Waves, WindowWaves, estimate_waves
from seaclutter_cli.arrays import Bytes, Floats, Indices, Ints, Mask
from seaclutter_cli.errors import InputError
from seaclutter_cli.grids.elevation import Cells, GriddedPoints, LandCells
from seaclutter_cli.grids.opening import SurfaceParams, open_grid, without_pits

_SAMPLE = 20_000
_PIT, _ROUGH_M, _HIGHEST = 2.0, 0.4, 1.25
_CREST_DEVIATIONS, _CALM_DEVIATIONS, _CALMEST_M = 3.0, 6.0, 0.35
_LAND_DEVIATIONS, _ISLAND_DEVIATIONS = 4.0, 6.0
_LEAST_SQUARES, _SURE_ODDS, _MOST_ODDS = 64, 1.5, 6.0


@dataclass(frozen=True)
class SeaState:
    """Waves of a tile, and the surface and height that separate objects from them.

    ``surface``: opened surface, or surface that follows the waves of rough water; ``level_m``: median level of the
    water; None, like the others, if the height is fixed or most of the tile is not sea; ``wave_height_m``,
    ``wave_length_m``: significant wave height, and length of the highest waves; ``object_height_m``: height above the
    surface that makes an object; on rough water, the median over its cells.
    """

    surface: Literal["opened", "followed"]
    level_m: float | None
    wave_height_m: float | None
    wave_length_m: float | None
    object_height_m: float


@dataclass(frozen=True)
class Separation:
    """Classes and heights of the N points of a tile.

    ``classification``, shape (N,): ASPRS class: `WATER`, `OTHER`, `GROUND`, or `NEVER` for points with a coordinate
    that is not finite; ``height_m``, shape (N,): height above the sea surface in metres; NaN for `NEVER`; ``cells``:
    number of grid cells with points; ``sea``: what the separation is based on; ``land``: where the land is;
    ``is_doubtful``: whether land was looked for, and the model is not sure what is water.
    """

    classification: Bytes
    height_m: NDArray[np.float32]
    cells: int
    sea: SeaState = SeaState("opened", None, None, None, CALM_M)
    land: LandCells = field(default_factory=LandCells)
    is_doubtful: bool = False

    def first(self, points: int) -> "Separation":
        """Return the separation of the first points alone."""
        return replace(self, classification=self.classification[:points], height_m=self.height_m[:points])

    @property
    def other(self) -> Indices:
        """Indices of the non-sea points."""
        return np.flatnonzero(self.classification == OTHER)

    @property
    def points_per_cell(self) -> float:
        """Mean number of points per cell with points."""
        return float(np.count_nonzero(self.classification != NEVER) / max(self.cells, 1))


def separate(parts: Iterable[Floats], params: SurfaceParams, column: Column = lambda _: None) -> Separation:
    """Return the separation of a tile into sea and non-sea points.

    ``parts``, shape (3, n): coordinates in metres; iterated over repeatedly; ``params``: window and heights. With
    `SeparationParams`, land and echoes from below the surface are handled, too; ``column``, optional: returns an
    attribute of all points by its LAS name, or None.

    Raise `InputError` if no point has finite coordinates, or the points are too scattered for a grid in memory.
    """
    points = GriddedPoints(parts, params.cell_m)
    if not points.grid.blocks:
        raise InputError("no points with finite coordinates: the sea surface cannot be computed")
    if isinstance(params, SeparationParams):
        found = LeveledTile(points, params, column).separation()
        given = column("classification") if params.trust_classes else None
        if given is not None:
            kept = np.isin(given, params.trust_classes) & (found.classification != NEVER)
            found.classification[kept] = given[kept]
        return found
    opened = open_grid(points.grid, params.window_m)
    surface = Surface(opened, params.height_m, np.zeros(opened.shape, np.bool_))
    state = SeaState("opened", None, None, None, round(params.height_m, 2))
    return Separation(*surface.classes(points), _cells(points), state, LandCells(params.cell_m))


def _cells(points: GriddedPoints) -> int:
    return int(np.isfinite(points.grid.lowest).sum())


class LeveledTile:
    """A tile with the level of all strips made the same.

    ``points``: the N points; ``params``: parameters of the separation; ``column``: returns an attribute of all points;
    ``look``, shape (N,): what shows each point at one moment, a strip or one direction of a scanner on a cone; None if
    it is one; ``change_m``: by how much the level of each square of all blocks differs between two strips; ``lowest``,
    ``opened``, shape (S, 256, 256): lowest elevations without echoes from below the surface, and their opening;
    ``squares``: squares of the tile.
    """

    def __init__(self, points: GriddedPoints, params: SeparationParams, column: Column) -> None:
        strip = strips_of(column) if params.follows_waves else None
        levels = None if strip is None else strip_levels(points, strip)
        if strip is not None and levels is not None and levels.tide_m.any():
            points = points.lowered(levels.tide_m[strip])
        self.points, self.params, self.column = points, params, column
        self.change_m = None if levels is None else levels.changes_m()
        self.look = looks_of(strip, points.parts, column) if params.follows_waves else None
        self.lowest, self.opened = _surfaces(points, params)
        self.squares = Squares(points.grid, self.lowest, self.lowest <= self._top)

    def separation(self) -> Separation:
        """Return the separation of the tile."""
        odds, shores = self._shores()
        doubtful = self.params.land != "ignore" and _is_doubtful(odds, shores.water)
        waves = self._waves(shores) if self.params.follows_waves else None
        if self.params.land == "ignore":
            shores = replace(shores, land=np.zeros_like(shores.land))
        surface, state = self._calm(shores), SeaState("opened", None, None, None, self.params.threshold_m)
        if waves is not None:
            middle, deviation = _water_heights(self.points, surface)
            has_crests = middle + _CREST_DEVIATIONS * deviation > _ROUGH_M
            # The opened surface, above which crests are this high, lies in the troughs.
            if max(waves.crest_m, _HIGHEST * waves.height_m) > _ROUGH_M or has_crests:
                return replace(self._rough(shores, waves), is_doubtful=doubtful)
            height = float(np.clip(middle + _CALM_DEVIATIONS * deviation, _CALMEST_M, CALM_M))
            surface, state = replace(surface, limit=height), _state("opened", waves, height)
        land = _land_cells(self.params.cell_m, [(self.points, surface.land)])
        return Separation(*surface.classes(self.points), _cells(self.points), state, land, doubtful)

    @property
    def _top(self) -> Cells:
        """Elevation up to which echoes are on the surface, shape (S, 256, 256)."""
        return self.opened + self.params.threshold_m

    def table(self) -> tuple[tuple[str, ...], NDArray[np.float32]]:
        """Return the features by which the model separates water from land, and their values in each square."""
        change = None if self.change_m is None else self.change_m[self.squares.index]
        return square_table(self.squares, self._echoes, self._windows, change)

    @cached_property
    def _echoes(self) -> SquareEchoes:
        return SquareEchoes(self.squares, self.points, self._top, self.column, self.params.trust_classes)

    @cached_property
    def _windows(self) -> WindowWaves:
        return WindowWaves(self._looks(), self.params.cell_m, self.squares.index)

    def _shores(self) -> tuple[Floats, Shores]:
        """Return the log odds of water of the squares, and the land and water of the tile."""
        odds = np.zeros(len(self.squares.index))
        if len(odds) >= _LEAST_SQUARES:
            name = "water" if np.isfinite(self._echoes.variation).any() else "water_by_shape"
            odds = WaterModel(name).log_odds(self.squares, *self.table(), self._echoes.trusted)
            shores = shores_of(self.points.grid, self.lowest, self.squares, odds, self._windows)
            if shores.water.any() or np.clip(odds, -_MOST_ODDS, _MOST_ODDS).mean() < -_SURE_ODDS:
                return odds, shores
        # Less than a wave, or nothing that is sure: as most tiles, it is sea.
        level = np.full(self.lowest.shape, np.median(self.lowest[np.isfinite(self.lowest)]))
        land = np.zeros(self.lowest.shape, np.bool_)
        return odds, Shores(land, level, 0.0, np.ones(len(odds), np.bool_))

    def _looks(self) -> Iterator[Cells]:
        """Yield the lowest elevations of each look, shape (S, 256, 256)."""
        if self.look is None:
            yield self.lowest
            return
        for number in np.unique(self.look).tolist():
            yield self.points.lowest_of(self.look == number)

    def _waves(self, shores: Shores) -> Waves | None:
        water = ~shores.land & np.isfinite(self.lowest)
        if not water.any() or not shores.water.any():
            return None
        return estimate_waves(self._looks(), self.lowest - self.opened, shores.level_m, water, self.params.cell_m)

    def _calm(self, shores: Shores) -> Surface:
        """Return the opened surface, which is at the level of the water on land."""
        grid, elevation, land, level = self.points.grid, self.opened.copy(), shores.land, shores.level_m
        island_m = self.params.island_m
        if not land.any() and island_m is not None:
            level = np.full(elevation.shape, commonest_level(grid, elevation, island_m / 4))
            land = island_cells(grid, elevation, level, self.params.threshold_m, island_m, land)
        elif land.any() and shores.water.any():
            land = land | island_cells(grid, elevation, level, shores.bank_m, island_m or np.inf, land)
        known = land & np.isfinite(level)
        elevation[known] = level[known]
        return Surface(elevation, self.params.threshold_m, land, self._top if self.params.land == "class2" else None)

    def _rough(self, shores: Shores, waves: Waves) -> Separation:
        """Return the separation of rough water, look by look: where strips overlap, they show it at two moments."""
        intensity = self.column("intensity")
        classification = np.full(self.points.size, NEVER, np.uint8)
        height = np.full(self.points.size, np.nan, np.float32)
        looks = []
        for number in [None] if self.look is None else np.unique(self.look).tolist():
            own = np.ones(self.points.size, np.bool_) if number is None else self.look == number
            points = self.points.chosen(own)
            if not points.grid.blocks:
                continue
            surface, alone_m = self._followed(points, shores, waves, None if intensity is None else intensity[own])
            classification[own], height[own] = surface.classes(points)
            looks.append((points, surface.land, alone_m))
        alone_m = max(looks, key=lambda look: _cells(look[0]))[2]
        land = _land_cells(self.params.cell_m, [look[:2] for look in looks])
        return Separation(classification, height, _cells(self.points), _state("followed", waves, alone_m), land)

    def _followed(
        self, points: GriddedPoints, shores: Shores, waves: Waves, intensity: NDArray[Any] | None
    ) -> tuple[Surface, float]:
        """Return the surface of the rough water of one look, and the height that a single cell needs to stand out."""
        grid, params = points.grid, self.params
        highest, echoes, brightness = _details(points, intensity)
        lowest, opened = _surfaces(points, params)
        slots = [self.points.grid.blocks[block] for block in grid.blocks]
        own, level, top = shores.land[slots], shores.level_m[slots], self._top[slots]
        above, high = _LAND_DEVIATIONS * waves.deviation_m, _ISLAND_DEVIATIONS * waves.deviation_m
        land = own | island_cells(grid, opened, level, above, max(params.island_m or np.inf, high), own)
        step = level - waves.level_m
        followed = follow_waves(grid, lowest - step, land, waves, lowest - opened, brightness)
        followed = replace(followed, surface=followed.surface + step)
        limit, alone_m = height_limits(grid, lowest, land, followed, highest, echoes)
        ground_top = top if params.land == "class2" else None
        return Surface(followed.surface, limit, land, ground_top), alone_m


def _surfaces(points: GriddedPoints, params: SeparationParams) -> tuple[Cells, Cells]:
    """Return the lowest elevations without echoes from below the surface, and their opening."""
    lowest = without_pits(points.grid, _PIT * params.threshold_m)
    return lowest, open_grid(points.grid, params.window_m, lowest)


def _is_doubtful(odds: Floats, water: Mask) -> bool:
    """Return whether the model is on average hardly sure of what it takes for water, or there is too little for it."""
    return not len(water) or bool(water.any() and np.clip(odds[water], -_MOST_ODDS, _MOST_ODDS).mean() < _SURE_ODDS)


def _state(surface: Literal["opened", "followed"], waves: Waves, height_m: float) -> SeaState:
    values = (waves.level_m, waves.height_m, waves.length_m, height_m)
    return SeaState(surface, *(round(value, 2) for value in values))


def _water_heights(points: GriddedPoints, surface: Surface) -> tuple[float, float]:
    """Return the median height of the echoes of water above the opened surface, and their deviation below it."""
    step = points.size // _SAMPLE + 1
    sample = []
    for own, z, cell in points:
        used = own % step == 0
        above, limit = surface.heights(z[used], cell[used])
        sample.append(above[limit > 0])  # no land
    above = np.concatenate(sample)
    low, middle = np.quantile(above, (0.1587, 0.5)) if len(above) else (0.0, 0.0)
    return float(middle), float(middle - low)


def _land_cells(cell_m: float, looks: Iterable[tuple[GriddedPoints, Mask]]) -> LandCells:
    """Return the land of a tile, which its looks have in parts."""
    blocks: dict[tuple[int, int], Mask] = {}
    for points, land in looks:
        for block, slot in points.grid.blocks.items():
            if land[slot].any():
                blocks[block] = blocks[block] | land[slot] if block in blocks else land[slot]
    return LandCells(cell_m, blocks)


def _details(points: GriddedPoints, intensity: NDArray[Any] | None) -> tuple[Cells, Ints, Cells | None]:
    """Return the highest elevation, the number of echoes and the logarithm of the highest intensity of each cell."""
    shape = points.grid.lowest.shape
    highest, echoes = np.full(shape, -np.inf), np.zeros(shape, np.int64)
    brightest = None if intensity is None else np.full(shape, -np.inf)
    for own, z, cell in points:
        np.maximum.at(highest.reshape(-1), cell, z)
        np.add.at(echoes.reshape(-1), cell, 1)
        if intensity is not None and brightest is not None:
            value = np.nan_to_num(intensity[own]).astype(np.float64)
            np.fmax.at(brightest.reshape(-1), cell, np.log1p(np.maximum(value, 0)))
    return highest, echoes, brightest
