"""Levels of strips: a survey takes hours; meanwhile the tide rises and falls, waves move, and land stays as it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.squares import square_of, squares_in
from seaclutter_cli.arrays import Floats, Ints, Mask
from seaclutter_cli.grids.elevation import NOWHERE, GriddedPoints

_LEAST_ECHOES, _FLAT_M = 6, 0.3
_STEP_M = 0.1
_LEAST_SQUARES, _LEAST_SHARE, _AGREEING = 6, 0.2, 0.8


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


def strip_levels(points: GriddedPoints, strip: NDArray[np.uint8]) -> StripLevels | None:
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
    count = _points_of(points, strip, strips, squares)
    mean, seen = _levels_of(points, strip, count)
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
    apart = difference_m[np.abs(difference_m) > _STEP_M]
    if len(apart) < max(_LEAST_SQUARES, _LEAST_SHARE * len(difference_m)):
        return 0.0
    step = float(np.median(apart))
    return step if np.mean(np.sign(apart) == np.sign(step)) >= _AGREEING else 0.0


def _points_of(points: GriddedPoints, strip: NDArray[np.uint8], strips: int, squares: int) -> Ints:
    """Return the number of points of each strip in each square, shape (K, S)."""
    count = np.zeros(strips * squares, np.int64)
    start = 0
    for cell in points.cells:
        located = np.flatnonzero(cell != NOWHERE)
        own = strip[start + located].astype(np.int64) * squares + square_of(cell[located])
        count += np.bincount(own, minlength=len(count))
        start += len(cell)
    return count.reshape(strips, squares)


def _levels_of(points: GriddedPoints, strip: NDArray[np.uint8], count: Ints) -> tuple[Floats, Mask]:
    """Return the mean elevation of each strip in each square, and where to compare it, both of shape (K, S).

    Strips are compared where two have enough of the points that ``count`` has, and are flat.
    """
    squares = count.shape[1]
    mean, power = np.zeros(count.size), np.zeros(count.size)
    seen = count >= _LEAST_ECHOES
    shared = seen.sum(axis=0) > 1
    middle = np.median(points.grid.lowest[np.isfinite(points.grid.lowest)])  # keeps the sums of squares precise
    for part, z, cell in points if shared.any() else ():
        square = square_of(cell)
        used = np.flatnonzero((cell != NOWHERE) & shared[square])
        own = strip[part][used].astype(np.int64) * squares + square[used]
        above = z[used] - middle
        mean += np.bincount(own, above, len(mean))
        power += np.bincount(own, above**2, len(mean))
    mean, power = (sums.reshape(count.shape) / np.maximum(count, 1) for sums in (mean, power))
    return mean, seen & shared & (power - mean**2 <= _FLAT_M**2)
