"""How often the water has echoes at the range of a point, and rows of them, in other directions."""

import math

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Mask

_SECTORS, _BESIDE = 72, 2
_NEAR_M, _PER_OCTAVE, _RINGS = 8.0, 8.0, 48
_LENGTHS = 8
_MEMORY_S = 6.0


class Background:
    """A map of the water's echoes around a lidar.

    Water has echoes all around at one range, a body in one direction, or longer rows of them there. So what the water
    shows at a point is learned from other directions at its range, as in radar detectors with a constant rate of false
    alarms [1]_.

    **State**: how often each cell of 5° and about a fifth of its range had rows of echoes of water in the last six
    seconds, for each octave of their length.

    References
    ----------
    .. [1] Rohling (1983). "Radar CFAR thresholding in clutter and multiple target situations". IEEE Transactions on
       Aerospace and Electronic Systems 19(4).
    """

    def __init__(self) -> None:
        self._seen = np.zeros((_LENGTHS, _RINGS, _SECTORS))
        self._time_s = -math.inf

    def shares(self, xyz: Floats, run: NDArray[np.int32], of_water: Mask, time_s: float) -> tuple[Floats, Floats]:
        """Return the shares of the other directions in which the water has echoes, and rows of them, at N points, (N,).

        The points of the next frame, shape (3, N), are in rows of ``run`` echoes, shape (N,). Some may be echoes of the
        water, ``of_water``, shape (N,). The water's rows count that have as many echoes as the row of a point, rounded
        down to a power of two.
        """
        kept = math.exp(-max(time_s - self._time_s, 0) / _MEMORY_S)
        self._time_s = time_s
        x, y, _ = xyz
        cell = np.minimum(np.log2(run), _LENGTHS - 1).astype(np.int16) * np.int16(_RINGS)
        cell += np.minimum(_PER_OCTAVE * np.log2(1 + np.hypot(x, y) / _NEAR_M), _RINGS - 1).astype(np.int16)
        cell *= np.int16(_SECTORS)
        cell += ((np.arctan2(y, x) + np.pi) * (_SECTORS / (2 * np.pi))).astype(np.int16) % np.int16(_SECTORS)
        seen = np.bincount(cell[of_water], minlength=self._seen.size).reshape(self._seen.shape) > 0
        seen = np.logical_or.accumulate(seen[::-1])[::-1]  # of that length, or longer
        around = seen.copy()
        around[:, 1:] |= seen[:, :-1]
        around[:, :-1] |= seen[:, 1:]
        self._seen = kept * self._seen + (1 - kept) * around
        beside = np.sum([np.roll(self._seen, shift, axis=2) for shift in range(-_BESIDE, _BESIDE + 1)], axis=0)
        others = (self._seen.sum(axis=2, keepdims=True) - beside) / (_SECTORS - 2 * _BESIDE - 1)
        return others[0].reshape(-1)[cell % others[0].size], others.reshape(-1)[cell]
