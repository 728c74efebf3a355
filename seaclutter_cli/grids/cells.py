"""Groups, neighbours and means of the cells of a grid, across its blocks."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.grids.elevation import BLOCK, Cells, ElevationGrid, near_known

_WIDTHS, _BOXES = 3, 2.0
_FEW_PAIRS = 1 << 20
_LEAST_WEIGHT = 1e-3


def joined_cells(grid: ElevationGrid, mask: Mask) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the groups of cells of a mask that touch each other, by side or corner, also across blocks.

    The result is the part of each cell, shape (S, 256, 256), 0 outside the mask, and the group of each part, shape
    (P,). Parts are groups within a block.
    """
    from scipy import ndimage  # slow to import, not needed without islands

    part = np.zeros(mask.shape, np.int32)
    parts = 1
    for own, cells in zip(part, mask, strict=True):
        found = ndimage.label(cells, np.ones((3, 3)), output=own)
        own[cells] += parts - 1
        parts += found
    pairs = [np.zeros((2, 1), np.int32)]
    for _, wide, _ in grid.padded(part, 1, 0):
        inner = wide[1:-1, 1:-1]
        for beside in (wide[2:, 1:-1], wide[1:-1, 2:], wide[2:, 2:], wide[2:, :-2]):
            touch = (inner != beside) & (inner > 0) & (beside > 0)
            pairs.append(np.stack((inner[touch], beside[touch])))
    return part, joined(np.concatenate(pairs, axis=1), parts)


def joined(pairs: NDArray[Any], size: int) -> NDArray[np.int32]:
    """Return the group of each of so many things, which pairs of them, shape (2, n), join."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(pairs.shape[1], np.bool_), (pairs[0], pairs[1])), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)


def smoothed(grid: ElevationGrid, values: Cells, used: Mask, width: float) -> tuple[Cells, Floats]:
    """Return the weighted mean of the values around each cell, and the share of the weight that is used.

    ``grid``: the grid; ``values``, shape (S, 256, 256): A value for each cell; ``used``, shape (S, 256, 256): cells
    that contribute; their values are finite; ``width``: standard deviation of the weights in cells: a Gaussian that
    ends at three of them or, from two cells on, two boxes one after the other, whose time does not depend on the width.
    The mean is 0 where there is next to nothing around, and the share is 0 there and 1 amid cells in use, both of shape
    (S, 256, 256).
    """
    from scipy import ndimage  # slow to import, not needed on calm water

    box = 2 * round((np.sqrt(6 * width**2 + 1) - 1) / 2) + 1
    halo = int(np.ceil(_WIDTHS * width)) if width < _BOXES else box - 1

    def around(part: Cells) -> Cells:
        if width < _BOXES:
            found = ndimage.gaussian_filter(part, width, mode="constant", radius=halo)
        else:
            found = ndimage.uniform_filter(ndimage.uniform_filter(part, box, mode="constant"), box, mode="constant")
        return np.asarray(found)

    mean, share = np.zeros(values.shape), np.zeros(values.shape)
    inner = (slice(halo, halo + BLOCK),) * 2
    for slot, padded, _ in grid.padded(np.where(used, values, np.inf), halo):
        known = np.isfinite(padded)
        if known.any():
            weight, total = np.zeros((2, *padded.shape))
            near = near_known(known, 2 * halo)  # sums of boxes leave traces behind their reach, by rounding
            weight[near], total[near] = around(known[near].astype(np.float64)), around(np.where(known, padded, 0)[near])
            some = weight[inner] > _LEAST_WEIGHT
            np.divide(total[inner], weight[inner], out=mean[slot], where=some)
            share[slot][some] = weight[inner][some]
    return mean, share


def touching(grid: ElevationGrid, mask: Mask) -> Mask:
    """Return a mask with the cells that touch it, by side or corner, shape (S, 256, 256)."""
    return number_around(grid, mask) > 0


def number_around(grid: ElevationGrid, mask: Mask) -> NDArray[np.uint8]:
    """Return how many of each cell and the eight around it are in a mask, shape (S, 256, 256)."""
    out = np.empty(mask.shape, np.uint8)
    for slot, cells, _ in grid.padded(mask.astype(np.uint8), 1, 0):
        rows = cells[:-2] + cells[1:-1] + cells[2:]
        out[slot] = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
    return out


def nearest(positions: NDArray[Any], queries: NDArray[Any]) -> NDArray[np.intp]:
    """Return the index of the position nearest to each query, shape (Q,).

    ``positions``, shape (2, P): at least one; ``queries``, shape (2, Q): where to search from.
    """
    if positions.shape[1] * queries.shape[1] > _FEW_PAIRS:
        from scipy.spatial import cKDTree  # slow to import

        return np.asarray(cKDTree(positions.T).query(queries.T)[1], np.intp)
    offset = queries[:, :, None] - positions[:, None]
    return np.asarray(np.argmin((offset**2).sum(axis=0), axis=1), np.intp)
