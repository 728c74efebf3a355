"""Bodies of a frame: clusters that rise out of the water, or lie alone, whatever a filter did to their points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Indices, Ints, Mask
from seaclutter_cli.filters.confirmation import ConfirmedParams
from seaclutter_cli.filters.confirmation.echoes import Echoes, Sea
from seaclutter_cli.filters.confirmation.objects import Clusters
from seaclutter_cli.filters.zones import LEAST_M
from seaclutter_cli.frame import Frame
from seaclutter_cli.tracking.detections import Detections
from seaclutter_cli.water import Mounting

_MAX_BODIES = 1000
_MAX_RISE = 4.0


@dataclass(frozen=True)
class Bodies:
    """The K bodies of a frame.

    ``points``, shape (n,), are indices of points of the frame, body by body; those of a body begin at ``start``, shape
    (K,). ``found`` are the bodies for a tracker, ``top_m``, shape (K,), heights above the water, NaN without water.
    ``looks``, shape (5, K), are multiples of the height at which points stand out, at most 4; 1 where the water around
    has no echoes, 0 where it has many; numbers of neighbours that lie on one surface, and that do not; and sizes in
    metres. ``flat``, shape (N,), are the points of the frame near the water, ``height_m``, shape (N,), heights above it
    of the points in no body, NaN where unknown.
    """

    points: Indices
    start: Ints
    found: Detections
    top_m: Floats
    looks: Floats
    flat: Mask
    height_m: Floats

    def __len__(self) -> int:
        return len(self.start)

    def sums(self, values: NDArray[np.generic]) -> Ints:
        """Return the sums of whole numbers or truth values of the points of the frame over each body, shape (K,)."""
        return np.add.reduceat(values[self.points].astype(np.int64), self.start) if len(self) else np.empty(0, np.int64)


class BodyFinder:
    """The bodies of the frames of a recording, in their order.

    **State**: the water and its echoes, and the elevations of the beams.
    """

    def __init__(self, mounting: Mounting) -> None:
        roll, pitch = mounting.roll_deg, mounting.pitch_deg
        self._params = ConfirmedParams(use_intensity=False, mounting_roll_deg=roll, mounting_pitch_deg=pitch)
        self._sea = Sea(self._params)

    def find(self, frame: Frame, left_out: Mask, time_s: float) -> Bodies:
        """Return the bodies of a frame at a time, without points that are left out, such as own ship's structure."""
        index = np.flatnonzero(frame.valid & ~left_out & (frame.range_m >= LEAST_M))
        xyz = self._params.mounting.levelled(frame.coordinates.take(index, axis=1))
        echoes = Echoes(index, xyz, frame.range_m[index], None, np.ones(len(index), np.uint8))
        heights = self._sea.measure(echoes, np.full(len(index), -np.inf), time_s)
        among = heights.high | heights.upright
        among |= (heights.unseen >= 1) & (heights.height_m > -heights.rise_m) & ~heights.mirrored
        clusters = _largest(Clusters.among(self._sea, echoes, among))
        flat = np.zeros(frame.size, np.bool_)
        flat[index] = np.abs(heights.height_m) <= heights.rise_m
        points = index[clusters.points]
        height = np.full(frame.size, np.nan)
        if heights.water is not None:
            height[index] = heights.height_m
            height[points] = np.nan
        owner = np.repeat(np.arange(len(clusters)), clusters.count)
        found = Detections.made(frame.coordinates.take(points, axis=1), owner, len(clusters))
        if not len(clusters):
            return Bodies(points, clusters.start, found, np.empty(0), np.empty((5, 0)), flat, height)
        (top,) = clusters.ranked(heights.height_m, clusters.count - 1 - np.clip(clusters.count // 4, 0, 3))
        rise = np.minimum(top / clusters.mean(heights.rise_m), _MAX_RISE)
        top = top if heights.water is not None else np.full(len(top), np.nan)
        neighbours = clusters.sum(heights.linked), clusters.sum(heights.loose)
        sizes = np.hypot(*np.ptp(found.hulls, axis=1).T)
        looks = np.stack((rise, clusters.mean(heights.unseen), *neighbours, sizes))
        return Bodies(points, clusters.start, found, top, looks, flat, height)


def _largest(clusters: Clusters) -> Clusters:
    if len(clusters) <= _MAX_BODIES:
        return clusters
    chosen = np.sort(np.argsort(-clusters.count, kind="stable")[:_MAX_BODIES])
    count = clusters.count[chosen]
    points = np.concatenate([clusters.members(k) for k in chosen.tolist()])
    return Clusters(points, np.cumsum(count) - count, count)
