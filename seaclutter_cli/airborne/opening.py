"""Morphological opening of a grid of elevations with empty cells."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells
from seaclutter_cli.airborne.grid import BLOCK, ElevationGrid

Cells = NDArray[np.float64]

_NEIGHBORS = 5
_ALIKE, _SHALLOW = 7, 0.25
_MANY_PITS, _WIDTH, _AROUND, _ROUGH = 0.002, 5, 7, 4.0
_LOW_SHARE, _LARGEST_GROUP, _LIKELY = 0.4, 12, 0.8


def half_window(window_m: float, cell_m: float) -> int:
    """Return the half width h of a window in cells; the window is 2 h + 1 cells wide.

    Examples
    --------
    >>> half_window(20.0, 1.0), half_window(0.5, 1.0)
    (10, 0)
    """
    return int(window_m / (2 * cell_m) + 1e-9)


def opened(lowest: Cells, half: int) -> Cells:
    r"""Return the opening of a grid: its erosion, dilated ([Shi2022], Eq. 1 to 3).

    .. math:: (f \ominus w)(i, j) = \min_{(s, t) \in w} f(s, t), \quad
        (f \oplus w)(i, j) = \max_{(s, t) \in w} f(s, t), \quad f \circ w = (f \ominus w) \oplus w

    Parameters
    ----------
    lowest : ndarray, shape (I, J), float64
        Elevations in metres; plus infinity in empty cells.
    half : int
        Half width of the window in cells; less where the grid is narrower than the window.

    Returns
    -------
    ndarray, shape (I, J), float64
        Elevation of the opened surface, at most the value of the cell. Minus infinity where the windows around a cell
        contain no value.

    Notes
    -----
    Only windows inside the grid count, so an object cut by the edge is seen in whole windows, too. Empty cells are
    neither low nor high. Without empty cells, the result equals ``scipy.ndimage.grey_opening`` with minus infinity
    beyond the edge.

    Examples
    --------
    >>> opened(np.array([[0.0, 5, 0.2, np.inf, 0.1]]), 1)
    array([[0. , 0.2, 0.2, 0.2, 0.1]])
    """
    from scipy import ndimage  # slow to import, not needed by other filters

    size = [2 * min(half, (cells - 1) // 2) + 1 for cells in lowest.shape]
    eroded = ndimage.minimum_filter(lowest, size, mode="constant", cval=-np.inf)
    eroded[np.isposinf(eroded)] = -np.inf
    return np.asarray(ndimage.maximum_filter(eroded, size, mode="constant", cval=-np.inf))


def filled(lowest: Cells, reach: int) -> Cells:
    """Return a grid whose empty cells have the lowest of the nearest values in four directions.

    Parameters
    ----------
    lowest : ndarray, shape (I, J), float64
        Elevations in metres; plus infinity in empty cells.
    reach : int
        Distance in cells up to which a value counts; a cell without any remains empty.

    Notes
    -----
    A ship hides the water behind it from an oblique beam, and calm water often returns nothing. With the lowest value,
    such a gap is water if there is water on any side, and does not widen the ship.

    Examples
    --------
    >>> filled(np.array([[7.0, np.inf, np.inf, 1, np.inf, np.inf, np.inf]]), 2)
    array([[ 7.,  1.,  1.,  1.,  1.,  1., inf]])
    """
    empty = np.isposinf(lowest)
    if not empty.any():
        return lowest
    out = lowest.copy()
    for source, target in ((lowest, out), (lowest.T, out.T)):
        gaps = np.isposinf(source)
        target[gaps] = np.minimum(target[gaps], _nearest_in_row(source, gaps, reach))
    return out


def _nearest_in_row(values: Cells, gaps: NDArray[np.bool_], reach: int) -> Cells:
    """Return the lower of the last value before and the first after each gap in its row, shape (gaps,).

    Values more than ``reach`` cells away, or none, are plus infinity.
    """
    columns = values.shape[1]
    flat = np.concatenate(([np.inf], values[~gaps], [np.inf]))
    far = -columns - reach
    place = np.concatenate(([far], np.flatnonzero(~gaps), [values.size - far]))
    gap = np.flatnonzero(gaps)
    before = gap - np.arange(len(gap))  # number of values before each gap
    found = np.full(len(gap), np.inf)
    for near in (before, before + 1):
        inside = (np.abs(place[near] - gap) <= reach) & (place[near] // columns == gap // columns)
        np.minimum(found, flat[near], out=found, where=inside)
    return found


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


def _around_values(cells: Cells, inside: tuple[slice, slice], reach: int) -> tuple[slice, ...]:
    """Return the part of ``inside`` that is at most ``reach`` cells from the rectangle around all values."""
    known = np.isfinite(cells[inside])
    rows = (np.flatnonzero(known.any(axis=1 - axis)) + part.start for axis, part in enumerate(inside))
    ends = ((int(row[0]) - reach, int(row[-1]) + reach + 1) for row in rows)
    return tuple(slice(max(a, p.start), min(b, p.stop)) for (a, b), p in zip(ends, inside, strict=True))


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
        part = np.full(cells.shape, -np.inf)
        near = _around_values(cells, inside, halo)
        part[near] = opened(filled(cells[near], reach), half)
        out[slot] = part[halo : halo + BLOCK, halo : halo + BLOCK]
    return out
