"""Terrain without water: hills, woods, and level land that waves may resemble."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.echoes import Echoes
from seaclutter_cli.airborne.oscillation import LONG_WAVE_M
from seaclutter_cli.airborne.part_waves import PART_CELLS
from seaclutter_cli.airborne.quarters import LocalWaves
from seaclutter_cli.airborne.reflection import CLEARLY_GROUND, SPECULAR
from seaclutter_cli.airborne.regions import are_flat
from seaclutter_cli.airborne.squares import LEAST_SQUARES, RELIEF_M, SIDE, Squares, SquareWaves, is_relief

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

SEVERAL = 0.05
"""Share of pulses with several echoes from which a square has leaves or roofs."""
_WOODED_SHARE, _BUILT_SHARE, _TREE_M, _LEAFY_SHARE = 0.5, 0.2, 2.0, 0.1
_WAVES_M, _HALF, _STEP, _FEW_MIRRORS = 3.0, 0.5, 0.5, 0.02
_HILL_M, _FLAT_SHARE, _LEVEL_SHARE = 0.5, 0.05, 0.08


def are_hills(squares: Squares, deviation_m: Values) -> bool:
    """Return whether a tile is without any water: next to nothing is flat, and no level is frequent."""
    few = np.count_nonzero(are_flat(squares, deviation_m)) < _FLAT_SHARE * len(squares.index)
    return bool(few and _most_within(squares, _HILL_M) < _LEVEL_SHARE)


def without_woods(squares: Squares, echoes: Echoes, waves: SquareWaves) -> SquareWaves:
    """Return the waves, or none if most squares of them are woods: ground below trees may undulate like water."""
    if are_woods(squares, echoes, waves.deviation_m > 0):
        none = np.zeros_like(waves.deviation_m)
        return SquareWaves(squares.level_m, none, none, none > 0)
    return waves


def without_banks(squares: Squares, echoes: Echoes, local: LocalWaves) -> LocalWaves:
    """Return waves without parts that are mostly ground, and higher than what reflects like a mirror: beside a canal.

    Ground must be higher by half the deviation. Where it is waves that reflect so, both have one level. In a part with
    next to no mirrors, those of the tile count, if they are a fiftieth of it.
    """
    ground, mirror = echoes.variation <= CLEARLY_GROUND, echoes.variation >= SPECULAR
    if not mirror.any():
        return local
    many = np.count_nonzero(mirror) >= max(_FEW_MIRRORS * len(mirror), LEAST_SQUARES)
    kept = np.ones(len(local.parts), np.bool_)
    for number, (center, part) in enumerate(zip(local.centers.T, local.parts, strict=True)):
        own = np.abs(squares.xy + 0.5 - center[:, None] / SIDE).max(axis=0) < PART_CELLS / 2 / SIDE
        beside = own & mirror
        if np.count_nonzero(beside) < LEAST_SQUARES and many:
            beside = mirror
        high, low = squares.level_m[own & ground], squares.level_m[beside]
        if part.is_sea and len(high) > _HALF * np.count_nonzero(own) and len(low) >= LEAST_SQUARES:
            kept[number] = np.median(high) - np.median(low) <= _STEP * part.deviation_m
    parts = [part for part, keep in zip(local.parts, kept, strict=True) if keep]
    return replace(local, centers=local.centers[:, kept], parts=parts)


def are_woods(squares: Squares, echoes: Echoes, own: Mask) -> bool:
    """Return whether some squares are woods or a town.

    Pulses have several echoes in most of them, and in most of these, something rises more than two metres. Or more than
    a twentieth of the echoes is as high in a fifth of them, as crowns are that hide little of the ground, and roofs.
    Ships are on fewer squares of a sea.
    """
    number, leafy = np.count_nonzero(own), own & (echoes.several > SEVERAL)
    many = np.count_nonzero(leafy) > _WOODED_SHARE * number
    if many and np.median(squares.top_m[leafy] - squares.level_m[leafy]) > _TREE_M:
        return True
    return bool(np.count_nonzero(own & (echoes.tall > SEVERAL)) > _BUILT_SHARE * number)


def may_be_waves(squares: Squares, echoes: Echoes) -> bool:
    """Return whether a tile without water may be of waves that are too long for it.

    This holds for small tiles with next to no leaves and roofs and, without intensities, for tiles that are mostly no
    higher than waves, and where next to nothing rises two metres either. Waves do not stay where they are from strip
    to strip.
    """
    every = np.ones(len(squares.index), np.bool_)
    if not len(every) or is_relief(squares, echoes.change_m, every, RELIEF_M):
        return False
    leafy, tall = echoes.several > SEVERAL, echoes.tall > SEVERAL
    few, fewer = (np.count_nonzero(own) <= _LEAFY_SHARE * len(every) for own in (leafy, leafy | tall))
    small = few and np.ptp(squares.xy, axis=1).max() * squares.side_m < LONG_WAVE_M
    unknown = fewer and not np.isfinite(echoes.variation).any()
    return bool(small or (unknown and _most_within(squares, _WAVES_M) > _HALF))


def _most_within(squares: Squares, height_m: float) -> float:
    """Return the share of the squares whose levels are in the one step of this height that contains the most."""
    level = np.sort(squares.level_m)
    near = np.searchsorted(level, level + height_m) - np.arange(len(level))
    return float(near.max(initial=0) / max(len(level), 1))
