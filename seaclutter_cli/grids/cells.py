"""Groups, neighbours and means of the cells of a grid, across its blocks."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.grids.elevation import BLOCK, Cells, ElevationGrid

_WIDTHS, _BOXES = 3, 2.0
_FEW_PAIRS = 1 << 20
_STEP = 1 << 10
_LEAST_WEIGHT = 1e-3
_ALL, _FIRST, _LAST = slice(None), slice(0, 1), slice(-1, None)
_EDGES = {
    (1, 0): ((-1, _ALL), (0, _ALL)),
    (0, 1): ((_ALL, -1), (_ALL, 0)),
    (1, 1): ((-1, _LAST), (0, _FIRST)),
    (1, -1): ((-1, _FIRST), (0, _LAST)),
}
"""Edge or corner of a block, and of the block that is these steps away along x and y, where they touch."""


def joined_cells(mask: Mask, blocks: Mapping[tuple[int, int], int]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the groups of cells that touch each other, by side or corner, also across blocks.

    The result is the part of each cell, shape (S, B, B), 0 outside the mask, and the group of each part, shape (P,).
    ``mask``, shape (S, B, B): the cells, in S blocks; ``blocks``: index of each block, by its block number along x and
    y.
    """
    from scipy import ndimage  # slow to import, not needed without islands

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
    return part, joined(np.concatenate(pairs, axis=1), parts)


def joined(pairs: NDArray[Any], size: int) -> NDArray[np.int32]:
    """Return the group of each of so many things, which pairs of them, shape (2, n), join."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(pairs.shape[1], np.bool_), (pairs[0], pairs[1])), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)


def _touching(edge: NDArray[np.int32], opposite: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    """Return the pairs of parts, shape (2, n), that touch across the edge of two blocks."""
    steps = ((edge, opposite), (edge[1:], opposite[:-1]), (edge[:-1], opposite[1:]))
    found = [np.stack(pair) for pair in steps]
    return [pairs[:, (pairs > 0).all(axis=0)] for pairs in found]


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
    inner = (slice(halo, halo + BLOCK),) * 2

    def around(part: Cells) -> Cells:
        if width < _BOXES:
            found = ndimage.gaussian_filter(part, width, mode="constant", radius=halo)
        else:
            found = ndimage.uniform_filter(ndimage.uniform_filter(part, box, mode="constant"), box, mode="constant")
        return np.asarray(found[inner])

    mean, share = np.zeros(values.shape), np.zeros(values.shape)
    for slot, cells, _ in grid.padded(np.where(used, values, np.inf), halo):
        known = np.isfinite(cells)
        if known.any():
            weight = around(known.astype(np.float64))
            some = weight > _LEAST_WEIGHT
            np.divide(around(np.where(known, cells, 0)), weight, out=mean[slot], where=some)
            share[slot][some] = weight[some]
    return mean, share


def touching(grid: ElevationGrid, mask: Mask) -> Mask:
    """Return a mask with the cells that touch it, by side or corner, shape (S, 256, 256)."""
    from scipy import ndimage

    out = np.empty(mask.shape, np.bool_)
    for slot, cells, _ in grid.padded(np.where(mask, 0.0, np.inf), 1):
        out[slot] = ndimage.minimum_filter(cells, 3)[1:-1, 1:-1] == 0
    return out


def nearest(positions: NDArray[Any], queries: NDArray[Any]) -> NDArray[np.intp]:
    """Return the index of the position nearest to each query, shape (Q,).

    ``positions``, shape (2, P): at least one; ``queries``, shape (2, Q): where to search from.
    """
    if positions.shape[1] * queries.shape[1] > _FEW_PAIRS:
        from scipy.spatial import cKDTree  # slow to import

        return np.asarray(cKDTree(positions.T).query(queries.T)[1], np.intp)
    found = np.empty(queries.shape[1], np.intp)
    for start in range(0, len(found), _STEP):
        offset = queries[:, start : start + _STEP, None] - positions[:, None]
        found[start : start + _STEP] = np.argmin((offset**2).sum(axis=0), axis=1)
    return found
