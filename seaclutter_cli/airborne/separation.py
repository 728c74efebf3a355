"""Separation of tiles into sea and non-sea points."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.bottom import Bottom, bottom_of
from seaclutter_cli.airborne.classes import GROUND, NEVER, OTHER, WATER
from seaclutter_cli.airborne.echo_reader import EchoReader
from seaclutter_cli.airborne.following import CellDetails
from seaclutter_cli.airborne.gridded import NOWHERE, GriddedPoints
from seaclutter_cli.airborne.land_cells import LandCells
from seaclutter_cli.airborne.standing import standing_elevations
from seaclutter_cli.airborne.strips import Column, looks_of, strips_of
from seaclutter_cli.airborne.surface import CALM_M, RoughWater, SeaSurfaceModel, SeparationParams
from seaclutter_cli.airborne.tides import LeveledParts, strip_levels
from seaclutter_cli.airborne.waves import Waves
from seaclutter_cli.errors import InputError
from seaclutter_cli.grids.elevation import ElevationGrid
from seaclutter_cli.grids.opening import SurfaceParams

__all__ = ["GROUND", "NEVER", "OTHER", "WATER", "SeaState", "Separation", "separate"]

_SAMPLE = 20_000


def _no_column(_name: str) -> None:
    """Return no attribute."""


@dataclass(frozen=True)
class SeaState:
    """Waves of a tile, and the surface and height that separate objects from them.

    Parameters
    ----------
    surface : {"opened", "followed"}
        Opened surface, or surface that follows the waves of rough water.
    level_m : float or None
        Median level of the water; None, like the others, if the height is fixed or most of the tile is not sea.
    wave_height_m, wave_length_m : float or None
        Significant wave height, and length of the highest waves.
    object_height_m : float
        Height above the surface that makes an object; on rough water, the median over its cells.
    """

    surface: Literal["opened", "followed"]
    level_m: float | None
    wave_height_m: float | None
    wave_length_m: float | None
    object_height_m: float

    @classmethod
    def of(cls, surface: SeaSurfaceModel) -> "SeaState":
        """Return the state of the sea of a tile, rounded to centimetres."""
        waves, followed = surface.waves, surface.followed
        height = round(surface.object_height_m, 2)
        if waves is None:
            return cls("opened", None, None, None, height)
        level, wave, length = (round(value, 2) for value in (waves.level_m, waves.height_m, waves.length_m))
        return cls("followed" if followed else "opened", level, wave, length, height)


@dataclass(frozen=True)
class Separation:
    """Classes and heights of the N points of a tile.

    Parameters
    ----------
    classification : ndarray, shape (N,), uint8
        ASPRS class: `WATER`, `OTHER`, `GROUND`, or `NEVER` for points with a coordinate that is not finite.
    height_m : ndarray, shape (N,), float32
        Height above the sea surface in metres; NaN for `NEVER`.
    cells : int
        Number of grid cells with points.
    sea : SeaState
        What the separation is based on.
    land : LandCells
        Where the land is.
    is_doubtful : bool
        Whether land was looked for, and nothing in the tile tells it from water.
    """

    classification: NDArray[np.uint8]
    height_m: NDArray[np.float32]
    cells: int
    sea: SeaState = SeaState("opened", None, None, None, CALM_M)
    land: LandCells = field(default_factory=LandCells)
    is_doubtful: bool = False

    def first(self, points: int) -> "Separation":
        """Return the separation of the first points alone."""
        return replace(self, classification=self.classification[:points], height_m=self.height_m[:points])

    @property
    def other(self) -> NDArray[np.intp]:
        """Indices of the non-sea points."""
        return np.flatnonzero(self.classification == OTHER)

    @property
    def points_per_cell(self) -> float:
        """Mean number of points per cell with points."""
        return float(np.count_nonzero(self.classification != NEVER) / max(self.cells, 1))


def separate(
    parts: Iterable[NDArray[np.float64]],
    params: SurfaceParams,
    column: Column = _no_column,
) -> Separation:
    """Return the separation of a tile into sea and non-sea points.

    Parameters
    ----------
    parts : iterable of ndarray, shape (3, n), float64
        Coordinates in metres; iterated over three times, or on rough water several times.
    params : SurfaceParams
        Window and heights. With `SeparationParams`, islands and echoes from below the surface are handled, too.
    column : callable, optional
        Returns an attribute of all points by its LAS name, or None.

    Raises
    ------
    InputError
        If no point has finite coordinates, or the points are too scattered for a grid in memory.
    """
    points = GriddedPoints.of(parts, params.cell_m)
    if not points.grid.blocks:
        raise InputError("no points with finite coordinates: the sea surface cannot be computed")
    if isinstance(params, SeparationParams) and params.follows_waves:
        if (bottom := bottom_of(points, column, params.trust_classes)) is not None:
            return _above(bottom, points, params, column)
        return _separated(*_leveled(points, params.cell_m, column), params, column)
    return _separated(points, None, params, column)


def _above(bottom: Bottom, points: GriddedPoints, params: SeparationParams, column: Column) -> Separation:
    """Return the separation of a tile of clear water: that of its surface, with the echoes from below as water."""
    surface = GriddedPoints.of(_Selected(points.parts, ~bottom.below), params.cell_m)
    columns = bottom.columns_above(column)
    found = _separated(*_leveled(surface, params.cell_m, columns), params, columns)
    classification, height = np.full(points.size, WATER, np.uint8), np.empty(points.size, np.float32)
    classification[~bottom.below], height[~bottom.below] = found.classification, found.height_m
    height[bottom.below] = bottom.height_m
    return replace(found, classification=classification, height_m=height)


def _separated(
    points: GriddedPoints, change_m: NDArray[np.float64] | None, params: SurfaceParams, column: Column
) -> Separation:
    trusted = params.trust_classes if isinstance(params, SeparationParams) else ()
    looks = _LookGrids(points, params.cell_m, column)
    surface = SeaSurfaceModel(points.grid, params, EchoReader(points, column, change_m, trusted), looks=looks)
    if surface.waves is not None and not surface.is_rough:
        surface.measure_calm(*_water_heights(points, surface))
    if surface.waves is not None and surface.is_rough:
        found = _rough(points, surface, surface.waves, column, looks.numbers)
    else:
        found = Separation(*_classes(points, surface), surface.cells, SeaState.of(surface), _land(surface))
    found = replace(found, is_doubtful=surface.is_doubtful)
    if trusted and (given := column("classification")) is not None:
        kept = np.isin(given, trusted) & (found.classification != NEVER)
        found.classification[kept] = given[kept]
    return found


def _water_heights(points: GriddedPoints, surface: SeaSurfaceModel) -> tuple[float, float]:
    """Return the median height of the echoes of water above the opened surface, and their deviation below it."""
    step = points.size // _SAMPLE + 1
    sample, start = [], 0
    for z, cell in points:
        every = np.arange(-start % step, len(cell), step)
        start += len(cell)
        used = every[cell[every] != NOWHERE]
        above, limit = surface.heights(z[used], cell[used])
        sample.append(above[np.broadcast_to(limit, above.shape) > 0])  # no land
    above = np.concatenate(sample)
    low, middle = np.quantile(above, (0.1587, 0.5)) if len(above) else (0.0, 0.0)
    return float(middle), float(middle - low)


def _leveled(points: GriddedPoints, cell_m: float, column: Column) -> tuple[GriddedPoints, NDArray[np.float64] | None]:
    """Return the points of a tile with the water of all strips at one level, and how squares change between strips."""
    strip = strips_of(column)
    levels = None if strip is None else strip_levels(points, strip)
    if strip is None or levels is None:
        return points, None
    if not levels.tide_m.any():
        return points, levels.changes_m()
    leveled = GriddedPoints.of(LeveledParts(points.parts, strip, levels.tide_m), cell_m)
    return leveled, levels.changes_m()


def _land(*surfaces: SeaSurfaceModel) -> LandCells:
    """Return the land of a tile, which its strips have in parts."""
    blocks: dict[tuple[int, int], NDArray[np.bool_]] = {}
    for surface in surfaces:
        for block, own in surface.all_land_by_block.items():
            blocks[block] = blocks[block] | own if block in blocks else own
    return LandCells(surfaces[0].params.cell_m, blocks)


def _rough(
    whole_tile: GriddedPoints, whole: SeaSurfaceModel, waves: Waves, column: Column, strip: NDArray[np.uint8] | None
) -> Separation:
    """Return the separation of rough water, strip by strip: where strips overlap, they show it at two moments."""
    intensity = column("intensity")
    classification, height = np.empty(whole_tile.size, np.uint8), np.empty(whole_tile.size, np.float32)
    may_mix = strip is None and column("gps_time") is None
    surfaces = []
    passes = strips_of(column)  # the looks of a cone are only seconds apart
    standing = None if passes is None else standing_elevations(whole_tile, passes, waves)
    for number in [None] if strip is None else np.unique(strip).tolist():
        own = np.ones(whole_tile.size, np.bool_) if number is None else strip == number
        points = GriddedPoints.of(_Selected(whole_tile.parts, own), whole.params.cell_m)
        if not points.grid.blocks:
            classification[own], height[own] = NEVER, np.nan
            continue
        details = _details(points, None if intensity is None else intensity[own], may_mix=may_mix)
        rough = RoughWater(
            waves,
            whole.land_by_block,
            whole.levels_by_block,
            details,
            _by_block(whole_tile, standing),
            whole.ditches_by_block,
        )
        surface = SeaSurfaceModel(points.grid, whole.params, rough=rough)
        classification[own], height[own] = _classes(points, surface)
        surfaces.append(surface)
    largest = max(surfaces, key=lambda surface: surface.cells)
    return Separation(classification, height, whole.cells, SeaState.of(largest), _land(*surfaces))


@dataclass(frozen=True)
class _LookGrids:
    """Grids of what each look of a tile shows; none if there is only one."""

    points: GriddedPoints
    cell_m: float
    column: Column

    @cached_property
    def numbers(self) -> NDArray[np.uint8] | None:
        """Look of each point, shape (N,); None if there is only one."""
        return looks_of(strips_of(self.column), self.points.parts, self.column)

    def __iter__(self) -> Iterator[ElevationGrid]:
        if self.numbers is None:
            return
        for number in np.unique(self.numbers).tolist():
            grid = GriddedPoints.of(_Selected(self.points.parts, self.numbers == number), self.cell_m).grid
            if grid.blocks:
                yield grid


@dataclass(frozen=True)
class _Selected:
    """Selected points of each part."""

    parts: Iterable[NDArray[np.float64]]
    own: NDArray[np.bool_]

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        start = 0
        for xyz in self.parts:
            yield xyz[:, self.own[start : start + xyz.shape[1]]]
            start += xyz.shape[1]


def _by_block(points: GriddedPoints, cells: NDArray[np.float64] | None) -> dict[tuple[int, int], NDArray[np.float64]]:
    return {} if cells is None else {block: cells[slot] for block, slot in points.grid.blocks.items()}


def _classes(points: GriddedPoints, surface: SeaSurfaceModel) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    classification, height = np.empty(points.size, np.uint8), np.empty(points.size, np.float32)
    to_ground = isinstance(surface.params, SeparationParams) and surface.params.land == "class2"
    start = 0
    for z, cell in points:
        own = slice(start, start + len(cell))
        above, limit = surface.heights(z, cell)
        located = cell != NOWHERE
        height[own] = np.where(located, above, np.nan)
        classification[own] = np.where(above > limit, np.uint8(OTHER), np.uint8(WATER))
        if to_ground:
            classification[own][surface.is_ground(z, cell) & (above > limit)] = GROUND
        classification[own][~located] = NEVER
        start = own.stop
    return classification, height


def _details(points: GriddedPoints, intensity: NDArray[Any] | None, *, may_mix: bool) -> CellDetails:
    """Return the highest elevation, the number of echoes, and the intensities of each cell."""
    shape = points.grid.lowest.shape
    highest, echoes = np.full(shape, -np.inf), np.zeros(shape, np.int64)
    brightest, one, two = (None if intensity is None else np.zeros(shape) for _ in range(3))
    if brightest is not None:
        brightest[:] = -np.inf
    start = 0
    for z, cell in points:
        located = cell != NOWHERE
        np.maximum.at(highest.reshape(-1), cell[located], z[located])
        np.add.at(echoes.reshape(-1), cell[located], 1)
        if intensity is not None and brightest is not None and one is not None and two is not None:
            value = np.nan_to_num(intensity[start : start + len(cell)][located]).astype(np.float64)
            np.fmax.at(brightest.reshape(-1), cell[located], np.log1p(np.maximum(value, 0)))
            np.add.at(one.reshape(-1), cell[located], value)
            np.add.at(two.reshape(-1), cell[located], value**2)
        start += len(cell)
    return CellDetails(highest, brightest, one, two, echoes, np.zeros(shape, np.bool_), may_mix)
