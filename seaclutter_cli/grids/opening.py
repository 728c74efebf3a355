"""Morphological opening of a grid of elevations with empty cells ([Shi2022], section 1.1), and pits in the grid."""

from dataclasses import dataclass

import numpy as np

from seaclutter_cli.arrays import Floats
from seaclutter_cli.grids.elevation import BLOCK, Cells, ElevationGrid, near_known
from seaclutter_cli.params import Positive, key

MAX_WINDOW_CELLS = 1000
_AROUND, _LEAST_CELLS, _LOWER, _SHALLOW, _PASSES = 2, 5, 0.2, 0.25, 2


@dataclass(frozen=True, kw_only=True)
class SurfaceParams:
    """Parameters of the sea surface by morphological opening."""

    cell_m: Positive = key(1.0, "Width of a grid cell; each cell stores its lowest elevation.")
    window_m: Positive = key(
        20.0, "Width of the square window of the opening, w; narrower objects rise above the opened surface."
    )
    height_m: Positive = key(0.5, "A point higher than this above the opened surface is a non-sea point, T_max.")

    def __post_init__(self) -> None:
        if self.window_m > MAX_WINDOW_CELLS * self.cell_m:
            raise ValueError(f"window_m ({self.window_m:g}) must not exceed {MAX_WINDOW_CELLS} cells of cell_m")


def half_window(window_m: float, cell_m: float) -> int:
    """Return the half width h of a window in cells; the window is 2 h + 1 cells wide."""
    return int(window_m / (2 * cell_m) + 1e-9)


def opened(lowest: Cells, half: int) -> Cells:
    r"""Return the opening of a grid: its erosion, dilated ([Shi2022], Eq. 1 to 3).

    .. math:: (f \ominus w)(i, j) = \min_{(s, t) \in w} f(s, t), \quad
        (f \oplus w)(i, j) = \max_{(s, t) \in w} f(s, t), \quad f \circ w = (f \ominus w) \oplus w

    ``lowest``, shape (I, J), has plus infinity in empty cells, the result minus infinity where the windows around a
    cell contain no value. ``half`` is the half width of the window in cells; less where the grid is narrower.

    Only windows inside the grid count, so an object cut by the edge is seen in whole windows, too. Empty cells are
    neither low nor high. Without empty cells, the result equals ``scipy.ndimage.grey_opening`` with minus infinity
    beyond the edge.
    """
    from scipy import ndimage  # slow to import, not needed by other filters

    size = [2 * min(half, (cells - 1) // 2) + 1 for cells in lowest.shape]
    eroded = ndimage.minimum_filter(lowest, size, mode="constant", cval=-np.inf)
    eroded[np.isposinf(eroded)] = -np.inf
    return np.asarray(ndimage.maximum_filter(eroded, size, mode="constant", cval=-np.inf))


def filled(lowest: Cells, reach: int) -> Cells:
    """Return a grid whose empty cells, plus infinity, have the lowest of the values in four directions in reach.

    A ship hides the water behind it from an oblique beam, and calm water often returns nothing. With the lowest value,
    such a gap is water if there is water on any side, and does not widen the ship.
    """
    gaps = np.isposinf(lowest)
    if not gaps.any():
        return lowest
    out = lowest.copy()
    for axis in (0, 1):
        place = np.expand_dims(np.arange(lowest.shape[axis], dtype=np.int32), 1 - axis)
        backwards = np.flip(lowest, axis), np.flip(out, axis), np.flip(gaps, axis)
        for source, target, empty in ((lowest, out, gaps), backwards):
            last = np.maximum.accumulate(np.where(empty, np.int32(-reach - 1), place), axis=axis)
            value = np.take_along_axis(source, np.maximum(last, 0), axis)  # of the last cell that is not empty
            np.minimum(target, value, out=target, where=place - last <= reach)
    return out


def open_grid(grid: ElevationGrid, window_m: float, lowest: Cells | None = None) -> Cells:
    """Return the opened surface of a grid, shape (S, 256, 256); minus infinity where unknown.

    ``lowest`` replaces the elevations of the grid. The grid ends at its outermost points. Empty cells are `filled` from
    up to a window's width away. The result does not depend on the division into blocks. Cells beyond the reach of any
    value are not computed, so scattered points take little time.
    """
    half = half_window(window_m, grid.cell_m)
    reach = 2 * half + 1
    halo = 2 * half + reach
    out = np.full(grid.lowest.shape, -np.inf)
    for slot, cells, inside in grid.padded(grid.lowest if lowest is None else lowest, halo):
        part, used = np.full(cells.shape, -np.inf), cells[inside]
        near = near_known(np.isfinite(used), halo)
        part[inside][near] = opened(filled(used[near], reach), half)
        out[slot] = part[halo : halo + BLOCK, halo : halo + BLOCK]
    return out


def heights_above_opening(xyz: Floats, params: SurfaceParams) -> Floats:
    """Return the height of points, shape (3, N), in metres and finite, above the opened surface of their grid.

    Raise `InputError` if the points are too scattered for a grid in memory.

    * Waves and swell: the opened surface follows waves longer than about twice the window. For shorter waves, the
      threshold has to exceed the height of their crests. A window much wider than the objects cuts off the crests of
      swell.
    * Edges: windows are inside the bounding rectangle of all points. An object cut by the edge is separated by the part
      inside, as if there were nothing beyond.
    * Empty cells are filled by `filled` from up to a window's width away.
    * An object wider than the window leaves its inner part in the opened surface, as if it were sea.
    """
    grid = ElevationGrid(params.cell_m)
    cell = grid.add(xyz)
    return np.asarray(xyz[2] - open_grid(grid, params.window_m).reshape(-1)[cell])


def without_pits(grid: ElevationGrid, depth_m: float) -> Cells:
    """Return the lowest elevations, shape (S, 256, 256), without pits.

    A cell below the closing over three cells, the opening upside down, may contain an echo from below the surface. It
    is a pit if it is lower than all but a fifth of the five by five cells around it, of which five must have points, by
    a quarter of ``depth_m`` and twice the upper quarter of them spans; it gets the value of the lowest of these.
    A ditch or a gap between ships has more cells as low. Where pits are many, those that are filled show others.

    Elsewhere an opening confines such a cell to itself, but near the edge of a tile, where no window avoids it, it
    would lower the surface along its whole row.
    """
    lowest = grid.lowest
    for _ in range(_PASSES):
        found = _filled_once(grid, lowest, _SHALLOW * depth_m)
        if (found == lowest).all():
            break
        lowest = found
    return lowest


def _filled_once(grid: ElevationGrid, lowest: Cells, depth_m: float) -> Cells:
    from scipy import ndimage

    out = lowest.copy()
    for slot, wide, _ in grid.padded(lowest, _AROUND):
        known = np.isfinite(wide)
        highest = ndimage.maximum_filter(np.where(known, wide, -np.inf), 3)
        closed = ndimage.minimum_filter(np.where(np.isfinite(highest), highest, np.inf), 3)
        inner = (slice(_AROUND, _AROUND + BLOCK),) * 2
        at = np.argwhere((known & (wide < closed - depth_m))[inner]).T
        window = np.indices((2 * _AROUND + 1,) * 2).reshape(2, -1, 1)
        around = np.sort(wide[tuple(window + at[:, None])], axis=0)
        number = np.isfinite(around).sum(axis=0)
        rank = (np.maximum(number * share, 1).astype(np.intp) - 1 for share in (_LOWER, 0.5, 0.75))
        value, middle, high = (around[row, np.arange(at.shape[1])] for row in rank)
        pits = (number >= _LEAST_CELLS) & (out[slot][tuple(at)] < value - depth_m - 2 * (high - middle))
        out[slot][tuple(at[:, pits])] = value[pits]
    return out
