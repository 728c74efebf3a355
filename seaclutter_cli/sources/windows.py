"""Windows of COPC files: the points of a rectangle, read without the rest of the file."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.errors import CloudError, InputError
from seaclutter_cli.sources.extents import Extent, TileHead, extent_of
from seaclutter_cli.sources.frame_files.copc import CopcIndex, is_copc, read_chunks, read_index
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
        If the file is damaged, or not a COPC file.
    """

    def __init__(self, path: Path, window: Extent) -> None:
        super().__init__(path)
        self.window = window
        self._kept = list(self.read())
        self.size = sum(map(len, self._kept))

    def read(self) -> Iterator[Any]:
        """Yield the points in parts."""
        for part in read_chunks(self.path, _chunks(read_index(self.path, self.header), self)):
            inside = self.window.contains(self.xyz(part))
            if inside.any():
                yield part[inside]


def _chunks(index: CopcIndex, tile: CopcWindow) -> list[tuple[int, int, int]]:
    low, high = (np.array(corner) / tile.crs.unit_m for corner in (tile.window.low, tile.window.high))
    return index.within(low, high)


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
    return path.suffix.lower() == ".laz" and is_copc(LasTile(path).header)


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
