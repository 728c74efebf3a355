"""Statistical outlier removal whose limit grows with range: of all points (DSOR), and of weak ones only (LIDSOR)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from seaclutter_cli.filters.base import WholeFrameFilter, valid_points
from seaclutter_cli.filters.statistical import ROUNDING, distances_and_limit
from seaclutter_cli.frame import Frame


@dataclass(frozen=True, kw_only=True)
class DsorParams:
    """Dynamic statistical outlier removal.

    Parameters
    ----------
    neighbors : int
        Nearest other points, k.
    std_ratio : float
        Standard deviations that are added to the mean distance, s.
    range_multiplier_per_m : float
        Factor of the limit for each metre of range, :math:`rho`.
    """

    neighbors: Annotated[int, Ge(1)] = 4
    std_ratio: Annotated[float, Ge(0)] = 0.01
    range_multiplier_per_m: Annotated[float, Gt(0)] = 0.05


@dataclass(frozen=True, kw_only=True)
class LidsorParams(DsorParams):
    """Low-intensity dynamic statistical outlier removal.

    Parameters
    ----------
    intensity_threshold : float
        Intensity below which points may go, in the sensor's own unit.
    max_range_m : float
        Range before which points may go.
    """

    neighbors: Annotated[int, Ge(1)] = 50
    std_ratio: Annotated[float, Ge(0)] = 0.15
    intensity_threshold: float = 5.0
    max_range_m: Annotated[float, Gt(0)] = 20.0


class DynamicStatisticalOutlierRemoval(WholeFrameFilter):
    r"""Dynamic statistical outlier removal (DSOR): the limit grows with range.

    Parameters
    ----------
    params : DsorParams
        Config keys of the method.

    Notes
    -----
    With the mean distance :math:`d_i` to the k nearest other valid points, its mean :math:`\mu` and sample standard
    deviation :math:`\sigma` over the frame, a point at range :math:`r_i` goes if [1]_

    .. math:: d_i \ge (\mu + s\,\sigma)\,\rho\,r_i

    Equal to the limit is beyond it, as in the authors' program, so where all distances are 0, all points go. Distances
    that differ by rounding alone are equal. Defaults are those of the authors' launch file, whose k of 5 counts the
    point itself. Of k points or fewer, all others are neighbours; a single point stays.

    References
    ----------
    .. [1] Kurup Akhil, Bos Jeremy (2021). "DSOR: A Scalable Statistical Filter for Removing Falling Snow from LiDAR
       Point Clouds in Severe Winter Weather". arXiv:2109.07078
    """

    Params: ClassVar[type[DsorParams]] = DsorParams

    def __init__(self, params: DsorParams) -> None:
        self.params = params

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        if len(valid) < 2:
            return valid[:0]
        distance, limit = self._distances_and_limits(points, frame.range_m[valid])
        return valid[distance >= limit * (1 - ROUNDING)]

    def _distances_and_limits(
        self, points: NDArray[np.float64], range_m: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return each point's mean distance to its neighbours and its limit, both of shape (N,)."""
        distance, limit = distances_and_limit(points, self.params.neighbors, self.params.std_ratio)
        return distance, limit * self.params.range_multiplier_per_m * range_m


class LowIntensityDynamicStatisticalOutlierRemoval(DynamicStatisticalOutlierRemoval):
    r"""DSOR of weak and near points only (LIDSOR).

    Parameters
    ----------
    params : LidsorParams
        Config keys of the method.

    Notes
    -----
    With :math:`d_i`, :math:`\mu` and :math:`\sigma` over all valid points as in DSOR, a point at range :math:`r_i` goes
    if its intensity is below the threshold, its range below the largest, and [1]_

    .. math:: d_i > (\mu + m\,\sigma)\,\rho\,r_i

    Equal to a limit stays here; distances that differ by rounding alone are equal. Of k points or fewer, all others are
    neighbours; a single point stays. Defaults are those of the authors' program, whose k of 50 counts the point itself,
    while here it counts others.

    References
    ----------
    .. [1] Huang He, Yan Xinyuan, Yang Junxing, Cao Yuming, Zhang Xin (2023). "LIDSOR: A Filter for Removing Rain and
       Snow Noise Points from LiDAR Point Clouds in Rainy and Snowy Weather". The International Archives of the
       Photogrammetry, Remote Sensing and Spatial Information Sciences, XLVIII-1/W2-2023, 733-740.
    """

    Params: ClassVar[type[DsorParams]] = LidsorParams
    params: LidsorParams

    def __init__(self, params: LidsorParams) -> None:
        super().__init__(params)

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        intensity, range_m = frame.intensity[valid], frame.range_m[valid]
        candidates = (intensity < self.params.intensity_threshold) & (range_m < self.params.max_range_m)
        if len(valid) < 2 or not candidates.any():
            return valid[:0]
        distance, limit = self._distances_and_limits(points, range_m)
        return valid[candidates & (distance > limit * (1 + ROUNDING))]
