"""Points of a tile with the cell of each, which is found once."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.grids.elevation import ElevationGrid

Cells = NDArray[np.float64]

NOWHERE = -1
"""Cell of a point without usable coordinates."""
_FARTHEST_M = 1e12


@dataclass(frozen=True)
class GriddedPoints:
    """The N points of a tile or strip, in their order, and their grid.

    ``parts``, shape (3, n): coordinates in metres; can be iterated over repeatedly; ``grid``: grid of the points;
    ``cells``, shape (n,): cell of each point by part, as an index into ``grid.lowest.ravel()``; `NOWHERE` for points
    without usable coordinates.
    """

    parts: Iterable[NDArray[np.float64]]
    grid: ElevationGrid
    cells: Sequence[NDArray[np.int32]]

    @classmethod
    def of(cls, parts: Iterable[NDArray[np.float64]], cell_m: float) -> Self:
        """Return points with their grid; raise `InputError` if they are too scattered for a grid in memory."""
        grid = ElevationGrid(cell_m)
        cells = []
        for xyz in parts:
            used = _located(xyz)
            cell = np.full(xyz.shape[1], NOWHERE, np.int32)
            cell[used] = grid.add(xyz[:, used])
            cells.append(cell)
        return cls(parts, grid, cells)

    @property
    def size(self) -> int:
        """Number of points."""
        return sum(map(len, self.cells))

    def __iter__(self) -> Iterator[tuple[slice, NDArray[np.float64], NDArray[np.int32]]]:
        """Yield which points are in each part, their elevations and their cells."""
        start = 0
        for xyz, cell in zip(self.parts, self.cells, strict=True):
            yield slice(start, start + len(cell)), xyz[2], cell
            start += len(cell)

    def chosen(self, own: NDArray[np.bool_]) -> "GriddedPoints":
        """Return the points of a mask, shape (N,), with a grid of their own."""
        return GriddedPoints.of(_Changed(_chosen, self.parts, own), self.grid.cell_m)

    def lowered(self, by_m: NDArray[np.float64]) -> "GriddedPoints":
        """Return the points, each lower by as much as ``by_m``, shape (N,), says."""
        return GriddedPoints.of(_Changed(_lowered, self.parts, by_m), self.grid.cell_m)

    def lowest_of(self, own: NDArray[np.bool_]) -> Cells:
        """Return the lowest elevations of the points of a mask, shape (S, 256, 256)."""
        lowest = np.full(self.grid.lowest.shape, np.inf)
        for part, z, cell in self:
            used = own[part] & (cell != NOWHERE)
            np.minimum.at(lowest.reshape(-1), cell[used], z[used])
        return lowest


@dataclass(frozen=True)
class _Changed:
    """What a function makes of each part, with the values of its points."""

    change: Callable[[NDArray[np.float64], NDArray[Any]], NDArray[np.float64]]
    parts: Iterable[NDArray[np.float64]]
    values: NDArray[Any]

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        start = 0
        for xyz in self.parts:
            yield self.change(xyz, self.values[start : start + xyz.shape[1]])
            start += xyz.shape[1]


def _chosen(xyz: NDArray[np.float64], own: NDArray[np.bool_]) -> NDArray[np.float64]:
    return xyz[:, own]


def _lowered(xyz: NDArray[np.float64], by_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack((xyz[0], xyz[1], xyz[2] - by_m))


def _located(xyz: NDArray[np.float64]) -> NDArray[np.bool_] | slice:
    """Return which points have usable coordinates, in most files all: squares of far greater ones overflow."""
    if xyz.min(initial=0) > -_FARTHEST_M and xyz.max(initial=0) < _FARTHEST_M:  # false if any is NaN
        return slice(None)
    return np.asarray((np.abs(xyz) < _FARTHEST_M).all(axis=0))
