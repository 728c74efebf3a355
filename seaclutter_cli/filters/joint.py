"""Joint intensity-space filter [Li2023], and the two of its stages that are also separate methods."""

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.filters.base import BaseFilter
from seaclutter_cli.filters.ring_params import JointParams, RingIntensityOutlierParams, RingIntensityParams
from seaclutter_cli.filters.ring_stages import OutlierStage, RingStage
from seaclutter_cli.frame import FilterResult, Frame


class RingIntensity(BaseFilter):
    """Intensity threshold for each range ring.

    This is step 2 of the joint filter [Li2023].

    Parameters
    ----------
    params : RingIntensityParams
        Config keys of the method.
    """

    Params: ClassVar[type[RingIntensityParams]] = RingIntensityParams

    def __init__(self, params: RingIntensityParams) -> None:
        self._rings = RingStage(params)

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame, and thresholds and counts of the range rings."""
        return self._rings.result(self._rings.threshold(frame, self._rings.initial))


class RingIntensityOutlier(BaseFilter):
    """Range-ring thresholds and outlier removal, no feedback.

    These are steps 2 and 3 of the joint filter [Li2023].

    Parameters
    ----------
    params : RingIntensityOutlierParams
        Config keys of the method.
    """

    Params: ClassVar[type[RingIntensityParams]] = RingIntensityOutlierParams

    def __init__(self, params: RingIntensityOutlierParams) -> None:
        self._rings, self._outliers = RingStage(params), OutlierStage(params)

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame, and thresholds and counts of the range rings."""
        passed = self._rings.threshold(frame, self._rings.initial)
        return self._rings.result(passed, self._outliers.find(passed))


class Joint(BaseFilter):
    r"""Joint intensity-space filter with feedback [Li2023].

    Parameters
    ----------
    params : JointParams
        Config keys of the method.

    Notes
    -----
    For each frame, in order:

    1. Range rings (Eq. 3): ring k spans the ranges :math:`[d_s + (k-1)d,\; d_s + kd)`; the last ends at :math:`d_e`.
    2. Threshold (Eq. 4, 5): :math:`I_k = u I_{0,k} + (1-u) I_{m,k}` where :math:`I_{m,k} \neq 0`, otherwise
       :math:`I_{0,k}`; points with :math:`I \ge I_k` pass.
    3. Outliers (Eq. 6, 7) among the :math:`n_k` points of a range ring that pass: with
       :math:`n = \max(1, \min(30, \lfloor 0.1\, n_k \rfloor))` neighbours and their mean distance :math:`d_i`, a point
       is an outlier if :math:`d_i > \mathrm{mean}(d) + \sigma(d)`. A single point is kept. With
       ``outlier_stage: adaptive_radius``, a point is an outlier if fewer than N of the points that pass in any range
       ring lie within K times its range, as in the adaptive radius filter. This rule does not assume a common density
       within a range ring.
    4. Correction (Eq. 8) for the next frame, 0 where there are no outliers:
       :math:`I_{m,k} = \sum I_{\mathrm{outliers}} / (n_{\mathrm{outliers}} + 1)`.

    The paper leaves some details open. Its Table 1 prints u = 0.5, but its experiments use u = 0.6, the default here.
    The subscript k + 1 in Eq. 8 is read as the next frame, not the next range ring. The standard deviation is the
    sample standard deviation.

    **State**: one correction per range ring, shape (K,), 0 after `reset`. The first frame is thus filtered with the
    initial thresholds.

    References
    ----------
    .. [1] Li Zhengyu, Wang Hongdong, Wei Shengzhe, Lou Jiankun (2023). "Marine Lidar Intensity-Space
       Combined Filtering Method". Chinese Journal of Lasers. doi:10.3788/CJL221207
    """

    Params: ClassVar[type[RingIntensityParams]] = JointParams

    def __init__(self, params: JointParams) -> None:
        self._weight = params.update_weight
        self._rings, self._outliers = RingStage(params), OutlierStage(params)
        self.reset()

    def reset(self) -> None:
        """Set the corrections to 0."""
        self._correction = np.zeros(self._rings.zones.count)

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame, and thresholds, corrections and counts of the range rings."""
        # 1. Range rings and 2. Threshold
        passed = self._rings.threshold(frame, self._thresholds())
        # 3. Outliers
        outliers = self._outliers.find(passed)
        result = self._rings.result(passed, outliers, self._correction)
        # 4. Correction
        sums = [frame.intensity[points].sum() / (len(points) + 1) for points in outliers]
        self._correction = np.array(sums, np.float64)
        return result

    def _thresholds(self) -> NDArray[np.float64]:
        """Return the thresholds of the next frame (Eq. 4)."""
        u, initial, correction = self._weight, self._rings.initial, self._correction
        return np.where(correction != 0, u * initial + (1 - u) * correction, initial)
