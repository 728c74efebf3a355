"""Points against the water: what stands out, what is bright, what stands upright."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.filters.confirmation.levelled import levelled
from seaclutter_cli.filters.confirmation.params import ConfirmedParams
from seaclutter_cli.filters.zones import Zones
from seaclutter_cli.frame import Frame, Reason
from seaclutter_cli.water import WaterSurface

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

OWN_SHIP_M = 3.0
_RISE_PER_M = 0.006
_RISE_FROM_M = 30.0
_WAVE_SIGMAS = 6.0
_GROWTH_SIGMAS = 1.5
_UNSEEN_M = 100.0


@dataclass(frozen=True)
class Heights:
    """The N points of a frame against the water; all arrays have shape (N,).

    Parameters
    ----------
    zone, reason : ndarray, uint8
        Zone number, and the `Reason` that follows from it.
    used : ndarray, bool
        Whether a point may belong to water or objects: valid, not excluded, not far if far points are dropped, and at
        least 3 m away.
    height_m, rise_m, wave_m : ndarray, float64
        Height above the water, height at which a point stands out, and height that no wave reaches.
    high, bright, low, upright, grows : ndarray, bool
        Whether a point stands out; is near the water and reaches its threshold; does not reach it; is in a column with
        echoes at several heights; is high enough to return to a confirmed object.
    brightness : ndarray, float64
        Intensity divided by the threshold; 0 without thresholds.
    sigma_m : float
        Standard deviation of the water; 0 without water.
    """

    zone: NDArray[np.uint8]
    reason: NDArray[np.uint8]
    used: Mask
    height_m: Floats
    rise_m: Floats
    wave_m: Floats
    high: Mask
    bright: Mask
    low: Mask
    upright: Mask
    grows: Mask
    brightness: Floats
    sigma_m: float


@dataclass(frozen=True)
class ZonedFrame:
    """A frame divided into zones.

    Parameters
    ----------
    frame : Frame
        The frame, with its points in the levelled frame.
    zone, reason : ndarray, shape (N,), uint8
        Zone number of each point, and the `Reason` that follows from it.
    threshold : ndarray, shape (N,), float64
        Intensity threshold of each point; minus infinity beyond the range rings. Near points have the first threshold.
    own_ship_m : float
        Range below which points belong to nothing but own ship, in metres.
    """

    frame: Frame
    zone: NDArray[np.uint8]
    reason: NDArray[np.uint8]
    threshold: Floats
    own_ship_m: float

    @classmethod
    def of(cls, frame: Frame, zones: Zones, thresholds: Floats, params: ConfirmedParams) -> "ZonedFrame":
        """Return the frame of a lidar with the zones of its points."""
        zone, reason = zones.divide(frame)
        threshold = zones.per_point(thresholds, zone)
        threshold[zone == 0] = thresholds[0]
        return cls(levelled(frame, params.mounting), zone, reason, threshold, min(OWN_SHIP_M, params.start_m))

    @cached_property
    def used(self) -> Mask:
        """Whether a point may belong to water or objects, shape (N,)."""
        in_reach = (self.reason == Reason.KEPT) | (self.reason == Reason.NEAR)
        return np.asarray(in_reach & (self.frame.range_m >= self.own_ship_m))


def measure(zoned: ZonedFrame, water: WaterSurface | None, params: ConfirmedParams) -> Heights:
    """Return the points of a frame against the water. Without water, every point stands out."""
    frame, used = zoned.frame, zoned.used
    x, y, z = np.where(used, frame.coordinates, 0.0)
    if water is None:
        height, deviation, sigma = z + _UNSEEN_M, np.zeros(frame.size), 0.0
    else:
        (height, deviation), sigma = water.above(x, y, z), water.sigma_m
    beyond = _RISE_PER_M * np.maximum(frame.range_m - _RISE_FROM_M, 0)
    rise = np.maximum(params.min_rise_m, params.rise_sigmas * deviation) + beyond
    high = used & (height > rise)
    reached, brightness = _brightness(zoned) if params.use_intensity else (~used, np.zeros(frame.size))
    stands = np.zeros(frame.size, np.bool_)
    if water is not None:
        stands[used] = water.upright
    return Heights(
        zoned.zone,
        zoned.reason,
        used,
        height,
        rise,
        _WAVE_SIGMAS * deviation + beyond,
        high,
        used & reached & (np.abs(height) <= rise),
        used & ~reached,
        stands,
        used & (height > np.maximum(params.growth_height_m, _GROWTH_SIGMAS * deviation)),
        brightness,
        sigma,
    )


def _brightness(zoned: ZonedFrame) -> tuple[Mask, Floats]:
    """Return which points reach their threshold, and intensity divided by threshold."""
    intensity, threshold = zoned.frame.intensity, zoned.threshold
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(threshold > 0, intensity / threshold, 1.0)
    return intensity >= threshold, ratio
