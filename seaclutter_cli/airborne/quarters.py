"""Waves of the quarters of blocks, of which some are too small, or too narrow, for long waves."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.looks import Look
from seaclutter_cli.airborne.nearest import nearest
from seaclutter_cli.airborne.oscillation import MAX_TILT, tilt
from seaclutter_cli.airborne.part_waves import PART_CELLS, PartWaves, part_waves

Cells = NDArray[np.float64]

_CORNERS = (0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)
_BETWEEN = (0.0, 0.5), (0.5, 0.0), (0.5, 0.5), (0.5, 1.0), (1.0, 0.5)
_NARROW_CELLS = 32
_HIGHEST_DEVIATIONS, _BELOW_DEVIATIONS = 3.0, 2.0
_LENGTHS, _ALIKE = 1.4, 1.5
_LEAST_SHARE = 0.1
_SAME_LEVEL_M = 0.1
_ROUGH_M, _SEVERAL, _ROUGH_SHARE, _SEA_SHARE = 0.5, 3, 0.05, 0.25


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
        Number of the cells in rough quarters that look like sea; in those that are level, or all at one level, but do
        not oscillate, as where echoes of several moments meet; and in all quarters.
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
        """Whether a twentieth of the rough cells, or a quarter of all, looks like a sea of one level.

        Moments mixed in cells are rough even if each of them is not.
        """
        sea = [part for part in self.parts if part.is_sea]
        rough = [part for part in sea if part.crest_m > _ROUGH_M]
        if self.sea_cells >= _ROUGH_SHARE * (self.sea_cells + self.mixed_cells) and _have_one_level(rough):
            return True
        return sum(part.cells for part in sea) >= _SEA_SHARE * self.cells and _have_one_level(sea)


def _have_one_level(parts: Sequence[PartWaves]) -> bool:
    """Return whether parts are three or more, at about one level."""
    if len(parts) < _SEVERAL:
        return False
    return bool(np.std([part.level_m for part in parts]) <= np.median([part.deviation_m for part in parts]))


@dataclass(frozen=True)
class Quarter:
    """A quarter of a block with enough points.

    Parameters
    ----------
    center : (float, float)
        Its centre, in cells.
    width_m, length_m : float
        Its shorter and longer side, as far as there are points.
    waves : PartWaves
        Its waves.
    """

    center: tuple[float, float]
    width_m: float
    length_m: float
    waves: PartWaves

    @property
    def shows_water(self) -> bool:
        """Whether it looks like sea, or like still water."""
        return self.waves.is_sea or self.waves.is_still

    def is_certain(self, beside: "Quarter | None") -> bool:
        """Return whether a narrow quarter shows waves or still water, beside a wide one that does.

        It may be less than half of a wave there. A slope may be a wave, unless two wave lengths are seen.
        """
        if beside is not None and beside.waves.is_sea and 2 * self.width_m < beside.waves.length_m:
            return not beside.waves.contains(self.waves, _HIGHEST_DEVIATIONS)
        return not self.waves.is_sea or 2 * self.waves.length_m <= self.length_m


def local_waves(looks: Iterable[Look]) -> LocalWaves:
    """Return the waves of the quarters of blocks, of each look.

    A quarter may be too small for long swell: it has the waves of a block if it is no rougher, and near their level.
    """
    own: list[tuple[tuple[float, float], PartWaves]] = []
    sea = mixed = cells = 0
    for look in looks:
        every = quarters(look, crests=False)
        rest = [quarter for quarter in every if not quarter.shows_water]
        own += [(quarter.center, quarter.waves) for quarter in every if quarter.shows_water]
        own += [(window.center, window.waves) for window in _between(look, every)]
        for swell in _long_swell(look, {quarter.waves.block for quarter in rest}):
            own += [(quarter.center, swell) for quarter in rest if swell.contains(quarter.waves)]
        rough = [quarter.waves for quarter in every if quarter.waves.crest_m > _ROUGH_M]
        if rough and np.std([waves.level_m for waves in rough]) > _SAME_LEVEL_M:
            rough = [waves for waves in rough if waves.is_level]
        sea += sum(waves.cells for waves in rough if waves.is_sea)
        mixed += sum(waves.cells for waves in rough if not waves.is_sea)
        cells += sum(quarter.waves.cells for quarter in every)
    return LocalWaves(_columns(center for center, _ in own), [waves for _, waves in own], sea, mixed, cells)


def _long_swell(look: Look, blocks: Collection[tuple[int, int]]) -> Iterator[PartWaves]:
    """Yield the waves of those of some blocks that look like sea, if they are too long for their quarters."""
    cell_m = look.grid.cell_m
    for block, slot in look.grid.blocks.items():
        if block in blocks:
            waves = part_waves(look, block, look.lowest[slot], look.opened[slot], crests=False)
            if waves is not None and waves.is_sea and waves.length_m > PART_CELLS * cell_m:
                yield waves


def quarters(look: Look, *, crests: bool) -> Sequence[Quarter]:
    """Return quarters of blocks with enough points; narrow ones at the edge count if they are certain, or all are."""
    found = [own for block in look.grid.blocks for own in _windows(look, block, _CORNERS, crests=crests)]
    narrow_m = _NARROW_CELLS * look.grid.cell_m
    wide = [own for own in found if own.width_m >= narrow_m and own.shows_water]
    centers = _columns(own.center for own in wide)

    def counts(own: Quarter) -> bool:
        beside = wide[nearest(centers, _columns([own.center]))[0]] if wide else None
        return own.width_m >= narrow_m or own.is_certain(beside)

    return [own for own in found if counts(own)] or found


def _between(look: Look, found: Sequence[Quarter]) -> Sequence[Quarter]:
    """Return windows with waves between quarters that show no water: a coast may divide all quarters of a block.

    They lie below the waves of all quarters, as the sea does below fields and dunes that undulate, and show 1.4 wave
    lengths. One that is much rougher than most contains something else, such as a dike.
    """
    centers = _columns(own.center for own in found if own.shows_water)
    lowest_m = min(
        (own.waves.level_m - _BELOW_DEVIATIONS * own.waves.deviation_m for own in found if own.waves.is_sea),
        default=np.inf,
    )
    windows = []
    for block in look.grid.blocks:
        apart = [np.abs(centers - _columns([_center(block, place)])).max(axis=0, initial=0) for place in _BETWEEN]
        free = [place for place, cells in zip(_BETWEEN, apart, strict=True) if not (cells < PART_CELLS).any()]
        for own in _windows(look, block, free, crests=False):
            is_wide = own.width_m >= _NARROW_CELLS * look.grid.cell_m
            is_clear = own.waves.is_sea and _LENGTHS * own.waves.length_m <= own.length_m
            if is_wide and is_clear and own.waves.level_m < lowest_m:
                windows.append(own)
    roughest_m = _ALIKE * float(np.median([own.waves.deviation_m for own in windows])) if windows else 0.0
    return [own for own in windows if own.waves.deviation_m <= roughest_m]


def _windows(
    look: Look, block: tuple[int, int], places: Sequence[tuple[float, float]], *, crests: bool
) -> Iterator[Quarter]:
    """Yield windows of the width of a quarter, at some places in a block in units of it, with enough points."""
    lowest, opened = (cells[look.grid.blocks[block]] for cells in (look.lowest, look.opened))
    for place in places:
        part = tuple(slice(int(PART_CELLS * at), int(PART_CELLS * (at + 1))) for at in place)
        waves = part_waves(look, block, lowest[part], opened[part], crests=crests)
        if waves is not None:
            is_sea = waves.is_sea and tilt(lowest[part]) < MAX_TILT * waves.deviation_m
            sides = sorted(np.count_nonzero(np.isfinite(lowest[part]).any(axis=axis)) for axis in (0, 1))
            width_m, length_m = (side * look.grid.cell_m for side in sides)
            yield Quarter(_center(block, place), width_m, length_m, replace(waves, is_sea=is_sea))


def _center(block: tuple[int, int], place: tuple[float, float]) -> tuple[float, float]:
    """Return the centre of a window in cells."""
    x, y = (PART_CELLS * (2 * at + own + 0.5) for at, own in zip(block, place, strict=True))
    return x, y


def _columns(centers: Iterable[tuple[float, float]]) -> Cells:
    """Return points as an array, shape (2, N)."""
    return np.array(list(centers)).reshape(-1, 2).T
