"""Echoes from the bottom of clear water, which green lasers see through its surface."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.cells import joined_cells
from seaclutter_cli.airborne.gridded import NOWHERE, GriddedPoints
from seaclutter_cli.airborne.nearest import nearest
from seaclutter_cli.airborne.squares import SIDE, positions, square_of, squares_in
from seaclutter_cli.airborne.strips import Column
from seaclutter_cli.grids.elevation import BLOCK

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FEW, _LEAST_ECHOES, _LEAST_SHARE, _SAMPLE = 0.01, 6, 0.05, 8
_ROUGH_M, _LEAST_DEPTH_M, _DEVIATIONS = 0.5, 0.3, 3.0
_LEAST_SQUARES, _HALF, _NEARLY, _REACH = 6, 0.5, 0.75, 2


@dataclass(frozen=True)
class Bottom:
    """Echoes of a tile of N points from below the surface of clear water.

    Parameters
    ----------
    below : ndarray, shape (N,), bool
        Echoes from below the surface.
    above : ndarray, shape (N,), bool
        All other echoes of squares of clear water: without the bottom, each is the only one of its pulse.
    height_m : ndarray, shape (M,), float32
        Height of the M echoes from below, relative to the mean surface around them; negative.
    """

    below: Mask
    above: Mask
    height_m: NDArray[np.float32]

    def columns_above(self, column: Column) -> Column:
        """Return the attributes of the echoes that are not from below."""

        def above(name: str) -> NDArray[Any] | None:
            values = column(name)
            if values is not None and name == "number_of_returns":
                values = np.where(self.above, 1, values)
            return None if values is None else values[~self.below]

        return above


@dataclass(frozen=True)
class _ClearWater:
    """Level and tolerance of the surface in all squares, shape (Q,), NaN far from clear water; where that is."""

    level_m: Values
    tolerance_m: Values
    clear: Mask


def bottom_of(points: GriddedPoints, column: Column, trusted: Collection[int] = ()) -> Bottom | None:
    """Return the echoes from the bottom of clear water; None if a tile has none, or too few to matter.

    Parameters
    ----------
    points : GriddedPoints
        The N points of a tile.
    column : callable
        Returns an attribute of all points; without the numbers of returns, no bottom is found.
    trusted : collection of int, optional
        ASPRS classes of points that are right.

    Notes
    -----
    A pulse that has several echoes met the surface first, then the bottom. So a square is clear water if

    * a twentieth of its pulses have several echoes;
    * the first of these echoes are level, to half a metre (standard deviation): trees and buildings are not;
    * the later ones are on average 0.3 m lower: a pulse cannot tell shallower water;
    * pulses with one echo are nearer to the former than to the latter: they, too, met the surface. Below trees, they
      met the ground.

    Groups of fewer than six connected squares do not count. A group is a mat on the water, not clear water, if in most
    squares around it that do not look like clear water, the echoes are near the level of its later echoes. In clear
    water, later echoes below the mean of the first ones are from the bottom. So is any echo more than three standard
    deviations (at least 0.3 m) below that mean, because calm water often returns nothing; this holds up to two squares
    around, where ships hide the surface.
    """
    returns = column("number_of_returns")
    if returns is None or np.count_nonzero(returns > 1) < _FEW * points.size:
        return None
    number = column("return_number")
    water = None if number is None else _clear_water(points, number, returns)
    if number is None or water is None:
        return None
    classes = column("classification") if trusted else None
    below, above = np.zeros(points.size, np.bool_), np.zeros(points.size, np.bool_)
    free = np.ones(points.size, np.bool_) if classes is None else ~np.isin(classes, list(trusted))
    height = []
    start = 0
    for z, cell in points:
        square, own = square_of(cell), slice(start, start + len(cell))
        rise, clear = z - water.level_m[square], water.clear[square] & (cell != NOWHERE)
        deep = (rise < -water.tolerance_m[square]) & (cell != NOWHERE)
        below[own] = free[own] & (deep | (clear & (number[own] > 1) & (rise < 0)))
        above[own] = clear & ~below[own]
        height.append(rise[below[own]])
        start += len(cell)
    return Bottom(below, above, np.concatenate(height).astype(np.float32))


def _clear_water(points: GriddedPoints, number: NDArray[np.uint8], returns: NDArray[np.uint8]) -> _ClearWater | None:
    several = returns > 1
    pulses, first, spread = _squares(points, several & (number <= 1))
    clear = (pulses >= _LEAST_ECHOES) & (spread <= _ROUGH_M)
    if np.count_nonzero(clear) < _LEAST_SQUARES:
        return None
    later = _squares(points, number > 1).mean_m
    clear &= first - later > _LEAST_DEPTH_M
    if np.count_nonzero(clear) < _LEAST_SQUARES:
        return None
    single = _squares(points, ~several, _SAMPLE)
    clear &= pulses >= _LEAST_SHARE * (pulses + single.pulses)
    beside = ~clear & np.isfinite(single.mean_m)
    clear &= ~(first - single.mean_m > (first - later) / 2)
    region = _regions(points, clear)
    place = positions(points.grid, np.arange(len(clear)))
    clear = (region > 0) & ~_are_mats(region, beside, place, first, later, single.mean_m)[region]
    if not clear.any():
        return None
    own = np.flatnonzero(clear)
    closest = own[nearest(place[:, own], place)]
    near = np.abs(place - place[:, closest]).max(axis=0) <= _REACH
    level = np.where(near, first[closest], np.nan)
    return _ClearWater(level, np.maximum(_LEAST_DEPTH_M, _DEVIATIONS * spread[closest]), clear)


class _Squares(NamedTuple):
    """Number, mean elevation and standard deviation of some echoes of each square; NaN without any."""

    pulses: Values
    mean_m: Values
    spread_m: Values


def _squares(points: GriddedPoints, chosen: Mask, every: int = 1) -> _Squares:
    """Return statistics of one in ``every`` of the chosen echoes, with the number that all of them have."""
    total = squares_in(points.grid)
    count, one, two = (np.zeros(total) for _ in range(3))
    datum = next((float(z[0]) for z, _ in points if len(z)), 0.0)  # large elevations have no digits left for squares
    start = 0
    for z, cell in points:
        own = np.flatnonzero(chosen[start : start + len(cell)] & (cell != NOWHERE))[::every]
        square, above = square_of(cell[own]), z[own] - datum
        count += np.bincount(square, minlength=total)
        one += np.bincount(square, above, total)
        two += np.bincount(square, above**2, total)
        start += len(cell)
    mean, power = (np.divide(sums, count, out=np.full(total, np.nan), where=count > 0) for sums in (one, two))
    return _Squares(every * count, mean + datum, np.sqrt(np.maximum(power - mean**2, 0)))


def _regions(points: GriddedPoints, squares: Mask) -> NDArray[np.int32]:
    """Return the number of the region of each square; 0 for squares in none that is large enough."""
    part, group = joined_cells(squares.reshape(-1, BLOCK // SIDE, BLOCK // SIDE), points.grid.blocks)
    region = group[part.reshape(-1)]
    large = np.bincount(region[squares], minlength=len(group)) >= _LEAST_SQUARES
    return np.asarray(np.where(squares & large[region], region, 0))


def _are_mats(
    region: NDArray[np.int32], beside: Mask, place: NDArray[np.int64], first: Values, later: Values, single: Values
) -> Mask:
    """Return whether most squares beside each region, of those that may be, have echoes at the level of its later ones.

    Squares amid clear water, from whose pulses with one echo some missed the surface, are not beside it.
    """
    inside, around = np.flatnonzero(region), np.flatnonzero(beside)
    mats = np.zeros(int(region.max(initial=0)) + 1, np.bool_)
    if not (len(inside) and len(around)):
        return mats
    closest = inside[nearest(place[:, inside], place[:, around])]
    touch = np.abs(place[:, around] - place[:, closest]).max(axis=0) == 1
    around, closest = around[touch], closest[touch]
    lower = first[closest] - single[around] > _NEARLY * (first - later)[closest]
    sides = np.bincount(region[closest], minlength=len(mats))
    return np.asarray(np.bincount(region[closest], lower, len(mats)) > _HALF * sides)
