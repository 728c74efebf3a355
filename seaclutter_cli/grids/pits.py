"""Echoes from below the surface, which are left out."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.grids.elevation import BLOCK, ElevationGrid

Cells = NDArray[np.float64]

_HALF, _LEAST_CELLS, _LOWER, _SHALLOW = 2, 5, 0.2, 0.25
_PASSES = 2


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
    from scipy import ndimage  # slow to import, not needed by other parts

    out = lowest.copy()
    for slot, wide, _ in grid.padded(lowest, _HALF):
        known = np.isfinite(wide)
        highest = ndimage.maximum_filter(np.where(known, wide, -np.inf), 3)
        closed = ndimage.minimum_filter(np.where(np.isfinite(highest), highest, np.inf), 3)
        at = np.argwhere((known & (wide < closed - depth_m))[_HALF : _HALF + BLOCK, _HALF : _HALF + BLOCK]).T
        window = np.indices((2 * _HALF + 1,) * 2).reshape(2, -1, 1)
        around = np.sort(wide[tuple(window + at[:, None])], axis=0)
        number = np.isfinite(around).sum(axis=0)
        rank = (np.maximum(number * share, 1).astype(np.intp) - 1 for share in (_LOWER, 0.5, 0.75))
        value, middle, high = (around[row, np.arange(at.shape[1])] for row in rank)
        pits = (number >= _LEAST_CELLS) & (out[slot][tuple(at)] < value - depth_m - 2 * (high - middle))
        out[slot][tuple(at[:, pits])] = value[pits]
    return out
