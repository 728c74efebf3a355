"""The points of a tile together with those of its neighbours in a margin around it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError
from seaclutter_cli.sources.extents import Extent
from seaclutter_cli.sources.tiles import LasTile, Tile, TilePointReader
from seaclutter_cli.sources.windows import read_within


@dataclass(frozen=True)
class Margin:
    """Where the margin of a tile is, and which tiles have points in it.

    Parameters
    ----------
    region : Extent
        Extent of the tile with its margin.
    neighbors : tuple of Path
        LAS and LAZ files; also the one of which the tile is a window.
    window : Extent or None
        Where the tile is in its file, if it is a window.
    """

    region: Extent
    neighbors: tuple[Path, ...]
    window: Extent | None = None


class MarginPoints:
    """Points of one neighbour in a region; of the neighbour, no more is kept in memory.

    Parameters
    ----------
    path : Path
        The neighbour.
    region : Extent
        The region.
    without : Extent, optional
        A part of it whose points are left out.

    Raises
    ------
    CloudError
        If the neighbour cannot be read.
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
    """The points of a tile, followed by those of its neighbours in a margin around it.

    Parameters
    ----------
    tile : Tile
        The tile.
    margin : sequence of MarginPoints
        Points of its neighbours.
    """

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
