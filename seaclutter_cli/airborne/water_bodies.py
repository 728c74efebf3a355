"""Bodies of water of a tile, each with its level, and the land between them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.echoes import Echoes
from seaclutter_cli.airborne.reflection import (
    CLEARLY_GROUND,
    DIFFUSE,
    LIKE_GROUND,
    MIRROR_SHARE,
    SPECULAR,
    is_diffuse,
    median_of,
)
from seaclutter_cli.airborne.regions import (
    COARSE,
    band_of,
    bands_of,
    beside,
    edge_of,
    is_amid,
    is_even,
    level_regions,
    relief_of,
    waves_in,
)
from seaclutter_cli.airborne.squares import LEAST_SQUARES, Squares, SquareWaves, is_relief
from seaclutter_cli.airborne.terrain import SEVERAL, may_be_waves

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LOWER_SHARE, _HIGHER_SHARE = 0.1, 0.02
_CERTAIN = 100
_LARGEST, _LARGE, _SMALL = 0.5, 0.05, 0.02
_GROUND_M, _GROUND_SHARE = 0.2, 0.5
_CLEAR_SHARE = 0.8
_SHORT_WAVES = 0.7
_MEASURED_SHARE, _SEEN_SHARE, _HIGH_M = 0.3, 0.1, 0.15
_UNEVEN = 2.0
_STEP_M, _BUMPS_M, _TILT_M, _SLOPE, _RELIEF_M = 0.04, 0.05, 0.02, 0.001, 0.02


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
    regions at that level are water, too, unless they have two more signs of land and no waves that are as high, or do
    not touch it. A region of at most 2 % of the tile is a crest if it touches such bodies along half of its edge, and
    no land, and is no further from their level than the waves in all of them.

    If such bodies have several levels, as at a lock, only those with waves or as even as still water are water: means
    over 64 cells deviate by at most 1 cm, and a plane by 4 cm, or either by 0.45 times the spread within squares;
    ground undulates more over wide distances than over short ones. Beside an even body, one at the same level that is
    twice as uneven is ground. Waves must have been measured in three tenths of a body, or a tenth if their significant
    height is 0.6 m. Of these bodies, water must not run off along a tenth of the edge that is in the tile, unless they
    are half of it. Without any such body, the tile remains undecided and no region is returned, unless nearly all
    squares are in regions with two more signs of land, and without waves.

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
      are not joined; a region with ground at its level along half of its edge is a part of it (-2). Where water is
      dark, it varies less: a region of at most 2 % of the tile with more than 0.35, in waves, that touches water at its
      level along half of its edge, and no land, is a part of it.
    * A pulse has several echoes under trees, and one on water (-1). Nothing rises two metres and more in most squares
      of water, with a twentieth of their echoes (-1).
    * Waves move, and still water is level: squares that deviate by 2 cm, and do so alike in two strips, are land (-2),
      unless they reflect like a mirror: rapids stay where they are.

    Squares with trusted classes are regions of their own, which need no signs. Beside trusted water, another region
    needs two more signs of water.

    A part of a wave slopes like a field. A tile without any water is not known to be land, and no region is returned,
    if it is at most 100 m on each side or, without intensities, if most of it lies within 3 m; unless pulses have
    several echoes in a tenth of its squares, as at leaves and roofs.
    """
    bodies = _judged(squares, echoes, waves)
    dry = not any(body.is_water for body in bodies) and not echoes.known.any()
    return [] if dry and may_be_waves(squares, echoes) else bodies


def _judged(squares: Squares, echoes: Echoes, waves: SquareWaves) -> Sequence[WaterBody]:
    """Return the level regions of a tile, and whether each is water by its signs."""
    ground, free = echoes.variation <= LIKE_GROUND, echoes.known == 0
    kinds = free & ground, free & ~ground, echoes.known > 0, echoes.known < 0
    # The level of waves beside it does not divide what reflects like ground, such as a beach.
    off_ground = replace(waves, level_m=np.where(ground, squares.level_m, waves.level_m))
    regions = level_regions(squares, off_ground, kinds)
    mirrors = sum(len(own) for own in regions if median_of(echoes.variation[own]) >= SPECULAR)
    has_mirrors = mirrors > MIRROR_SHARE * len(squares.index)
    if free.all() and not has_mirrors:
        return _without_mirrors(squares, echoes, level_regions(squares, waves, kinds), waves)
    signs = _all_signs(squares, echoes, regions, waves, has_mirrors=has_mirrors)
    least = 2 if (echoes.known > 0).any() else 1
    half = _LARGEST * len(free)
    doubt = [least == 1 and len(own) >= half and not (has_mirrors and is_diffuse(echoes, own)) for own in regions]
    certain = signs >= np.where(doubt, 0, least)
    water = certain if certain.any() else signs >= 0
    return _bodies(squares, regions, water | _amid_waves(squares, echoes, regions, water, waves))


def _amid_waves(
    squares: Squares, echoes: Echoes, regions: Sequence[NDArray[np.int64]], water: Mask, waves: SquareWaves
) -> Mask:
    """Return which small regions are a part of the waves around them: at their level, and not clearly ground."""
    sea, land = (_squares_of(squares, regions, chosen) for chosen in (water, ~water))
    found = np.zeros(len(regions), np.bool_)
    for number, own in enumerate(regions):
        deviation_m = float(np.median(waves.deviation_m[own]))
        if water[number] or not deviation_m or len(own) > _SMALL * len(squares.index) or echoes.known[own[0]]:
            continue
        if is_amid(squares, own, sea, land) and not median_of(echoes.variation[own]) <= CLEARLY_GROUND:
            around = beside(squares, own)
            apart = np.median(squares.level_m[own]) - np.median(squares.level_m[around[sea[around]]])
            found[number] = abs(apart) <= band_of(deviation_m)
    return found


def _squares_of(squares: Squares, regions: Sequence[NDArray[np.int64]], chosen: Mask) -> Mask:
    """Return which squares are in the chosen regions."""
    inside = np.zeros(len(squares.index), np.bool_)
    for own, is_chosen in zip(regions, chosen, strict=True):
        inside[own] = is_chosen
    return inside


def _without_mirrors(
    squares: Squares, echoes: Echoes, regions: Sequence[NDArray[np.int64]], waves: SquareWaves
) -> Sequence[WaterBody]:
    """Return the bodies of water of a tile that does not reflect like a mirror; none if they are not known."""
    deviation_m = waves.deviation_m
    joined = level_regions(squares, waves, (np.ones(len(squares.index), np.bool_),))
    signs = _all_signs(squares, echoes, joined, waves, has_mirrors=False)
    size = np.array([len(own) for own in joined], np.int64)
    certain = signs >= np.where(size >= _LARGEST * len(squares.index), 0, 1)
    large = certain & (size > _LARGE * len(squares.index))
    level, band = _levels(squares, joined, deviation_m)
    basins = large & np.array([_is_basin(squares, own, waves) for own in joined], np.bool_)
    ground = large & ~basins & np.array([not is_even(squares, own, _UNEVEN) for own in joined], np.bool_)
    if _are_apart(level[large], band[large]):
        large = certain = basins
    elif basins.any():
        large, certain = large & ~ground, certain & ~ground
    if large.any():
        apart = np.abs(level[:, None] - level[large])
        at_level = (apart <= band[large]).any(axis=1)
        in_waves = np.array([np.median(deviation_m[own]) for own in joined])
        are_crests = (in_waves > 0) & (apart.min(axis=1) <= bands_of(in_waves))
        groups = bands_of(np.sqrt([np.mean(deviation_m[own] ** 2) for own in joined]))  # waves come in groups
        is_crest = (size <= _SMALL * len(squares.index)) & (apart <= groups[large]).any(axis=1)
        wet, dry = (_squares_of(squares, joined, chosen) for chosen in (large, ~(large | at_level)))
        is_crest &= [is_amid(squares, own, wet, dry) for own in joined]
        are_crests &= [bool(wet[beside(squares, own)].any()) for own in joined]
        return _bodies(squares, joined, certain | is_crest | (at_level & ~ground & ((signs > -2) | are_crests)))
    signs = _all_signs(squares, echoes, regions, waves, has_mirrors=False)
    clear = sum(len(own) for own, sign in zip(regions, signs, strict=True) if sign <= -2 and not deviation_m[own].any())
    if clear < _CLEAR_SHARE * sum(map(len, regions)):
        return []
    water = signs >= 1
    level, band = _levels(squares, regions, deviation_m)
    if _are_apart(level[water], band[water]):
        mirrors = [median_of(echoes.variation[own]) >= SPECULAR for own in regions]
        water &= np.array([_is_basin(squares, own, waves) for own in regions]) | mirrors
    return _bodies(squares, regions, water)


def _levels(squares: Squares, regions: Sequence[NDArray[np.int64]], deviation_m: Values) -> tuple[Values, Values]:
    """Return the level of each region, and how far squares of it may be from that."""
    level = np.array([np.median(squares.level_m[own]) for own in regions])
    return level, np.array([band_of(waves_in(squares, own, deviation_m)) for own in regions])


def _are_apart(level_m: Values, band_m: Values) -> bool:
    """Return whether regions have several levels."""
    return bool(len(level_m) and np.ptp(level_m) > band_m.max())


def _bodies(squares: Squares, regions: Sequence[NDArray[np.int64]], water: Mask) -> Sequence[WaterBody]:
    return [_body(squares, own, is_water=bool(is_water)) for own, is_water in zip(regions, water, strict=True)]


def _all_signs(
    squares: Squares, echoes: Echoes, regions: Sequence[NDArray[np.int64]], waves: SquareWaves, *, has_mirrors: bool
) -> NDArray[np.int64]:
    return np.array([_signs(squares, echoes, own, waves, has_mirrors=has_mirrors) for own in regions], np.int64)


def _is_basin(squares: Squares, own: NDArray[np.int64], waves: SquareWaves) -> bool:
    """Return whether a region looks like water, and is held back along its edge in the tile or is half of it."""
    level, band = float(np.median(squares.level_m[own])), band_of(waves_in(squares, own, waves.deviation_m))
    beyond, runs_off = edge_of(squares, own, level + band, level - band, has_walls=True)
    is_held = np.count_nonzero(runs_off) <= _LOWER_SHARE * np.count_nonzero(beyond >= 0)
    return (is_held or len(own) >= _LARGEST * len(squares.index)) and looks_like_water(squares, own, waves)


def looks_like_water(squares: Squares, own: NDArray[np.int64], waves: SquareWaves, least_m: float = 0.0) -> bool:
    """Return whether a region is as even over wide distances as over short ones, or has waves.

    ``least_m`` is the deviation that waves exceed.
    """
    deviation_m = float(np.median(waves.deviation_m[own]))
    least_share = _MEASURED_SHARE if deviation_m < _HIGH_M else _SEEN_SHARE
    has_waves = deviation_m > least_m and waves.measured[own].mean() > least_share
    return bool(has_waves or is_even(squares, own))


def _signs(squares: Squares, echoes: Echoes, own: NDArray[np.int64], around: SquareWaves, *, has_mirrors: bool) -> int:
    """Return the number of signs that a region is water, less those that it is land."""
    if known := int(echoes.known[own[0]]):
        return _CERTAIN * known
    level = float(np.median(squares.level_m[own]))
    waves = waves_in(squares, own, around.deviation_m)
    measured = own[around.measured[own]]  # waves are as high as the foot of a beach, which slopes
    variation, several = (median_of(values[own]) for values in (echoes.variation, echoes.several))
    in_waves = waves > 0 and len(measured) >= LEAST_SQUARES
    relief = relief_of(squares, measured if in_waves else own)
    is_flat = relief.step_m <= np.hypot(_STEP_M, waves) and relief.bumps_m <= np.hypot(_BUMPS_M, waves)
    has_short_waves = len(own) >= COARSE**2 and relief.step_m <= _SHORT_WAVES * np.median(squares.spread_m[own])
    is_flat |= has_short_waves and is_even(squares, own)
    is_mirror = variation >= SPECULAR
    band = band_of(waves)
    # What reflects like water around water may be its troughs.
    trough = np.where(has_mirrors & is_mirror & (echoes.variation >= SPECULAR), 2 * band, band)
    signs = _hollow(squares, own, level + band, level - trough, has_walls=is_flat) - (not is_flat)
    chance = 2 * relief.step_m * np.sqrt(2 / len(own)) if is_mirror else 0.0
    tilt_in_waves = max(np.hypot(_TILT_M, waves if is_mirror else waves / 2), chance)
    signs -= 2 * (relief.slope > _SLOPE and relief.tilt_m > tilt_in_waves)
    signs += int(is_mirror) - int(has_mirrors and variation <= DIFFUSE)
    signs -= 2 * (has_mirrors and _goes_on_as_ground(squares, echoes, own, level))
    signs -= several > SEVERAL
    signs -= median_of(echoes.tall[own]) > SEVERAL
    signs -= 2 * (not is_mirror and is_relief(squares, echoes.change_m, own, _RELIEF_M) is True)
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
    ground = np.append((echoes.variation <= LIKE_GROUND) & (np.abs(squares.level_m - level_m) <= _GROUND_M), False)
    return bool(np.count_nonzero(ground[beyond]) > _GROUND_SHARE * len(beyond))


def _hollow(squares: Squares, own: NDArray[np.int64], high_m: float, low_m: float | Values, *, has_walls: bool) -> int:
    """Return -2 if water would run off a region, over at most one square beyond it; 1 if it is in a hollow."""
    beyond, runs_off = edge_of(squares, own, high_m, low_m, has_walls=has_walls)
    if np.count_nonzero(runs_off) > _LOWER_SHARE * len(beyond):
        return -2
    higher = np.append(squares.top_m > high_m, False)[beyond]
    return int(np.count_nonzero(higher) > _HIGHER_SHARE * len(beyond))
