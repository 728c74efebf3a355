"""Windows of COPC files: the points of a rectangle, read without the rest of the file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.errors import CloudError, InputError
from seaclutter_cli.sources.extents import Extent, TileHead, extent_of
from seaclutter_cli.sources.frame_files.copc import is_copc, read_chunks, read_index
from seaclutter_cli.sources.tiles import CloudTile, LasTile, open_tile


class CopcWindow(LasTile):
    """The points of a COPC file in a rectangle, which are kept in memory.

    Parameters
    ----------
    path : Path
        The file.
    window : Extent
        The rectangle.

    Raises
    ------
    CloudError
        If the file is damaged.
    """

    def __init__(self, path: Path, window: Extent) -> None:
        super().__init__(path)
        self._kept = list(read_within(self, window))
        self.size = sum(map(len, self._kept))


def read_within(tile: LasTile, window: Extent, without: Extent | None = None) -> Iterator[Any]:
    """Yield the points of a tile in a rectangle in parts, without keeping them in memory.

    Parameters
    ----------
    tile : LasTile
        The tile; of a COPC file, only the chunks that the rectangle needs are read.
    window : Extent
        The rectangle.
    without : Extent, optional
        A part of it whose points are left out.

    Raises
    ------
    CloudError
        If the file is damaged.
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

    Windows are squares whose corners have multiples of their width as coordinates.

    Raises
    ------
    CloudError
        If the file is damaged, or not a COPC file.
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
