"""Where the sea surface is under each point, and which points stand out of it."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt
from numpy.typing import NDArray

from seaclutter_cli.airborne.grid import BLOCK, ElevationGrid
from seaclutter_cli.airborne.opening import open_grid, without_pits
from seaclutter_cli.errors import InputError

MAX_WINDOW_CELLS = 1000
_PIT = 2.0


@dataclass(frozen=True, kw_only=True)
class SurfaceParams:
    """The sea surface by morphological opening.

    Parameters
    ----------
    cell_m : float
        Width of a grid cell; each holds its lowest elevation.
    window_m : float
        Width of the opening's square window, w; what is narrower stands out of the sea.
    height_m : float
        A point higher than this above the opened surface is no sea, T_max.
    """

    cell_m: Annotated[float, Gt(0)] = 1.0
    window_m: Annotated[float, Gt(0)] = 20.0
    height_m: Annotated[float, Gt(0)] = 0.5

    def __post_init__(self) -> None:
        """Check that the window can be computed."""
        if self.window_m > MAX_WINDOW_CELLS * self.cell_m:
            raise ValueError(f"window_m ({self.window_m:g}) must not exceed {MAX_WINDOW_CELLS} cells of cell_m")


@dataclass(frozen=True, kw_only=True)
class SeparationParams(SurfaceParams):
    """Separation of a tile into sea and what is not.

    Parameters
    ----------
    island_m : float or None
        What the opening leaves standing is land, down to ``height_m`` above the level of the sea, if it rises this far
        above it; null: it is sea, as in the paper.
    """

    island_m: Annotated[float, Gt(0)] | None = 2.0

    def __post_init__(self) -> None:
        """Check that land is higher than what stands out."""
        super().__post_init__()
        if self.island_m is not None and self.island_m < self.height_m:
            raise ValueError(f"island_m ({self.island_m:g}) must not be less than height_m ({self.height_m:g})")


class SeaSurfaceModel:
    r"""The sea surface of a tile or frame: its grid of lowest elevations, opened (S1, 1.1).

    Parameters
    ----------
    grid : ElevationGrid
        All points that count.
    params : SurfaceParams
        Window and heights. `SeparationParams` see to islands.

    Notes
    -----
    A point is no sea if it is more than :math:`T_{\max}` above the opened surface of its cell.

    * Waves and swell: the surface follows what is longer than about twice the window; the threshold has to exceed the
      height of crests above it otherwise. A window much wider than the objects cuts off the crests of swell.
    * Edges of a tile: windows lie in the least rectangle about all points. An object that the edge cuts is told by the
      part inside, as if there were nothing beyond.
    * Of a tile, echoes from below the surface are left out: cells alone, deeper than twice ``height_m``.
    * Empty cells are filled as `filled` tells, from as far as the window is wide; beyond they count as nothing.
    * An object wider than the window leaves its inner part in the opened surface, as if it were sea. With ``island_m``
      that part is told by its level: cells that are (lowest point or opened surface) more than ``height_m`` above the
      sea level, and joined by side or corner with one that the opening leaves standing above that and whose lowest
      point (or opened surface) is more than ``island_m`` above it, are land; heights over land are above the sea level.
      That is the median of the opened surface in its commonest ``island_m`` / 4: land has many elevations, the sea few.

    References
    ----------
    .. [1] Shi Liang, Xing Junxin, Cai Yanjing (2022). "Classification of ship LIDAR point cloud data based on machine
       learning algorithm". Ship Science and Technology 44(17), 140-143. doi:10.3404/j.issn.1672-7649.2022.17.028
    """

    def __init__(self, grid: ElevationGrid, params: SurfaceParams) -> None:
        self._grid = grid
        self.params = params
        tile = isinstance(params, SeparationParams)
        lowest = without_pits(grid, _PIT * params.height_m) if tile else grid.lowest
        self._opened = open_grid(grid, params.window_m, lowest)
        island_m = params.island_m if isinstance(params, SeparationParams) else None
        if island_m is not None and len(self._opened):
            level = self._level(island_m / 4)
            self._opened[self._land_cells(level, island_m)] = level

    def height(self, xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height of points that were in the grid, shape (3, N), above the surface in metres, shape (N,)."""
        cell = self._grid.locate(xyz[0], xyz[1])
        return np.asarray(xyz[2] - self._opened.reshape(-1)[cell])

    @property
    def cells(self) -> int:
        """Number of cells with points."""
        return int(np.isfinite(self._grid.lowest).sum())

    def _level(self, step_m: float) -> float:
        """Return the median of the opened surface within the commonest step of its elevations."""
        known = self._opened[np.isfinite(self._grid.lowest)]
        step = np.floor(known / step_m)
        values, counts = np.unique(step, return_counts=True)
        return float(np.median(known[step == values[np.argmax(counts)]]))

    def _land_cells(self, level: float, island_m: float) -> NDArray[np.bool_]:
        """Return which cells are land, shape (S, 256, 256)."""
        lowest, above = self._grid.lowest, level + self.params.height_m
        land = (self._opened > above) | (np.isfinite(lowest) & (lowest > above))
        left = self._opened[land]
        peak = np.where(np.isfinite(lowest[land]), lowest[land], left)
        high = (left > above) & (np.maximum(left, peak) > level + island_m)
        if not high.any():
            return np.zeros_like(land)
        slot, i, j = np.nonzero(land)
        corners = np.empty((len(self._grid.blocks), 2), np.int64)
        for key, number in self._grid.blocks.items():
            corners[number] = key
        column, row = corners[slot, 0] * BLOCK + i, corners[slot, 1] * BLOCK + j
        part = joined_cells(column, row)
        islands = np.zeros(part.max(initial=-1) + 1, np.bool_)
        islands[part[high]] = True
        land[land] = islands[part]
        return land


def joined_cells(column: NDArray[np.int64], row: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return which group of touching cells each of M distinct cells belongs to, shape (M,).

    Examples
    --------
    >>> joined_cells(np.array([0, 1, 5]), np.array([0, 1, 5]))
    array([0, 0, 1])
    """
    from scipy.sparse import coo_array  # takes a while to load, which tiles without islands are spared
    from scipy.sparse.csgraph import connected_components

    if not len(column):
        return np.empty(0, np.int64)
    span = int(row.max() - row.min()) + 3
    key = (column - column.min()) * span + (row - row.min()) + 1
    order = np.argsort(key)
    ordered = key[order]
    pairs = [np.empty((2, 0), np.int64)]
    for step in (1, span - 1, span, span + 1):
        at = np.searchsorted(ordered, ordered + step).clip(max=len(key) - 1)
        near = np.flatnonzero(ordered[at] == ordered + step)
        pairs.append(np.stack((order[near], order[at[near]])))
    one, other = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(len(one), np.bool_), (one, other)), shape=(len(key), len(key)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def surface_of(xyz: NDArray[np.float64], params: SurfaceParams) -> SeaSurfaceModel:
    """Return the surface under points, shape (3, N), in metres and finite.

    Raises
    ------
    InputError
        If there are no points, or they are scattered too far.
    """
    if not xyz.shape[1]:
        raise InputError("no points, so no sea surface")
    grid = ElevationGrid(params.cell_m)
    grid.add(xyz)
    return SeaSurfaceModel(grid, params)
