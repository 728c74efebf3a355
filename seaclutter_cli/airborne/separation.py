"""Separation of tiles into sea and non-sea points."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.following import CellDetails
from seaclutter_cli.airborne.grid import ElevationGrid
from seaclutter_cli.airborne.squares import Echoes, Squares, echoes_of
from seaclutter_cli.airborne.strips import Column, strips_of
from seaclutter_cli.airborne.surface import CALM_M, RoughWater, SeaSurfaceModel, SeparationParams, SurfaceParams
from seaclutter_cli.airborne.waves import Waves
from seaclutter_cli.errors import InputError

NEVER, OTHER, GROUND, WATER = 0, 1, 2, 9
"""ASPRS classes: never classified (points without finite coordinates), unclassified, ground, water."""
_FARTHEST_M = 1e12


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
        ASPRS class: `WATER`, `OTHER`, or `NEVER` for points with a coordinate that is not finite.
    height_m : ndarray, shape (N,), float32
        Height above the sea surface in metres; NaN for `NEVER`.
    cells : int
        Number of grid cells with points.
    sea : SeaState
        What the separation is based on.
    """

    classification: NDArray[np.uint8]
    height_m: NDArray[np.float32]
    cells: int
    sea: SeaState = SeaState("opened", None, None, None, CALM_M)

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
        Coordinates in metres; iterated over twice, or on rough water several times.
    params : SurfaceParams
        Window and heights. With `SeparationParams`, islands and echoes from below the surface are handled, too.
    column : callable, optional
        Returns an attribute of all points by its LAS name, or None; called on rough water only.

    Raises
    ------
    InputError
        If no point has finite coordinates, or the points are too scattered for a grid in memory.
    """
    grid = ElevationGrid(params.cell_m)
    for xyz in parts:
        grid.add(xyz[:, _located(xyz)])
    if not grid.blocks:
        raise InputError("no points with finite coordinates: the sea surface cannot be computed")
    surface = SeaSurfaceModel(grid, params, lambda squares, top: _echoes(parts, grid, squares, top, column))
    if surface.waves is not None and surface.is_rough:
        return _rough(parts, surface, surface.waves, column)
    found = [_classes(xyz, surface) for xyz in parts]
    classification, height = (np.concatenate(values) for values in zip(*found, strict=True))
    return Separation(classification, height, surface.cells, SeaState.of(surface))


def _rough(parts: Iterable[NDArray[np.float64]], whole: SeaSurfaceModel, waves: Waves, column: Column) -> Separation:
    """Return the separation of rough water, strip by strip: where strips overlap, they show it at two moments."""
    intensity, strip = column("intensity"), strips_of(column)
    points = sum(xyz.shape[1] for xyz in parts)
    classification, height = np.empty(points, np.uint8), np.empty(points, np.float32)
    surfaces = []
    for number in [None] if strip is None else np.unique(strip).tolist():
        own = np.ones(points, np.bool_) if number is None else strip == number
        selected = _Selected(parts, own)
        grid = ElevationGrid(whole.params.cell_m)
        for xyz in selected:
            grid.add(xyz[:, _located(xyz)])
        details = _details(selected, grid, None if intensity is None else intensity[own])
        surface = SeaSurfaceModel(grid, whole.params, rough=RoughWater(waves, whole.land_by_block, details))
        found = [_classes(xyz, surface) for xyz in selected]
        classification[own], height[own] = (np.concatenate(values) for values in zip(*found, strict=True))
        surfaces.append(surface)
    largest = max(surfaces, key=lambda surface: surface.cells)
    return Separation(classification, height, whole.cells, SeaState.of(largest))


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


def _located(xyz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each point has usable coordinates: squares of far greater ones, which are damaged, overflow."""
    return np.asarray((np.abs(xyz) < _FARTHEST_M).all(axis=0))


def _classes(xyz: NDArray[np.float64], surface: SeaSurfaceModel) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    finite = _located(xyz)
    height = np.full(len(finite), np.nan)
    limit = np.full(len(finite), surface.params.threshold_m)
    height[finite], limit[finite] = surface.heights(xyz if finite.all() else xyz[:, finite])
    classes = np.where(height > limit, OTHER, WATER)
    if isinstance(surface.params, SeparationParams) and surface.params.land == "class2":
        classes[finite] = np.where(surface.is_ground(xyz[:, finite]), GROUND, classes[finite])
    return np.where(finite, classes, NEVER).astype(np.uint8), height.astype(np.float32)


def _echoes(
    parts: Iterable[NDArray[np.float64]],
    grid: ElevationGrid,
    squares: Squares,
    top: NDArray[np.float64],
    column: Column,
) -> Echoes:
    """Return the echoes of squares that are no higher than ``top``, the elevation of each cell."""

    def located() -> Iterator[tuple[NDArray[np.int64], NDArray[np.bool_]]]:
        for xyz in parts:
            used = _located(xyz)
            cell = np.zeros(len(used), np.int64)
            cell[used] = grid.locate(*xyz[:2, used])
            yield cell, used & (xyz[2] <= top.reshape(-1)[cell])

    return echoes_of(squares, grid, located(), column)


def _details(parts: Iterable[NDArray[np.float64]], grid: ElevationGrid, intensity: NDArray[Any] | None) -> CellDetails:
    """Return the highest elevation of each cell, and the logarithm of its highest intensity if there are any."""
    highest = np.full(grid.lowest.size, -np.inf)
    brightest = np.full(0 if intensity is None else grid.lowest.size, -np.inf)
    start = 0
    for xyz in parts:
        located = _located(xyz)
        cell = grid.locate(*xyz[:2, located])
        np.maximum.at(highest, cell, xyz[2, located])
        if intensity is not None:
            value = intensity[start : start + xyz.shape[1]][located].astype(np.float64)
            np.fmax.at(brightest, cell, np.log1p(np.maximum(value, 0)))
        start += xyz.shape[1]
    shape = grid.lowest.shape
    return CellDetails(highest.reshape(shape), None if intensity is None else brightest.reshape(shape))
