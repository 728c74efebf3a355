"""Where tiles are: extents and neighbours, windows of COPC files, and the points in the margin around a tile."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, product
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError, opening
from seaclutter_cli.sources.frame_files.las import read_chunks, read_index
from seaclutter_cli.sources.tiles import LAS, CloudTile, Crs, LasTile, Tile, open_tile

_REPEATED = 0.5
LEAST_M = 600.0
"""Least length of the sides of a tile with its margin, if there are neighbours."""


@dataclass(frozen=True)
class Extent:
    """Rectangle along the axes of a tile's coordinates, in metres, by its lowest and highest corner."""

    low: tuple[float, float]
    high: tuple[float, float]

    @classmethod
    def of(cls, low: NDArray[np.float64], high: NDArray[np.float64]) -> "Extent":
        """Return the rectangle between two corners, shape (2,)."""
        (west, south), (east, north) = low.tolist(), high.tolist()
        return cls((west, south), (east, north))

    @property
    def area(self) -> float:
        """Area in square metres."""
        return self.overlap(self)

    def grown(self, by_m: float, least_m: float = 0.0) -> "Extent":
        """Return the rectangle with a margin on all sides, which makes each side at least ``least_m`` long."""
        low, high = np.array(self.low), np.array(self.high)
        margin = np.maximum(by_m, (least_m - (high - low)) / 2)
        return Extent.of(low - margin, high + margin)

    def clipped(self, other: "Extent") -> "Extent":
        """Return what two rectangles that overlap have in common."""
        return Extent.of(np.maximum(self.low, other.low), np.minimum(self.high, other.high))

    def overlap(self, other: "Extent") -> float:
        """Return the area that two rectangles have in common; negative if they are apart."""
        sides = np.minimum(self.high, other.high) - np.maximum(self.low, other.low)
        return float(sides.min() if sides.min() < 0 else sides.prod())

    def contains(self, xyz: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points, shape (3, N) or (2, N), are inside, or on the sides with the lowest coordinates."""
        low, high = np.array(self.low)[:, None], np.array(self.high)[:, None]
        return np.asarray(((xyz[:2] >= low) & (xyz[:2] < high)).all(axis=0))


@dataclass(frozen=True)
class TileHead:
    """Where a tile is, as far as its header says; ``size`` are the bytes of a ``window`` of the file, otherwise 0."""

    path: Path
    crs: Crs
    extent: Extent | None = None
    window: Extent | None = None
    size: int = 0

    @property
    def name(self) -> str:
        """Name of the tile; that of a window has its lowest coordinates in the unit of the file."""
        if self.window is None:
            return self.path.stem
        x, y = (round(value / self.crs.unit_m) for value in self.window.low)
        return f"{self.path.name.removesuffix('.laz').removesuffix('.copc')}_{x}_{y}"

    @property
    def file_name(self) -> str:
        """Name of a file with the points of the tile."""
        return f"{self.name}.laz" if self.window else self.path.name


def read_head(path: Path) -> TileHead:
    """Return where a tile is; without an extent if its format has none in the header, or it cannot be read."""
    if path.suffix.lower() in LAS:
        with suppress(InputError, OSError):  # reported when the tile is processed
            tile = LasTile(path)
            return TileHead(path, tile.crs, extent_of(tile))
    return TileHead(path, Crs())


def extent_of(tile: LasTile) -> Extent | None:
    """Return the extent in the header of a tile; None if it has no points, or damaged bounds or degrees."""
    unit = tile.crs.unit_m
    low, high = (np.asarray(bounds[:2], np.float64) * unit for bounds in (tile.header.mins, tile.header.maxs))
    if tile.crs.is_geographic or not tile.size or not np.isfinite([low, high]).all() or (low > high).any():
        return None
    return Extent.of(low, high)


def region_of(tile: TileHead, margin_m: float) -> Extent | None:
    """Return the extent of a tile with its margin; that of a small tile is wider, so that waves can be estimated."""
    return tile.extent and tile.extent.grown(margin_m, LEAST_M)


def neighbors_of(tiles: Sequence[TileHead], margin_m: float) -> list[list[TileHead]]:
    """Return the neighbours of each tile: those with points in its `region_of`, from west to east.

    Neighbours have the same coordinate reference system. Of two tiles that share more than half of the smaller one,
    neither is a neighbour of the other: they show the same place at different times, or are alternatives.
    """
    placed = [(tile.extent.low, str(tile.path), tile) for tile in tiles if tile.extent]
    ordered = [tile for *_, tile in sorted(placed, key=itemgetter(0, 1))]
    low, high = (np.array([getattr(tile.extent, side) for tile in ordered]).reshape(-1, 2) for side in ("low", "high"))
    found: list[list[TileHead]] = []
    for tile in tiles:
        if (region := region_of(tile, margin_m)) is None:
            found.append([])
            continue
        near = ((low < region.high) & (high > region.low)).all(axis=1)
        others = (ordered[at] for at in np.flatnonzero(near) if ordered[at] is not tile)
        others = (other for other in others if other.crs.by_code == tile.crs.by_code)
        found.append([other for other in others if not _repeats(tile.extent, other.extent)])
    return found


def _repeats(tile: Extent | None, other: Extent | None) -> bool:
    return not tile or not other or tile.overlap(other) > _REPEATED * min(tile.area, other.area)


class TilePart(LasTile):
    """The points of a LAS or LAZ file in a rectangle, but not those in a part of it; `CloudError` if it is damaged."""

    def __init__(self, path: Path, window: Extent, without: Extent | None = None) -> None:
        super().__init__(path)
        self._kept = list(self._within(window, without))
        self.size = sum(map(len, self._kept))

    def _within(self, window: Extent, without: Extent | None) -> Iterator[Any]:
        near = self.read()
        if index := read_index(self.path, self.header):
            low, high = (np.array(corner) / self.crs.unit_m for corner in (window.low, window.high))
            near = read_chunks(self.path, index.within(low, high))
        for part in near:
            xyz = self.xyz(part)
            inside = window.contains(xyz)
            if without is not None:
                inside &= ~without.contains(xyz)
            if inside.any():
                yield part[inside]


def open_tile_or_window(path: Path, window: Extent | None) -> LasTile | CloudTile:
    """Open a tile, or a window of a COPC file; raise `InputError` if it cannot be read."""
    if window is None:
        return open_tile(path)
    with opening(path):
        return TilePart(path, window)


def windows_of(path: Path, side_m: float) -> list[TileHead]:
    """Return the windows of a COPC file with points: squares at multiples of their width; other tiles are whole.

    Raise `CloudError` if the file is damaged.
    """
    tile = LasTile(path) if path.suffix.lower() == ".laz" else None
    index = read_index(path, tile.header) if tile else None
    if tile is None or index is None:
        return [read_head(path)]
    if (extent := extent_of(tile)) is None:
        return []
    first, last = (np.floor(np.array(corner) / side_m).astype(int).tolist() for corner in (extent.low, extent.high))
    found = []
    for cell in product(range(first[0], last[0] + 1), range(first[1], last[1] + 1)):
        low = np.array(cell) * side_m
        if chunks := index.within(low / tile.crs.unit_m, (low + side_m) / tile.crs.unit_m):
            window = Extent.of(low, low + side_m)
            size = sum(size for _, size, _ in chunks)
            found.append(TileHead(path, tile.crs, window.clipped(extent), window, size))
    return found


@dataclass(frozen=True)
class Margin:
    """Extent of a tile with its margin, and the files with points in it, among them that of which it is a window."""

    region: Extent
    neighbors: tuple[Path, ...]
    window: Extent | None = None


class PointsWithMargin:
    """The points of a tile, followed by those of its neighbours in a margin around it."""

    def __init__(self, tile: Tile, margin: Sequence[TilePart]) -> None:
        self._tile, self._margin = tile, [own for own in margin if own.size]

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Yield coordinates in metres, shape (3, n), of each part of the tile, then of each part of the margin."""
        return chain(self._tile, (tile.xyz(part) for tile in self._margin for part in tile.parts()))

    def column(self, name: str) -> NDArray[Any] | None:
        """Return an attribute of all points by its LAS name, shape (N,); None if the tile does not have it."""
        own = self._tile.column(name)
        if own is None or not self._margin:
            return own
        # NaN where a neighbour does not have the attribute.
        others = (tile.columns([name]).get(name, np.full(tile.size, np.nan)) for tile in self._margin)
        return np.concatenate([own, *others])
