"""Stages of the joint method: thresholds of the range rings, and outliers among the points that pass them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.filters.adaptive_radius import isolated_by_range
from seaclutter_cli.filters.ring_params import RingIntensityOutlierParams, RingIntensityParams
from seaclutter_cli.filters.statistical import outliers
from seaclutter_cli.filters.zones import Zones
from seaclutter_cli.frame import FilterResult, Frame, Reason, Rings


class RingStage:
    """Threshold stage of the range rings; also assembles the result of a frame.

    Parameters
    ----------
    params : RingIntensityParams
        Config keys of the filter.
    """

    def __init__(self, params: RingIntensityParams) -> None:
        self.zones = Zones(params)
        self.initial = np.asarray(params.initial_thresholds, np.float64)

    def threshold(self, frame: Frame, thresholds: NDArray[np.float64]) -> "ThresholdedFrame":
        """Return the frame after the threshold stage ([Li2023], Eq. 3 and 5)."""
        intensity = frame.intensity
        zone, reason = self.zones.divide(frame)
        low = intensity < self.zones.per_point(thresholds, zone)
        reason[low] = Reason.LOW_INTENSITY
        return ThresholdedFrame(frame, thresholds, zone, reason, low)

    def result(
        self,
        passed: "ThresholdedFrame",
        outliers: Sequence[NDArray[np.intp]] = (),
        corrections: NDArray[np.float64] | None = None,
    ) -> FilterResult:
        """Return the reasons of all points, and thresholds and counts of the range rings."""
        found = np.zeros(self.zones.count, np.int64)
        for k, points in enumerate(outliers):
            passed.reason[points] = Reason.OUTLIER
            found[k] = len(points)
        used = np.zeros(self.zones.count) if corrections is None else corrections
        tally, beyond = self.zones.tally, self.zones.beyond(passed.zone, passed.reason)
        counts = tally(passed.zone), tally(passed.zone[passed.low]), found
        rings = Rings(passed.thresholds.copy(), used, *counts, beyond)
        return FilterResult(passed.frame, passed.reason, rings)


@dataclass(frozen=True)
class ThresholdedFrame:
    """Frame after the threshold stage, with N points and K range rings.

    Parameters
    ----------
    frame : Frame
        The frame as it was read.
    thresholds : ndarray, shape (K,), float64
        Thresholds used.
    zone, reason : ndarray, shape (N,), uint8
        Zone number and `Reason` of each point.
    low : ndarray, shape (N,), bool
        Whether a point is below its threshold.
    """

    frame: Frame
    thresholds: NDArray[np.float64]
    zone: NDArray[np.uint8]
    reason: NDArray[np.uint8]
    low: NDArray[np.bool_]


class OutlierStage:
    """Outlier stage of the range rings.

    Parameters
    ----------
    params : RingIntensityOutlierParams
        Config keys of the filter.
    """

    def __init__(self, params: RingIntensityOutlierParams) -> None:
        self._params, self._zones = params, Zones(params)

    def find(self, passed: ThresholdedFrame) -> list[NDArray[np.intp]]:
        """Return the indices of the outliers among each range ring's points that passed (Eq. 6 and 7)."""
        frame, members = passed.frame, self._zones.members(passed.zone, ~passed.low)
        preset = self._params.outlier_preset
        if preset is None:
            return [points[self._outlying(frame.coordinates[:, points].T)] for points in members]
        together = np.concatenate(members)
        outlying = isolated_by_range(frame.coordinates[:, together].T, preset.radius_ratio, preset.min_neighbors)
        ends = np.cumsum([len(points) for points in members])
        return [points[found] for points, found in zip(members, np.split(outlying, ends[:-1]), strict=True)]

    def _outlying(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return a mask of the outliers by mean distance among the points of a range ring, shape (n_k, 3)."""
        share = int(self._params.neighbor_fraction * len(points) + 1e-9)  # 0.29 of 100 is 29, slightly less in floats
        neighbors = max(1, min(self._params.max_neighbors, share))
        return outliers(points, neighbors, self._params.std_ratio)
