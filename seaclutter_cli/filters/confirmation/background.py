"""What the water shows at the range of a point in other directions: how often it has echoes, and how bright."""

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SECTORS, _BESIDE = 72, 2
_NEAR_M, _PER_OCTAVE, _RINGS = 8.0, 8.0, 48
_MEMORY_S = 1.0
_DOUBT, _DIMMEST, _MOST_OCTAVES = 2.0, 1e-6, 4.0


class Background:
    """A map of the water's echoes around a lidar.

    Water has echoes all around at one range, a body in one direction. So what the water shows at a point is learned
    from other directions at its range, as in radar detectors with a constant rate of false alarms [1]_.

    **State**: how often each cell of 5° and about a fifth of its range had echoes of water in the last second, and the
    mean logarithm of their intensities.

    References
    ----------
    .. [1] Rohling (1983). "Radar CFAR thresholding in clutter and multiple target situations". IEEE Transactions on
       Aerospace and Electronic Systems 19(4).
    """

    def __init__(self) -> None:
        self._seen = np.zeros((_RINGS, _SECTORS))
        self._lit = np.zeros((2, _RINGS, _SECTORS))
        self._time_s = -math.inf

    def compare(self, xyz: Floats, intensity: Floats | None, of_water: Mask, time_s: float) -> tuple[Floats, Floats]:
        """Compare the N points of the next frame, shape (3, N), with the water at their ranges in other directions.

        Return the share of these in which the water has echoes, and by how many octaves each point is brighter than
        they are, at most 4, shape (N,) each; 0 without intensities. ``of_water``, shape (N,), tells which points may
        be echoes of the water. Where few directions have any, brightness says little.
        """
        kept = math.exp(-max(time_s - self._time_s, 0) / _MEMORY_S)
        self._time_s = time_s
        x, y, _ = xyz
        cell = np.minimum(_PER_OCTAVE * np.log2(1 + np.hypot(x, y) / _NEAR_M), _RINGS - 1).astype(np.int16)
        cell *= np.int16(_SECTORS)
        cell += ((np.arctan2(y, x) + np.pi) * (_SECTORS / (2 * np.pi))).astype(np.int16) % np.int16(_SECTORS)
        number = _grid(cell[of_water])
        self._seen = kept * self._seen + (1 - kept) * (_around(number) > 0)
        share = _elsewhere(self._seen) / (_SECTORS - 2 * _BESIDE - 1)
        if intensity is None:
            return np.asarray(share.reshape(-1)[cell]), np.zeros(len(cell))
        octaves = np.log2(np.where(np.isfinite(intensity), np.maximum(intensity, _DIMMEST), _DIMMEST))
        mean = _grid(cell[of_water], octaves[of_water]) / np.maximum(number, 1)
        self._lit = kept * self._lit + (1 - kept) * np.stack(((number > 0).astype(np.float64), mean))
        weight, total = (_elsewhere(_around(grid)).reshape(-1) for grid in self._lit)
        level = (total / np.maximum(weight, _DIMMEST))[cell]
        contrast = np.clip(octaves - level, -_MOST_OCTAVES, _MOST_OCTAVES) * (weight / (weight + _DOUBT))[cell]
        return np.asarray(share.reshape(-1)[cell]), contrast


def _grid(cell: NDArray[np.int16], weights: Floats | None = None) -> Floats:
    """Return the number of points of each cell, or the sum of their weights, shape (48, 72)."""
    return np.bincount(cell, weights, minlength=_RINGS * _SECTORS).reshape(_RINGS, _SECTORS).astype(np.float64)


def _around(grid: Floats) -> Floats:
    """Return the sums of each cell with those before and behind it."""
    around = grid.copy()
    around[1:] += grid[:-1]
    around[:-1] += grid[1:]
    return around


def _elsewhere(grid: Floats) -> Floats:
    """Return the sums over the ring of each cell, but for the directions beside it."""
    beside = np.sum([np.roll(grid, shift, axis=1) for shift in range(-_BESIDE, _BESIDE + 1)], axis=0)
    return np.asarray(grid.sum(axis=1, keepdims=True) - beside)
