"""Sea surface of tiles and frames by morphological opening."""

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
    """Parameters of the sea surface by morphological opening.

    Parameters
    ----------
    cell_m : float
        Width of a grid cell; each cell stores its lowest elevation.
    window_m : float
        Width of the square window of the opening, w; narrower objects rise above the opened surface.
    height_m : float
        A point higher than this above the opened surface is a non-sea point, T_max.
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
    """Parameters of the separation of a tile into sea and non-sea points.

    Parameters
    ----------
    island_m : float or None
        The opened surface is land where it rises more than this above the sea level, down to ``height_m`` above that
        level; null: it is sea, as in [Shi2022].
    """

    island_m: Annotated[float, Gt(0)] | None = 2.0

    def __post_init__(self) -> None:
        """Check that ``island_m`` is at least ``height_m``."""
        super().__post_init__()
        if self.island_m is not None and self.island_m < self.height_m:
            raise ValueError(f"island_m ({self.island_m:g}) must not be less than height_m ({self.height_m:g})")


class SeaSurfaceModel:
    r"""Sea surface of a tile or frame: the opening of its grid of lowest elevations ([Shi2022], section 1.1).

    Parameters
    ----------
    grid : ElevationGrid
        Grid of all valid points.
    params : SurfaceParams
        Window and heights. With `SeparationParams`, islands are handled, too.

    Notes
    -----
    A point is a non-sea point if it is more than :math:`T_{\max}` above the opened surface of its cell.

    * Waves and swell: the surface follows waves longer than about twice the window. For shorter waves, the threshold
      has to exceed the height of their crests. A window much wider than the objects cuts off the crests of swell.
    * Edges of a tile: windows are inside the bounding rectangle of all points. An object cut by the edge is separated
      by the part inside, as if there were nothing beyond.
    * Echoes from below the surface are ignored in tiles: single cells deeper than twice ``height_m``.
    * Empty cells are filled by `filled` from up to a window's width away; cells that remain empty are ignored.
    * An object wider than the window leaves its inner part in the opened surface, as if it were sea. ``island_m`` finds
      that part by its elevation. A candidate cell has its lowest point or opened surface more than ``height_m`` above
      the sea level. Candidates joined by side or corner are land if the opened surface of one of them is more than
      ``height_m``, and its lowest point or opened surface more than ``island_m``, above the sea level. Heights over
      land are relative to the sea level: the median of the opened surface in its most frequent elevation step of
      ``island_m`` / 4, since land has many elevations and the sea few.

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
        """Return the height above the surface in metres, shape (N,), of points from the grid, shape (3, N)."""
        cell = self._grid.locate(xyz[0], xyz[1])
        return np.asarray(xyz[2] - self._opened.reshape(-1)[cell])

    @property
    def cells(self) -> int:
        """Number of cells with points."""
        return int(np.isfinite(self._grid.lowest).sum())

    def _level(self, step_m: float) -> float:
        """Return the sea level: the median of the opened surface in its most frequent elevation step."""
        known = self._opened[np.isfinite(self._grid.lowest)]
        step = np.floor(known / step_m)
        values, counts = np.unique(step, return_counts=True)
        return float(np.median(known[step == values[np.argmax(counts)]]))

    def _land_cells(self, level: float, island_m: float) -> NDArray[np.bool_]:
        """Return a mask of the land cells, shape (S, 256, 256)."""
        lowest, above = self._grid.lowest, level + self.params.height_m
        land = (self._opened > above) | (np.isfinite(lowest) & (lowest > above))
        opened = self._opened[land]
        peak = np.where(np.isfinite(lowest[land]), lowest[land], opened)
        high = (opened > above) & (np.maximum(opened, peak) > level + island_m)
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
    """Return the index of the group of touching cells of each of M distinct cells, shape (M,).

    Examples
    --------
    >>> joined_cells(np.array([0, 1, 5]), np.array([0, 1, 5]))
    array([0, 0, 1])
    """
    from scipy.sparse import coo_array  # slow to import, not needed without islands
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
    """Return the sea surface under points, shape (3, N), in metres and finite.

    Raises
    ------
    InputError
        If there are no points, or they are too scattered for a grid in memory.
    """
    if not xyz.shape[1]:
        raise InputError("no points: the sea surface cannot be computed")
    grid = ElevationGrid(params.cell_m)
    grid.add(xyz)
    return SeaSurfaceModel(grid, params)
