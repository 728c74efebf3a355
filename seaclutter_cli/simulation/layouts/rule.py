"""What makes water open or confined: how much of the horizon facades close."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from seaclutter_cli.simulation.lidar.models import LIDARS
from seaclutter_cli.simulation.marine.ground import GroundParams
from seaclutter_cli.simulation.marine.scene import Scene, SceneObjectParams

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

REACH_M = 60.0
"""How far from the vessel a facade closes a bearing, in metres."""

_BEARINGS = 120
_LEAST_HEIGHT_M = 0.5
_SIDE = 10  # bearings: 30 degrees


@dataclass(frozen=True)
class Horizon:
    """The bearings about the vessel at one moment that something solid closes, three degrees each.

    Parameters
    ----------
    closed : ndarray, shape (120,), bool
        Whether something at least half a metre high stands within `REACH_M` and above the lowest beam. A gap of a
        single bearing between two closed ones counts as closed, so that a row of boats is one facade.
    """

    closed: Mask

    @property
    def share(self) -> float:
        """Share of the bearings that are closed."""
        return float(self.closed.mean())

    @property
    def sides(self) -> Mask:
        """Bearings that belong to a facade at least 30° wide, shape (120,)."""
        return self.closed & (_runs(self.closed) >= _SIDE)

    @property
    def longest_deg(self) -> float:
        """Width of the widest facade in degrees."""
        return float(_runs(self.closed).max()) * 360 / _BEARINGS

    @property
    def on_two_sides(self) -> bool:
        """Whether there are facades at least 90° apart."""
        sides = np.flatnonzero(self.sides)
        apart = np.abs(sides[:, None] - sides)
        return bool((np.minimum(apart, _BEARINGS - apart) >= _BEARINGS // 4).any())

    @property
    def scene_class(self) -> str | None:
        """``confined``, ``open``, or None for what is neither.

        Confined: at least half of the bearings are closed, by facades on two sides. Open: at most 35 % are, by nothing
        wider than 60°.
        """
        if self.share >= 0.5 and self.on_two_sides:
            return "confined"
        return "open" if self.share <= 0.35 and self.longest_deg <= 60 else None


def horizon(scene: Scene, time_s: float = 0.0) -> Horizon:
    """Return the horizon about own vessel at a time."""
    x, y, heading = (float(value[0]) for value in scene.vessel.track.at(np.array([time_s])))
    bearings = heading + 2 * np.pi / _BEARINGS * np.arange(_BEARINGS)
    rays = np.stack((np.cos(bearings), np.sin(bearings)), axis=1)
    down = -np.tan(np.radians(min(LIDARS[scene.recording.lidar].elevations_deg)))
    closed = np.zeros(_BEARINGS, bool)
    for item in scene.objects:
        high = float(item.size_m[2])
        if high >= _LEAST_HEIGHT_M:
            away = _distances(rays, np.array([x, y]), item, time_s)
            closed |= (away <= REACH_M) & (scene.vessel.lidar_height_m - down * away < high)
    between = np.roll(closed, 1) & np.roll(closed, -1)
    return Horizon(closed | between)


def scene_class(scene: Scene) -> str | None:
    """Return the class that a scene has from its first frame to its last, or None.

    On water it is that of the horizon. Of a plantation it is that of the gaps between neighbouring trees at breast
    height: dense where their median is at most 0.1 m, so that a row is one facade; sparse where it is at least 1.5 m.
    """
    if isinstance(scene.terrain, GroundParams):
        return _planting(scene)
    seconds = scene.recording.frames / 10
    classes = {horizon(scene, time_s).scene_class for time_s in np.linspace(0, seconds, 4).tolist()}
    return classes.pop() if len(classes) == 1 else None


def _planting(scene: Scene) -> str | None:
    """Return the class of a plantation."""
    trees = [item for item in scene.objects if not item.ignore]
    places = np.array([item.path[0] for item in trees])
    away, _ = cKDTree(places).query(places, k=2)
    gap = float(np.median(away[:, 1] - [float(item.size_m[0]) for item in trees]))
    return "dense" if gap <= 0.1 else "sparse" if gap >= 1.5 else None


def _distances(rays: Floats, origin: Floats, item: SceneObjectParams, time_s: float) -> Floats:
    """Return how far away each ray on the plane meets the footprint of an object, shape (120,); infinite: never."""
    x, y, heading = (float(value[0]) for value in item.track.at(np.array([time_s])))
    cos, sin = np.cos(heading), np.sin(heading)
    turn = np.array([[cos, -sin], [sin, cos]])
    start, ahead = (origin - (x, y)) @ turn, rays @ turn
    half = np.array([float(item.size_m[0]), float(item.size_m[1])]) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-half - start) / ahead, (half - start) / ahead
    begin = np.maximum(np.fmin(one, other).max(axis=1), 0)
    return np.where(np.fmax(one, other).min(axis=1) > begin, begin, np.inf)


def _runs(mask: Mask) -> NDArray[np.int64]:
    """Return for each bearing how many closed ones in a row it belongs to, around the circle; 0 where it is open."""
    if mask.all():
        return np.full(len(mask), len(mask))
    if not mask.any():
        return np.zeros(len(mask), np.int64)
    first = int(np.argmin(mask))  # an open one
    turned = np.roll(mask, -first)
    number = np.cumsum(np.diff(turned, prepend=False) & turned) * turned
    lengths = np.bincount(number)
    lengths[0] = 0
    return np.roll(lengths[number], first)
