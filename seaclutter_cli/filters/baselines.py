"""Baselines: one intensity threshold for all ranges, one up to a maximum range, and no filtering."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from seaclutter_cli.arrays import Indices
from seaclutter_cli.filters.base import WholeFrameFilter
from seaclutter_cli.filters.histogram import IntensityHistogram
from seaclutter_cli.filters.zones import ZoneParams, Zones
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.interfaces import Filter
from seaclutter_cli.params import Positive, Share, key


@dataclass(frozen=True, kw_only=True)
class GlobalIntensityParams(ZoneParams):
    """Parameters of the global intensity threshold."""

    threshold: float | None = key(
        None, "Intensity below which points are removed, in the sensor's unit; null: derived from filter_rate."
    )
    filter_rate: Share = key(
        0.8, "Share of a recording's valid points from start_m to end_m to remove, 0 to 1, if threshold is null."
    )


class GlobalIntensity(Filter):
    """One intensity threshold for all ranges.

    This is the baseline of [Li2023].

    **State**: if ``threshold`` is None, a histogram of the recording's intensities (at most 5 MB), filled by
    `observe` in a first pass.
    """

    Params: ClassVar[type[GlobalIntensityParams]] = GlobalIntensityParams

    def __init__(self, params: GlobalIntensityParams) -> None:
        self._params, self._zones = params, Zones(params)
        self.needs_first_pass = params.threshold is None
        self.reset()

    def reset(self) -> None:
        """Discard the observed intensities, and where own ship ends."""
        self._zones.reset()
        self._histogram = IntensityHistogram()
        self._found: float | None = None

    def observe(self, frame: Frame) -> None:
        """Add the intensities of a frame to the histogram."""
        zone, _ = self._zones.divide(frame)
        self._histogram.add(frame.intensity[zone == 1])
        self._found = None

    @property
    def _threshold(self) -> float:
        if self._params.threshold is not None:
            return self._params.threshold
        if self._found is None:
            self._found = self._histogram.threshold(self._params.filter_rate)
        return self._found

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame; its single range ring spans ``start_m`` to ``end_m``."""
        zone, reason = self._zones.divide(frame)
        threshold = np.array([self._threshold])
        reason[frame.intensity < self._zones.per_point(threshold, zone)] = Reason.LOW_INTENSITY
        return FilterResult(frame, reason, self._zones.rings(zone, reason, threshold))


@dataclass(frozen=True, kw_only=True)
class NaiveParams:
    """Parameters of the naive filter."""

    intensity_threshold: float = key(1.0, "Intensity below which near points are removed, in the sensor's unit.")
    max_range_m: Positive = key(20.0, "Range below which weak points are removed, in metres.")


class Naive(WholeFrameFilter[NaiveParams]):
    """One intensity threshold up to a maximum range.

    A point is removed if its intensity is below the threshold and its range below the maximum; a point at either limit
    is kept. Other points have no influence.
    """

    Params: ClassVar[type[NaiveParams]] = NaiveParams
    reason = Reason.LOW_INTENSITY

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the weak, near points."""
        weak = frame.intensity < self.params.intensity_threshold
        return np.flatnonzero(frame.valid & weak & (frame.range_m < self.params.max_range_m))


class Nothing(Filter):
    """No filtering: every point is kept, invalid ones too."""

    def step(self, frame: Frame) -> FilterResult:
        """Return `Reason.KEPT` for every point of a frame."""
        return FilterResult(frame, np.zeros(frame.size, np.uint8))
