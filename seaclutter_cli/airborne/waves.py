"""Waves of a tile: their height and length, part by part, from the lowest echo of each cell."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.grid import BLOCK
from seaclutter_cli.airborne.looks import Look
from seaclutter_cli.airborne.nearest import nearest
from seaclutter_cli.airborne.oscillation import MAX_TILT, are_sparse, oscillation, tilt

Cells = NDArray[np.float64]

PART_CELLS = BLOCK // 2
"""Width of the parts of a tile whose waves are estimated."""

_FEW_CELLS, _FEW_SPARSE_CELLS, _MANY_CELLS = 2000, 1000, 4096
_CRESTS = 4.0
_MIN_OSCILLATION = 0.15
_MAX_SKEW = 1.7
_TAIL = 0.9
_MAX_DEVIATION_M = 1.0
_MAX_STEP_M = 2.0
_MIN_SHARE = 0.5
_ROUGHEST_PARTS = 0.75
_OTHER_LEVEL = 2.0
_SAME_LEVEL_M, _LEAST_SHARE = 0.2, 0.1
_STILL_M = 0.1
_ROUGH_M, _SEVERAL, _ROUGH_SHARE = 0.5, 3, 0.05
_ALIKE = 1.5
_HIGHEST = 1.25


@dataclass(frozen=True)
class PartWaves:
    """Waves in one block of the grid.

    Parameters
    ----------
    block : (int, int)
        Number of the block along x and y.
    cells : int
        Number of its cells with points.
    level_m, deviation_m : float
        Median and standard deviation of the elevation of the water.
    crest_m : float
        Height of the crests above the opened surface.
    crests : sequence of (int, float)
        Number of cells and height of the crests of each quarter.
    length_m : float
        Length of the highest waves.
    is_sea : bool
        Whether the elevations oscillate, and are distributed, like those of waves.
    is_level : bool
        Whether they are distributed like those of waves.
    """

    block: tuple[int, int]
    cells: int
    level_m: float
    deviation_m: float
    crest_m: float
    crests: Sequence[tuple[int, float]]
    length_m: float
    is_sea: bool
    is_level: bool

    @property
    def is_still(self) -> bool:
        """Whether the part is level, but has hardly any waves."""
        return self.is_level and not self.is_sea and self.deviation_m <= _STILL_M

    def contains(self, quarter: "PartWaves") -> bool:
        """Return whether a smaller part may show a part of these waves."""
        near = abs(quarter.level_m - self.level_m) <= _CRESTS / 2 * self.deviation_m
        return near and quarter.deviation_m <= _ALIKE * self.deviation_m

    def resembles(self, level_m: float, deviation_m: float) -> bool:
        """Return whether the part is like a sea whose waves have this level and deviation."""
        near = abs(self.level_m - level_m) <= deviation_m
        alike = deviation_m / _ALIKE <= self.deviation_m <= _ALIKE * deviation_m
        return self.is_level and near and alike


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


@dataclass(frozen=True)
class LocalWaves:
    """Waves of the quarters of blocks.

    Parameters
    ----------
    centers : ndarray, shape (2, P), float64
        Centres of the quarters that look like sea or are still, in cells.
    parts : sequence of PartWaves
        Their waves.
    sea_cells, mixed_cells, cells : int
        Number of the cells in rough quarters that look like sea; in those that are level, but do not oscillate, as
        where echoes of several moments meet; and in all quarters.
    """

    centers: Cells
    parts: Sequence[PartWaves]
    sea_cells: int
    mixed_cells: int
    cells: int

    @property
    def is_mixed(self) -> bool:
        """Whether a tenth of the cells, and most rough ones, may show waves of several moments."""
        return self.mixed_cells > max(_LEAST_SHARE * self.cells, self.sea_cells)

    @property
    def is_one_sea(self) -> bool:
        """Whether a twentieth of the rough cells, in three quarters or more at about one level, looks like sea."""
        sea = [part for part in self.parts if part.is_sea and part.crest_m > _ROUGH_M]
        if len(sea) < _SEVERAL or self.sea_cells < _ROUGH_SHARE * (self.sea_cells + self.mixed_cells):
            return False
        return bool(np.std([part.level_m for part in sea]) <= np.median([part.deviation_m for part in sea]))


def local_waves(looks: Iterable[Look]) -> LocalWaves:
    """Return the waves of the quarters of blocks, of each look.

    A quarter may be too small for long swell: it has the waves of a block if it is no rougher, and near their level.
    """
    own: list[tuple[list[float], PartWaves]] = []
    sea = mixed = cells = 0
    for look in looks:
        every = list(_quarters(look, crests=False))
        rest = [(center, part) for center, part in every if not (part.is_sea or part.is_still)]
        own += [(center, part) for center, part in every if part.is_sea or part.is_still]
        for wave in _long_swell(look, {part.block for _, part in rest}):
            own += [(center, wave) for center, part in rest if wave.contains(part)]
        rough = [part for _, part in every if part.is_level and part.crest_m > _ROUGH_M]
        sea += _cells([part for part in rough if part.is_sea])
        mixed += _cells([part for part in rough if not part.is_sea])
        cells += _cells([part for _, part in every])
    centers = np.array([center for center, _ in own]).reshape(-1, 2).T
    return LocalWaves(centers, [part for _, part in own], sea, mixed, cells)


def _long_swell(look: Look, blocks: Collection[tuple[int, int]]) -> Iterator[PartWaves]:
    """Yield the waves of those of some blocks that look like sea, if they are too long for their quarters."""
    cell_m = look.grid.cell_m
    for block, slot in look.grid.blocks.items():
        if block in blocks:
            waves = _part(look, block, look.lowest[slot], look.opened[slot], crests=False)
            if waves is not None and waves.is_sea and waves.length_m > PART_CELLS * cell_m:
                yield waves


def _quarters(look: Look, *, crests: bool) -> Iterator[tuple[list[float], PartWaves]]:
    """Yield the centre of each quarter of a block with enough points, in cells, and its waves."""
    for block, slot in look.grid.blocks.items():
        for corner in np.ndindex(2, 2):
            part = tuple(slice(PART_CELLS * at, PART_CELLS * (at + 1)) for at in corner)
            lowest = look.lowest[slot][part]
            waves = _part(look, block, lowest, look.opened[slot][part], crests=crests)
            if waves is not None:
                is_sea = waves.is_sea and tilt(lowest) < MAX_TILT * waves.deviation_m
                center = [PART_CELLS * (2 * at + c + 0.5) for at, c in zip(block, corner, strict=True)]
                yield center, replace(waves, is_sea=is_sea)


def local_levels(look: Look, waves: Waves) -> tuple[Cells, Cells]:
    """Return the level and the deviation of the nearest waves at each cell, both of shape (S, 256, 256).

    Basins on both sides of a lock or weir have waves at two levels. A level differs from that of the tile from two
    standard deviations on. Still water belongs to a basin if there are waves at its level. The deviation is not less
    than that of the tile.
    """
    levels, deviations = (np.full(look.lowest.shape, value) for value in (waves.level_m, waves.deviation_m))
    found = local_waves([look])
    centers, parts = found.centers, found.parts
    oscillating = np.array([part.level_m for part in parts if part.is_sea])
    wet = [bool((np.abs(oscillating - part.level_m) <= _SAME_LEVEL_M).any()) for part in parts]
    if not any(wet):
        return levels, deviations
    centers, parts = centers[:, wet], [part for part, own in zip(parts, wet, strict=True) if own]
    for block, slot in look.grid.blocks.items():
        for corner in np.ndindex(2, 2):
            center = PART_CELLS * (2 * np.array(block) + corner + 0.5)
            part = parts[nearest(centers, center[:, None])[0]]
            own = tuple(slice(PART_CELLS * at, PART_CELLS * (at + 1)) for at in corner)
            deviations[slot][own] = max(part.deviation_m, waves.deviation_m)
            levels[slot][own] = other_levels(np.float64(part.level_m), waves)
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
        _part(look, block, look.lowest[slot], look.opened[slot], crests=True)
        for look in looks
        for block, slot in look.grid.blocks.items()
    ]
    waves = _waves_of([part for part in found if part])
    return waves or _waves_of([part for look in looks for _, part in _quarters(look, crests=True)])


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
    level, deviation, length = (_weighted_quantile(sea, name, 0.5) for name in ("level_m", "deviation_m", "length_m"))
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


def _part(look: Look, block: tuple[int, int], lowest: Cells, opened: Cells, *, crests: bool) -> PartWaves | None:
    """Return the waves of a part of a look, with or without the crests of its quarters; None if it is nearly empty."""
    known = np.isfinite(lowest) & np.isfinite(opened)
    cells = int(known.sum())
    if cells < (_FEW_SPARSE_CELLS if are_sparse(known) else _FEW_CELLS):
        return None
    above = lowest - np.where(known, opened, 0)
    step = (cells // _MANY_CELLS) | 1  # waves are alike over many cells, so that more of them would tell little
    crest = _crest(above[known][::step])
    tail, lower, level, upper = quantiles(lowest[known][::step], (0.1587, 0.25, 0.5, 0.75))
    deviation = float(level - tail)
    length, depth = 0.0, 0.0
    has_tail = level - lower <= _TAIL * deviation
    if is_level := bool(upper - level <= _MAX_SKEW * (level - lower) and has_tail and deviation <= _MAX_DEVIATION_M):
        water = known & (above <= crest) & (np.abs(np.where(known, lowest, level) - level) <= _CRESTS * deviation)
        length, depth = oscillation(lowest - level, water, whole_lengths=not look.is_small)
    is_sea = is_level and depth >= _MIN_OSCILLATION
    own_crests = _crests(above, known) if crests and is_level else []
    return PartWaves(
        block,
        cells,
        float(level),
        deviation,
        crest,
        own_crests or [(cells, crest)],
        length * look.grid.cell_m,
        is_sea,
        is_level,
    )


def _crests(above: Cells, known: NDArray[np.bool_]) -> list[tuple[int, float]]:
    """Return the number of cells in each quarter of a part that has enough, and the height of its crests."""
    halves = [(slice(0, side // 2), slice(side // 2, side)) for side in known.shape]
    quarters = [(int(known[own].sum()), own) for own in product(*halves)]
    return [
        (cells, _crest(above[own][::2, ::2][known[own][::2, ::2]])) for cells, own in quarters if cells >= _FEW_CELLS
    ]


def _crest(above: NDArray[np.float64]) -> float:
    """Return the height of the crests of water, from heights above the opened surface."""
    low, middle = quantiles(above, (0.1587, 0.5))
    return float(middle + _CRESTS * (middle - low))


def quantiles(values: NDArray[np.float64], shares: Sequence[float]) -> NDArray[np.float64]:
    """Return the quantiles that `numpy.quantile` returns, for a few thousand values in a third of the time.

    Examples
    --------
    >>> quantiles(np.array([3.0, 1, 2, 4]), (0.5, 0.75))
    array([2.5 , 3.25])
    """
    ordered = np.sort(values)
    low, between = np.divmod(np.array(shares) * (len(ordered) - 1), 1)
    first, second = ordered[low.astype(np.intp)], ordered[np.ceil(low + between).astype(np.intp)]
    step = second - first
    return np.asarray(np.where(between < 0.5, first + step * between, second - step * (1 - between)))
