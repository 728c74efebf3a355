"""Adaptive radius filter of Bi and Wang [Bi]: a search radius proportional to range, with a preset for each scene."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters.base import ROUNDING, WholeFrameFilter, valid_points
from seaclutter_cli.filters.radius import isolated
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.scenes import SceneParams, make_scene_tracker

if TYPE_CHECKING:
    from seaclutter_cli.scenes.model import SceneTracker

AUTO = "auto"
"""Value of ``scene`` that leaves the choice of the preset to the scene classifier."""


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Parameters for one class of scene.

    Parameters
    ----------
    radius_ratio : float
        Search radius divided by range, K.
    min_neighbors : int
        Minimum number of other points within the search radius, N.
    """

    radius_ratio: Annotated[float, Gt(0)]
    min_neighbors: Annotated[int, Ge(1)]


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
    """Presets of the adaptive radius filter and the choice between them.

    Parameters
    ----------
    scene : str
        Class of scene whose preset is used: open, confined, another key of ``presets``, or auto (by the classifier).
    presets : mapping of str to Preset
        Preset of each class of scene. radius_ratio: search radius divided by range, K; min_neighbors: minimum number of
        other points within the search radius, N.
    """

    scene: str = "open"
    presets: Mapping[str, Preset] = field(default_factory=lambda: dict(PRESETS))

    def __post_init__(self) -> None:
        """Check that there is a preset for the scene."""
        if AUTO in self.presets:
            raise ValueError(f"presets.{AUTO}: the name {AUTO} is reserved; give the class of scene another name")
        if self.scene not in (*self.presets, AUTO):
            raise ValueError(f"scene: must be one of {', '.join((*self.presets, AUTO))}, got {self.scene!r}")


@dataclass(frozen=True, kw_only=True)
class AdaptiveRadiusParams(SceneParams, PresetParams):
    """Parameters of the adaptive radius filter: presets, and the scene classifier for ``scene: auto``."""


def isolated_by_range(points: NDArray[np.float64], radius_ratio: float, min_neighbors: int) -> NDArray[np.bool_]:
    r"""Return a mask of the points with too few others within a radius proportional to range ([Bi], Eq. 5 and 6).

    .. math:: r_i = K d_i, \quad d_i = \sqrt{x_i^2 + y_i^2 + z_i^2}

    The lidar is at the origin of the points, shape (N, 3); K is ``radius_ratio``. The bound is included. If N is
    ``min_neighbors`` or less, all are isolated.

    Examples
    --------
    >>> isolated_by_range(np.array([[10.0, 0, 0], [10, 1, 0], [40, 0, 0], [40, 4, 0], [10, 3, 0]]), 0.1, 1)
    array([False, False, False, False,  True])
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

    def removed(self, frame: Frame) -> NDArray[np.intp]:
        """Return the indices of the outliers by the preset of the frame."""
        valid, points = valid_points(frame)
        return valid[isolated_by_range(points, self._preset.radius_ratio, self._preset.min_neighbors)]
