"""Columns with echoes at several heights, which the water surface does not have."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.groups import group_sizes, group_starts

Floats = NDArray[np.float64]

_REACH = 128
_COLUMNS = 2 * _REACH


def upright(x: Floats, y: Floats, height: Floats, span_m: float) -> NDArray[np.bool_]:
    """Return the points in columns of 1 m whose echoes span a height: water has one height at a place, a hull many.

    Parameters
    ----------
    x, y, height : ndarray, shape (N,), float64
        Coordinates in metres. Points beyond 127 m along x or y are in no column.
    span_m : float
        Least difference between the highest and the lowest echo of a column, in metres.

    Returns
    -------
    ndarray, shape (N,), bool
        True for all points of such columns. Columns are those of two grids, shifted by half a column along x and y.

    Examples
    --------
    >>> upright(np.array([10.2, 10.3, 20.0]), np.zeros(3), np.array([0.1, 0.9, 0.2]), 0.5)
    array([ True,  True, False])
    """
    found = np.zeros(len(x), np.bool_)
    inside = np.flatnonzero((np.abs(x) < _REACH - 1) & (np.abs(y) < _REACH - 1))
    x, y, height = x[inside], y[inside], height[inside]
    if not len(inside):
        return found
    for shift in (0.0, 0.5):
        column = (x + (_REACH + shift)).astype(np.uint16) * np.uint16(_COLUMNS)
        column += (y + (_REACH + shift)).astype(np.uint16)
        order = np.argsort(column, kind="stable")  # a radix sort for 16 bits
        ordered, values = column[order], height[order]
        start = group_starts(ordered)
        span = np.maximum.reduceat(values, start) - np.minimum.reduceat(values, start)
        stands = np.repeat(span >= span_m, group_sizes(start, len(order)))
        found[inside[order[stands]]] = True
    return found
