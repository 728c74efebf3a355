"""Elevations of a lidar's beams, learned from its points, and what they can meet in a frame."""

import numpy as np

from seaclutter_cli.arrays import Floats, Ints, Mask
from seaclutter_cli.water.mounting import Mounting
from seaclutter_cli.water.surface import WaterSurface

_BIN_DEG = 0.1
_HALF_DEG = 90.0
_BINS = round(2 * _HALF_DEG / _BIN_DEG) + 1
_FRAMES = 50
_OPEN_DEG = 3.0


class Beams:
    """The elevations at which a lidar has points.

    They show how much of a body the beams can miss. Where a single beam meets it, its height can be anything up to the
    next beam above. ``spacing_deg`` is the median angle between neighbouring beams; 0 if it is not known.
    """

    def __init__(self, mounting: Mounting) -> None:
        self._mounting = mounting
        self._upwards = 1.0 if mounting.up[2] >= 0 else -1.0
        self._seen = np.zeros(_BINS, np.bool_)
        self._frames = 0
        self._update()

    def elevation_deg(self, xyz: Floats) -> Floats:
        """Return the elevations of points of the levelled frame, shape (3, N), in the frame of the lidar, shape (N,).

        They increase upwards, even if the lidar is upside down.
        """
        x, y, z = self._mounting.unlevelled(xyz)
        return np.asarray(np.degrees(np.arctan2(self._upwards * z, np.hypot(x, y))))

    def add(self, xyz: Floats) -> None:
        """Add the elevations of the points of a frame, shape (3, N), until 50 frames have shown all beams."""
        if self._frames < _FRAMES and xyz.size:
            self._frames += 1
            found = _bins(self.elevation_deg(xyz))
            if not self._seen[found].all():
                self._seen[found] = True
                self._update()

    def meet(self, water: WaterSurface, positions: Floats, tops_m: Floats) -> Mask:
        """Return whether any beam meets bodies at horizontal positions, shape (K, 2), of heights above the water, (K,).

        Low objects far away often lie between two beams, and waves lift them in and out of sight. Only where a beam
        would have met an object does its absence show that it is gone.
        """
        x, y = positions.T
        level = water.height(x, y)
        low, high = (_bins(self.elevation_deg(np.array((x, y, z)))) for z in (level, level + tops_m))
        return np.asarray(self._count[high + 1] > self._count[low])

    def gaps(self, lowest_deg: Floats, highest_deg: Floats) -> tuple[Floats, Floats]:
        """Return the angles from the lowest points of K bodies to the beams below, and from the highest to those above.

        At the edge of the field of view, the angle is 3°. All arrays have the shape (K,).
        """
        return self._below_deg[_bins(lowest_deg)], self._above_deg[_bins(highest_deg)]

    def _update(self) -> None:
        """Derive the beams around each elevation, and their spacing, from the elevations seen so far."""
        seen, every = np.flatnonzero(self._seen), np.arange(_BINS)
        # The points of one beam can be in two bins.
        below = np.concatenate(([-np.inf], seen))[np.searchsorted(seen, every - 1)]
        above = np.concatenate((seen, [np.inf]))[np.searchsorted(seen, every + 1, side="right")]
        self._below_deg = np.minimum((every - below) * _BIN_DEG, _OPEN_DEG)
        self._above_deg = np.minimum((above - every) * _BIN_DEG, _OPEN_DEG)
        self._count = np.concatenate(([0], np.cumsum(self._seen)))
        steps = np.diff(seen)
        steps = steps[steps > 1]
        self.spacing_deg = float(np.median(steps)) * _BIN_DEG if len(steps) else 0.0


def _bins(elevation_deg: Floats) -> Ints:
    return np.rint((elevation_deg + _HALF_DEG) / _BIN_DEG).astype(np.int64)
