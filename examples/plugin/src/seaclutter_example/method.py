"""A filter method of one frame."""

from dataclasses import dataclass

import numpy as np

from seaclutter.plugins import Filter, FilterResult, Frame, Positive, Reason, Share, key


@dataclass(frozen=True, kw_only=True)
class AboveWaterParams:
    """Keys of the method in a configuration."""

    water_share: Share = key(0.25, "Share of the points, the lowest ones, whose median height is the water's.")
    height_m: Positive = key(0.8, "Height above the water below which points are removed, in metres.")


class AboveWater(Filter):
    """Removes what is less than a height above the water, the median of the lowest points."""

    Params = AboveWaterParams

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame."""
        reason = np.where(frame.valid, Reason.KEPT, Reason.INVALID).astype(np.uint8)
        heights = np.sort(frame.xyz[frame.valid, 2])
        if len(heights):
            water = np.median(heights[: max(1, round(self.params.water_share * len(heights)))])
            reason[frame.valid & (frame.xyz[:, 2] < water + self.params.height_m)] = Reason.OUTLIER
        return FilterResult(frame, reason)
