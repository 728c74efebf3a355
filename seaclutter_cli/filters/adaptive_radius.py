"""The adaptive radius filter of Bi and Wang (S3): a search radius that grows with range, presets for each scene."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.filters.base import SpatialFilter
from seaclutter_cli.filters.radius import lonely
from seaclutter_cli.filters.statistical import ROUNDING
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import SceneSource
from seaclutter_cli.scenes.params import SceneParams

AUTO = "auto"
"""In place of a scene: the classifier tells it."""


@dataclass(frozen=True, kw_only=True)
class Preset:
    """What goes for one class of scene.

    Parameters
    ----------
    radius_ratio : float
        Search radius by range, K.
    min_neighbors : int
        Other points that are needed within it, N.
    """

    radius_ratio: Annotated[float, Gt(0)]
    min_neighbors: Annotated[int, Ge(1)]


PRESETS: Mapping[str, Preset] = {
    "open": Preset(radius_ratio=0.015, min_neighbors=9),
    "confined": Preset(radius_ratio=0.022, min_neighbors=10),
}
"""Presets for open water and for confined (quay walls, moored rows, channels).

Made for the steps of an RS-LiDAR-32, 0.2° and, where its beams are dense, 0.33°: K is 3.3 and 4.9 times the spacing of
its points by range, so that a surface that faces the lidar has about 35 and 75 of them within the radius. N is a
quarter and a seventh of that, found by ``tune`` on simulated scenes (docs/density.md). K of another lidar follows from
its steps: `seaclutter_cli.sensors.density.radius_ratio`.
"""


@dataclass(frozen=True, kw_only=True)
class PresetParams:
    """Presets by scene.

    Parameters
    ----------
    scene : str
        Class of scene whose preset goes: open, confined or another one of ``presets``; auto: the classifier tells.
    presets : mapping of str to Preset
        Of each class, radius_ratio: search radius by range, K; min_neighbors: other points needed within it, N.
    """

    scene: str = "open"
    presets: Mapping[str, Preset] = field(default_factory=lambda: dict(PRESETS))

    def __post_init__(self) -> None:
        """Check that there is a preset for the scene."""
        if AUTO in self.presets:
            raise ValueError(f"presets.{AUTO}: no class of scene can be called that")
        if self.scene not in (*self.presets, AUTO):
            raise ValueError(f"scene: must be one of {', '.join((*self.presets, AUTO))}, is {self.scene!r}")


@dataclass(frozen=True, kw_only=True)
class AdaptiveRadiusParams(SceneParams, PresetParams):
    """Adaptive radius filter: presets by scene, and how the scene is told where that is asked for."""


@dataclass(frozen=True)
class FixedScene:
    """A scene that the configuration tells, in place of a classifier."""

    name: str

    def scene(self, frame: Frame) -> "FixedScene":  # noqa: ARG002
        """Return what was told."""
        return self

    def reset(self) -> None:
        """Have nothing to forget."""


def sparse(points: NDArray[np.float64], radius_ratio: float, min_neighbors: int) -> NDArray[np.bool_]:
    r"""Tell which points have too few others within a radius that grows with range (S3, Eq. 5 and 6).

    .. math:: r_i = K d_i, \quad d_i = \sqrt{x_i^2 + y_i^2 + z_i^2}

    Parameters
    ----------
    points : ndarray, shape (N, 3), float64
        Finite coordinates in metres, the lidar at the origin.
    radius_ratio : float
        Radius by range, K.
    min_neighbors : int
        Other points that are needed within it, bounds included; at least 1.

    Returns
    -------
    ndarray, shape (N,), bool
        True where there are fewer; everywhere if there are not so many others at all.

    Examples
    --------
    >>> sparse(np.array([[10.0, 0, 0], [10, 1, 0], [40, 0, 0], [40, 4, 0], [10, 3, 0]]), 0.1, 1)
    array([False, False, False, False,  True])
    """
    with np.errstate(over="ignore"):
        range_m = np.sqrt(np.einsum("ij,ij->i", points, points))
        return lonely(points, radius_ratio * range_m * (1 + ROUNDING), min_neighbors)


class AdaptiveRadius(SpatialFilter):
    r"""Adaptive radius filter: the radius is a share of the range, by scene.

    Parameters
    ----------
    params : AdaptiveRadiusParams
        Config keys of the method.
    scenes : SceneSource, optional
        Tells the scene of each frame; by default what ``scene`` says, which for ``auto`` is the classifier (it needs
        the extra ``scene``).

    Notes
    -----
    A point at distance :math:`d_i` from the lidar goes if fewer than N other valid points lie within [1]_

    .. math:: r_i = K d_i

    of itself, bounds included. That is, if its N-th nearest other point is farther than :math:`r_i`, which costs much
    less to find and takes no memory for large K. Of N points or fewer, none stays. A distance that differs from
    :math:`r_i` by rounding alone is not farther.

    The distance between neighbouring beams grows in proportion to range (docs/density.md), so :math:`r_i` holds as many
    points of a surface that faces the lidar wherever it stands: about :math:`\pi K^2 / (r_h r_v)` for steps of
    :math:`r_h` and :math:`r_v` radians between beams, and no fewer than :math:`2 \lfloor K / r_h \rfloor` along a row
    where K is less than :math:`r_v`.

    **State**: that of what tells the scenes; none where the configuration does.

    References
    ----------
    .. [1] Bi Song, Wang Yuhao. "Adaptive radius filter for denoising of lidar point clouds in plantations" (in
       Chinese). Transactions of the Chinese Society for Agricultural Machinery.
    """

    Params: ClassVar[type[AdaptiveRadiusParams]] = AdaptiveRadiusParams

    def __init__(self, params: AdaptiveRadiusParams, scenes: SceneSource | None = None) -> None:
        self.params = params
        self._scenes = scenes or _scenes(params)
        self._preset = Preset(radius_ratio=1.0, min_neighbors=1)

    def reset(self) -> None:
        """Forget the scene."""
        self._scenes.reset()

    def step(self, frame: Frame) -> FilterResult:
        """Return a reason for every point of a frame, and the scene.

        Raises
        ------
        ConfigError
            If there is no preset for the scene that the classifier tells.
        """
        scene = self._scenes.scene(frame).name
        if scene not in self.params.presets:
            known = ", ".join(self.params.presets)
            raise ConfigError(f"filter.presets: the classifier tells the scene {scene!r}, there are: {known}")
        self._preset = self.params.presets[scene]
        return replace(super().step(frame), scene=scene)

    def outlying(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which of some points, shape (N, 3), are outliers under the preset of the frame."""
        return sparse(points, self._preset.radius_ratio, self._preset.min_neighbors)


def _scenes(params: AdaptiveRadiusParams) -> SceneSource:
    """Return what tells the scenes."""
    if params.scene != AUTO:
        return FixedScene(params.scene)
    from seaclutter_cli.scenes import make_scene_tracker

    return make_scene_tracker(params)
