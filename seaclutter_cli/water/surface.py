"""The water surface of one frame: a plane, the swell on it, and the uncertainty of both."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.frame import WaterState
from seaclutter_cli.water.plane import Plane

Cells = NDArray[np.int32]

_REACH_M = 60.0
_CELL_M = 1.5
_CELLS = int(2 * _REACH_M / _CELL_M)
BEYOND = _CELLS**2
"""Number of the cell beyond the grid."""
_SMOOTHING_M = 2.5
_TRUNCATION = 4.0
_WEIGHTS = int(_TRUNCATION * _SMOOTHING_M / _CELL_M)
_MAX_PER_CELL = 3
_COARSE = 4
_MIN_DEPTH_M, _DEPTH_SIGMAS = 0.3, 4.5
_LONG_WAVES = 5.0
_SHRINKAGE = 2.0
_ROUGHNESS = 0.5
RANGE_NOISE_M = 0.02
_DECIMALS = 9


def grid_cells(x: Floats, y: Floats) -> Cells:
    """Return the cells of N positions in metres on a grid of 1.5 m within 60 m, shape (N,); 6400 beyond the grid."""
    column, row = (x + _REACH_M) / _CELL_M, (y + _REACH_M) / _CELL_M
    inside = (column >= 0) & (column < _CELLS) & (row >= 0) & (row < _CELLS)
    with np.errstate(invalid="ignore"):  # positions far beyond the grid have no integer
        cells = column.astype(np.int32) * np.int32(_CELLS) + row.astype(np.int32)
    cells[~inside] = BEYOND
    return cells


def beside(cells: Cells, bodies: Mask) -> Mask:
    """Return which of N positions are in the cells of others, ``bodies``, or next to them, shape (N,).

    Beyond the grid, all are.
    """
    body = np.zeros(BEYOND + 1, np.bool_)
    body[cells[bodies]] = True
    around = np.zeros((_CELLS + 2, _CELLS + 2), np.bool_)
    around[1:-1, 1:-1] = body[:BEYOND].reshape(_CELLS, _CELLS)
    rows = around[:-2] | around[1:-1] | around[2:]
    body[:BEYOND] = (rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]).reshape(-1)
    body[BEYOND] = True
    return body[cells]


def swell_of(cells: Cells, height: Floats, echoes: Mask) -> Floats:
    """Return the swell through those of N points that are echoes of the water, shape (2, 6401).

    It is the height of the water above its mean plane in each cell, a mean over 2.5 m, shrunk towards 0 where echoes
    are few, and how many echoes it rests on. Both are 0 beyond the grid.
    """
    used = np.flatnonzero(echoes)
    count = np.bincount(cells[used], minlength=BEYOND + 1)
    total = np.bincount(cells[used], weights=height[used], minlength=BEYOND + 1)
    grids: Floats = np.stack((total, count.astype(np.float64)))
    many = np.flatnonzero(count > _MAX_PER_CELL)
    grids[0, many] *= _MAX_PER_CELL / count[many]
    grids[1, many] = _MAX_PER_CELL
    grids[:, :-1] = _smoothed(grids[:, :-1].reshape(2, _CELLS, _CELLS)).reshape(2, -1)
    grids[:, -1] = 0
    grids[0] /= grids[1] + _SHRINKAGE
    return grids


def _smoothed(grids: Floats) -> Floats:
    """Return grids, shape (2, 80, 80), summed along both axes with Gaussian weights, in halves: most weights are 0."""
    weights, middle = _smoothing(), _CELLS // 2
    along, across = np.empty_like(grids), np.empty_like(grids)
    halves = (slice(middle), slice(middle + _WEIGHTS)), (slice(middle, None), slice(middle - _WEIGHTS, None))
    for half, used in halves:
        np.matmul(weights[half, used], grids[:, used], out=along[:, half])
    for half, used in halves:
        np.matmul(along[:, :, used], weights[used, half], out=across[:, :, half])
    return across


@cache
def _smoothing() -> Floats:
    """Return the matrix that sums a grid along one axis with Gaussian weights, cut off at four deviations."""
    steps = np.abs(np.subtract.outer(np.arange(_CELLS), np.arange(_CELLS))) * (_CELL_M / _SMOOTHING_M)
    return np.asarray(np.where(steps <= _TRUNCATION, np.exp(-0.5 * steps**2), 0.0))


@dataclass(frozen=True)
class WaterSurface:
    """The water around a lidar in one frame: its mean plane, the standard deviation around it, and the swell above it.

    ``level_deviation_m`` is the standard deviation of the error of the plane at the lidar, ``covariance``, shape
    (3, 3), that of the errors of its level and slopes.
    """

    plane: Plane
    sigma_m: float
    swell: Floats
    level_deviation_m: float
    covariance: Floats

    def above(self, x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the height of points above the water, its standard deviation, and how many echoes show the water.

        Heights and deviations are in metres.

        Notes
        -----
        Where many echoes support the swell, half of the deviation remains as waves too short for the grid. Where there
        are none, only the plane is known.
        """
        swell, echoes = self.swell.take(grid_cells(x, y), axis=1)
        unknown = _SHRINKAGE / (echoes + _SHRINKAGE)
        deviation = self.sigma_m * np.sqrt(_ROUGHNESS**2 + unknown) + RANGE_NOISE_M
        return z - self.plane.height(x, y) - swell, deviation, echoes

    def below(self, x: Floats, y: Floats, height: Floats, deviation: Floats, bodies: Mask) -> tuple[Mask, Mask]:
        """Return which of N echoes are below the water, as images and noise are, and which are images, shape (N,) each.

        The image of a body lies under it, as deep as the body is high; ``bodies``, shape (N,), are the echoes of
        bodies. An echo with no body in its cell of 6 m or a neighbouring one must be far below the water: in simulated
        swell longer than the view, errors of the plane are up to seven times those that independent cells leave.
        """
        rows = np.stack((np.ones_like(x), x, y))
        of_plane = np.sum(rows * (self.covariance @ rows), axis=0)
        below, far_below = (
            height < -np.maximum(_MIN_DEPTH_M, _DEPTH_SIGMAS * np.sqrt(deviation**2 + factor**2 * of_plane))
            for factor in (1, _LONG_WAVES)
        )
        mirrored = below & beside(grid_cells(x / _COARSE, y / _COARSE), bodies & ~below)
        return far_below | mirrored, mirrored

    def height(self, x: Floats, y: Floats) -> Floats:
        """Return z of the water at given positions, in metres."""
        return np.asarray(self.plane.height(x, y) + self.swell[0, grid_cells(x, y)])

    @property
    def state(self) -> WaterState:
        """Level, attitude, wave height and deviation of the level, without the digits in which processors differ."""
        roll, pitch = np.degrees(np.arctan((-self.plane.slope_y, self.plane.slope_x))).tolist()
        values = self.plane.level_m, roll, pitch, 4 * self.sigma_m, self.level_deviation_m
        return WaterState(*(round(value, _DECIMALS) for value in values))
