"""The points of a frame that may belong to water or objects."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.filters.confirmation.params import ConfirmedParams
from seaclutter_cli.frame import Frame, Reason

Floats = NDArray[np.float64]

OWN_SHIP_M = 3.0


@dataclass(frozen=True, eq=False)
class Echoes:
    """The M points of a frame that may belong to water or objects.

    They are valid, not excluded, not far if far points are dropped, and at least 3 m away.

    Parameters
    ----------
    index : ndarray, shape (M,), int64
        Their indices in the frame.
    xyz : ndarray, shape (3, M), float64
        Their coordinates in the levelled frame in metres.
    range_m : ndarray, shape (M,), float64
        Their distances from the lidar.
    intensity : ndarray, shape (M,), float64, or None
        Their intensities, unless the method ignores them.
    zone : ndarray, shape (M,), uint8
        Their zones; 0 is nearer than ``start_m``.
    """

    index: NDArray[np.intp]
    xyz: Floats
    range_m: Floats
    intensity: Floats | None
    zone: NDArray[np.uint8]

    @classmethod
    def of(cls, frame: Frame, zone: NDArray[np.uint8], reason: NDArray[np.uint8], params: ConfirmedParams) -> "Echoes":
        """Return the echoes among the points of a frame, given their zones and the reasons that follow from them."""
        in_reach = (reason == Reason.KEPT) | (reason == Reason.NEAR)
        index = np.flatnonzero(in_reach & (frame.range_m >= min(OWN_SHIP_M, params.start_m)))
        every = len(index) == frame.size  # no copies of whole frames
        used = slice(None) if every else index
        xyz = params.mounting.levelled(frame.coordinates if every else frame.coordinates.take(index, axis=1))
        intensity = frame.intensity[used] if params.use_intensity else None
        return cls(index, xyz, frame.range_m[used], intensity, zone[used])

    @property
    def size(self) -> int:
        """Number of echoes, M."""
        return len(self.index)

    @property
    def is_near(self) -> NDArray[np.bool_]:
        """Whether they are nearer than ``start_m``, shape (M,)."""
        return np.asarray(self.zone == 0)
