"""The joint intensity-space filter of Li et al. 2023 (S0), and the two stages of it that are methods of their own."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Interval, Len
from numpy.typing import NDArray

from seaclutter_cli.filters.adaptive_radius import Preset, sparse
from seaclutter_cli.filters.base import BaseFilter
from seaclutter_cli.filters.statistical import outliers
from seaclutter_cli.filters.zones import ZoneParams, Zones, ring_edges
from seaclutter_cli.frame import FilterResult, Frame, Reason, Rings


@dataclass(frozen=True, kw_only=True)
class RingIntensityParams(ZoneParams):
    """Ring thresholds.

    Parameters
    ----------
    ring_width_m : float
        Width of a ring, :math:`d`.
    initial_thresholds : tuple of float
        :math:`I_0`, one per ring, in the sensor's own intensity unit. The default is Table 2, for RS-LiDAR-32.
    """

    ring_width_m: Annotated[float, Gt(0)] = 15.0
    initial_thresholds: Annotated[tuple[float, ...], Len(1)] = (30, 16, 7, 4)

    @property
    def edges(self) -> NDArray[np.float64]:
        """Edges of the rings in metres, shape (K + 1,)."""
        return ring_edges(self.start_m, self.end_m, self.ring_width_m)

    def __post_init__(self) -> None:
        """Check that there is a threshold for each ring."""
        super().__post_init__()
        rings = len(self.edges) - 1
        if len(self.initial_thresholds) != rings:
            span = f"{self.start_m:g} to {self.end_m:g} m in rings of {self.ring_width_m:g} m"
            raise ValueError(f"initial_thresholds has {len(self.initial_thresholds)} values, {span} need {rings}")


@dataclass(frozen=True, kw_only=True)
class RingIntensityOutlierParams(RingIntensityParams):
    """Ring thresholds and the search for outliers.

    Parameters
    ----------
    max_neighbors : int
        Upper bound of n, the neighbours that count.
    neighbor_fraction : float
        Share of a ring's points that count as neighbours below that bound.
    std_ratio : float
        Standard deviations above the mean at which a point is an outlier.
    outlier_stage : {"sor", "adaptive_radius"}
        Rule for outliers: the three keys above, or a radius that grows with range: the two keys below.
    outlier_radius_ratio : float or None
        Search radius by range, K; 0.025 if nothing is said.
    outlier_min_neighbors : int or None
        Other points that are needed within it, N; 7 if nothing is said.
    """

    max_neighbors: Annotated[int, Ge(1)] = 30
    neighbor_fraction: Annotated[float, Interval(gt=0, le=1)] = 0.1
    std_ratio: Annotated[float, Ge(0)] = 1.0
    outlier_stage: Literal["sor", "adaptive_radius"] = "sor"
    outlier_radius_ratio: Annotated[float, Gt(0)] | None = None
    outlier_min_neighbors: Annotated[int, Ge(1)] | None = None

    def __post_init__(self) -> None:
        """Check that what goes with one rule is not given for the other, and fill in what is not given."""
        super().__post_init__()
        if self.outlier_preset is not None:
            for name, value in vars(self.outlier_preset).items():
                object.__setattr__(self, f"outlier_{name}", value)
            return
        for name in ("outlier_radius_ratio", "outlier_min_neighbors"):
            if getattr(self, name) is not None:
                raise ValueError(f"{name}: belongs to outlier_stage adaptive_radius, not to sor")

    @property
    def outlier_preset(self) -> Preset | None:
        """K and N of the stage ``adaptive_radius``; None for the other one."""
        if self.outlier_stage == "sor":
            return None
        # A wider net than the adaptive radius filter has: thresholds have thinned the points out.
        ratio, needed = self.outlier_radius_ratio, self.outlier_min_neighbors
        return Preset(radius_ratio=0.025 if ratio is None else ratio, min_neighbors=7 if needed is None else needed)


@dataclass(frozen=True, kw_only=True)
class JointParams(RingIntensityOutlierParams):
    """All of the joint method.

    Parameters
    ----------
    update_weight : float
        Weight u of the initial threshold against the correction; 1 means no correction.
    """

    update_weight: Annotated[float, Interval(ge=0, le=1)] = 0.6


class RingIntensity(BaseFilter):
    """Drop what is weaker than its ring's threshold (S0, step 2).

    Parameters
    ----------
    params : RingIntensityParams
        Config keys of the method.
    """

    Params: ClassVar[type[ZoneParams]] = RingIntensityParams

    def __init__(self, params: RingIntensityParams) -> None:
        self.params = params
        self._zones = Zones(params)
        self._initial = np.asarray(params.initial_thresholds, np.float64)

    def step(self, frame: Frame) -> FilterResult:
        """Return a reason for every point of a frame, with the rings' thresholds and counts."""
        none = np.zeros(self._zones.count)
        zone, reason, low = self._threshold(frame, self._initial)
        tally = self._zones.tally
        rings = Rings(self._initial.copy(), none, tally(zone), tally(zone[low]), none.astype(np.int64))
        return FilterResult(frame, reason, rings)

    def _threshold(
        self, frame: Frame, thresholds: NDArray[np.float64]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.bool_]]:
        """Return zone, reason and whether a point's intensity is below its ring's threshold (Eq. 3 and 5)."""
        intensity = frame.intensity
        zone, reason = self._zones.divide(frame)
        low = intensity < self._zones.per_point(thresholds, zone)
        reason[low] = Reason.LOW_INTENSITY
        return zone, reason, low


class Joint(RingIntensity):
    r"""Joint intensity-space filter with threshold feedback (S0).

    Parameters
    ----------
    params : JointParams
        Config keys of the method.

    Notes
    -----
    For each frame, in order:

    1. Rings (Eq. 3): ring k holds the ranges :math:`[d_s + (k-1)d,\; d_s + kd)`; the last is cut at :math:`d_e`.
    2. Threshold (Eq. 4, 5): :math:`I_k = u I_{0,k} + (1-u) I_{m,k}` where :math:`I_{m,k} \neq 0`, else
       :math:`I_{0,k}`; points with :math:`I \ge I_k` stay.
    3. Outliers (Eq. 6, 7) among the :math:`n_k` points that stay in a ring: with
       :math:`n = \max(1, \min(30, \lfloor 0.1\, n_k \rfloor))` neighbours and their mean distance :math:`d_i`, a point
       is an outlier if :math:`d_i > \mathrm{mean}(d) + \sigma(d)`. A single point stays. On request
       (``outlier_stage``), a point is one if fewer than N of the points that stay in any ring lie within
       :math:`r_i = K d_i` of it, as in the adaptive radius filter: no density common to a ring is needed then.
    4. Correction (Eq. 8) for the next frame, 0 where there are no outliers:
       :math:`I_{m,k} = \sum I_{\mathrm{outliers}} / (n_{\mathrm{outliers}} + 1)`.

    The paper leaves some of this open. Its Table 1 prints u = 0.5, its experiments use u = 0.6, the default here. The
    subscript k + 1 in Eq. 8 is read as the next frame, not the next ring. The standard deviation is that of a sample.

    **State**: one correction per ring, shape (K,), 0 after `reset`, so the first frame is filtered with the initial
    thresholds.

    References
    ----------
    .. [1] Li Zhengyu, Wang Hongdong, Wei Shengzhe, Lou Jiankun (2023). "Marine Lidar Intensity-Space
       Combined Filtering Method". Chinese Journal of Lasers. doi:10.3788/CJL221207
    """

    Params: ClassVar[type[ZoneParams]] = JointParams
    params: JointParams

    def __init__(self, params: JointParams) -> None:
        super().__init__(params)
        self.reset()

    def reset(self) -> None:
        """Forget the corrections."""
        self._correction = np.zeros(self._zones.count)

    def step(self, frame: Frame) -> FilterResult:
        """Return a reason for every point of a frame, with the rings' thresholds, corrections and counts."""
        correction, thresholds = self._correction, self._thresholds()
        zone, reason, low = self._threshold(frame, thresholds)

        found = np.zeros(self._zones.count, np.int64)
        following = np.zeros(self._zones.count)
        for k, outlying in enumerate(self._outliers(frame, self._zones.members(zone, ~low))):
            reason[outlying] = Reason.OUTLIER
            found[k] = len(outlying)
            following[k] = frame.intensity[outlying].sum() / (len(outlying) + 1)
        self._correction = following

        tally = self._zones.tally
        return FilterResult(frame, reason, Rings(thresholds, correction, tally(zone), tally(zone[low]), found))

    def _thresholds(self) -> NDArray[np.float64]:
        """Return the thresholds of the frame to come (Eq. 4)."""
        u, initial, correction = self.params.update_weight, self._initial, self._correction
        return np.where(correction != 0, u * initial + (1 - u) * correction, initial)

    def _outliers(self, frame: Frame, members: Sequence[NDArray[np.intp]]) -> list[NDArray[np.intp]]:
        """Return the indices of the outliers among each ring's points."""
        preset = self.params.outlier_preset
        if preset is None:
            return [points[self._outlying(frame.xyz[:, points].T)] for points in members]
        together = np.concatenate(members)
        outlying = sparse(frame.xyz[:, together].T, preset.radius_ratio, preset.min_neighbors)
        ends = np.cumsum([len(points) for points in members])
        return [points[found] for points, found in zip(members, np.split(outlying, ends[:-1]), strict=True)]

    def _outlying(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell the outliers among one ring's points, shape (n_k, 3), by their mean distances (Eq. 6 and 7)."""
        share = int(self.params.neighbor_fraction * len(points) + 1e-9)  # 0.29 of 100 are 29, in floats a bit less
        neighbors = max(1, min(self.params.max_neighbors, share))
        return outliers(points, neighbors, self.params.std_ratio)


class RingIntensityOutlier(Joint):
    """Ring thresholds and outliers without correction (S0, steps 2 and 3).

    Every frame is a first frame to it.

    Parameters
    ----------
    params : RingIntensityOutlierParams
        Config keys of the method.
    """

    Params: ClassVar[type[ZoneParams]] = RingIntensityOutlierParams

    def __init__(self, params: RingIntensityOutlierParams) -> None:
        super().__init__(JointParams(**vars(params)))

    def step(self, frame: Frame) -> FilterResult:
        """Return a reason for every point of a frame, with the rings' thresholds and counts."""
        self.reset()
        return super().step(frame)
