"""Sparse grid with the lowest elevation of each cell, points with the cell of each, and cells of land for maps."""

import bz2
import json
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Indices, Ints, Mask
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import InputError
from seaclutter_cli.text import count

Cells = Floats
T = TypeVar("T", bound=np.generic)

_BITS = 8
BLOCK = 1 << _BITS
"""Number of cells along each side of a block."""
MAX_BLOCKS = 800
"""Maximum number of blocks, 400 MB."""
FREE_BLOCKS, POINTS_PER_BLOCK = 128, 500
"""Number of blocks of any grid, 64 MB, and of points that allow one more block: few points never need much memory."""

NOWHERE = -1
"""Cell of a point without usable coordinates."""

_FARTHEST, _FARTHEST_M = 2.0**38, 1e12
_FEW = 1 << 22
_BLOCK_BYTES = BLOCK * BLOCK // 8


class ElevationGrid:
    """Sparse horizontal grid with the lowest elevation of each cell.

    Cells are square and aligned to multiples of their width. They are stored in blocks of 256 by 256, and only blocks
    with points exist: an outlying point far away costs one block. Points may be in up to 800 blocks, and in no more
    than 128 and one for each 500 points.
    """

    def __init__(self, cell_m: float) -> None:
        self.cell_m = cell_m
        self.blocks: dict[tuple[int, int], int] = {}
        """Index of each block in `lowest`, by its block number along x and y."""
        self._lowest = np.full((0, BLOCK, BLOCK), np.inf)
        self._extent = np.array([[2**62, -(2**62)]] * 2)
        self._points = 0

    @property
    def lowest(self) -> Cells:
        """Lowest elevation in metres, shape (S, 256, 256) for S blocks; plus infinity in empty cells."""
        return self._lowest[: len(self.blocks)]

    def add(self, xyz: Floats) -> Ints:
        """Update cells with points, shape (3, N), in metres and finite; return the indices into ``lowest.ravel()``.

        Raise `InputError` if the points are too scattered for a grid in memory.
        """
        self._points += xyz.shape[1]
        if not xyz.shape[1]:
            return np.empty(0, np.int64)
        # Coordinates out of range share the outermost cell.
        place = np.floor(np.clip(xyz[:2] / self.cell_m, -_FARTHEST, _FARTHEST)).astype(np.int64)
        block, which = _distinct(*(place >> _BITS))
        self._grow(block)
        self._extent[:, 0] = np.minimum(self._extent[:, 0], place.min(axis=1))
        self._extent[:, 1] = np.maximum(self._extent[:, 1], place.max(axis=1))
        slots = np.array([self.blocks[key] for key in block], np.int64)
        column, row = place & (BLOCK - 1)
        cell = np.asarray((slots[which] << (2 * _BITS)) + (column << _BITS) + row)
        np.minimum.at(self._lowest.reshape(-1), cell, xyz[2])
        return cell

    def padded(
        self, values: NDArray[T], halo: int, beyond: Any = np.inf
    ) -> Iterator[tuple[int, NDArray[T], tuple[slice, slice]]]:
        """Yield the index of each block, its values padded by ``halo`` cells on each side, and slices to cells in use.

        Values have the shape (S, 256, 256). Padding without a block is ``beyond``. The slices select the cells in the
        bounding rectangle of all points.
        """
        reach = -(-halo // BLOCK)
        for (column, row), slot in self.blocks.items():
            out = np.full((BLOCK + 2 * halo,) * 2, beyond, values.dtype)
            for i in range(-reach, reach + 1):
                for j in range(-reach, reach + 1):
                    other = self.blocks.get((column + i, row + j))
                    if other is not None:
                        (to_x, from_x), (to_y, from_y) = _overlap(i, halo), _overlap(j, halo)
                        out[to_x, to_y] = values[other, from_x, from_y]
            yield slot, out, (self._within(0, column, halo), self._within(1, row, halo))

    def _within(self, axis: int, block: int, halo: int) -> slice:
        """Return the slice of a padded block from the first to the last cell with points along an axis."""
        low, high = (self._extent[axis] - (block * BLOCK - halo)).tolist()
        return slice(max(low, 0), min(high + 1, BLOCK + 2 * halo))

    def _grow(self, block: list[tuple[int, int]]) -> None:
        for key in block:
            self.blocks.setdefault(key, len(self.blocks))
        needed = len(self.blocks)
        most = min(MAX_BLOCKS, FREE_BLOCKS + self._points // POINTS_PER_BLOCK)
        if needed > most:
            side = BLOCK * self.cell_m
            raise InputError(
                f"{count(self._points, 'point')} are scattered over more than {most} squares of {side:g} m, too many"
                f" for a grid of {self.cell_m:g} m cells in memory; remove outlying points, cut the tile, or choose a"
                " larger cell_m"
            )
        if needed > len(self._lowest):
            more = min(MAX_BLOCKS, max(needed, 3 * len(self._lowest) // 2))
            self._lowest = np.concatenate((self.lowest, np.full((more - len(self.lowest), BLOCK, BLOCK), np.inf)))


def near_known(known: Mask, reach: int) -> tuple[slice, ...]:
    """Return the part of an array up to ``reach`` cells from what is known: most blocks of a tile are nearly empty."""
    ends = (np.flatnonzero(known.any(axis=1 - axis))[[0, -1]].tolist() for axis in range(2))
    return tuple(slice(max(first - reach, 0), last + reach + 1) for first, last in ends)


def _overlap(step: int, halo: int) -> tuple[slice, slice]:
    """Return the slice of a padded block that the block ``step`` blocks away fills, and the slice of the latter."""
    start = halo + step * BLOCK
    low, high = max(start, 0), min(start + BLOCK, BLOCK + 2 * halo)
    return slice(low, high), slice(low - start, high - start)


def _distinct(column: Ints, row: Ints) -> tuple[list[tuple[int, int]], Ints]:
    """Return the distinct pairs, sorted, and the index of each pair among them."""
    low = int(column.min()), int(row.min())
    span = int(row.max()) - low[1] + 1
    key = (column - low[0]) * span + (row - low[1])
    most = int(key.max()) + 1
    if most <= _FEW:
        taken = np.zeros(most, np.bool_)
        taken[key] = True
        found, which = np.flatnonzero(taken), (np.cumsum(taken) - 1)[key]
    else:
        found, which = np.unique(key, return_inverse=True)
    return [(k // span + low[0], k % span + low[1]) for k in found.tolist()], which.reshape(-1)


class GriddedPoints:
    """The N points of a tile or strip, in their order, and their grid.

    ``parts``, shape (3, n): coordinates in metres; can be iterated over repeatedly; ``grid``: grid of the points;
    ``cells``, shape (n,): cell of each point by part, as an index into ``grid.lowest.ravel()``; `NOWHERE` for points
    without usable coordinates; ``size``: number of points. Raise `InputError` if they are too scattered for a grid in
    memory.
    """

    def __init__(self, parts: Iterable[Floats], cell_m: float) -> None:
        self.parts, self.grid = parts, ElevationGrid(cell_m)
        self.cells: list[NDArray[np.int32]] = []
        for xyz in parts:
            used = _located(xyz)
            cell = np.full(xyz.shape[1], NOWHERE, np.int32)
            cell[used] = self.grid.add(xyz[:, used])
            self.cells.append(cell)
        self.size = sum(map(len, self.cells))

    def __iter__(self) -> Iterator[tuple[Indices, Floats, NDArray[np.int32]]]:
        """Yield the indices of the points of each part that have a cell, their elevations and their cells."""
        for (part, xyz), cell in zip(sliced(self.parts), self.cells, strict=True):
            located = np.flatnonzero(cell != NOWHERE)
            yield part.start + located, xyz[2, located], cell[located]

    def chosen(self, own: Mask) -> "GriddedPoints":
        """Return the points of a mask, shape (N,), with a grid of their own."""
        return GriddedPoints(_Parts(lambda: (xyz[:, own[part]] for part, xyz in sliced(self.parts))), self.grid.cell_m)

    def lowered(self, by_m: Floats) -> "GriddedPoints":
        """Return the points, each lower by as much as ``by_m``, shape (N,), says."""
        parts = _Parts(lambda: (np.stack((*xyz[:2], xyz[2] - by_m[part])) for part, xyz in sliced(self.parts)))
        return GriddedPoints(parts, self.grid.cell_m)

    def lowest_of(self, own: Mask) -> Cells:
        """Return the lowest elevations of the points of a mask, shape (S, 256, 256)."""
        lowest = np.full(self.grid.lowest.shape, np.inf)
        for index, z, cell in self:
            used = own[index]
            np.minimum.at(lowest.reshape(-1), cell[used], z[used])
        return lowest


@dataclass(frozen=True)
class _Parts:
    """Parts that a function makes anew for each iteration."""

    make: Callable[[], Iterator[Floats]]

    def __iter__(self) -> Iterator[Floats]:
        return self.make()


def sliced(parts: Iterable[Floats]) -> Iterator[tuple[slice, Floats]]:
    """Yield which of all points are in each part, and their coordinates, shape (3, n)."""
    start = 0
    for xyz in parts:
        yield slice(start, start := start + xyz.shape[1]), xyz


def _located(xyz: Floats) -> Mask | slice:
    """Return which points have usable coordinates, in most files all: squares of far greater ones overflow."""
    if xyz.min(initial=0) > -_FARTHEST_M and xyz.max(initial=0) < _FARTHEST_M:  # false if any is NaN
        return slice(None)
    return np.asarray((np.abs(xyz) < _FARTHEST_M).all(axis=0))


@dataclass(frozen=True)
class LandCells:
    """Cells of the grid that are land or a ditch. Points there that are not water belong to the land, not to objects.

    ``cell_m``: width of a cell; ``blocks``, shape (256, 256): the cells, in the blocks that contain any.
    """

    cell_m: float = 1.0
    blocks: Mapping[tuple[int, int], Mask] = field(default_factory=dict)

    def contain(self, xy: Floats) -> Mask:
        """Return whether positions in metres, shape (2, N), are on land."""
        column, row = np.floor(xy / self.cell_m).astype(np.int64)
        found = np.zeros(xy.shape[1], np.bool_)
        for block, land in self.blocks.items():
            inside = np.flatnonzero((column // BLOCK == block[0]) & (row // BLOCK == block[1]))
            found[inside] = land[column[inside] % BLOCK, row[inside] % BLOCK]
        return found

    def as_text(self) -> str:
        """Return the cells as JSON."""
        bits = b"".join(np.packbits(land).tobytes() for land in self.blocks.values())
        # bzip2 gives the same bytes in every version, deflate does not
        packed = b64encode(bz2.compress(bits)).decode() if bits else ""
        return json.dumps({"cell_m": self.cell_m, "blocks": [list(map(int, at)) for at in self.blocks], "land": packed})

    @classmethod
    def from_text(cls, text: str) -> "LandCells":
        """Return the cells that `as_text` described; raise `ValueError` if the text is damaged."""
        try:
            stored: Any = load_json(text)
            cell_m, places = float(stored["cell_m"]), [(int(i), int(j)) for i, j in stored["blocks"]]
            bits = b""
            if places:
                size = len(places) * _BLOCK_BYTES
                bits = bz2.BZ2Decompressor().decompress(b64decode(stored["land"]), size + 1)
            land = np.unpackbits(np.frombuffer(bits, np.uint8)).reshape(len(places), BLOCK, BLOCK).astype(np.bool_)
        except (KeyError, TypeError, ValueError, OSError, EOFError) as error:
            raise ValueError(f"damaged record of the land ({error!r})") from error
        return cls(cell_m, dict(zip(places, land, strict=True)))
