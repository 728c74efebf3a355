"""Looks of a tile: what a strip, or one direction of a scanner on a cone, shows of it at one moment."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.oscillation import LONG_WAVE_M
from seaclutter_cli.airborne.pits import without_pits
from seaclutter_cli.grids.elevation import ElevationGrid
from seaclutter_cli.grids.opening import open_grid

Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Look:
    """Grid of a tile, or of one look of it.

    Parameters
    ----------
    grid : ElevationGrid
        The grid, in S blocks.
    lowest : ndarray, shape (S, 256, 256), float64
        Lowest elevations, in tiles without pits; plus infinity in empty cells.
    opened : ndarray, shape (S, 256, 256), float64
        Opened surface.
    """

    grid: ElevationGrid
    lowest: Cells
    opened: Cells

    @classmethod
    def of(cls, grid: ElevationGrid, window_m: float, pit_m: float | None) -> Self:
        """Return a grid with its opened surface, without pits that are deeper than ``pit_m``."""
        lowest = grid.lowest if pit_m is None else without_pits(grid, pit_m)
        return cls(grid, lowest, open_grid(grid, window_m, lowest))

    @property
    def is_small(self) -> bool:
        """Whether the tile may be a part of one wave."""
        return max(self.grid.sides_m) < LONG_WAVE_M


@dataclass(frozen=True)
class OpenedLooks:
    """Looks of a tile, whose opened surfaces are computed each time: all of them need more memory than the tile."""

    grids: Iterable[ElevationGrid]
    window_m: float
    pit_m: float | None

    def __iter__(self) -> Iterator[Look]:
        for grid in self.grids:
            yield Look.of(grid, self.window_m, self.pit_m)


@dataclass(frozen=True)
class WithoutLand:
    """Looks without the land, which is known by block."""

    looks: Iterable[Look]
    land: Mapping[tuple[int, int], Mask]

    def __iter__(self) -> Iterator[Look]:
        for look in self.looks:
            land = np.stack([self.land[block] for block in look.grid.blocks])
            yield replace(look, lowest=np.where(land, np.inf, look.lowest))
