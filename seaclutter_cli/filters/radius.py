"""Radius outlier removal with a fixed radius (ROR), one that grows with range, and for weak points (LIOR).

The radius grows with range in DROR, and in the adaptive radius filter of [Bi], which has a preset for each scene.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Interval

from seaclutter_cli.arrays import Floats, Indices, Mask
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters.base import ROUNDING, WholeFrameFilter, valid_points
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.neighbors import nth_neighbor_distance
from seaclutter_cli.params import Count, NotNegative, Positive, key
from seaclutter_cli.scenes import SceneParams, make_scene_tracker

if TYPE_CHECKING:
    from seaclutter_cli.scenes.model import SceneTracker

AUTO = "auto"
"""Value of ``scene`` that leaves the choice of the preset to the scene classifier."""


def isolated(points: Floats, radius_m: float | Floats, min_neighbors: int, query: Indices | None = None) -> Mask:
    """Return a mask of the points, shape (N, 3), with fewer than ``min_neighbors`` others within a radius (inclusive).

    There is one radius for all points or one per point. With ``query``, the indices of M points, only these are tested,
    among all N. If N is ``min_neighbors`` or less, all are isolated.
    """
    if len(points) <= min_neighbors:
        return np.ones(len(points) if query is None else len(query), np.bool_)
    # At least n points are within the radius if and only if the n-th nearest is; it is much faster to find.
    return nth_neighbor_distance(np.ascontiguousarray(points), min_neighbors, query) > radius_m


@dataclass(frozen=True, kw_only=True)
class RorParams:
    """Parameters of radius outlier removal."""

    radius_m: Positive = key(0.5, "Search radius, R, in metres.")
    min_neighbors: Count = key(5, "Minimum number of other points within the search radius, n.")


class RadiusOutlierRemoval(WholeFrameFilter[RorParams]):
    """Radius outlier removal (ROR) over all valid points."""

    Params: ClassVar[type[RorParams]] = RorParams

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        return valid[isolated(points, self.params.radius_m, self.params.min_neighbors)]


@dataclass(frozen=True, kw_only=True)
class DrorParams:
    """Parameters of dynamic radius outlier removal."""

    radius_multiplier: Positive = key(
        3.0, "Search radius divided by twice the spacing of neighbouring points at that range, beta."
    )
    angle_deg: Annotated[float, Interval(gt=0, le=90)] = key(
        0.16, "Azimuth step between neighbouring points of a beam, alpha, in degrees."
    )
    min_radius_m: NotNegative = key(0.04, "Minimum search radius, r_min, in metres.")
    min_points: Annotated[int, Ge(2)] = key(
        3, "Minimum number of points within the search radius, n, including the point itself."
    )


class DynamicRadiusOutlierRemoval(WholeFrameFilter[DrorParams]):
    r"""Radius outlier removal, radius grows with range (DROR).

    Notes
    -----
    A point is removed if fewer than n valid points, including itself, lie within the search radius [1]_

    .. math:: r_i = \max(r_{\min},\; 2 \beta \sin(\alpha) \sqrt{x_i^2 + y_i^2})

    of it, bound included. Equivalently, its (n - 1)-th nearest other point is farther than :math:`r_i`, so one distance
    per point is enough. If a frame has fewer than n valid points, all are removed. A distance that exceeds :math:`r_i`
    only by rounding error counts as equal. The defaults are those of the authors' launch files.

    References
    ----------
    .. [1] Charron Nicholas, Phillips Stephen, Waslander Steven L. (2018). "De-noising of Lidar Point Clouds Corrupted
       by Snowfall". 15th Conference on Computer and Robot Vision (CRV), 254-261. doi:10.1109/CRV.2018.00043
    """

    Params: ClassVar[type[DrorParams]] = DrorParams

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the outliers."""
        valid, points = valid_points(frame)
        spacing = 2 * math.sin(math.radians(self.params.angle_deg)) * np.hypot(points[:, 0], points[:, 1])
        radius = np.maximum(self.params.min_radius_m, self.params.radius_multiplier * spacing)
        return valid[isolated(points, radius * (1 + ROUNDING), self.params.min_points - 1)]


@dataclass(frozen=True, kw_only=True)
class LiorParams:
    """Parameters of low-intensity outlier removal."""

    intensity_threshold: float = key(
        5.0, "Intensity up to which points may be removed, in the sensor's unit; bound included."
    )
    max_range_m: Positive = key(71.2, "Range up to which points may be removed, R_snow, in metres; bound included.")
    radius_m: Positive = key(0.1, "Search radius, R, in metres.")
    min_neighbors: Count = key(3, "Minimum number of other points within the search radius for a point to be kept, n.")


class LowIntensityOutlierRemoval(WholeFrameFilter[LiorParams]):
    r"""Radius outlier removal of weak, near points (LIOR).

    Notes
    -----
    A point is removed if its intensity is at most the threshold, its range at most :math:`R_{\mathrm{snow}}`, and fewer
    than n other valid points, of any intensity and range, lie within R of it, bound included [1]_. As in radius outlier
    removal, the point itself does not count; in a frame of n valid points or fewer, every point is isolated.

    References
    ----------
    .. [1] Park Ji-Il, Park Jihyuk, Kim Kyung-Soo (2020). "Fast and Accurate Desnowing Algorithm for LiDAR Point
       Clouds". IEEE Access, 8, 160202-160212. doi:10.1109/ACCESS.2020.3020266
    """

    Params: ClassVar[type[LiorParams]] = LiorParams

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the isolated points among the weak, near ones."""
        valid, points = valid_points(frame)
        weak = frame.intensity[valid] <= self.params.intensity_threshold
        candidates = np.flatnonzero(weak & (frame.range_m[valid] <= self.params.max_range_m))
        if not len(candidates):
            return candidates
        return valid[candidates[isolated(points, self.params.radius_m, self.params.min_neighbors, candidates)]]


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Parameters for one class of scene."""

    radius_ratio: Positive = key(meaning="Search radius divided by range, K.")
    min_neighbors: Count = key(meaning="Minimum number of other points within the search radius, N.")


PRESETS: Mapping[str, Preset] = {
    "open": Preset(radius_ratio=0.015, min_neighbors=9),
    "confined": Preset(radius_ratio=0.022, min_neighbors=10),
}
"""Presets for open water and for confined water (quay walls, moored rows, channels).

They suit the angular steps of an RS-LiDAR-32: 0.2° horizontally and, where its beams are dense, 0.33° vertically. K is
3.3 and 4.9 times the point spacing per metre of range. A surface that faces the lidar then has about 35 and 75 points
within the radius. N is a quarter and a seventh of these numbers, found by ``tune`` on simulated scenes
(docs/density.md, which has the formula of K for the angular steps of another lidar).
"""


@dataclass(frozen=True, kw_only=True)
class PresetParams:
    """Presets of the adaptive radius filter and the choice between them."""

    scene: str = key(
        "open",
        "Class of scene whose preset is used: open, confined, another key of presets, or auto (by the classifier).",
    )
    presets: Mapping[str, Preset] = key(
        meaning="Preset of each class of scene. radius_ratio: search radius divided by range, K; min_neighbors: "
        "minimum number of other points within the search radius, N.",
        factory=lambda: dict(PRESETS),
    )

    def __post_init__(self) -> None:
        """Check that there is a preset for the scene."""
        if AUTO in self.presets:
            raise ValueError(f"presets.{AUTO}: the name {AUTO} is reserved; give the class of scene another name")
        if self.scene not in (*self.presets, AUTO):
            raise ValueError(f"scene: must be one of {', '.join((*self.presets, AUTO))}, got {self.scene!r}")


@dataclass(frozen=True, kw_only=True)
class AdaptiveRadiusParams(SceneParams, PresetParams):
    """Parameters of the adaptive radius filter: presets, and the scene classifier for ``scene: auto``."""


def isolated_by_range(points: Floats, radius_ratio: float, min_neighbors: int) -> Mask:
    r"""Return a mask of the points with too few others within a radius proportional to range ([Bi], Eq. 5 and 6).

    .. math:: r_i = K d_i, \quad d_i = \sqrt{x_i^2 + y_i^2 + z_i^2}

    The lidar is at the origin of the points, shape (N, 3); K is ``radius_ratio``. The bound is included. If N is
    ``min_neighbors`` or less, all are isolated.
    """
    with np.errstate(over="ignore"):
        range_m = np.sqrt(np.einsum("ij,ij->i", points, points))
        return isolated(points, radius_ratio * range_m * (1 + ROUNDING), min_neighbors)


class AdaptiveRadius(WholeFrameFilter[AdaptiveRadiusParams]):
    r"""Radius outlier removal, radius proportional to range [Bi].

    Notes
    -----
    A point at distance :math:`d_i` from the lidar is removed if fewer than N other valid points lie within [1]_

    .. math:: r_i = K d_i

    of it, bound included. Equivalently, its N-th nearest other point is farther than :math:`r_i`; this is much faster
    to compute and needs no memory for large K. If a frame has N valid points or fewer, all are removed. A distance that
    exceeds :math:`r_i` only by rounding error counts as equal.

    The spacing of neighbouring beams is proportional to range (docs/density.md). A surface that faces the lidar
    therefore has the same number of points within :math:`r_i` at every range: about :math:`\pi K^2 / (r_h r_v)` for
    angular steps of :math:`r_h` and :math:`r_v` radians between beams, and at least
    :math:`2 \lfloor K / r_h \rfloor` along a row where K is less than :math:`r_v`.

    **State**: that of the scene classifier, which needs the extra ``scene``; none if the configuration names the class
    of scene.

    References
    ----------
    .. [1] Bi Song, Wang Yuhao. "Adaptive radius filter for denoising of lidar point clouds in plantations" (in
       Chinese). Transactions of the Chinese Society for Agricultural Machinery.
    """

    Params: ClassVar[type[AdaptiveRadiusParams]] = AdaptiveRadiusParams
    has_scenes = True

    def __init__(self, params: AdaptiveRadiusParams, scenes: "SceneTracker | None" = None) -> None:
        super().__init__(params)
        self._scenes = scenes or (make_scene_tracker(params) if params.scene == AUTO else None)

    def reset(self) -> None:
        """Forget the scene."""
        if self._scenes is not None:
            self._scenes.reset()

    def step(self, frame: Frame) -> FilterResult:
        """Return the reason of every point of a frame, and its class of scene.

        Raises
        ------
        ConfigError
            If there is no preset for the class of scene that the classifier returns.
        """
        scene = self.params.scene if self._scenes is None else self._scenes.scene(frame).name
        if scene not in self.params.presets:
            known, model = ", ".join(self.params.presets), self.params.scene_model
            of = f"the scene {scene!r} of the classifier{f' {model}' if model else ''}"
            raise ConfigError(f"filter.presets: no preset for {of}; presets: {known}")
        self._preset = self.params.presets[scene]
        return replace(super().step(frame), scene=scene)

    def removed(self, frame: Frame) -> Indices:
        """Return the indices of the outliers by the preset of the frame."""
        valid, points = valid_points(frame)
        return valid[isolated_by_range(points, self._preset.radius_ratio, self._preset.min_neighbors)]
