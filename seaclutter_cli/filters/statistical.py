"""Statistical outlier removal (SOR); with limits that grow with range for all points (DSOR) or weak ones (LIDSOR)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from seaclutter_cli.arrays import Floats, Indices, Mask
from seaclutter_cli.filters.base import ROUNDING, WholeFrameFilter, valid_points
from seaclutter_cli.frame import Frame
from seaclutter_cli.neighbors import mean_neighbor_distance
from seaclutter_cli.params import Count, NotNegative, Positive, key


def distances_and_limit(points: Floats, neighbors: int, std_ratio: float) -> tuple[Floats, float]:
    r"""Return each point's mean distance to its neighbours, and the limit :math:`\mathrm{mean}(d) + m\,\sigma(d)`.

    There are at least two points, shape (N, 3), finite. The distance :math:`d_i` is that to ``neighbors`` nearest other
    points, N - 1 if there are fewer; m is ``std_ratio``, the number of sample standard deviations.
    """
    distance = mean_neighbor_distance(np.ascontiguousarray(points), min(neighbors, len(points) - 1))
    return distance, float(distance.mean() + std_ratio * distance.std(ddof=1))


def outliers(points: Floats, neighbors: int, std_ratio: float) -> Mask:
    r"""Return a mask of the statistical outliers: points far from their neighbours ([Li2023], Eq. 6 and 7).

    .. math:: d_i > \lambda = \mathrm{mean}(d) + m\,\sigma(d)

    The arguments are those of `distances_and_limit`; a single point is not an outlier.
    """
    if len(points) < 2:
        return np.zeros(len(points), np.bool_)
    distance, limit = distances_and_limit(points, neighbors, std_ratio)
    return np.asarray(distance > limit * (1 + ROUNDING))


@dataclass(frozen=True, kw_only=True)
class SorParams:
    """Parameters of statistical outlier removal."""

    neighbors: Count = key(30, "Number of nearest other points in a point's mean distance, k.")
    std_ratio: NotNegative = key(
        1.0, "Standard deviations above the frame's mean distance beyond which a point is an outlier, m."
    )


class StatisticalOutlierRemoval(WholeFrameFilter[SorParams]):
    """Statistical outlier removal (SOR) over all valid points."""

    Params: ClassVar[type[SorParams]] = SorParams

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        return valid[outliers(points, self.params.neighbors, self.params.std_ratio)]


@dataclass(frozen=True, kw_only=True)
class DsorParams:
    """Parameters of dynamic statistical outlier removal."""

    neighbors: Count = key(4, "Number of nearest other points in a point's mean distance, k.")
    std_ratio: NotNegative = key(0.01, "Standard deviations added to the frame's mean distance for the limit, s.")
    range_multiplier_per_m: Positive = key(0.05, "Factor of the distance limit per metre of range, rho, in 1/m.")

    def distances_and_limits(self, points: Floats, range_m: Floats) -> tuple[Floats, Floats]:
        """Return each point's mean distance to its neighbours and its limit, both of shape (N,)."""
        distance, limit = distances_and_limit(points, self.neighbors, self.std_ratio)
        return distance, limit * self.range_multiplier_per_m * range_m


class DynamicStatisticalOutlierRemoval(WholeFrameFilter[DsorParams]):
    r"""Statistical outlier removal, limit grows with range (DSOR).

    Notes
    -----
    Let :math:`d_i` be the mean distance of a point to its k nearest other valid points, and :math:`\mu` and
    :math:`\sigma` the mean and sample standard deviation of :math:`d_i` over the frame. A point at range :math:`r_i` is
    removed if [1]_

    .. math:: d_i \ge (\mu + s\,\sigma)\,\rho\,r_i

    As in the authors' program, a distance equal to the limit is an outlier; if all distances are 0, all points are
    removed. Distances that differ only by rounding error are equal. If a frame has k valid points or fewer, all others
    are neighbours; a single point is kept. The defaults are those of the authors' launch file, where k = 5 includes the
    point itself.

    References
    ----------
    .. [1] Kurup Akhil, Bos Jeremy (2021). "DSOR: A Scalable Statistical Filter for Removing Falling Snow from LiDAR
       Point Clouds in Severe Winter Weather". arXiv:2109.07078
    """

    Params: ClassVar[type[DsorParams]] = DsorParams

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        if len(valid) < 2:
            return valid[:0]
        distance, limit = self.params.distances_and_limits(points, frame.range_m[valid])
        return valid[distance >= limit * (1 - ROUNDING)]


@dataclass(frozen=True, kw_only=True)
class LidsorParams(DsorParams):
    """Parameters of low-intensity dynamic statistical outlier removal."""

    neighbors: Count = 50
    std_ratio: NotNegative = 0.15
    intensity_threshold: float = key(5.0, "Intensity below which points may be removed, in the sensor's unit.")
    max_range_m: Positive = key(20.0, "Range below which points may be removed, in metres.")


class LowIntensityDynamicStatisticalOutlierRemoval(WholeFrameFilter[LidsorParams]):
    r"""DSOR restricted to weak, near points (LIDSOR).

    Notes
    -----
    :math:`d_i`, :math:`\mu` and :math:`\sigma` are computed over all valid points, as in DSOR. A point at range
    :math:`r_i` is removed if its intensity is below the threshold, its range below the maximum, and [1]_

    .. math:: d_i > (\mu + s\,\sigma)\,\rho\,r_i

    Unlike in DSOR, a distance equal to the limit is not an outlier; distances that differ only by rounding error are
    equal. If a frame has k valid points or fewer, all others are neighbours; a single point is kept. The defaults are
    those of the authors' program, where k = 50 includes the point itself; here k counts other points only.

    References
    ----------
    .. [1] Huang He, Yan Xinyuan, Yang Junxing, Cao Yuming, Zhang Xin (2023). "LIDSOR: A Filter for Removing Rain and
       Snow Noise Points from LiDAR Point Clouds in Rainy and Snowy Weather". The International Archives of the
       Photogrammetry, Remote Sensing and Spatial Information Sciences, XLVIII-1/W2-2023, 733-740.
    """

    Params: ClassVar[type[LidsorParams]] = LidsorParams

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        intensity, range_m = frame.intensity[valid], frame.range_m[valid]
        candidates = (intensity < self.params.intensity_threshold) & (range_m < self.params.max_range_m)
        if len(valid) < 2 or not candidates.any():
            return valid[:0]
        distance, limit = self.params.distances_and_limits(points, range_m)
        return valid[candidates & (distance > limit * (1 + ROUNDING))]
