"""Bodies of water of a tile, each with its level, and the land between them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.echoes import Echoes
from seaclutter_cli.airborne.reflection import (
    CLEARLY_GROUND,
    LIKE_GROUND,
    MIRROR_SHARE,
    SAME_LEVEL_M,
    SPECULAR,
    is_diffuse,
    median_of,
)
from seaclutter_cli.airborne.regions import (
    band_of,
    bands_of,
    beside,
    is_amid,
    is_even,
    level_regions,
    waves_in,
)
from seaclutter_cli.airborne.signs import LARGEST, has_relief, is_basin, signs_of
from seaclutter_cli.airborne.squares import Squares, SquareWaves
from seaclutter_cli.airborne.terrain import may_be_waves

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LARGE, _SMALL = 0.05, 0.02
_CLEAR_SHARE, _KNOWN_SHARE = 0.8, 0.95
_UNEVEN, _HALF = 1.5, 0.5
_NORMAL_HALF = 1.35
"""Width that contains half of a normal distribution, in standard deviations."""
_ALIKE = np.log(1.2)


@dataclass(frozen=True)
class WaterBody:
    """Connected squares at one level.

    Parameters
    ----------
    squares : ndarray, shape (M,), int64
        The squares.
    level_m, deviation_m : float
        Their median level, or that of the waves whose crest or trough they are; and the median deviation of elevations
        in them.
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

    Signs of water and of land are added up (`signs_of`). A region needs more signs of water than of land; any if there
    is no other water, or one that covers half of the tile and does not reflect like ground, as many. A region of at
    most 2 % of the tile, or 5 % if it is at most 1.2 times as bright as the water, that touches water along half of its
    edge, and no land, is a part of it, unless it varies by less than 0.33, as ground does: at the edge of a strip, and
    near the holes below an aircraft, echoes are weak, and vary less than others. The level may differ by 3 cm, or as
    much as in the waves there. Other such regions beside it are no land, and may be parts of the water after it.

    If nothing in the tile reflects like a mirror, a body of water that covers a twentieth of the tile sets the level
    of all water: other regions at that level are water, too, unless they have two more signs of land and no waves that
    are as high, measured in half of it or in the water that it touches. A region of at most 2 % of the tile is a crest
    if it touches such bodies along half of its edge, and no land, and is no further from their level than the waves in
    all of them.

    If such bodies have several levels, as at a lock, only those with waves or as even as still water are water: means
    over 64 cells deviate by at most 1 cm, and a plane by 4 cm, or either by 0.45 times the spread within squares;
    ground undulates more over wide distances than over short ones. Beside an even body, one at the same level that is
    1.5 times as uneven is ground. Waves must have been measured in three tenths of a body; or a tenth if their
    significant height is 0.6 m, and squares deviate by a quarter of their deviation. Of these bodies, water must not
    run off along a tenth of the edge that is in the tile, or over more than a weir, unless they are half of it. Without
    any such body, the tile remains undecided and no region is returned, unless nearly all squares are in regions whose
    relief two strips show alike, or with two more signs of land and without waves. Those do not count if the relief is
    that of most squares. Half of a region with relief must not be twice as level as the whole: that may be water.

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
    has_mirrors = _have_mirrors(echoes, regions)
    if free.all() and not has_mirrors:
        return _without_mirrors(squares, echoes, level_regions(squares, waves, kinds), waves)
    signs = signs_of(squares, echoes, regions, waves, has_mirrors=has_mirrors)
    least = 2 if (echoes.known > 0).any() else 1
    half = LARGEST * len(free)
    doubt = [least == 1 and len(own) >= half and not (has_mirrors and is_diffuse(echoes, own)) for own in regions]
    certain = signs >= np.where(doubt, 0, least)
    water = certain if certain.any() else signs >= 0
    return _bodies(squares, regions, _with_amid(squares, echoes, regions, water, waves), waves)


def _have_mirrors(echoes: Echoes, regions: Sequence[NDArray[np.int64]]) -> bool:
    """Return whether enough regions reflect like a mirror: fewer suffice if all others are clearly ground."""
    size = np.array([len(own) for own in regions], np.int64)
    variation = np.array([median_of(echoes.variation[own]) for own in regions])
    mirrors, ground = (int(size[own].sum()) for own in (variation >= SPECULAR, variation <= CLEARLY_GROUND))
    least = _SMALL if mirrors + ground >= _KNOWN_SHARE * size.sum() else MIRROR_SHARE
    return mirrors > least * len(echoes.variation)


def _with_amid(
    squares: Squares, echoes: Echoes, regions: Sequence[NDArray[np.int64]], water: Mask, waves: SquareWaves
) -> Mask:
    """Return which regions are water, also the small ones amid it: at its level, and not clearly ground."""
    bright = median_of(echoes.brightness[_squares_of(squares, regions, water)]) + _ALIKE
    may_be = np.zeros(len(regions), np.bool_)
    for number, own in enumerate(regions):
        largest = (_LARGE if median_of(echoes.brightness[own]) < bright else _SMALL) * len(squares.index)
        is_ground = median_of(echoes.variation[own]) <= CLEARLY_GROUND
        may_be[number] = len(own) <= largest and not is_ground and not echoes.known[own[0]]
    while True:
        sea, found = _squares_of(squares, regions, water), may_be & ~water
        for number in np.flatnonzero(found).tolist():
            found[number] = _is_at_level(squares, regions[number], sea, waves)
        land = _squares_of(squares, regions, ~(water | found))
        for number in np.flatnonzero(found).tolist():
            found[number] = is_amid(squares, regions[number], sea, land)
        if not found.any():
            return water
        water = water | found


def _is_at_level(squares: Squares, own: NDArray[np.int64], sea: Mask, waves: SquareWaves) -> bool:
    """Return whether a region is at the level of the water beside it or, without any, of all that is."""
    around, deviation_m = beside(squares, own), float(np.median(waves.deviation_m[own]))
    around = around[sea[around]] if sea[around].any() else around
    apart = abs(np.median(squares.level_m[own]) - median_of(squares.level_m[around]))
    return bool(apart <= (band_of(deviation_m) if deviation_m else SAME_LEVEL_M))


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
    signs = signs_of(squares, echoes, joined, waves, has_mirrors=False)
    size = np.array([len(own) for own in joined], np.int64)
    certain = signs >= np.where(size >= LARGEST * len(squares.index), 0, 1)
    large = certain & (size > _LARGE * len(squares.index))
    level, band = _levels(squares, joined, deviation_m)
    basins, ground = large.copy(), np.zeros_like(large)
    for number in np.flatnonzero(large).tolist():
        basins[number] = is_basin(squares, joined[number], waves)
        ground[number] = not (basins[number] or is_even(squares, joined[number], _UNEVEN))
    if _are_apart(level[large], band[large]):
        large = certain = basins
    elif basins.any():
        large, certain = large & ~ground, certain & ~ground
    if large.any():
        same = _at_levels_of(squares, joined, large, waves, (level, band), signs)
        return _bodies(squares, joined, certain | (same & ~ground), waves)
    signs = signs_of(squares, echoes, regions, waves, has_mirrors=False)
    size = np.array([len(own) for own in regions], np.int64)
    stays = np.array(
        [has_relief(squares, echoes, own) and not _is_mostly_level(squares, own) for own in regions], np.bool_
    )
    still = np.array([not deviation_m[own].any() for own in regions], np.bool_)
    still |= size[stays].sum() > LARGEST * size.sum()  # what looks like waves elsewhere in such a tile is relief, too
    if size[stays | (still & (signs <= -2))].sum() < _CLEAR_SHARE * size.sum():
        return []
    water = signs >= 1
    level, band = _levels(squares, regions, deviation_m)
    if _are_apart(level[water], band[water]):
        for number in np.flatnonzero(water).tolist():
            is_mirror = median_of(echoes.variation[regions[number]]) >= SPECULAR
            water[number] = is_mirror or is_basin(squares, regions[number], waves)
    return _bodies(squares, regions, water, waves)


def _is_mostly_level(squares: Squares, own: NDArray[np.int64]) -> bool:
    """Return whether half of a region is twice as level as its deviation: still water beside a flat, not a field."""
    level = np.sort(squares.level_m[own])
    half = len(level) // 2
    low, high = np.quantile(level, (0.1587, 0.8413))
    width, deviation = (level[half:] - level[: len(level) - half]).min(), (high - low) / 2
    return bool(width < _NORMAL_HALF * deviation / 2)


def _at_levels_of(
    squares: Squares,
    regions: Sequence[NDArray[np.int64]],
    large: Mask,
    waves: SquareWaves,
    levels: tuple[Values, Values],
    signs: NDArray[np.int64],
) -> Mask:
    """Return which regions are at the level of large bodies of water, and may be water, too, or are crests of it."""
    level, band = levels
    apart = np.abs(level[:, None] - level[large])
    at_level = (apart <= band[large]).any(axis=1)
    wet, dry = (_squares_of(squares, regions, chosen) for chosen in (large, ~(large | at_level)))
    in_waves = np.array([np.median(waves.deviation_m[own]) for own in regions])
    follows = (in_waves > 0) & (apart.min(axis=1) <= bands_of(in_waves))
    follows &= [waves.measured[own].mean() > _HALF or bool(wet[beside(squares, own)].any()) for own in regions]
    groups = bands_of(np.sqrt([np.mean(waves.deviation_m[own] ** 2) for own in regions]))  # waves come in groups
    size = np.array([len(own) for own in regions])
    is_crest = (size <= _SMALL * len(squares.index)) & (apart <= groups[large]).any(axis=1)
    is_crest &= [is_amid(squares, own, wet, dry) for own in regions]
    return np.asarray(is_crest | (at_level & ((signs > -2) | follows)))


def _levels(squares: Squares, regions: Sequence[NDArray[np.int64]], deviation_m: Values) -> tuple[Values, Values]:
    """Return the level of each region, and how far squares of it may be from that."""
    level = np.array([np.median(squares.level_m[own]) for own in regions])
    return level, np.array([band_of(waves_in(squares, own, deviation_m)) for own in regions])


def _are_apart(level_m: Values, band_m: Values) -> bool:
    """Return whether regions have several levels."""
    return bool(len(level_m) and np.ptp(level_m) > band_m.max())


def _bodies(
    squares: Squares, regions: Sequence[NDArray[np.int64]], water: Mask, waves: SquareWaves
) -> Sequence[WaterBody]:
    """Return regions as bodies; crests and troughs have the level of the waves in them.

    They are small and amid water; a trough may be large if the waves were measured in most of it. What is higher may be
    the foot of a beach.
    """
    sea, land = (_squares_of(squares, regions, chosen) for chosen in (water, ~water))
    bodies = []
    for own, is_water in zip(regions, water, strict=True):
        level, spread = (float(np.median(values[own])) for values in (squares.level_m, squares.spread_m))
        is_amid_water = len(own) <= _SMALL * len(squares.index) and is_amid(squares, own, sea, land)
        of_waves = float(np.median(waves.level_m[own]))
        is_trough = level < of_waves and waves.measured[own].mean() > _HALF
        if np.median(waves.deviation_m[own]) > 0 and (is_amid_water or is_trough):
            level = of_waves
        bodies.append(WaterBody(own, level, spread, bool(is_water)))
    return bodies
