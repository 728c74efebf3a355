"""Separation of tiles into sea and non-sea points."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.grid import ElevationGrid
from seaclutter_cli.airborne.surface import SeaSurfaceModel, SurfaceParams
from seaclutter_cli.errors import InputError

NEVER, OTHER, WATER = 0, 1, 9
"""ASPRS classes: never classified (points without finite coordinates), unclassified, water."""
_FARTHEST_M = 1e12


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
    """

    classification: NDArray[np.uint8]
    height_m: NDArray[np.float32]
    cells: int

    @property
    def other(self) -> NDArray[np.intp]:
        """Indices of the non-sea points."""
        return np.flatnonzero(self.classification == OTHER)

    @property
    def points_per_cell(self) -> float:
        """Mean number of points per cell with points."""
        return float(np.count_nonzero(self.classification != NEVER) / max(self.cells, 1))


def separate(parts: Iterable[NDArray[np.float64]], params: SurfaceParams) -> Separation:
    """Return the separation of a tile into sea and non-sea points.

    Parameters
    ----------
    parts : iterable of ndarray, shape (3, n), float64
        Coordinates in metres; iterated over twice.
    params : SurfaceParams
        Window and heights. With `SeparationParams`, islands and echoes from below the surface are handled, too.

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
    surface = SeaSurfaceModel(grid, params)
    found = [_classes(xyz, surface) for xyz in parts]
    classification, height = (np.concatenate(column) for column in zip(*found, strict=True))
    return Separation(classification, height, surface.cells)


def _located(xyz: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each point has usable coordinates: squares of far greater ones, which are damaged, overflow."""
    return np.asarray((np.abs(xyz) < _FARTHEST_M).all(axis=0))


def _classes(xyz: NDArray[np.float64], surface: SeaSurfaceModel) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    finite = _located(xyz)
    height = np.full(len(finite), np.nan)
    height[finite] = surface.height(xyz if finite.all() else xyz[:, finite])
    classes = np.where(height > surface.params.height_m, OTHER, WATER)
    return np.where(finite, classes, NEVER).astype(np.uint8), height.astype(np.float32)
