"""Grid over points with cells small enough for all points of a cell to be neighbours."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.groups import group_sizes, group_starts

Indices = NDArray[np.int64]
Points = NDArray[np.float64]

_REACH = 2
_FEW_CELLS = 1 << 20
_ALL_PAIRED = 100
_BLOCK = 1 << 13
_STEPS = np.array([(i, j) for i in range(_REACH + 1) for j in range(-_REACH, _REACH + 1) if (i, j) >= (0, 0)])
"""Steps along x and y to columns in reach, in one direction."""


@dataclass(frozen=True)
class Cells:
    """The C occupied cells of a grid over N points, sorted by column and height.

    The side of a cell is the tolerance divided by the root of 3, reduced by 1 part in 10^8. Any two points of a cell
    are closer than the tolerance, and points closer than it are at most two cells apart on each axis.

    ``order``, shape (N,), has the points in the order of their cells; ``start`` and ``count``, shape (C,), the index of
    a cell's first point in it, and the number of its points. ``column`` is the rank of a cell's column, ``height`` its
    height in it. ``columns``, shape (K,), are the numbers of the occupied columns, ascending, ``row`` is the difference
    between the numbers of columns that are neighbours along x.
    """

    order: Indices
    start: Indices
    count: Indices
    column: Indices
    height: Indices
    columns: Indices
    row: int

    def __len__(self) -> int:
        return len(self.start)

    def pairs(self) -> Iterator[Indices]:
        """Yield arrays, shape (2, n), with the pairs of cells at most two apart on each axis, each once; all of few."""
        if len(self) <= _ALL_PAIRED:
            yield np.stack(np.tril_indices(len(self), -1))
            return
        stride = int(self.height.max()) + 1 + _REACH
        key = self.column * stride + self.height
        sought = self.columns + (_STEPS @ (self.row, 1))[:, None]
        other = np.searchsorted(self.columns, sought)
        known = np.append(self.columns, -1)[other] == sought
        for start in range(0, len(self), _BLOCK):
            column = self.column[start : start + _BLOCK]
            step, own = known[:, column].nonzero()
            beside = other[step, column[own]] * stride + self.height[own + start]
            first = np.searchsorted(key, beside - np.where(step, _REACH, -1))  # upwards only in the same column
            found = np.searchsorted(key, beside + _REACH, side="right") - first
            yield np.stack((np.repeat(own + start, found), spans(first, found)))


def cells_of(xyz: Points, tolerance_m: float) -> Cells:
    """Return the cells of finite points, shape (3, N), in metres."""
    if not xyz.shape[1]:
        none = np.empty(0, np.int64)
        return Cells(none, none, none, none, none, none, 1)
    side = tolerance_m / np.sqrt(3) * (1 - 1e-8)
    y, z = (_along_axis(values, side, tolerance_m) for values in xyz[1:])
    row = int(y.max()) + 1 + _REACH
    column = _along_axis(xyz[0], side, tolerance_m)
    column *= row
    column += y
    stride = int(z.max()) + 1
    rank = column
    if int(column.max()) * stride >= 2**62:
        rank = np.unique(column, return_inverse=True)[1].reshape(-1)
    key = rank * stride
    key += z
    order = np.argsort(key)
    start = group_starts(key[order])
    columns = column[order[start]]
    first = group_starts(columns)
    return Cells(
        order,
        start,
        group_sizes(start, len(order)),
        np.repeat(np.arange(len(first)), group_sizes(first, len(columns))),
        z[order[start]],
        columns[first],
        row,
    )


def blocks(sizes: Indices, limit: int) -> Iterator[slice]:
    """Yield slices over items whose sizes add up to at most a limit; a larger item forms a slice of its own."""
    ends = np.cumsum(sizes)
    start = 0
    while start < len(sizes):
        before = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, before + limit, side="right")))
        yield slice(start, stop)
        start = stop


def spans(start: Indices, count: Indices) -> Indices:
    """Return the indices of all spans, one span after the other."""
    ends = np.cumsum(count)
    total = int(ends[-1]) if len(ends) else 0
    return np.arange(total) + np.repeat(start - ends + count, count)


def _along_axis(values: Points, side: float, tolerance_m: float) -> Indices:
    """Return the cell numbers of coordinates along an axis, from 0."""
    least = values.min()
    with np.errstate(over="ignore"):
        if (values.max() - least) / side < _FEW_CELLS:
            return np.asarray((values - least) / side, np.int64)
    return _with_gaps(values, side, tolerance_m)


def _with_gaps(values: Points, side: float, tolerance_m: float) -> Indices:
    """Return the cell numbers of widely spread coordinates, exactly: every gap is shortened to three cells."""
    order = np.argsort(values)
    ordered = values[order]
    with np.errstate(over="ignore"):
        gap = np.diff(ordered, prepend=ordered[0]) >= tolerance_m
    starts = np.flatnonzero(gap)
    segment = np.cumsum(gap)
    local = np.asarray((ordered - np.append(ordered[0], ordered[starts])[segment]) / side, np.int64)
    steps = local[starts - 1] + 1 + _REACH
    cells = np.empty(len(local), np.int64)
    cells[order] = local + np.append(0, np.cumsum(steps))[segment]
    return cells
