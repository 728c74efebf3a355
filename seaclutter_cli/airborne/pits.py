"""Echoes from below the surface, which are left out."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells
from seaclutter_cli.grids.elevation import BLOCK, ElevationGrid

Cells = NDArray[np.float64]

_NEIGHBORS = 5
_ALIKE, _SHALLOW = 7, 0.25
_MANY_PITS, _WIDTH, _AROUND, _ROUGH = 0.002, 5, 7, 4.0
_LOW_SHARE, _LARGEST_GROUP, _LIKELY = 0.4, 12, 0.8


def without_pits(grid: ElevationGrid, depth_m: float) -> Cells:
    """Return the lowest elevations, shape (S, 256, 256), without pits that are one cell wide.

    A cell that is more than ``depth_m`` below each of at least five neighbours with points contains an echo from below
    the surface; it gets the lowest of their values. Amid fewer, cells that are two away count, too. Elsewhere an
    opening confines such a cell to itself, but near the edge of a tile, where no window avoids it, it would lower the
    surface along its whole row.

    In water that light penetrates, such echoes are many and from shallow depths. Amid eight neighbours, most of which
    are alike, a cell is a pit from a quarter of ``depth_m`` on, even if one neighbour is one, too; in a ditch, two are
    as low. Amid seven, it is one from ``depth_m`` on.

    If more than two in a thousand cells are pits amid level neighbours, pits touch by chance, and groups are left out,
    too (`_without_groups`).
    """
    out = grid.lowest.copy()
    level = 0
    for slot, wide, _ in grid.padded(grid.lowest, 2):
        cells = wide[1:-1, 1:-1]
        around = _neighbors(cells)
        deep = np.isfinite(out[slot])
        higher = np.zeros(deep.shape, np.uint8)
        for lower in _neighbors(cells - depth_m):
            deep &= out[slot] < lower
        for lower in _neighbors(cells - _SHALLOW * depth_m):
            higher += out[slot] < lower
        shallow = np.isfinite(out[slot]) & (higher >= _ALIKE) & ~deep
        beside = np.stack([own[deep] for own in around])
        pits = np.isfinite(beside).sum(axis=0) >= _NEIGHBORS
        out[slot][tuple(np.argwhere(deep)[pits].T)] = beside.min(axis=0)[pits]
        level += _fill_lonely(out[slot], np.argwhere(deep)[~pits].T, wide, depth_m)
        level += _count_level(beside[:, pits], depth_m)
        ordered = np.sort(np.stack([own[shallow] for own in around]), axis=0)
        depth = ordered[1] - out[slot][shallow]
        alike = np.isfinite(ordered[-1]) | (np.isfinite(ordered[-2]) & (depth > depth_m))
        lower, middle, upper = ordered[[1, 3, 6]][:, alike]
        at = np.argwhere(shallow)[alike].T
        pits = upper - lower < (lower - out[slot][tuple(at)]) / 2
        out[slot][tuple(at[:, pits])] = middle[pits]
        level += int(np.count_nonzero(pits))
    if level <= _MANY_PITS * np.count_nonzero(np.isfinite(out)):
        return out
    return _without_groups(grid, out, _SHALLOW * depth_m)


def _fill_lonely(out: Cells, at: NDArray[np.int64], wide: Cells, depth_m: float) -> int:
    """Fill pits with few neighbours, shape (2, P), from the cells up to two away in a block that is padded by two.

    Return how many pits are amid level cells.
    """
    window = np.indices((5, 5)).reshape(2, -1, 1)
    beside = wide[tuple(window + at[:, None])]
    beside[len(beside) // 2] = np.inf
    value = beside.min(axis=0, initial=np.inf)
    pits = (np.isfinite(beside).sum(axis=0) >= _NEIGHBORS) & (out[tuple(at)] < value - depth_m)
    out[tuple(at[:, pits])] = value[pits]
    return _count_level(beside[:, pits], depth_m)


def _count_level(beside: Cells, depth_m: float) -> int:
    """Return of how many pits the cells beside, shape (K, P), are level; plus infinity in empty cells."""
    highest = np.where(np.isfinite(beside), beside, -np.inf).max(axis=0, initial=-np.inf)
    return int(np.count_nonzero(highest - beside.min(axis=0, initial=np.inf) < depth_m / 2))


def _without_groups(grid: ElevationGrid, lowest: Cells, depth_m: float) -> Cells:
    """Return elevations, shape (S, 256, 256), without groups of low cells, such as chance makes of many pits.

    The closing over five cells, the opening upside down, is the surface without them. Cells are low if they are more
    than ``depth_m`` below it, and four times what noise and waves are. They are filled with it if at most twelve of
    them touch, or as many as chance makes: a ditch or a gap between ships is longer. At most four in ten cells around
    are low: between trees, more are.
    """
    from scipy import ndimage  # slow to import, not needed without pits

    closed, share = lowest.copy(), np.zeros(lowest.shape)
    inner = (slice(_WIDTH, _WIDTH + BLOCK),) * 2
    for slot, cells, _ in grid.padded(lowest, _WIDTH):
        dilated = ndimage.maximum_filter(np.where(np.isfinite(cells), cells, -np.inf), _WIDTH)
        dilated[np.isneginf(dilated)] = np.inf
        closed[slot] = ndimage.minimum_filter(dilated, _WIDTH)[inner]
    known = np.isfinite(lowest)
    below = np.where(known, closed, 0) - np.where(known, lowest, 0)
    low = below > max(depth_m, _ROUGH * float(np.median(below[known])))
    for slot, cells, _ in grid.padded(np.where(known, low, np.inf), _WIDTH):
        some = np.isfinite(cells).astype(np.float64)
        both = [ndimage.uniform_filter(values, _AROUND)[inner] for values in (np.where(some, cells, 0), some)]
        np.divide(both[0], both[1], out=share[slot], where=known[slot])
    part, group = joined_cells(low, grid.blocks)
    member = group[part]
    size = np.bincount(member[low], minlength=len(group))
    low &= share <= _LOW_SHARE
    count = np.count_nonzero(known)
    left = max(int(np.count_nonzero(low)), 1)
    chance = np.log(count) / -np.log(min(8 * left / count, _LIKELY))
    return np.where(low & (size[member] <= max(_LARGEST_GROUP, chance)), closed, lowest)


def _neighbors(cells: Cells) -> list[Cells]:
    """Return the cells beside those of a block that is padded by one cell, in each of eight directions."""
    return [cells[i : i + BLOCK, j : j + BLOCK] for i, j in np.ndindex(3, 3) if (i, j) != (1, 1)]
