"""Joint intensity-space filter [Li2023], and the two of its stages that are also separate methods."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Interval, Len

from seaclutter_cli.arrays import Floats, Indices, Mask
from seaclutter_cli.filters.radius import Preset, isolated_by_range
from seaclutter_cli.filters.statistical import outliers
from seaclutter_cli.filters.zones import ZoneParams, Zones, ring_edges
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.interfaces import Filter
from seaclutter_cli.params import Count, NotNegative, Positive, Share, key


@dataclass(frozen=True, kw_only=True)
class RingIntensityParams(ZoneParams):
    """Parameters of the thresholds of the range rings."""

    ring_width_m: Positive = key(15.0, "Width of a range ring, d, in metres.")
    initial_thresholds: Annotated[tuple[float, ...], Len(1)] = key(
        (30, 16, 7, 4),
        "Initial intensity threshold of each range ring, I_0, in the sensor's unit; the default is for the "
        "RS-LiDAR-32 (Table 2 of [Li2023]).",
    )

    @property
    def edges(self) -> Floats:
        """Edges of the range rings in metres, shape (K + 1,)."""
        return self.from_start(ring_edges(self.own_ship_m, self.end_m, self.ring_width_m))

    def __post_init__(self) -> None:
        """Check that there is one threshold for each range ring."""
        super().__post_init__()
        rings = len(self.edges) - 1
        if len(self.initial_thresholds) != rings:
            span = f"{self.own_ship_m:g} to {self.end_m:g} m in range rings of {self.ring_width_m:g} m"
            raise ValueError(f"initial_thresholds: expected {rings} ({span}), got {len(self.initial_thresholds)}")


@dataclass(frozen=True, kw_only=True)
class RingIntensityOutlierParams(RingIntensityParams):
    """Parameters of the thresholds of the range rings and of the outlier stage."""

    max_neighbors: Count = key(30, "Maximum number of neighbours in a point's mean distance, n; for outlier_stage sor.")
    neighbor_fraction: Annotated[float, Interval(gt=0, le=1)] = key(
        0.1,
        "Share of a range ring's remaining points that count as neighbours, up to max_neighbors; for outlier_stage "
        "sor.",
    )
    std_ratio: NotNegative = key(
        1.0, "Standard deviations above the mean distance beyond which a point is an outlier; for outlier_stage sor."
    )
    outlier_stage: Literal["sor", "adaptive_radius"] = key(
        "sor",
        "Outlier rule: sor (mean distance to neighbours) or adaptive_radius (neighbours within a share of the range).",
    )
    outlier_radius_ratio: Positive | None = key(
        None, "Search radius divided by range, K; 0.025 if null; for outlier_stage adaptive_radius."
    )
    outlier_min_neighbors: Count | None = key(
        None,
        "Minimum number of other points within the search radius, N; 7 if null; for outlier_stage adaptive_radius.",
    )

    def __post_init__(self) -> None:
        """Reject keys that belong to the other outlier rule, and set the defaults of this one."""
        super().__post_init__()
        if self.outlier_preset is not None:
            for name, value in vars(self.outlier_preset).items():
                object.__setattr__(self, f"outlier_{name}", value)
            return
        for name in ("outlier_radius_ratio", "outlier_min_neighbors"):
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: valid only with outlier_stage adaptive_radius")

    @property
    def outlier_preset(self) -> Preset | None:
        """K and N for outlier_stage ``adaptive_radius``; None for ``sor``."""
        if self.outlier_stage == "sor":
            return None
        # More permissive than the adaptive radius filter, because the thresholds have already thinned out the points.
        ratio, needed = self.outlier_radius_ratio, self.outlier_min_neighbors
        return Preset(radius_ratio=0.025 if ratio is None else ratio, min_neighbors=7 if needed is None else needed)


@dataclass(frozen=True, kw_only=True)
class JointParams(RingIntensityOutlierParams):
    """Parameters of the joint filter."""

    update_weight: Share = key(
        0.6, "Weight of the initial threshold against the correction, u, from 0 to 1; 1 disables the correction."
    )


class _Thresholded:
    """A frame after the threshold stage of the range rings ([Li2023], Eq. 3 and 5), with N points and K range rings.

    ``low`` is whether each point is below its threshold, shape (N,).
    """

    def __init__(self, frame: Frame, zones: Zones, thresholds: Floats) -> None:
        intensity = frame.intensity
        self._frame, self._zones, self._thresholds = frame, zones, thresholds
        self._zone, self._reason = zones.divide(frame)
        self._low = intensity < zones.per_point(thresholds, self._zone)
        self._reason[self._low] = Reason.LOW_INTENSITY

    def outliers(self, params: RingIntensityOutlierParams) -> list[Indices]:
        """Return the indices of the outliers among the points of each range ring that passed (Eq. 6 and 7)."""
        xyz, members = self._frame.coordinates, self._zones.members(self._zone, ~self._low)
        preset = params.outlier_preset
        if preset is None:
            return [points[_outlying(xyz[:, points].T, params)] for points in members]
        together = np.concatenate(members)
        outlying = isolated_by_range(xyz[:, together].T, preset.radius_ratio, preset.min_neighbors)
        ends = np.cumsum([len(points) for points in members])
        return [points[found] for points, found in zip(members, np.split(outlying, ends[:-1]), strict=True)]

    def result(self, outliers: Sequence[Indices] = (), corrections: Floats | None = None) -> FilterResult:
        """Return the reasons of all points, and thresholds and counts of the range rings."""
        for points in outliers:
            self._reason[points] = Reason.OUTLIER
        rings = self._zones.rings(self._zone, self._reason, self._thresholds, corrections)
        return FilterResult(self._frame, self._reason, rings)


def _outlying(points: Floats, params: RingIntensityOutlierParams) -> Mask:
    """Return a mask of the outliers by mean distance among the points of a range ring, shape (n_k, 3)."""
    share = int(params.neighbor_fraction * len(points) + 1e-9)  # 0.29 of 100 is 29, slightly less in floats
    return outliers(points, max(1, min(params.max_neighbors, share)), params.std_ratio)


class RingIntensity(Filter):
    """Intensity threshold for each range ring.

    This is step 2 of the joint filter [Li2023].
    """

    Params: ClassVar[type[RingIntensityParams]] = RingIntensityParams

    def __init__(self, params: RingIntensityParams) -> None:
        super().__init__(params)
        self._zones, self._initial = Zones(params), np.asarray(params.initial_thresholds, np.float64)

    def reset(self) -> None:
        """Forget where own ship ends."""
        self._zones.reset()

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame, and thresholds and counts of the range rings."""
        return _Thresholded(frame, self._zones, self._initial).result()


class RingIntensityOutlier(RingIntensity):
    """Range-ring thresholds and outlier removal, no feedback.

    These are steps 2 and 3 of the joint filter [Li2023].
    """

    Params: ClassVar[type[RingIntensityOutlierParams]] = RingIntensityOutlierParams

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame, and thresholds and counts of the range rings."""
        passed = _Thresholded(frame, self._zones, self._initial)
        return passed.result(passed.outliers(self.params))


class Joint(RingIntensityOutlier):
    r"""Joint intensity-space filter with feedback [Li2023].

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

    Params: ClassVar[type[JointParams]] = JointParams

    def __init__(self, params: JointParams) -> None:
        super().__init__(params)
        self.reset()

    def reset(self) -> None:
        """Set the corrections to 0, and forget where own ship ends."""
        super().reset()
        self._correction = np.zeros(self._zones.count)

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame, and thresholds, corrections and counts of the range rings."""
        # 1. Range rings and 2. Threshold
        u, initial, correction = self.params.update_weight, self._initial, self._correction
        thresholds = np.where(correction != 0, u * initial + (1 - u) * correction, initial)
        passed = _Thresholded(frame, self._zones, thresholds)
        # 3. Outliers
        outliers = passed.outliers(self.params)
        result = passed.result(outliers, correction)
        # 4. Correction
        sums = [frame.intensity[points].sum() / (len(points) + 1) for points in outliers]
        self._correction = np.array(sums, np.float64)
        return result
