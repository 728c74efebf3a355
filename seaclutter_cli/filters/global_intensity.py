"""One intensity threshold for all ranges: the method that S0 sets out to improve."""

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
    """One threshold.

    Parameters
    ----------
    threshold : float or None
        Intensity below which points go, in the sensor's own unit. None: found from ``filter_rate``.
    filter_rate : float
        Share of a recording's valid points between ``start_m`` and ``end_m`` that are to go.
    """

    threshold: float | None = None
    filter_rate: Annotated[float, Interval(ge=0, le=1)] = 0.8


class GlobalIntensity(BaseFilter):
    """Drop what is weaker than one threshold.

    **State**: where ``threshold`` is None, a histogram of the recording's intensities (at most 5 MB), filled by
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
        """Forget the intensities seen."""
        self._histogram = IntensityHistogram()
        self._found: float | None = None

    def observe(self, frame: Frame) -> None:
        """Count the intensities of a frame."""
        zone, _ = self._zones.divide(frame)
        self._histogram.add(frame.intensity[zone == 1])
        self._found = None

    @property
    def threshold(self) -> float:
        """The threshold in use."""
        if self.params.threshold is not None:
            return self.params.threshold
        if self._found is None:
            self._found = self._histogram.threshold(self.params.filter_rate)
        return self._found

    def step(self, frame: Frame) -> FilterResult:
        """Return a reason for every point of a frame; the one ring reaches from ``start_m`` to ``end_m``."""
        zone, reason = self._zones.divide(frame)
        threshold = np.array([self.threshold])
        low = frame.intensity < self._zones.per_point(threshold, zone)
        reason[low] = Reason.LOW_INTENSITY
        tally = self._zones.tally
        rings = Rings(threshold, np.zeros(1), tally(zone), tally(zone[low]), np.zeros(1, np.int64))
        return FilterResult(frame, reason, rings)
