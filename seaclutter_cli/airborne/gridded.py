"""Points of a tile with the cell of each, which is found once."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.grids.elevation import ElevationGrid

NOWHERE = -1
"""Cell of a point without usable coordinates."""
_FARTHEST_M = 1e12


@dataclass(frozen=True)
class GriddedPoints:
    """The N points of a tile or strip, in their order, and their grid.

    Parameters
    ----------
    parts : iterable of ndarray, shape (3, n), float64
        Coordinates in metres; can be iterated over repeatedly.
    grid : ElevationGrid
        Grid of the points.
    cells : sequence of ndarray, shape (n,), int32
        Cell of each point by part, as an index into ``grid.lowest.ravel()``; `NOWHERE` for points without usable
        coordinates.
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

    def __iter__(self) -> Iterator[tuple[NDArray[np.float64], NDArray[np.int32]]]:
        """Yield elevation and cell of the points, part by part."""
        for xyz, cell in zip(self.parts, self.cells, strict=True):
            yield xyz[2], cell


def _located(xyz: NDArray[np.float64]) -> NDArray[np.bool_] | slice:
    """Return which points have usable coordinates, in most files all: squares of far greater ones overflow."""
    if xyz.min(initial=0) > -_FARTHEST_M and xyz.max(initial=0) < _FARTHEST_M:  # false if any is NaN
        return slice(None)
    return np.asarray((np.abs(xyz) < _FARTHEST_M).all(axis=0))
