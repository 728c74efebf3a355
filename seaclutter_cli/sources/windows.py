"""Points of a rectangle: windows of COPC files, read without the rest, and the margin around a tile."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError, InputError
from seaclutter_cli.sources.extents import Extent, TileHead, extent_of
from seaclutter_cli.sources.frame_files.copc import is_copc, read_chunks, read_index
from seaclutter_cli.sources.tiles import CloudTile, LasTile, Tile, TilePointReader, open_tile


class CopcWindow(LasTile):
    """The points of a COPC file in a rectangle, which are kept in memory; `CloudError` if the file is damaged."""

    def __init__(self, path: Path, window: Extent) -> None:
        super().__init__(path)
        self._kept = list(read_within(self, window))
        self.size = sum(map(len, self._kept))


def read_within(tile: LasTile, window: Extent, without: Extent | None = None) -> Iterator[Any]:
    """Yield the points of a tile in a rectangle, but not those in a part of it, without keeping them in memory.

    Of a COPC file, only the chunks that the rectangle needs are read. `CloudError` if the file is damaged.
    """
    for part in _read_near(tile, window):
        xyz = tile.xyz(part)
        inside = window.contains(xyz)
        if without is not None:
            inside &= ~without.contains(xyz)
        if inside.any():
            yield part[inside]


def _read_near(tile: LasTile, window: Extent) -> Iterator[Any]:
    if not _is_indexed(tile):
        return tile.read()
    low, high = (np.array(corner) / tile.crs.unit_m for corner in (window.low, window.high))
    return read_chunks(tile.path, read_index(tile.path, tile.header).within(low, high))


def open_tile_or_window(path: Path, window: Extent | None) -> LasTile | CloudTile:
    """Open a tile, or a window of a COPC file; raise `InputError` if it cannot be read."""
    if window is None:
        return open_tile(path)
    try:
        return CopcWindow(path, window)
    except (CloudError, OSError) as error:
        raise InputError(f"{path}: {error}") from error


def is_indexed(path: Path) -> bool:
    """Return whether a tile is a COPC file; raise `CloudError` if it cannot be read."""
    return path.suffix.lower() == ".laz" and _is_indexed(LasTile(path))


def _is_indexed(tile: LasTile) -> bool:
    return tile.path.suffix.lower() == ".laz" and is_copc(tile.header)


def windows_of(path: Path, side_m: float) -> list[TileHead]:
    """Return the windows of a COPC file in which there may be points.

    Windows are squares whose corners have multiples of their width as coordinates. `CloudError` if the file is damaged,
    or not a COPC file.
    """
    tile = LasTile(path)
    extent, index = extent_of(tile), read_index(path, tile.header)
    if extent is None:
        return []
    first, last = (np.floor(np.array(corner) / side_m).astype(int).tolist() for corner in (extent.low, extent.high))
    found = []
    for column in range(first[0], last[0] + 1):
        for row in range(first[1], last[1] + 1):
            low = np.array((column, row)) * side_m
            chunks = index.within(low / tile.crs.unit_m, (low + side_m) / tile.crs.unit_m)
            if chunks:
                (west, south), (east, north) = low.tolist(), (low + side_m).tolist()
                window = Extent((west, south), (east, north))
                size = sum(size for _, size, _ in chunks)
                found.append(TileHead(path, tile.crs, window.clipped(extent), window, size))
    return found


@dataclass(frozen=True)
class Margin:
    """Extent of a tile with its margin, and the LAS and LAZ files that have points in it.

    If the tile is a window of its file, this file is among the neighbours.
    """

    region: Extent
    neighbors: tuple[Path, ...]
    window: Extent | None = None


class MarginPoints:
    """Points of one neighbour in a region, but not in a part of it; of the neighbour, no more is kept in memory.

    `CloudError` if the neighbour cannot be read.
    """

    def __init__(self, path: Path, region: Extent, without: Extent | None = None) -> None:
        self._tile = LasTile(path)
        self._parts = list(read_within(self._tile, region, without))

    @property
    def size(self) -> int:
        """Number of points."""
        return sum(map(len, self._parts))

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Yield coordinates in metres, shape (3, n)."""
        return (self._tile.xyz(part) for part in self._parts)

    def column(self, name: str) -> NDArray[Any]:
        """Return an attribute of all points by its LAS name, shape (N,); NaN if the neighbour does not have it."""
        if name not in self._tile.names:
            return np.full(self.size, np.nan)
        return np.concatenate([self._tile.column(part, name) for part in self._parts])


class PointsWithMargin(TilePointReader):
    """The points of a tile, followed by those of its neighbours in a margin around it."""

    def __init__(self, tile: Tile, margin: Sequence[MarginPoints]) -> None:
        super().__init__(tile)
        self._margin = [own for own in margin if own.size]

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Yield coordinates in metres, shape (3, n), of each part of the tile, then of each part of the margin."""
        return chain(super().__iter__(), *self._margin)

    def column(self, name: str) -> NDArray[Any] | None:
        """Return an attribute of all points by its LAS name, shape (N,); None if the tile does not have it."""
        own = super().column(name)
        if own is None or not self._margin:
            return own
        return np.concatenate([own, *(margin.column(name) for margin in self._margin)])


def read_margin(path: Path, margin: Margin) -> tuple[list[MarginPoints], dict[Path, str]]:
    """Return the points in the margin of a tile of a file, and why neighbours could not be read."""
    found, failed = [], {}
    for neighbor in margin.neighbors:
        try:
            found.append(MarginPoints(neighbor, margin.region, margin.window if neighbor == path else None))
        except (CloudError, OSError) as error:
            failed[neighbor] = str(error)
    return found, failed
