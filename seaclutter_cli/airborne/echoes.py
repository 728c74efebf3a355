"""Echoes from the surface of squares: how they reflect, and how many a pulse has."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.classes import GROUND, WATER
from seaclutter_cli.airborne.gridded import NOWHERE, GriddedPoints
from seaclutter_cli.airborne.squares import Squares, are_moving, square_of, squares_in
from seaclutter_cli.airborne.strips import Column

Values = NDArray[np.float64]
Cells = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAST_ECHOES, _MANY_ECHOES = 12, 60
_LEAST_SATURATED, _CONSTANT_SHARE = 0.01, 0.05
_TALL_M = 2.0


@dataclass(frozen=True)
class Echoes:
    """What the echoes from the surface of each of N squares look like; NaN if unknown.

    Parameters
    ----------
    variation : ndarray, shape (N,), float64
        Standard deviation of the intensities divided by the mean, of pulses with one echo: several share the energy of
        the pulse. Of fewer than 60, the average with the squares beside. If some are saturated, relative to that of
        equally saturated speckle.
    brightness : ndarray, shape (N,), float64
        Logarithm of the mean intensity of pulses with one echo.
    several : ndarray, shape (N,), float64
        Share of those from pulses with several echoes.
    tall : ndarray, shape (N,), float64
        Share of all echoes that are more than two metres above the level of the square.
    change_m : ndarray, shape (N,), float64
        By how much the level differs between two strips, beyond what their squares have in common.
    moving : ndarray, shape (N,), bool
        Whether they rise and fall from strip to strip (`are_moving`).
    known : ndarray, shape (N,), int8
        1 if most of them have the trusted class of water, -1 if most have that of ground; 0 for all others.
    """

    variation: Values
    brightness: Values
    several: Values
    tall: Values
    change_m: Values
    moving: Mask
    known: NDArray[np.int8]


def echoes_of(
    squares: Squares,
    points: GriddedPoints,
    top: Cells,
    column: Column,
    change_m: Values | None,
    trusted: Collection[int] = (),
) -> Echoes:
    """Return the echoes of squares that are no higher than ``top``, the elevation of each cell.

    ``change_m`` is the difference between two strips in each square of all blocks, ``trusted`` are the ASPRS classes of
    the points, 2 or 9, that are right.
    """
    count = _counted(squares, points, top, column, trusted)
    unknown = np.full(len(squares.index), np.nan)
    number = np.where(count.single >= _LEAST_ECHOES, count.single, np.nan)
    mean = count.intensity / number
    spread = np.sqrt(np.maximum(count.squared / number - mean**2, 0))
    least = 1.0 if _is_whole(column("intensity")) else 0.0  # below, the deviation is that of rounding
    clipped = count.saturated / number
    if np.count_nonzero(clipped == 1) > _CONSTANT_SHARE * len(clipped):  # one surface has this intensity, and no other
        clipped = np.zeros(len(clipped))
    variation = np.divide(spread, mean, out=unknown.copy(), where=mean > least) / _speckle(clipped)
    variation = np.where(number < _MANY_ECHOES, _with_neighbors(squares, variation), variation)
    several = unknown
    if column("number_of_returns") is not None:
        known = count.surface >= _LEAST_ECHOES
        several = np.divide(count.surface - count.single, count.surface, out=unknown.copy(), where=known)
    change = unknown if change_m is None else change_m[squares.index]
    ground, water = (count.right[code] > count.surface / 2 for code in (GROUND, WATER))
    return Echoes(
        variation,
        np.log(mean, out=unknown.copy(), where=mean > 0),
        several,
        count.tall / np.maximum(count.every, 1),
        change,
        are_moving(squares, change),
        water.astype(np.int8) - ground.astype(np.int8),
    )


@dataclass(frozen=True)
class _Counts:
    """Numbers of echoes of each square: of all, of those from its surface, and of these from pulses with one echo.

    The last also have the sums of their intensities and of the squares of these, and the number that are saturated.
    """

    every: Values
    tall: Values
    surface: Values
    right: Mapping[int, Values]
    single: Values
    intensity: Values
    squared: Values
    saturated: Values


def _counted(squares: Squares, points: GriddedPoints, top: Cells, column: Column, trusted: Collection[int]) -> _Counts:
    intensity, returns = column("intensity"), column("number_of_returns")
    classes = column("classification") if trusted else None
    saturated = None if intensity is None else saturated_echoes(intensity)
    size = squares_in(points.grid)
    every, tall, surface, single, one, two, full = (np.zeros(size) for _ in range(7))
    right = {code: np.zeros(size) for code in (GROUND, WATER)}
    high = np.full(size, np.inf)
    high[squares.index] = squares.level_m + _TALL_M
    start = 0
    for z, cell in points:
        used = np.flatnonzero(cell != NOWHERE)
        square = square_of(cell[used])
        every += np.bincount(square, minlength=size)
        tall += np.bincount(square, z[used] > high[square], size)
        low = z[used] <= top.reshape(-1)[cell[used]]
        used, square = used[low] + start, square[low]
        start += len(cell)
        surface += np.bincount(square, minlength=size)
        if classes is not None:
            for code in trusted:
                right[code] += np.bincount(square, classes[used] == code, size)
        if returns is not None:
            whole = returns[used] <= 1
            used, square = used[whole], square[whole]
        single += np.bincount(square, minlength=size)
        if intensity is not None:
            value = np.nan_to_num(intensity[used]).astype(np.float64)
            one += np.bincount(square, value, size)
            two += np.bincount(square, value**2, size)
            if saturated is not None:
                full += np.bincount(square, saturated[used], size)
    known, own = {code: values[squares.index] for code, values in right.items()}, squares.index
    return _Counts(every[own], tall[own], surface[own], known, single[own], one[own], two[own], full[own])


def _with_neighbors(squares: Squares, values: Values) -> Values:
    """Return the mean of the finite values of each square and those beside it, or NaN without any."""
    around = np.append(values, np.nan)[np.vstack((np.arange(len(values)), squares.neighbor))]
    known = np.isfinite(around)
    total = np.where(known, around, 0).sum(axis=0)
    return np.asarray(np.divide(total, known.sum(axis=0), out=np.full(len(values), np.nan), where=known.any(axis=0)))


def _is_whole(intensity: NDArray[Any] | None) -> bool:
    """Return whether intensities are whole numbers."""
    return intensity is not None and np.issubdtype(intensity.dtype, np.integer)


def saturated_echoes(intensity: NDArray[Any]) -> Mask | None:
    """Return which intensities are the highest; None if they are too rare to be a limit of the sensor."""
    highest = np.asarray(intensity == np.nanmax(intensity))
    return highest if np.count_nonzero(highest) > _LEAST_SATURATED * len(highest) else None


def _speckle(saturated: Values) -> Values:
    """Return the coefficient of variation of exponential intensities, of which a share is saturated: 1 for none."""
    below = 1 - saturated
    limit = -np.log(np.where((saturated > 0) & (below > 0), saturated, 1.0))  # in units of the mean of all
    variance = 2 * (below - saturated * limit) - below**2
    return np.sqrt(np.divide(variance, below**2, out=np.ones_like(below), where=limit > 0))
