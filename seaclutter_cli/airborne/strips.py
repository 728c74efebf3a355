"""Strips of a tile: the passes of the aircraft, each of which shows the water at one moment."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Column = Callable[[str], NDArray[Any] | None]
"""Returns an attribute of all points by its LAS name, shape (N,); None if the tile does not have it."""

_TURN_S = 30.0
_LEAST_SHARE = 0.01


def strips_of(column: Column) -> NDArray[np.intp] | None:
    """Return the strip of each point, shape (N,); None if nothing tells strips apart.

    Notes
    -----
    Strips have different point source IDs or, where all IDs are the same, are at least half a minute apart in GPS time:
    an aircraft needs longer to turn. Strips with less than a hundredth of the points are one strip together.

    Examples
    --------
    >>> times = np.array([5.0, 6, 7, 205, 206, 207])
    >>> strips_of({"gps_time": times}.get)
    array([0, 0, 0, 1, 1, 1])
    """
    source = column("point_source_id")
    strip = None if source is None else np.unique(source, return_inverse=True)[1].reshape(-1)
    if strip is None or not strip.any():
        times = column("gps_time")
        strip = None if times is None else _passes(np.asarray(times, np.float64))
    if strip is None or not strip.any():
        return None
    size = np.bincount(strip)
    few = size < _LEAST_SHARE * len(strip)
    return np.where(few[strip], len(size), strip)


def _passes(times_s: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the pass of each point: times without a gap of half a minute; points without a time are in the first."""
    known = np.isfinite(times_s)
    strip = np.zeros(len(times_s), np.intp)
    step = np.floor(times_s[known] / _TURN_S)
    values, which = np.unique(step, return_inverse=True)
    strip[known] = np.cumsum(np.diff(values, prepend=values[:1]) > 1)[which.reshape(-1)]
    return strip
