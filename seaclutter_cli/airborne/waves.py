"""Waves of a tile: their height and length, part by part, from the lowest echo of each cell."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.looks import Look
from seaclutter_cli.airborne.nearest import nearest
from seaclutter_cli.airborne.part_waves import PART_CELLS, PartWaves, part_waves
from seaclutter_cli.airborne.quarters import local_waves, quarters

Cells = NDArray[np.float64]

_MAX_STEP_M = 2.0
_MIN_SHARE = 0.5
_ROUGHEST_PARTS = 0.75
_OTHER_LEVEL = 2.0
_SAME_LEVEL_M, _LEAST_SHARE = 0.2, 0.1
_HIGHEST, _SHOWN_LENGTHS = 1.25, 2.0


@dataclass(frozen=True)
class Waves:
    """Waves of a tile: medians over the parts of its roughest water, weighted by their cells.

    Parameters
    ----------
    parts : sequence of PartWaves
        Waves in each part that looks like sea, at any level.
    level_m, deviation_m, length_m : float
        Level of the water, standard deviation of its elevation, and length of the highest waves.
    crest_m : float
        Height of the crests above the opened surface that a quarter of the sea exceeds.
    """

    parts: Sequence[PartWaves]
    level_m: float
    deviation_m: float
    length_m: float
    crest_m: float

    @property
    def height_m(self) -> float:
        """Significant wave height: four standard deviations of the elevation."""
        return 4 * self.deviation_m

    @property
    def highest_m(self) -> float:
        """Height that the highest crests may reach above the opened surface.

        It lies in the troughs of short waves, and follows the longest swell. Between these, and where strips show the
        water at two moments, the highest crests rise above it by a little more than the significant height.
        """
        return max(self.crest_m, _HIGHEST * self.height_m)


def local_levels(look: Look, waves: Waves) -> tuple[Cells, Cells]:
    """Return the level and the deviation of the nearest waves at each cell, both of shape (S, 256, 256).

    Basins on both sides of a lock or weir have waves at two levels. A level differs from that of the tile from two
    standard deviations on. Still water belongs to a basin if there are waves at its level. The deviation is not less
    than that of the tile. Swell comes in groups, of which a quarter may show less than two lengths: near the end of a
    quarter, it may be as high as in the next one.
    """
    levels, deviations = (np.full(look.lowest.shape, value) for value in (waves.level_m, waves.deviation_m))
    found = local_waves([look])
    level, deviation, length = (
        np.array([(part.level_m, part.deviation_m, part.length_m) for part in found.parts]).reshape(-1, 3).T
    )
    oscillating = level[[part.is_sea for part in found.parts]]
    wet = (np.abs(level[:, None] - oscillating) <= _SAME_LEVEL_M).any(axis=1)
    if not wet.any():
        return levels, deviations
    centers, level, deviation = found.centers[:, wet], level[wet], deviation[wet]
    is_swell = length[wet] > PART_CELLS * look.grid.cell_m / _SHOWN_LENGTHS
    for block, slot in look.grid.blocks.items():
        for corner in np.ndindex(2, 2):
            center = PART_CELLS * (2 * np.array(block)[:, None] + np.array(corner)[:, None] + 0.5)
            closest = nearest(centers, center)[0]
            group = is_swell & (np.abs(centers - center).max(axis=0) <= PART_CELLS)
            group &= np.abs(level - level[closest]) <= _SAME_LEVEL_M
            group[closest] = True
            own = tuple(slice(PART_CELLS * at, PART_CELLS * (at + 1)) for at in corner)
            deviations[slot][own] = max(waves.deviation_m, deviation[group].max())
            levels[slot][own] = other_levels(level[closest], waves)
    return levels, deviations


def other_levels(levels: Cells | np.float64, waves: Waves) -> Cells:
    """Return levels of water, or that of the tile where they do not differ from it by two standard deviations."""
    differ = np.abs(levels - waves.level_m) > _OTHER_LEVEL * waves.deviation_m
    return np.where(differ, levels, waves.level_m)


def estimate_waves(looks: Iterable[Look]) -> Waves | None:
    """Return the waves of a tile; None if less than half of it looks like sea.

    ``looks`` are iterated over at most twice.

    Notes
    -----
    Objects stand above the water, so everything is estimated from the median downwards. Waves oscillate: half a wave
    length away, elevations are the opposite of what they are here. The autocovariance over both directions has its
    minimum there, which gives the length. Land hardly ever has such a minimum; nor is it level from part to part. A
    part with two levels, as of a polder and the sea, may have one; but its lower quartile is nearly as low as its 16th
    percentile, unlike that of waves. Where swell and wind sea cross, a part may have none either; it is sea if its
    level and deviation are those of the others. A still part, such as a sheltered basin, does not show the waves
    elsewhere. Each level has its own waves; those of the tile are the roughest that a tenth of it has. If blocks do not
    look like sea, their quarters may: a block beside a weir has two levels.
    """
    found = [
        part_waves(look, block, look.lowest[slot], look.opened[slot], crests=True)
        for look in looks
        for block, slot in look.grid.blocks.items()
    ]
    waves = _waves_of([part for part in found if part])
    return waves or _waves_of([quarter.waves for look in looks for quarter in quarters(look, crests=True)])


def _waves_of(known: Sequence[PartWaves]) -> Waves | None:
    """Return the waves of parts of a tile; None if less than half of what is not still looks like sea."""
    waters = [_water_of(likely, known) for likely in by_level([part for part in known if part.is_sea])]
    parts = [part for water in waters for part in water.parts]
    rest = [part for part in known if not part.is_still and not any(part is own for own in parts)]
    if _cells(parts) < _MIN_SHARE * (_cells(parts) + _cells(rest)):
        return None
    large = [water for water in waters if _cells(water.parts) >= _LEAST_SHARE * _cells(known)]
    return replace(max(large, key=lambda water: water.highest_m), parts=parts) if large else None


def by_level(parts: Sequence[PartWaves]) -> Iterator[Sequence[PartWaves]]:
    """Yield the parts of each water: between its level and the next is a gap that the lower waves do not explain."""
    ordered = sorted(parts, key=lambda part: part.level_m)
    start = 0
    for end, (one, other) in enumerate(pairwise(ordered), 1):
        if other.level_m - one.level_m > max(_SAME_LEVEL_M, min(one.deviation_m, other.deviation_m)):
            yield ordered[start:end]
            start = end
    if ordered:
        yield ordered[start:]


def _water_of(likely: Sequence[PartWaves], known: Sequence[PartWaves]) -> Waves:
    """Return the waves of the parts at one level, and of those of the others that resemble them."""
    level, deviation = (_weighted_quantile(likely, name, 0.5) for name in ("level_m", "deviation_m"))
    near = [part for part in likely if abs(part.level_m - level) < _MAX_STEP_M]
    sea = near + [part for part in known if not part.is_sea and part.resembles(level, deviation)]
    level, deviation = (_weighted_quantile(sea, name, 0.5) for name in ("level_m", "deviation_m"))
    length = _weighted_quantile(near, "length_m", 0.5)  # the others do not show any
    cells, crests = zip(*(crest for part in sea for crest in part.crests), strict=True)
    return Waves(sea, level, deviation, length, _quantile(cells, crests, _ROUGHEST_PARTS))


def _cells(parts: Sequence[PartWaves]) -> int:
    return sum(part.cells for part in parts)


def _weighted_quantile(parts: Sequence[PartWaves], name: str, share: float) -> float:
    return _quantile([part.cells for part in parts], [getattr(part, name) for part in parts], share)


def _quantile(cells: Sequence[int], values: Sequence[float], share: float) -> float:
    order = np.argsort(values, kind="stable")
    weight = np.cumsum(np.array(cells)[order])
    return float(np.array(values)[order][np.searchsorted(weight, share * weight[-1])])
