"""Strips of a tile: the passes of the aircraft, each of which shows the water at one moment; levels of strips.

A survey takes hours; meanwhile the tide rises and falls, waves move, and land stays as it is.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.squares import Column, square_of, squares_in
from seaclutter_cli.arrays import Bytes, Floats, Indices, Mask
from seaclutter_cli.grids.elevation import GriddedPoints, sliced

_TURN_S = 30.0
_LEAST_SHARE = 0.01
_MANY_POINTS, _SIDE_M, _LEAST_POINTS = 200_000, 8.0, 4
_STILL_S, _TWICE_SHARE = 0.25, 0.05
_ROW = 2.0**24
_LEAST_ECHOES, _FLAT_M = 6, 0.3
_MOVED_M = 0.1
_LEAST_SQUARES, _MOVED_SHARE, _AGREEING = 6, 0.2, 0.8


def strips_of(column: Column) -> Bytes | None:
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


def _passes(times_s: Floats) -> Indices:
    """Return the pass of each point: times without a gap of half a minute; points without a time are in the first."""
    known = np.isfinite(times_s)
    strip = np.zeros(len(times_s), np.intp)
    step = np.floor(times_s[known] / _TURN_S)
    values, which = np.unique(step, return_inverse=True)
    strip[known] = np.cumsum(np.diff(values, prepend=values[:1]) > 1)[which.reshape(-1)]
    return strip


def looks_of(strip: Bytes | None, parts: Iterable[Floats], column: Column) -> Bytes | None:
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
    return np.asarray(plane[0] + plane[1:] @ place)


@dataclass(frozen=True)
class StripLevels:
    """Levels of each of K strips in the S squares of a tile.

    ``mean_m``, shape (K, S): mean elevation; ``seen``, shape (K, S): where a strip has enough points, which are flat,
    and so has another; ``tide_m``, shape (K,): level of the water, relative to the largest strip; 0 where it is the
    same.
    """

    mean_m: Floats
    seen: Mask
    tide_m: Floats

    def changes_m(self) -> Floats:
        """Return by how much each square differs between its first and last strip, shape (S,); NaN if one saw it.

        What all squares of a pair of strips have in common, such as the tide, is no change.
        """
        strips, squares = self.seen.shape
        first, last = self.seen.argmax(axis=0), strips - 1 - self.seen[::-1].argmax(axis=0)
        every = np.arange(squares)
        twice = np.count_nonzero(self.seen, axis=0) > 1
        change = np.where(twice, self.mean_m[last, every] - self.mean_m[first, every], np.nan)
        pair = first * strips + last
        for number in np.unique(pair[np.isfinite(change)]).tolist():
            change[pair == number] -= np.nanmedian(change[pair == number])
        return change


def strip_levels(points: GriddedPoints, strip: Bytes) -> StripLevels | None:
    """Return the levels of strips; None if there is only one.

    ``points``: the N points of a tile; ``strip``, shape (N,): strip of each point, less than K.

    Where strips overlap, ground has one elevation, and water may have two. Flat squares that two strips both see are
    compared. The water has another level if a fifth of them differ by more than ten centimetres, four in five of these
    in the same direction; their median is the difference. Waves are as often higher as lower. Strips that are scattered
    over more squares than they have points are not compared.
    """
    strips, squares = int(strip.max()) + 1, squares_in(points.grid)
    if strips < 2 or strips * squares > len(strip):
        return None
    middle = np.median(points.grid.lowest[np.isfinite(points.grid.lowest)])  # keeps the sums of squares precise
    count, mean, power = np.zeros((3, strips * squares))
    for index, z, cell in points:
        own = strip[index].astype(np.int64) * squares + square_of(cell)
        above = z - middle
        count += np.bincount(own, minlength=len(count))
        mean += np.bincount(own, above, len(mean))
        power += np.bincount(own, above**2, len(power))
    count, mean, power = (sums.reshape(strips, squares) for sums in (count, mean, power))
    mean, power = (sums / np.maximum(count, 1) for sums in (mean, power))
    seen = count >= _LEAST_ECHOES
    seen &= (seen.sum(axis=0) > 1) & (power - mean**2 <= _FLAT_M**2)
    tide = np.full(strips, np.nan)
    tide[np.argmax(count.sum(axis=1))] = 0
    for _ in range(strips):
        steps = [
            (int(np.count_nonzero(both)), new, tide[known] + _step(mean[new, both] - mean[known, both]))
            for known in np.flatnonzero(np.isfinite(tide)).tolist()
            for new in np.flatnonzero(~np.isfinite(tide)).tolist()
            if (both := seen[known] & seen[new]).any()
        ]
        if not steps:
            break
        _, new, tide[new] = max(steps)
    return StripLevels(mean, seen, np.nan_to_num(tide))


def _step(difference_m: Floats) -> float:
    """Return by how much the water of a strip is higher than that of another, from the differences of squares."""
    apart = difference_m[np.abs(difference_m) > _MOVED_M]
    if len(apart) < max(_LEAST_SQUARES, _MOVED_SHARE * len(difference_m)):
        return 0.0
    step = float(np.median(apart))
    return step if np.mean(np.sign(apart) == np.sign(step)) >= _AGREEING else 0.0
