"""Morphological opening of a grid of elevations, empty cells and all."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.grid import BLOCK, ElevationGrid

Cells = NDArray[np.float64]

_NEIGHBORS = 5


def half_window(window_m: float, cell_m: float) -> int:
    """Return how many cells a window reaches to each side of its middle one; it is that many twice, and one, wide.

    Examples
    --------
    >>> half_window(20.0, 1.0), half_window(0.5, 1.0)
    (10, 0)
    """
    return int(window_m / (2 * cell_m) + 1e-9)


def opened(lowest: Cells, half: int) -> Cells:
    r"""Return the opening of a grid: its erosion, dilated (S1, Eq. 1 to 3).

    .. math:: (f \ominus w)(i, j) = \min_{(s, t) \in w} f(s, t), \quad
        (f \oplus w)(i, j) = \max_{(s, t) \in w} f(s, t), \quad f \circ w = (f \ominus w) \oplus w

    Parameters
    ----------
    lowest : ndarray, shape (I, J), float64
        Elevations in metres; plus infinity in empty cells.
    half : int
        The window reaches so many cells to each side; fewer where the grid is narrower than that.

    Returns
    -------
    ndarray, shape (I, J), float64
        Elevation of the opened surface: where there is a value, that or less. Minus infinity where the windows about a
        cell hold no value.

    Notes
    -----
    Only windows that lie in the grid count, so that an object cut by its edge is seen in whole windows too; empty cells
    are neither low nor high. On a grid without any this is ``scipy.ndimage.grey_opening`` with minus infinity beyond
    the edge.

    Examples
    --------
    >>> opened(np.array([[0.0, 5, 0.2, np.inf, 0.1]]), 1)
    array([[0. , 0.2, 0.2, 0.2, 0.1]])
    """
    from scipy import ndimage  # takes a while to load, which all other filters are spared

    size = [2 * min(half, (cells - 1) // 2) + 1 for cells in lowest.shape]
    eroded = ndimage.minimum_filter(lowest, size, mode="constant", cval=-np.inf)
    eroded[np.isposinf(eroded)] = -np.inf
    return np.asarray(ndimage.maximum_filter(eroded, size, mode="constant", cval=-np.inf))


def filled(lowest: Cells, reach: int) -> Cells:
    """Return a grid whose empty cells have the least of the nearest values to four sides.

    Parameters
    ----------
    lowest : ndarray, shape (I, J), float64
        Elevations in metres; plus infinity in empty cells.
    reach : int
        A value farther along than so many cells does not count; without any, a cell stays empty.

    Notes
    -----
    A ship hides the water behind it from a lidar that looks at it askance, and calm water often sends nothing back.
    With the least value such a gap is water if it has water on any side, and does not widen the ship.

    Examples
    --------
    >>> filled(np.array([[7.0, np.inf, np.inf, 1, np.inf, np.inf, np.inf]]), 2)
    array([[ 7.,  1.,  1.,  1.,  1.,  1., inf]])
    """
    empty = np.isposinf(lowest)
    if not empty.any():
        return lowest
    out = lowest.copy()
    for turned, target in ((lowest, out), (lowest.T, out.T)):
        for step in (1, -1):
            values, gaps = target[:, ::step], np.isposinf(turned[:, ::step])
            np.minimum(values, _carried(turned[:, ::step], reach), out=values, where=gaps)
    return out


def _carried(values: Cells, reach: int) -> Cells:
    """Return the last value before each cell along its row; infinity where it is too far back."""
    here = np.arange(values.shape[1])
    last = np.maximum.accumulate(np.where(np.isposinf(values), -reach - 1, here), axis=1)
    carried = np.take_along_axis(values, np.maximum(last, 0), axis=1)
    carried[here - last > reach] = np.inf
    return np.asarray(carried)


def without_pits(grid: ElevationGrid, depth_m: float) -> Cells:
    """Return the lowest elevations, shape (S, 256, 256), without pits that are one cell wide.

    A cell that lies deeper than ``depth_m`` below each of at least five neighbours with points holds an echo from below
    the surface, and gets the least of their values. An opening leaves such a cell as it is, but near the edge of a
    tile, where no window can avoid it, it would draw the surface down all along its row.
    """
    from scipy import ndimage

    out = grid.lowest.copy()
    around = np.ones((3, 3), np.bool_)
    around[1, 1] = False
    for slot, cells, _ in grid.padded(grid.lowest, 1):
        least = ndimage.minimum_filter(cells, footprint=around, mode="constant", cval=np.inf)
        known = ndimage.convolve(np.isfinite(cells).astype(np.int8), around.astype(np.int8), mode="constant")
        pits = ((cells < least - depth_m) & (known >= _NEIGHBORS) & np.isfinite(cells))[1:-1, 1:-1]
        out[slot][pits] = least[1:-1, 1:-1][pits]
    return out


def open_grid(grid: ElevationGrid, window_m: float, lowest: Cells | None = None) -> Cells:
    """Return the opened surface of a grid, shape (S, 256, 256), block by block; minus infinity where unknown.

    The elevations are those of the grid, unless others are given for its cells.

    The grid ends where its points end. Empty cells are `filled` from as far as a window is wide. The blocks do not show
    in the result.
    """
    half = half_window(window_m, grid.cell_m)
    reach = 2 * half + 1
    halo = 2 * half + reach
    out = np.full(grid.lowest.shape, -np.inf)
    for slot, cells, inside in grid.padded(grid.lowest if lowest is None else lowest, halo):
        part = np.full(cells.shape, -np.inf)
        part[inside] = opened(filled(cells[inside], reach), half)
        out[slot] = part[halo : halo + BLOCK, halo : halo + BLOCK]
    return out
