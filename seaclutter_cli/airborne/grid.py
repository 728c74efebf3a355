"""The lowest elevation in each cell of a grid that takes memory only where there are points."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError

Cells = NDArray[np.float64]

_BITS = 8
BLOCK = 1 << _BITS
"""Cells along the side of a block."""
MAX_BLOCKS = 800
"""Blocks at most: 400 MB."""

_FARTHEST = 2.0**38
_FEW = 1 << 22


class ElevationGrid:
    """Square cells of a horizontal plane, anchored at multiples of their width, each with its lowest elevation.

    Cells are kept in blocks of 256 by 256, and only blocks with points exist: a stray point far away costs one block.

    Parameters
    ----------
    cell_m : float
        Width of a cell in metres.

    Examples
    --------
    >>> grid = ElevationGrid(1.0)
    >>> grid.add(np.array([[0.2, 0.9, 5.0], [0, 0, 0], [3, 1, 2]]))
    >>> grid.lowest.ravel()[grid.locate(np.array([0.5, 5.0]), np.array([0.5, 0.5]))]
    array([1., 2.])
    """

    def __init__(self, cell_m: float) -> None:
        self.cell_m = cell_m
        self._slots: dict[tuple[int, int], int] = {}
        self._lowest = np.full((0, BLOCK, BLOCK), np.inf)
        self._extent = np.array([[2**62, -(2**62)]] * 2)

    @property
    def lowest(self) -> Cells:
        """Lowest elevation in metres, shape (S, 256, 256), S blocks; plus infinity in empty cells."""
        return self._lowest[: len(self._slots)]

    @property
    def blocks(self) -> dict[tuple[int, int], int]:
        """Place of each block in `lowest`, by its number along x and y."""
        return self._slots

    def add(self, xyz: NDArray[np.float64]) -> None:
        """Lower the cells to points, shape (3, N), in metres and finite.

        Raises
        ------
        InputError
            If the points are scattered so far that the grid would take too much memory.
        """
        if xyz.shape[1]:
            cell = self._flat(xyz[0], xyz[1], grow=True)
            np.minimum.at(self._lowest.reshape(-1), cell, xyz[2])

    def locate(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the cells of places, shape (N,), as indices into ``lowest.ravel()``; each must be in a block."""
        return self._flat(x, y, grow=False)

    def padded(self, values: Cells, halo: int) -> Iterator[tuple[int, Cells, tuple[slice, slice]]]:
        """Yield each block's place with its part of ``values`` and ``halo`` cells around it; infinity beyond.

        The slices are the part of these cells that lies in the least rectangle about all points.

        Parameters
        ----------
        values : ndarray, shape (S, 256, 256), float64
            A value for each cell.
        halo : int
            Cells to every side.
        """
        reach = -(-halo // BLOCK)
        for (column, row), slot in self._slots.items():
            out = np.full((BLOCK + 2 * halo,) * 2, np.inf)
            for i in range(-reach, reach + 1):
                for j in range(-reach, reach + 1):
                    other = self._slots.get((column + i, row + j))
                    if other is not None:
                        (to_x, from_x), (to_y, from_y) = _overlap(i, halo), _overlap(j, halo)
                        out[to_x, to_y] = values[other, from_x, from_y]
            yield slot, out, (self._within(0, column, halo), self._within(1, row, halo))

    def _within(self, axis: int, block: int, halo: int) -> slice:
        """Return which of a padded block's cells along an axis lie between the first and the last with points."""
        low, high = (self._extent[axis] - (block * BLOCK - halo)).tolist()
        return slice(max(low, 0), min(high + 1, BLOCK + 2 * halo))

    def _flat(self, x: NDArray[np.float64], y: NDArray[np.float64], *, grow: bool) -> NDArray[np.int64]:
        column, row = self._cell(x), self._cell(y)
        block, which = _distinct(column >> _BITS, row >> _BITS)
        if grow:
            self._grow(block)
            for extent, cells in zip(self._extent, (column, row), strict=True):
                extent[:] = min(extent[0], cells.min()), max(extent[1], cells.max())
        slots = np.array([self._slots[key] for key in block], np.int64)
        inside = ((column & (BLOCK - 1)) << _BITS) + (row & (BLOCK - 1))
        return np.asarray((slots[which] << (2 * _BITS)) + inside)

    def _cell(self, places: NDArray[np.float64]) -> NDArray[np.int64]:
        # What lies beyond all measure shares the last cell.
        return np.floor(np.clip(places / self.cell_m, -_FARTHEST, _FARTHEST)).astype(np.int64)

    def _grow(self, block: list[tuple[int, int]]) -> None:
        for key in block:
            self._slots.setdefault(key, len(self._slots))
        needed = len(self._slots)
        if needed > MAX_BLOCKS:
            side = BLOCK * self.cell_m
            raise InputError(
                f"points are scattered over more than {MAX_BLOCKS} squares of {side:g} m, more than a grid of"
                f" {self.cell_m:g} m cells can hold in memory: cut the tile, or choose a larger cell_m"
            )
        if needed > len(self._lowest):
            more = min(MAX_BLOCKS, max(needed, 3 * len(self._lowest) // 2))
            self._lowest = np.concatenate((self.lowest, np.full((more - len(self.lowest), BLOCK, BLOCK), np.inf)))


def _overlap(step: int, halo: int) -> tuple[slice, slice]:
    """Return where the block ``step`` further on lies in a padded one, and which part of it."""
    start = halo + step * BLOCK
    low, high = max(start, 0), min(start + BLOCK, BLOCK + 2 * halo)
    return slice(low, high), slice(low - start, high - start)


def _distinct(column: NDArray[np.int64], row: NDArray[np.int64]) -> tuple[list[tuple[int, int]], NDArray[np.int64]]:
    """Return the distinct pairs, sorted, and which of them each pair is."""
    if not len(column):
        return [], np.empty(0, np.int64)
    low = int(column.min()), int(row.min())
    spans = int(column.max()) - low[0] + 1, int(row.max()) - low[1] + 1
    if spans[0] * spans[1] <= _FEW:
        key = (column - low[0]) * spans[1] + (row - low[1])
        taken = np.zeros(spans[0] * spans[1], np.bool_)
        taken[key] = True
        found = np.flatnonzero(taken)
        number = np.empty(len(taken), np.int64)
        number[found] = np.arange(len(found))
        return [(k // spans[1] + low[0], k % spans[1] + low[1]) for k in found.tolist()], number[key]
    pairs, which = np.unique(np.stack((column, row), 1), axis=0, return_inverse=True)
    return [(a, b) for a, b in pairs.tolist()], which.reshape(-1)
