"""Filter with one intensity threshold for all ranges: the baseline of [Li2023]."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Interval

from seaclutter_cli.filters.base import BaseFilter
from seaclutter_cli.filters.histogram import IntensityHistogram
from seaclutter_cli.filters.zones import ZoneParams, Zones
from seaclutter_cli.frame import FilterResult, Frame, Reason, Rings


@dataclass(frozen=True, kw_only=True)
class GlobalIntensityParams(ZoneParams):
    """Parameters of the global intensity threshold.

    Parameters
    ----------
    threshold : float or None
        Intensity below which points are removed, in the sensor's unit; null: derived from ``filter_rate``.
    filter_rate : float
        Share of a recording's valid points from ``start_m`` to ``end_m`` to remove, 0 to 1, if ``threshold`` is null.
    """

    threshold: float | None = None
    filter_rate: Annotated[float, Interval(ge=0, le=1)] = 0.8


class GlobalIntensity(BaseFilter):
    """One intensity threshold for all ranges.

    **State**: if ``threshold`` is None, a histogram of the recording's intensities (at most 5 MB), filled by
    `observe` in a first pass.

    Parameters
    ----------
    params : GlobalIntensityParams
        Config keys of the method.
    """

    Params: ClassVar[type[GlobalIntensityParams]] = GlobalIntensityParams

    def __init__(self, params: GlobalIntensityParams) -> None:
        self.params = params
        self.needs_first_pass = params.threshold is None
        self._zones = Zones(params)
        self.reset()

    def reset(self) -> None:
        """Discard the observed intensities."""
        self._histogram = IntensityHistogram()
        self._found: float | None = None

    def observe(self, frame: Frame) -> None:
        """Add the intensities of a frame to the histogram."""
        zone, _ = self._zones.divide(frame)
        self._histogram.add(frame.intensity[zone == 1])
        self._found = None

    @property
    def threshold(self) -> float:
        """Intensity threshold in use."""
        if self.params.threshold is not None:
            return self.params.threshold
        if self._found is None:
            self._found = self._histogram.threshold(self.params.filter_rate)
        return self._found

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame; its single range ring spans ``start_m`` to ``end_m``."""
        zone, reason = self._zones.divide(frame)
        threshold = np.array([self.threshold])
        low = frame.intensity < self._zones.per_point(threshold, zone)
        reason[low] = Reason.LOW_INTENSITY
        tally = self._zones.tally
        counts = tally(zone), tally(zone[low]), np.zeros(1, np.int64)
        rings = Rings(threshold, np.zeros(1), *counts, self._zones.beyond(zone, reason))
        return FilterResult(frame, reason, rings)
