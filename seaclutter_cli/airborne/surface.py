"""Sea surface of tiles and frames by morphological opening."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Gt
from numpy.typing import NDArray

from seaclutter_cli.airborne.grid import ElevationGrid
from seaclutter_cli.airborne.opening import open_grid, without_pits
from seaclutter_cli.errors import InputError

MAX_WINDOW_CELLS = 1000
_PIT = 2.0
_ALL, _FIRST, _LAST = slice(None), slice(0, 1), slice(-1, None)
_EDGES = {
    (1, 0): ((-1, _ALL), (0, _ALL)),
    (0, 1): ((_ALL, -1), (_ALL, 0)),
    (1, 1): ((-1, _LAST), (0, _FIRST)),
    (1, -1): ((-1, _FIRST), (0, _LAST)),
}
"""Edge or corner of a block, and of the block that is these steps away along x and y, where they touch."""


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
        above = level + self.params.height_m
        land, high = (np.zeros(self._opened.shape, np.bool_) for _ in range(2))
        for slot, (lowest, opened) in enumerate(zip(self._grid.lowest, self._opened, strict=True)):
            known = np.isfinite(lowest)
            land[slot] = (opened > above) | (known & (lowest > above))
            high[slot] = (opened > above) & (np.where(known, np.maximum(opened, lowest), opened) > level + island_m)
        if not high.any():
            return high
        number, group = joined_cells(land, self._grid.blocks)
        islands = np.zeros(len(group), np.bool_)
        islands[group[number[high]]] = True
        for slot, inside in enumerate(number):
            land[slot] = islands[group[inside]]
        return land


def joined_cells(
    mask: NDArray[np.bool_], blocks: Mapping[tuple[int, int], int]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the groups of cells that touch each other, by side or corner, also across blocks.

    Parameters
    ----------
    mask : ndarray, shape (S, B, B), bool
        The cells, in S blocks.
    blocks : mapping of (int, int) to int
        Index of each block, by its block number along x and y.

    Returns
    -------
    (ndarray, shape (S, B, B), int32), (ndarray, shape (P,), int32)
        Part of each cell, 0 outside the mask, and the group of each part.

    Examples
    --------
    >>> part, group = joined_cells(np.eye(3, dtype=bool)[None], {(0, 0): 0})
    >>> group[part[0]]
    array([[1, 0, 0],
           [0, 1, 0],
           [0, 0, 1]], dtype=int32)
    """
    from scipy import ndimage  # slow to import, not needed without islands
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    part = np.zeros(mask.shape, np.int32)
    parts = 1
    for own, cells in zip(part, mask, strict=True):
        found = ndimage.label(cells, np.ones((3, 3)), output=own)
        own[cells] += parts - 1
        parts += found
    pairs = [np.zeros((2, 1), np.int32)]
    for (column, row), slot in blocks.items():
        for step, (edge, opposite) in _EDGES.items():
            other = blocks.get((column + step[0], row + step[1]))
            if other is not None:
                pairs += _touching(part[slot][edge], part[other][opposite])
    one, other_one = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(len(one), np.bool_), (one, other_one)), shape=(parts, parts))
    return part, np.asarray(connected_components(graph, directed=False)[1], np.int32)


def _touching(edge: NDArray[np.int32], opposite: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    """Return the pairs of parts, shape (2, n), that touch across the edge of two blocks."""
    steps = ((edge, opposite), (edge[1:], opposite[:-1]), (edge[:-1], opposite[1:]))
    found = [np.stack(pair) for pair in steps]
    return [pairs[:, (pairs > 0).all(axis=0)] for pairs in found]


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
