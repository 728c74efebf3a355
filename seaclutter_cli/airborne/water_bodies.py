"""Bodies of water of a tile, each with its level, and the land between them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.reflection import DIFFUSE, LIKE_GROUND, MIRROR_SHARE, SPECULAR, is_diffuse, median_of
from seaclutter_cli.airborne.squares import LEAST_SQUARES, Echoes, Squares, SquareWaves

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

_BAND_M, _BAND_DEVIATIONS, _LEVEL_DEVIATIONS = 0.2, 3.0, 1.0
_ROUGH_M = 0.15
_OPEN_SHARE = 0.5
_LOWER_SHARE, _HIGHER_SHARE = 0.1, 0.02
_SEVERAL = 0.05
_CERTAIN = 100
_COARSE = 8
_LARGEST, _LARGE, _SMALL, _GROUND_SHARE = 0.5, 0.05, 0.02, 0.5
_CLEAR_SHARE = 0.8
_WOODED_SHARE, _TREE_M, _LEAFY_SHARE = 0.5, 2.0, 0.1
LONG_WAVE_M = 100.0
"""Longer side of a tile that shows its waves; a smaller one may be a part of one wave."""
_WAVES_M, _HALF = 3.0, 0.5
_HILL_M, _FLAT_SHARE, _LEVEL_SHARE = 0.5, 0.05, 0.08
_EVEN_M, _EVEN_TILT_M, _EVEN_SHARE = 0.01, 0.04, 0.45
_SHORT_WAVES = 0.7
_MEASURED_SHARE = 0.3
_STEP_M, _BUMPS_M, _TILT_M, _SLOPE = 0.04, 0.05, 0.02, 0.001


@dataclass(frozen=True)
class WaterBody:
    """Connected squares at one level.

    Parameters
    ----------
    squares : ndarray, shape (M,), int64
        The squares.
    level_m, deviation_m : float
        Their median level, and the median deviation of elevations in them.
    is_water : bool
        Whether it is water, not land.
    """

    squares: NDArray[np.int64]
    level_m: float
    deviation_m: float
    is_water: bool


def find_bodies(squares: Squares, echoes: Echoes, waves: SquareWaves) -> Sequence[WaterBody]:
    r"""Return the level regions of a tile, and whether each is water.

    Parameters
    ----------
    squares : Squares
        The N squares of the tile.
    echoes : Echoes
        Their echoes.
    waves : SquareWaves
        Waves in each of them.

    Notes
    -----
    The most frequent level comes first, in waves that of their water, with all flat squares within 0.2 m of it, or
    three standard deviations of the waves, whose own level is within one; then that of the remaining squares, and so
    on. Connected squares are a region. Regions of fewer than six squares are left out: the opening takes what is that
    small for an object.

    Signs of water and of land are added up. A region needs more signs of water than of land; any if there is no other
    water, or one that covers half of the tile and does not reflect like ground, as many. If nothing in the tile
    reflects like a mirror, a body of water that covers a twentieth of the tile tells the level of all water: other
    regions at that level are water, too, unless they have two more signs of land and no waves that are as high. A
    region of at most 2 % of the tile that touches nothing but such bodies, and is no further from their level than the
    waves in all of them, is a crest. If such bodies have several levels, as at a lock, only those with waves or as even
    as still water are water: means over 64 cells deviate by at most 1 cm, and a plane by 4 cm, or either by 0.45 times
    the spread within squares; ground undulates more over wide distances than over short ones. Of these, water must not
    run off along a tenth of the edge that is in the tile, unless they are half of it. Without any such body, the tile
    remains undecided and no region is returned, unless nearly all squares are in regions with two more signs of land,
    and without waves.

    * Water lies in a hollow: something along its edge is higher (+1). Land is a region from which water would run off
      along a tenth of its edge (-2): a slope, a bank, a field above a ditch. What is higher holds it back, and if the
      region is flat, a wall in the lower square does, too, as that of a weir.
    * Still water is level. A plane through a slope or a river falls by more than one in a thousand (-2); for a
      region like a mirror, by more than chance makes of the differences between its squares, or the waves do. Wind
      and strips that do not match cause less. In waves, only squares count in which these were measured: the foot of a
      beach is no higher than they are.
    * Water is flat. Neighbouring squares that differ by more than 4 cm, or means over 64 cells by more than 5 cm,
      beyond what waves explain, are a sign of land (-1). Short waves are not: the squares of an even region of 64 or
      more may differ by 0.7 times their spread.
    * Water reflects like a mirror, and an echo depends on the facet that it met: a coefficient of variation of at least
      0.6 among neighbouring intensities (+1; the speckle of many facets has 0.7 and more). Ground scatters light in all
      directions: 0.45 at most (-1, if a twentieth of the tile does reflect like a mirror). Squares of ground and others
      are not joined; a region with ground at its level along half of its edge is a part of it (-2).
    * A pulse has several echoes under trees, and one on water (-1).

    Squares with trusted classes are regions of their own, which need no signs. Beside trusted water, another region
    needs two more signs of water.

    A part of a wave slopes like a field. A tile without any water is not known to be land, and no region is returned,
    if it is at most 100 m on each side or, without intensities, if most of it lies within 3 m; unless pulses have
    several echoes in a tenth of its squares, as at leaves and roofs.
    """
    bodies = _judged(squares, echoes, waves)
    dry = not any(body.is_water for body in bodies) and not echoes.known.any()
    return [] if dry and _may_be_waves(squares, echoes) else bodies


def _judged(squares: Squares, echoes: Echoes, waves: SquareWaves) -> Sequence[WaterBody]:
    """Return the level regions of a tile, and whether each is water by its signs."""
    ground, free = echoes.variation <= LIKE_GROUND, echoes.known == 0
    kinds = free & ground, free & ~ground, echoes.known > 0, echoes.known < 0
    # The level of waves beside it does not divide what reflects like ground, such as a beach.
    off_ground = replace(waves, level_m=np.where(ground, squares.level_m, waves.level_m))
    regions = _all_regions(squares, off_ground, kinds)
    mirrors = sum(len(own) for own in regions if median_of(echoes.variation[own]) >= SPECULAR)
    has_mirrors = mirrors > MIRROR_SHARE * len(squares.index)
    if free.all() and not has_mirrors:
        return _without_mirrors(squares, echoes, _all_regions(squares, waves, kinds), waves)
    signs = _all_signs(squares, echoes, regions, waves, has_mirrors=has_mirrors)
    least = 2 if (echoes.known > 0).any() else 1
    half = _LARGEST * len(free)
    doubt = [least == 1 and len(own) >= half and not (has_mirrors and is_diffuse(echoes, own)) for own in regions]
    certain = signs >= np.where(doubt, 0, least)
    return _bodies(squares, regions, certain if certain.any() else signs >= 0)


def _without_mirrors(
    squares: Squares, echoes: Echoes, regions: Sequence[NDArray[np.int64]], waves: SquareWaves
) -> Sequence[WaterBody]:
    """Return the bodies of water of a tile that does not reflect like a mirror; none if they are not known."""
    deviation_m = waves.deviation_m
    joined = _all_regions(squares, waves, (np.ones(len(squares.index), np.bool_),))
    signs = _all_signs(squares, echoes, joined, waves, has_mirrors=False)
    size = np.array([len(own) for own in joined], np.int64)
    certain = signs >= np.where(size >= _LARGEST * len(squares.index), 0, 1)
    large = certain & (size > _LARGE * len(squares.index))
    level = np.array([np.median(squares.level_m[own]) for own in joined])
    band = np.array([_band(_waves_in(squares, own, deviation_m)) for own in joined])
    if large.any() and np.ptp(level[large]) > band[large].max():
        large &= [_is_basin(squares, own, waves) for own in joined]
        certain = large
    if large.any():
        apart = np.abs(level[:, None] - level[large])
        at_level = (apart <= band[large]).any(axis=1)
        in_waves = np.array([np.median(deviation_m[own]) for own in joined])
        are_crests = (in_waves > 0) & (apart.min(axis=1) <= bands_of(in_waves))
        groups = bands_of(np.sqrt([np.mean(deviation_m[own] ** 2) for own in joined]))  # waves come in groups
        sea = np.concatenate([own for own, is_large in zip(joined, large, strict=True) if is_large])
        is_crest = (size <= _SMALL * len(squares.index)) & (apart <= groups[large]).any(axis=1)
        is_crest &= [_is_amid(squares, own, sea) for own in joined]
        return _bodies(squares, joined, certain | is_crest | (at_level & ((signs > -2) | are_crests)))
    signs = _all_signs(squares, echoes, regions, waves, has_mirrors=False)
    clear = sum(len(own) for own, sign in zip(regions, signs, strict=True) if sign <= -2 and not deviation_m[own].any())
    if clear < _CLEAR_SHARE * sum(map(len, regions)):
        return []
    return _bodies(squares, regions, signs >= 1)


def _is_amid(squares: Squares, own: NDArray[np.int64], others: NDArray[np.int64]) -> bool:
    """Return whether all that touches a region, within the tile, is among some other squares."""
    apart, chosen = np.ones(len(squares.index) + 1, np.bool_), np.zeros(len(squares.index) + 1, np.bool_)
    apart[own] = apart[-1] = False
    chosen[others] = True
    beyond = squares.neighbor[:, own]
    return bool(chosen[beyond[apart[beyond]]].all())


def _bodies(squares: Squares, regions: Sequence[NDArray[np.int64]], water: Mask) -> Sequence[WaterBody]:
    return [_body(squares, own, is_water=bool(is_water)) for own, is_water in zip(regions, water, strict=True)]


def _all_signs(
    squares: Squares, echoes: Echoes, regions: Sequence[NDArray[np.int64]], waves: SquareWaves, *, has_mirrors: bool
) -> NDArray[np.int64]:
    return np.array([_signs(squares, echoes, own, waves, has_mirrors=has_mirrors) for own in regions], np.int64)


def _is_basin(squares: Squares, own: NDArray[np.int64], waves: SquareWaves) -> bool:
    """Return whether a region looks like water, and is held back along its edge in the tile or is half of it."""
    level, band = float(np.median(squares.level_m[own])), _band(_waves_in(squares, own, waves.deviation_m))
    beyond, runs_off = _edge(squares, own, level + band, level - band, has_walls=True)
    is_held = np.count_nonzero(runs_off) <= _LOWER_SHARE * np.count_nonzero(beyond >= 0)
    return (is_held or len(own) >= _LARGEST * len(squares.index)) and looks_like_water(squares, own, waves)


def looks_like_water(squares: Squares, own: NDArray[np.int64], waves: SquareWaves, least_m: float = 0.0) -> bool:
    """Return whether a region is as even over wide distances as over short ones, or has waves.

    ``least_m`` is the deviation that waves exceed.
    """
    has_waves = np.median(waves.deviation_m[own]) > least_m and waves.measured[own].mean() > _MEASURED_SHARE
    return bool(has_waves or _is_even(squares, own))


def _is_even(squares: Squares, own: NDArray[np.int64]) -> bool:
    """Return whether a region is level, and its means over 64 cells deviate little compared with cells in squares."""
    _, tilt, _, bumps = _unevenness(squares, own)
    allowed = _EVEN_SHARE * float(np.median(squares.spread_m[own]))
    return bumps <= max(_EVEN_M, allowed) and tilt <= max(_EVEN_TILT_M, allowed)


def _all_regions(squares: Squares, waves: SquareWaves, kinds: Sequence[Mask]) -> Sequence[NDArray[np.int64]]:
    """Return the regions of several kinds of squares, which are not joined; the largest comes first."""
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
    """Return whether squares are no rougher than calm water or the waves in them."""
    flat = squares.spread_m <= np.maximum(_ROUGH_M, _BAND_DEVIATIONS * deviation_m)
    return flat & (squares.open_share >= _OPEN_SHARE)


def are_hills(squares: Squares, deviation_m: Values) -> bool:
    """Return whether a tile is without any water: next to nothing is flat, and no level is frequent."""
    few = np.count_nonzero(are_flat(squares, deviation_m)) < _FLAT_SHARE * len(squares.index)
    return bool(few and _most_within(squares, _HILL_M) < _LEVEL_SHARE)


def without_woods(squares: Squares, echoes: Echoes, waves: SquareWaves) -> SquareWaves:
    """Return the waves, or none if most squares of them are woods: ground below trees may undulate like water."""
    if are_woods(squares, echoes, waves.deviation_m > 0):
        none = np.zeros_like(waves.deviation_m)
        return SquareWaves(squares.level_m, none, none > 0)
    return waves


def are_woods(squares: Squares, echoes: Echoes, own: Mask) -> bool:
    """Return whether some squares are woods or a town.

    Pulses have several echoes in most of them, and in most of these, something rises more than two metres.
    """
    leafy = own & (echoes.several > _SEVERAL)
    many = np.count_nonzero(leafy) > _WOODED_SHARE * np.count_nonzero(own)
    return bool(many and np.median(squares.top_m[leafy] - squares.level_m[leafy]) > _TREE_M)


def _may_be_waves(squares: Squares, echoes: Echoes) -> bool:
    """Return whether a tile without water may be of waves that are too long for it, with next to no leaves or roofs.

    This holds for small tiles and, without intensities, for tiles that are mostly no higher than waves.
    """
    if not len(squares.index):
        return False
    few = np.count_nonzero(echoes.several > _SEVERAL) <= _LEAFY_SHARE * len(squares.index)
    small = np.ptp(squares.xy, axis=1).max() * squares.side_m < LONG_WAVE_M
    unknown = not np.isfinite(echoes.variation).any()
    return bool(few and (small or (unknown and _most_within(squares, _WAVES_M) > _HALF)))


def _most_within(squares: Squares, height_m: float) -> float:
    """Return the share of the squares whose levels are in the one step of this height that contains the most."""
    level = np.sort(squares.level_m)
    near = np.searchsorted(level, level + height_m) - np.arange(len(level))
    return float(near.max(initial=0) / max(len(level), 1))


def bands_of(deviation_m: Values) -> Values:
    """Return how far squares of a region may be from its level, shape (N,)."""
    return np.maximum(_BAND_M, _BAND_DEVIATIONS * deviation_m)


def _band(waves_m: float) -> float:
    return max(_BAND_M, _BAND_DEVIATIONS * waves_m)


def _waves_in(squares: Squares, own: NDArray[np.int64], deviation_m: Values) -> float:
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


def _signs(squares: Squares, echoes: Echoes, own: NDArray[np.int64], around: SquareWaves, *, has_mirrors: bool) -> int:
    """Return the number of signs that a region is water, less those that it is land."""
    if known := int(echoes.known[own[0]]):
        return _CERTAIN * known
    level = float(np.median(squares.level_m[own]))
    waves = _waves_in(squares, own, around.deviation_m)
    measured = own[around.measured[own]]  # waves are as high as the foot of a beach, which slopes
    variation, several = (median_of(values[own]) for values in (echoes.variation, echoes.several))
    in_waves = waves > 0 and len(measured) >= LEAST_SQUARES
    slope, tilt, step, bumps = _unevenness(squares, measured if in_waves else own)
    is_even = step <= np.hypot(_STEP_M, waves) and bumps <= np.hypot(_BUMPS_M, waves)
    has_short_waves = len(own) >= _COARSE**2 and step <= _SHORT_WAVES * np.median(squares.spread_m[own])
    is_even |= has_short_waves and _is_even(squares, own)
    is_mirror = variation >= SPECULAR
    band = _band(waves)
    # What reflects like water around water may be its troughs.
    trough = np.where(has_mirrors & is_mirror & (echoes.variation >= SPECULAR), 2 * band, band)
    signs = _hollow(squares, own, level + band, level - trough, has_walls=is_even) - (not is_even)
    chance = 2 * step * np.sqrt(2 / len(own)) if is_mirror else 0.0
    signs -= 2 * (slope > _SLOPE and tilt > max(np.hypot(_TILT_M, waves if is_mirror else waves / 2), chance))
    signs += int(is_mirror) - int(has_mirrors and variation <= DIFFUSE)
    signs -= 2 * (has_mirrors and _goes_on_as_ground(squares, echoes, own, level))
    signs -= several > _SEVERAL
    return int(signs)


def _body(squares: Squares, own: NDArray[np.int64], *, is_water: bool) -> WaterBody:
    level, spread = (float(np.median(values[own])) for values in (squares.level_m, squares.spread_m))
    return WaterBody(own, level, spread, is_water)


def _goes_on_as_ground(squares: Squares, echoes: Echoes, own: NDArray[np.int64], level_m: float) -> bool:
    """Return whether half of the edge of a region touches ground at its level."""
    inside = np.zeros(len(squares.index) + 1, np.bool_)
    inside[own] = True
    beyond = squares.neighbor[:, own]
    beyond = beyond[~inside[beyond]]
    ground = np.append((echoes.variation <= LIKE_GROUND) & (np.abs(squares.level_m - level_m) <= _BAND_M), False)
    return bool(np.count_nonzero(ground[beyond]) > _GROUND_SHARE * len(beyond))


def _hollow(squares: Squares, own: NDArray[np.int64], high_m: float, low_m: float | Values, *, has_walls: bool) -> int:
    """Return -2 if water would run off a region, over at most one square beyond it; 1 if it is in a hollow."""
    beyond, runs_off = _edge(squares, own, high_m, low_m, has_walls=has_walls)
    if np.count_nonzero(runs_off) > _LOWER_SHARE * len(beyond):
        return -2
    higher = np.append(squares.top_m > high_m, False)[beyond]
    return int(np.count_nonzero(higher) > _HIGHER_SHARE * len(beyond))


def _edge(
    squares: Squares, own: NDArray[np.int64], high_m: float, low_m: float | Values, *, has_walls: bool
) -> tuple[NDArray[np.int64], Mask]:
    """Return the squares beyond the edge of a region, -1 for none, and whether water would run off there.

    What is above ``high_m`` holds it back; with ``has_walls``, also if it is in the square below ``low_m``, as a weir.
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
    return beyond, open_way[start] & (falls[side, beyond] | (open_way[beyond] & falls_further))


def _unevenness(squares: Squares, own: NDArray[np.int64]) -> tuple[float, float, float, float]:
    """Return the slope of a plane through a region, and its standard deviation; that of steps and of wide means."""
    offset = squares.xy[:, own] - squares.xy[:, own].mean(axis=1, keepdims=True)
    level = squares.level_m[own] - squares.level_m[own].mean()
    slope = np.linalg.lstsq(offset.T, level, rcond=None)[0]
    plane = offset.T @ slope
    _, which, count = np.unique(squares.xy[:, own] // _COARSE, axis=1, return_inverse=True, return_counts=True)
    mean = (np.bincount(which.reshape(-1), level - plane) / count)[count >= _COARSE]
    steepness = float(np.hypot(*slope)) / squares.side_m
    inside = np.full(len(squares.index) + 1, np.nan)
    inside[own] = level
    steps = (inside[squares.neighbor[:2, own]] - level)[np.isfinite(inside[squares.neighbor[:2, own]])]
    step = 1.48 * float(np.median(np.abs(steps))) if len(steps) else 0.0
    return steepness, float(plane.std()), step / np.sqrt(2), float(mean.std()) if len(mean) > 1 else 0.0
