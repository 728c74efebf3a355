"""How squares reflect: water like a mirror, ground in all directions."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.echoes import Echoes
from seaclutter_cli.airborne.quantiles import quantile_of_each
from seaclutter_cli.airborne.regions import connected
from seaclutter_cli.airborne.squares import LEAST_SQUARES, Squares

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

SPECULAR, DIFFUSE = 0.6, 0.45
"""Coefficients of variation of neighbouring intensities: at least that of a mirror, and at most that of ground."""
LIKE_GROUND = (SPECULAR + DIFFUSE) / 2
"""Coefficient of variation that divides the two kinds."""
CLEARLY_GROUND = 0.33
"""Coefficient of variation up to which a small region is ground, whatever is around it."""
SAME_LEVEL_M = 0.03
"""Difference between the levels of one still surface."""
MIRROR_SHARE = 0.05
"""Share of the squares that reflect like a mirror in tiles whose intensities tell water from land."""

_GROUND_SHARE = 0.02
_ALIKE_BETWEEN, _ALIKE_WITHIN = 1.5, 1.25
_WAVES_M, _NEAR_IN_WAVES, _ALIKE_IN_WAVES = 0.1, 0.75, 1.75
_APART, _LEAST_RATIO, _TWICE, _HARDLY_LESS = 4.0, np.log(1.5), np.log(2.0), np.log(1.25)
_STEP_M, _STEPS, _PURE = 0.03, 1.5, 0.3
_WATER_SHARE = 0.5


def is_diffuse(echoes: Echoes, own: NDArray[np.int64]) -> bool:
    """Return whether some squares reflect like ground."""
    return median_of(echoes.variation[own]) <= DIFFUSE


def median_of(values: Values) -> float:
    """Return the median of the finite values, or NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def comparable_echoes(squares: Squares, echoes: Echoes, flat: Mask, band_m: Values) -> Echoes:
    """Return echoes whose variation is unknown if it differs on one and the same surface.

    Parameters
    ----------
    squares : Squares
        The N squares of a tile.
    echoes : Echoes
        Their echoes.
    flat : ndarray, shape (N,), bool
        Squares that may be water.
    band_m : ndarray, shape (N,), float64
        How far they may be from its level.

    Notes
    -----
    Where a sensor records roots or logarithms, one part of the water reflects like a mirror and another like ground.
    Ground at the level of water has other elevations, or another roughness. If a twentieth of the flat squares at the
    level of the mirrors are mirrors, and a fiftieth are like ground, the two kinds are compared. They are one surface
    if their median levels are within 3 cm or one standard deviation, and their deviations between and within squares
    are similar. In waves, of which squares of several strips contain more than one moment, levels within three quarters
    of the deviation between squares suffice if that is at least 10 cm, and the same within a factor of 1.75. The
    intensities of such a tile do not distinguish water from land.
    """
    mirror = flat & (echoes.variation >= SPECULAR)
    if not mirror.any():
        return echoes
    near = flat & (np.abs(squares.level_m - np.median(squares.level_m[mirror])) <= band_m)
    ground, mirror = near & (echoes.variation <= LIKE_GROUND), near & mirror
    counts = np.count_nonzero(ground), np.count_nonzero(mirror)
    if (counts < LEAST_SQUARES + np.count_nonzero(near) * np.array([_GROUND_SHARE, MIRROR_SHARE])).any():
        return echoes
    level, between, within = _elevations(squares, ground)
    other_level, other_between, other_within = _elevations(squares, mirror)
    apart = abs(level - other_level)
    waves = min(between, other_between)
    differ = _ratio(np.hypot(between, SAME_LEVEL_M), np.hypot(other_between, SAME_LEVEL_M))
    is_one = waves >= _WAVES_M and apart <= _NEAR_IN_WAVES * waves and differ <= _ALIKE_IN_WAVES
    is_one |= (
        apart <= max(SAME_LEVEL_M, np.hypot(other_between, other_within))
        and differ <= _ALIKE_BETWEEN
        and _ratio(within, other_within) <= _ALIKE_WITHIN
    )
    return replace(echoes, variation=np.full(len(flat), np.nan)) if is_one else echoes


def are_foam(echoes: Echoes) -> Mask:
    """Return which squares move, are bright, and do not reflect like a mirror, as most water does.

    The foam of breakers and surf scatters light in all directions, as sand does. It is brighter than most water.
    """
    mirrors = echoes.variation >= SPECULAR
    if np.count_nonzero(mirrors) <= MIRROR_SHARE * np.count_nonzero(np.isfinite(echoes.variation)):
        return np.zeros_like(mirrors)
    bright = echoes.brightness > median_of(echoes.brightness[mirrors])
    return np.asarray(echoes.moving & (echoes.variation < SPECULAR) & bright)


def by_contrast(squares: Squares, echoes: Echoes) -> Echoes | None:
    """Return echoes whose variation is that of a mirror on water and that of ground elsewhere, by their contrast.

    None if neither the brightness of the N squares nor their variation distinguishes water from land, or reflections
    like those of a mirror do. Squares along the edge that contain both have one between the two.

    Notes
    -----
    Water that does not reflect like a mirror is dark: it absorbs infrared light. Where a sensor records roots or
    logarithms, its echoes vary less than those of a mirror, but at least twice as much as those of ground. The
    logarithms of the brightness, or else of the variation, form two kinds if their means are further apart than those
    of any even distribution. Dark regions are water if what is just beyond three quarters of their edge is higher than
    dark squares differ: a quay, a bank, a dike. They must be most of what is dark. A dark road, even beside a dike, has
    no such steps, and is ground. Nor has one surface of two kinds, as of strips with different gains, and bright water
    beside dark ground is lower.
    """
    if np.count_nonzero(echoes.variation >= SPECULAR) > MIRROR_SHARE * len(squares.index):
        return None
    steadiness = -np.log(np.where(echoes.variation > 0, echoes.variation, np.nan))
    return _divided(squares, echoes, echoes.brightness, _LEAST_RATIO, np.inf) or _divided(
        squares, echoes, steadiness, _TWICE, _HARDLY_LESS
    )


def _divided(
    squares: Squares, echoes: Echoes, brightness: Values, least_apart: float, most_apart: float
) -> Echoes | None:
    """Return the variation of two kinds of squares by a logarithm that is lower on water; None if they are not two.

    The kinds are ``least_apart``. What is ``most_apart`` from the dark ones may contain both: a few echoes from water
    make most of the variation of a square.
    """
    known = np.isfinite(brightness)
    limit = _limit_between(brightness[known], least_apart)
    bright = known & (brightness > limit)
    if not bright.any():
        return None
    dark = known & ~bright
    rise = _rise_around(squares, dark, dark & (brightness <= np.median(brightness[dark]) + most_apart))
    water, ground = rise > 0, bright | (rise <= 0)
    if not water.any() or np.count_nonzero(water) < _WATER_SHARE * np.count_nonzero(dark):
        return None
    mean = np.exp(brightness)
    low, high = float(np.median(mean[water])), float(np.median(mean[bright]))
    share = (mean - low) / (high - low)
    mixed = (share > _PURE) & (share < 1 - _PURE) & ((water & _beside(squares, bright)) | _beside(squares, water))
    variation = np.select([mixed, water, ground], [(SPECULAR + LIKE_GROUND) / 2, SPECULAR, DIFFUSE], np.nan)
    return replace(echoes, variation=variation)


def _beside(squares: Squares, own: Mask) -> Mask:
    """Return the squares that touch some others by a side."""
    return np.asarray(np.append(own, False)[squares.neighbor].any(axis=0))


def _limit_between(values: Values, least_apart: float) -> float:
    """Return the value between two kinds, those of Otsu; infinity if there is only one, or one has few."""
    ordered, number = np.sort(values), len(values)
    least = int(MIRROR_SHARE * number) + LEAST_SQUARES
    below = np.arange(least, number - least)
    if not len(below):
        return np.inf
    total, power = (np.concatenate(([0.0], np.cumsum(part))) for part in (ordered, ordered**2))
    low, high = total[below] / below, (total[-1] - total[below]) / (number - below)
    within = power[-1] - below * low**2 - (number - below) * high**2
    at = int(np.argmin(within))
    apart = high[at] - low[at]
    if apart < max(least_apart, _APART * np.sqrt(max(within[at], 0) / number)):
        return np.inf
    return float(ordered[below[at] - 1] + ordered[below[at]]) / 2


def _rise_around(squares: Squares, dark: Mask, pure: Mask) -> Values:
    """Return by how much three quarters of the edge of each dark region are higher than its squares differ.

    The edge is that of its ``pure`` squares. NaN for squares that are not dark, and for regions with a short edge.
    """
    region = np.full(len(dark), -1)
    region[dark] = connected(squares, np.flatnonzero(dark))
    number = int(region.max(initial=-1)) + 1
    edge, step = _steps(squares, pure, ~pure)
    inner, within = _steps(squares, pure, pure)
    rise = quantile_of_each(step, region[edge], number, 0.25, LEAST_SQUARES)
    differ = np.nan_to_num(quantile_of_each(np.abs(within), region[inner], number, 0.5))
    return np.asarray(np.append(rise - _STEP_M - _STEPS * differ, np.nan)[region])


def _steps(squares: Squares, own: Mask, beyond: Mask) -> tuple[NDArray[np.int64], Values]:
    """Return some squares, and by how much the second from each is higher, if both on the way are of another kind.

    The first may be a mixture of both.
    """
    start = np.flatnonzero(own)
    first = squares.neighbor[:, start]
    second = np.take_along_axis(squares.neighbor, first, axis=1)
    kind = np.append(beyond, False)
    side, at = np.nonzero((first >= 0) & kind[first] & kind[second])
    return start[at], squares.level_m[second[side, at]] - squares.level_m[start[at]]


def _elevations(squares: Squares, own: Mask) -> tuple[float, float, float]:
    """Return the median level of some squares, the deviation of their levels, and the median deviation in them."""
    lower, level, upper = np.quantile(squares.level_m[own], (0.1587, 0.5, 0.8413))
    return float(level), float(upper - lower) / 2, float(np.median(squares.spread_m[own]))


def _ratio(one: float, other: float) -> float:
    return max(one, other) / max(min(one, other), 1e-12)
