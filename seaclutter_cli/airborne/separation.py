"""Tiles into sea and what is not."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.grid import ElevationGrid
from seaclutter_cli.airborne.surface import SeaSurfaceModel, SurfaceParams
from seaclutter_cli.errors import InputError

NEVER, OTHER, WATER = 0, 1, 9
"""ASPRS classes: never classified (points without a place), unclassified, water."""


@dataclass(frozen=True)
class Separation:
    """A tile's points, N of them, as sea or not.

    Parameters
    ----------
    classification : ndarray, shape (N,), uint8
        ASPRS class: `WATER`, `OTHER`, or `NEVER` for points with a coordinate that is not finite.
    height_m : ndarray, shape (N,), float32
        Height above the sea surface; NaN for those.
    cells : int
        Grid cells with points.
    """

    classification: NDArray[np.uint8]
    height_m: NDArray[np.float32]
    cells: int

    @property
    def other(self) -> NDArray[np.intp]:
        """Indices of the points that are no sea."""
        return np.flatnonzero(self.classification == OTHER)

    @property
    def points_per_cell(self) -> float:
        """Mean number of points in a cell that has any."""
        return float(np.count_nonzero(self.classification != NEVER) / max(self.cells, 1))


def separate(parts: Iterable[NDArray[np.float64]], params: SurfaceParams) -> Separation:
    """Separate a tile.

    Parameters
    ----------
    parts : iterable of ndarray, shape (3, n), float64
        Coordinates in metres; gone through twice.
    params : SurfaceParams
        Window and heights. `SeparationParams` tell islands, and echoes from below.

    Raises
    ------
    InputError
        If no point has finite coordinates, or they are scattered so far that the grid would take too much memory.
    """
    grid = ElevationGrid(params.cell_m)
    for xyz in parts:
        grid.add(xyz[:, np.isfinite(xyz).all(axis=0)])
    if not grid.blocks:
        raise InputError("no points with finite coordinates, so no sea surface")
    surface = SeaSurfaceModel(grid, params)
    found = [_classes(xyz, surface) for xyz in parts]
    classification, height = (np.concatenate(column) for column in zip(*found, strict=True))
    return Separation(classification, height, surface.cells)


def _classes(xyz: NDArray[np.float64], surface: SeaSurfaceModel) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    placed = np.asarray(np.isfinite(xyz).all(axis=0))
    height = np.full(len(placed), np.nan)
    height[placed] = surface.height(xyz if placed.all() else xyz[:, placed])
    classes = np.where(height > surface.params.height_m, OTHER, WATER)
    return np.where(placed, classes, NEVER).astype(np.uint8), height.astype(np.float32)
