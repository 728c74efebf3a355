"""What the beams of a lidar can meet in one frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.filters.confirmation.beams import Beams
from seaclutter_cli.water import WaterSurface

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Sight:
    """The beams over the water in one frame.

    Low objects far away often lie between two beams, and waves lift them in and out of sight. Only where a beam would
    have met an object does its absence show that it is gone.

    Parameters
    ----------
    beams : Beams
        Elevations of the beams.
    water : WaterSurface or None
        The water; without it, everything is in sight.
    min_top_m : float
        Minimum height of all objects above the water, in metres.
    """

    beams: Beams
    water: WaterSurface | None
    min_top_m: float

    def meets(self, positions: Floats, top_m: Floats) -> NDArray[np.bool_]:
        """Return whether any beam meets bodies between the water and a height above it.

        Parameters
        ----------
        positions : ndarray, shape (K, 2), float64
            Horizontal positions in metres.
        top_m : ndarray, shape (K,), float64
            Heights of their tops above the water, in metres.

        Returns
        -------
        ndarray, shape (K,), bool
        """
        if self.water is None:
            return np.ones(len(positions), np.bool_)
        x, y = positions.T
        level = self.water.height(x, y)
        tops = level + np.maximum(top_m, self.min_top_m)
        low, high = (self.beams.elevation_deg(np.array((x, y, z))) for z in (level, tops))
        return self.beams.pass_between(low, high)
