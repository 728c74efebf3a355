"""Level regions of a tile: connected flat squares at one level, their edges and how even they are."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.squares import LEAST_SQUARES, Squares, SquareWaves

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

COARSE = 8
"""Width in squares of the wide means of a region."""
_BAND_M, _BAND_DEVIATIONS, _LEVEL_DEVIATIONS = 0.2, 3.0, 1.0
_ROUGH_M = 0.15
_OPEN_SHARE, _AMID_SHARE = 0.5, 0.5
_EVEN_M, _EVEN_TILT_M, _EVEN_SHARE = 0.01, 0.04, 0.45


@dataclass(frozen=True)
class Relief:
    """Relief of a region.

    Parameters
    ----------
    slope : float
        Slope of a plane through the levels of its squares.
    tilt_m : float
        Standard deviation of that plane.
    step_m : float
        Deviation of a square from its neighbours.
    bumps_m : float
        Standard deviation from that plane of means over 64 squares; 0 for fewer than two.
    """

    slope: float
    tilt_m: float
    step_m: float
    bumps_m: float


def level_regions(squares: Squares, waves: SquareWaves, kinds: Sequence[Mask]) -> Sequence[NDArray[np.int64]]:
    """Return the level regions of several kinds of squares, which are not joined; the largest comes first.

    Parameters
    ----------
    squares : Squares
        The N squares of a tile.
    waves : SquareWaves
        Waves in each of them.
    kinds : sequence of ndarray, shape (N,), bool
        Squares of each kind.

    Returns
    -------
    sequence of ndarray, int64
        The squares of each region, at least six.
    """
    return sorted((own for kind in kinds for own in _regions(squares, waves, kind)), key=len, reverse=True)


def _regions(squares: Squares, waves: SquareWaves, kind: Mask) -> Iterator[NDArray[np.int64]]:
    """Yield connected flat squares at one level, beginning with the most frequent level."""
    band = bands_of(waves.deviation_m)
    around = np.maximum(_BAND_M, _LEVEL_DEVIATIONS * waves.deviation_m)
    remaining = np.flatnonzero(are_flat(squares, waves.deviation_m) & kind)
    while len(remaining) >= LEAST_SQUARES:
        level = waves.level_m[remaining]
        step = np.floor(level / np.median(band[remaining])).astype(np.int64)
        _, which, counts = np.unique(step, return_inverse=True, return_counts=True)
        if counts.max() < LEAST_SQUARES:
            return
        middle = np.median(level[which == np.argmax(counts)])
        inside = np.abs(squares.level_m[remaining] - middle) <= band[remaining]
        inside &= np.abs(level - middle) <= around[remaining]
        if not inside.any():  # land beside waves, which are not as high
            remaining = remaining[which != np.argmax(counts)]
            continue
        own = remaining[inside]
        part = connected(squares, own)
        for number in np.flatnonzero(np.bincount(part) >= LEAST_SQUARES):
            yield own[part == number]
        remaining = remaining[~inside]


def are_flat(squares: Squares, deviation_m: Values) -> Mask:
    """Return whether squares are no rougher than calm water or the waves in them.

    Without waves, what is mostly above the opened surface is an object; in waves, it may be a crest.
    """
    flat = squares.spread_m <= np.maximum(_ROUGH_M, _BAND_DEVIATIONS * deviation_m)
    return flat & ((squares.open_share >= _OPEN_SHARE) | (deviation_m > 0))


def bands_of(deviation_m: Values) -> Values:
    """Return how far squares of a region may be from its level, shape (N,)."""
    return np.maximum(_BAND_M, _BAND_DEVIATIONS * deviation_m)


def band_of(waves_m: float) -> float:
    """Return how far squares of a region may be from its level in waves of one deviation."""
    return max(_BAND_M, _BAND_DEVIATIONS * waves_m)


def waves_in(squares: Squares, own: NDArray[np.int64], deviation_m: Values) -> float:
    """Return the deviation of the waves in a region, no more than its elevations have: they may be beside it."""
    return min(
        float(np.median(deviation_m[own])),
        float(np.hypot(squares.level_m[own].std(), np.median(squares.spread_m[own]))),
    )


def connected(squares: Squares, own: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return the group of each of some squares; those that touch by side are one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    place = np.full(len(squares.index) + 1, -1)
    place[own] = np.arange(len(own))
    pairs = [(place[own], place[side[own]]) for side in squares.neighbor]
    one, other = (np.concatenate(ends) for ends in zip(*pairs, strict=True))
    both = other >= 0
    graph = coo_array((np.ones(both.sum(), np.bool_), (one[both], other[both])), shape=(len(own), len(own)))
    return np.asarray(connected_components(graph, directed=False)[1])


def beside(squares: Squares, own: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the squares of the tile that touch a region."""
    return np.setdiff1d(squares.neighbor[:, own], np.append(own, -1))


def are_joined(squares: Squares, own: NDArray[np.int64], beyond: NDArray[np.int64]) -> bool:
    """Return whether some squares that touch a region are one stretch along it."""
    along = np.intersect1d(own, squares.neighbor[:, beyond])
    return not connected(squares, np.union1d(along, beyond)).any()


def is_amid(squares: Squares, own: NDArray[np.int64], water: Mask, land: Mask) -> bool:
    """Return whether a region touches squares of water along half of its edge in the tile, and none of land."""
    beyond = beside(squares, own)
    return bool(np.count_nonzero(water[beyond]) >= _AMID_SHARE * len(beyond) and not land[beyond].any())


def edge_of(
    squares: Squares, own: NDArray[np.int64], high_m: float, low_m: float | Values, *, has_walls: bool
) -> tuple[NDArray[np.int64], Mask]:
    """Return the squares beyond the edge of a region, -1 for none, and whether water would run off there.

    What is above ``high_m`` holds it back; with ``has_walls``, also if it is in the square below ``low_m``, as a weir.
    The upper part of a slope does not hold back the lower.
    """
    last = len(squares.index)  # stands for a missing neighbour
    inside, open_way = np.zeros(last + 1, np.bool_), np.zeros(last + 1, np.bool_)
    inside[own] = True
    open_way[:last] = squares.top_m <= high_m
    falls = np.zeros((len(squares.neighbor), last + 1), np.bool_)  # from each side
    falls[:, :last] = squares.level_m < low_m
    if has_walls:
        falls[:, :last] &= np.tile(squares.sill_m <= high_m, (2, 1))
    side, column = np.nonzero(~inside[squares.neighbor[:, own]])
    start = own[column]
    beyond = squares.neighbor[side, start]
    further = squares.neighbor[:, beyond]
    falls_further = (np.take_along_axis(falls, further, 1) & ~inside[further]).any(axis=0)
    level = np.append(squares.level_m, np.nan)
    behind = squares.neighbor[(side + len(squares.neighbor) // 2) % len(squares.neighbor), start]
    is_slope = level[behind] - level[start] > (level[start] - level[beyond]) / 2
    is_slope &= squares.top_m[start] <= level[behind]
    return beyond, (open_way[start] | is_slope) & (falls[side, beyond] | (open_way[beyond] & falls_further))


def relief_of(squares: Squares, own: NDArray[np.int64]) -> Relief:
    """Return the relief of a region."""
    offset = squares.xy[:, own] - squares.xy[:, own].mean(axis=1, keepdims=True)
    level = squares.level_m[own] - squares.level_m[own].mean()
    slope = np.linalg.lstsq(offset.T, level, rcond=None)[0]
    plane = offset.T @ slope
    _, which, count = np.unique(squares.xy[:, own] // COARSE, axis=1, return_inverse=True, return_counts=True)
    mean = (np.bincount(which.reshape(-1), level - plane) / count)[count >= COARSE]
    steepness = float(np.hypot(*slope)) / squares.side_m
    inside = np.full(len(squares.index) + 1, np.nan)
    inside[own] = level
    steps = (inside[squares.neighbor[:2, own]] - level)[np.isfinite(inside[squares.neighbor[:2, own]])]
    step = 1.48 * float(np.median(np.abs(steps))) if len(steps) else 0.0
    return Relief(steepness, float(plane.std()), step / np.sqrt(2), float(mean.std()) if len(mean) > 1 else 0.0)


def is_even(squares: Squares, own: NDArray[np.int64], times: float = 1.0) -> bool:
    """Return whether a region is level, and its means over 64 cells deviate little compared with cells in squares.

    ``times`` is how many times as uneven it may be.
    """
    relief = relief_of(squares, own)
    allowed = _EVEN_SHARE * float(np.median(squares.spread_m[own]))
    return relief.bumps_m <= times * max(_EVEN_M, allowed) and relief.tilt_m <= times * max(_EVEN_TILT_M, allowed)


def is_widely_even(squares: Squares, own: NDArray[np.int64]) -> bool:
    """Return whether a region is even, and large enough to show it."""
    return len(own) >= COARSE**2 and is_even(squares, own)
