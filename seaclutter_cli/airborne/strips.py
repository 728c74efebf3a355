"""Strips of a tile: the passes of the aircraft, each of which shows the water at one moment."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats
from seaclutter_cli.grids.elevation import sliced

Column = Callable[[str], NDArray[Any] | None]
"""Returns an attribute of all points by its LAS name, shape (N,); None if the tile does not have it."""

_TURN_S = 30.0
_LEAST_SHARE = 0.01
_MANY_POINTS, _SIDE_M, _LEAST_POINTS = 200_000, 8.0, 4
_STILL_S, _TWICE_SHARE = 0.25, 0.05
_ROW = 2.0**24


def strips_of(column: Column) -> NDArray[np.uint8] | None:
    """Return the strip of each point, from 0 on, shape (N,); None if nothing distinguishes strips.

    Strips have different point source IDs or, where all IDs are the same, are at least half a minute apart in GPS time:
    an aircraft needs longer to turn. Strips with less than a hundredth of the points are one strip together.

    Examples
    --------
    >>> times = np.array([5.0, 6, 7, 205, 206, 207])
    >>> strips_of({"gps_time": times}.get)
    array([0, 0, 0, 1, 1, 1], dtype=uint8)
    """
    strip = column("point_source_id")
    if strip is None or _are_same(strip):
        times = column("gps_time")
        strip = None if times is None else _passes(np.asarray(times, np.float64))
    elif strip.dtype != np.uint16:  # as in LAS
        strip = np.unique(strip, return_inverse=True)[1].reshape(-1)
    if strip is None or _are_same(strip):
        return None
    size = np.bincount(strip)
    many = size >= _LEAST_SHARE * len(strip)
    number = np.where(many, np.cumsum(many) - 1, np.count_nonzero(many)).astype(np.uint8)
    return np.asarray(number[strip])


def _are_same(values: NDArray[Any]) -> bool:
    return not (values != values[:1]).any()


def _passes(times_s: Floats) -> NDArray[np.intp]:
    """Return the pass of each point: times without a gap of half a minute; points without a time are in the first."""
    known = np.isfinite(times_s)
    strip = np.zeros(len(times_s), np.intp)
    step = np.floor(times_s[known] / _TURN_S)
    values, which = np.unique(step, return_inverse=True)
    strip[known] = np.cumsum(np.diff(values, prepend=values[:1]) > 1)[which.reshape(-1)]
    return strip


def looks_of(strip: NDArray[np.uint8] | None, parts: Iterable[Floats], column: Column) -> NDArray[np.uint8] | None:
    """Return the strip of each point, shape (N,); those that see places twice are divided into their looks.

    ``parts`` are coordinates in metres, shape (3, n).

    A scanner on a cone (Palmer) sees a place ahead of the aircraft and again behind it, seconds later. In the time that
    an aircraft takes, such echoes are before or after those that a plane through the times of the strip expects. Others
    differ by less than a tenth of the period of the shortest waves that are followed, a quarter of a second.
    """
    times = column("gps_time")
    if times is None:
        return strip
    own = np.zeros(len(times), np.uint8) if strip is None else strip
    step = max(len(times) // _MANY_POINTS, 1)
    place = np.concatenate([xyz[:2, -part.start % step :: step] for part, xyz in sliced(parts)], axis=1)
    late = np.zeros(len(times), np.bool_)
    for number in np.unique(own[::step]).tolist():
        some = np.isfinite(place).all(axis=0) & np.isfinite(times[::step]) & (own[::step] == number)
        plane = _between_looks(place[:, some], np.asarray(times[::step][some], np.float64))
        if plane is None:
            continue
        for part, xyz in sliced(parts):
            late[part] |= (own[part] == number) & (times[part] > _at(plane, xyz[:2]))
    return 2 * own + late if late.any() else strip


def _between_looks(place: Floats, times_s: Floats) -> Floats | None:
    """Return the plane through the times midway between both looks of a strip; None if nearly all is seen once.

    ``place``, shape (2, N), and ``times_s``, shape (N,), are those of its echoes. Squares of 8 m whose times deviate by
    a quarter of a second from a plane through all are seen twice.
    """
    if place.shape[1] < _LEAST_POINTS:
        return None
    plane = _fitted(place, times_s)
    late = times_s - _at(plane, place)
    own = np.unique([_ROW, 1.0] @ np.floor(place / _SIDE_M), return_inverse=True)[1]
    count = np.bincount(own)
    mean, power = (np.bincount(own, values) / count for values in (late, late**2))
    many = count >= _LEAST_POINTS
    twice = many & (np.sqrt(np.maximum(power - mean**2, 0)) > _STILL_S)
    if not np.count_nonzero(twice) > _TWICE_SHARE * np.count_nonzero(many):
        return None
    first, last = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(first, own, late)
    np.maximum.at(last, own, late)
    center = np.stack([np.bincount(own, axis) / count for axis in place])[:, twice]
    return plane + _fitted(center, ((first + last) / 2)[twice])


def _fitted(place: Floats, values: Floats) -> Floats:
    """Return level and slopes, shape (3,), of the plane through values at places, shape (2, N)."""
    middle = place.mean(axis=1, keepdims=True)
    slope = np.linalg.lstsq((place - middle).T, values - values.mean(), rcond=None)[0]
    return np.array([values.mean() - slope @ middle[:, 0], *slope])


def _at(plane: Floats, place: Floats) -> Floats:
    """Return the values of a plane at places, shape (2, N)."""
    return np.asarray(plane[0] + plane[1:] @ place)
