"""Layouts: generators of random scenes, each of one scene class, for training and tests; the rule of the classes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seaclutter_cli.arrays import Floats, Ints, Mask, Rng
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.layouts import generators
from seaclutter_cli.simulation.layouts.generators import APPLE, POPLAR, WILLOW, plantation
from seaclutter_cli.simulation.layouts.plan import Plan
from seaclutter_cli.simulation.layouts.worlds import draw_world, with_wide_physics
from seaclutter_cli.simulation.lidar import LIDARS
from seaclutter_cli.simulation.marine.motion import rotations
from seaclutter_cli.simulation.marine.scene import Scene, SceneObjectParams, builtin_scenes, load_scene
from seaclutter_cli.simulation.marine.sea import SeaParams
from seaclutter_cli.simulation.marine.shapes import intersect_box
from seaclutter_cli.simulation.marine.terrain import GroundParams
from seaclutter_cli.text import suggestion

REACH_M = 60.0
"""Range in metres up to which a facade closes a bearing."""

_BEARINGS = 120
_MIN_HEIGHT_M = 0.5
_FACADE_BEARINGS = 10  # 30 degrees


def horizon_class(closed: Mask) -> str | None:
    """Return the class of a horizon, shape (120,): ``confined``, ``open``, or None for neither.

    Confined: at least half of the bearings are closed, by facades of at least 30° on two sides, at least 90° apart.
    Open: at most 35 % are closed, and no facade is wider than 60°.
    """
    share, facades = closed.mean(), _run_lengths(closed)
    sides = np.flatnonzero(facades >= _FACADE_BEARINGS)
    apart = np.abs(sides[:, None] - sides)
    if share >= 0.5 and (np.minimum(apart, _BEARINGS - apart) >= _BEARINGS // 4).any():
        return "confined"
    return "open" if share <= 0.35 and facades.max() <= 2 * _FACADE_BEARINGS else None


def horizon(scene: Scene, time_s: float = 0.0) -> Mask:
    """Return which bearings around own ship are closed at a time, three degrees each, shape (120,).

    A bearing is closed if an object at least half a metre high is within `REACH_M` and reaches above the lowest beam. A
    single open bearing between two closed ones counts as closed, so a row of boats is one facade.
    """
    x, y, heading = scene.vessel.track.at(time_s)
    bearings = heading + 2 * np.pi / _BEARINGS * np.arange(_BEARINGS)
    rays = np.stack((np.cos(bearings), np.sin(bearings), np.zeros(_BEARINGS)), axis=1)
    down = -np.tan(np.radians(min(LIDARS[scene.recording.lidar].elevations_deg)))
    closed = np.zeros(_BEARINGS, bool)
    for item in scene.objects:
        if item.size_m[2] >= _MIN_HEIGHT_M:
            distance = _distances(rays, (x, y), item, time_s)
            closed |= (distance <= REACH_M) & (scene.vessel.lidar_height_m - down * distance < item.size_m[2])
    between = np.roll(closed, 1) & np.roll(closed, -1)
    return np.asarray(closed | between)


def scene_class(scene: Scene) -> str | None:
    """Return the class that a scene has from its first frame to its last, or None.

    On water, the horizon decides. In a plantation, the gaps between neighbouring trees at breast height decide: dense
    if their median is at most 0.1 m, which makes a row one facade; sparse if it is at least 1.5 m.
    """
    if isinstance(scene.terrain, GroundParams):
        trees = [item for item in scene.objects if not item.ignore]
        positions = np.array([item.path[0] for item in trees])
        distance, _ = cKDTree(positions).query(positions, k=2)
        gap = float(np.median(distance[:, 1] - [item.size_m[0] for item in trees]))
        return "dense" if gap <= 0.1 else "sparse" if gap >= 1.5 else None
    seconds = scene.recording.frames / 10
    classes = {horizon_class(horizon(scene, time_s)) for time_s in np.linspace(0, seconds, 4).tolist()}
    return classes.pop() if len(classes) == 1 else None


def _distances(rays: Floats, origin: tuple[float, float], item: SceneObjectParams, time_s: float) -> Floats:
    """Return the distance along each horizontal ray to the footprint of an object, shape (120,); infinity for none."""
    x, y, heading = item.track.at(time_s)
    offset, rotation = np.array([[origin[0] - x, origin[1] - y, 0.0]]), rotations(heading)
    half = np.array([item.size_m[0] / 2, item.size_m[1] / 2, 1.0])
    begin, end = intersect_box(offset @ rotation, rays @ rotation, -half, half)
    return np.where(end > begin, begin, np.inf)


def _run_lengths(mask: Mask) -> Ints:
    """Return the length of the closed run that each bearing belongs to, around the circle; 0 for open bearings."""
    number, _ = ndimage.label(np.tile(mask, 3))  # runs of the second circle are whole
    lengths = np.bincount(number)
    lengths[0] = 0
    return np.asarray(np.minimum(lengths[number[len(mask) : 2 * len(mask)]], len(mask)))


_TRIES = 200


@dataclass(frozen=True)
class Layout:
    """A generator of random scenes of one class: ``open`` or ``confined`` water, a ``dense`` or ``sparse`` plantation.

    Scenes that are drawn are not necessarily of the class.
    """

    scene_class: str
    draw: Callable[[Plan], Scene]

    def make(self, rng: Rng) -> Scene:
        """Return a random scene that `scene_class` assigns to the class in all of its frames."""
        for _ in range(_TRIES):
            scene = self.draw(Plan(rng))
            if scene_class(scene) == self.scene_class:
                return scene
        raise AssertionError(f"layout draws no {self.scene_class} scene in {_TRIES} attempts")


LAYOUTS: Mapping[str, Layout] = {
    "open_sea": Layout("open", generators.open_sea),
    "anchorage": Layout("open", generators.anchorage),
    "fairway": Layout("open", generators.fairway),
    "regatta": Layout("open", generators.regatta),
    "coast": Layout("open", generators.coast),
    "rough_sea": Layout("open", generators.rough_sea),
    "pile_field": Layout("open", generators.pile_field),
    "harbour_basin": Layout("confined", generators.harbour_basin),
    "moored_boats": Layout("confined", generators.moored_rows),
    "channel": Layout("confined", generators.narrow_channel),
    "lock_chamber": Layout("confined", generators.lock),
    "river": Layout("confined", generators.river),
    "apple_rows": Layout("dense", partial(plantation, APPLE)),
    "poplar_grove": Layout("sparse", partial(plantation, POPLAR)),
    "willow_grove": Layout("sparse", partial(plantation, WILLOW)),
}
"""Layouts by name; to add one, add a line here."""

RANDOM = "random"
"""Name of a scene of a layout at sea, or of wide physics, that the seed chooses."""


def find_scene(name: str, seed: int | None = None, *, wide: bool = False) -> Scene:
    """Return the scene in a file, a built-in scene, or a random scene of a layout; see `RANDOM`.

    ``seed`` replaces that of the scene. A layout draws the whole scene from it; its default there is 1. If ``wide``,
    water, weather, lidar and own ship are drawn from the ranges of wide physics. Raise `ConfigError` if the scene does
    not exist or is not valid.
    """
    if wide and name == RANDOM:
        return draw_world(1 if seed is None else seed)
    scene = _named(name, seed)
    if wide and not isinstance(scene.terrain, SeaParams):
        raise ConfigError(f"{name}: is on land; wide physics is that of a sea")
    return with_wide_physics(scene, scene.recording.seed) if wide else scene


def _named(name: str, seed: int | None) -> Scene:
    if Path(name).exists() or name in builtin_scenes():
        return load_scene(name).with_recording(seed=seed)
    rng = np.random.default_rng(1 if seed is None else seed)
    if name == RANDOM:
        at_sea = [layout for layout in LAYOUTS.values() if layout.scene_class in ("open", "confined")]
        return at_sea[int(rng.integers(len(at_sea)))].make(rng)
    if name not in LAYOUTS:
        known = f"built-in scenes: {', '.join(builtin_scenes())}; layouts: {', '.join(LAYOUTS)}; {RANDOM}"
        meant = suggestion(name, [*builtin_scenes(), *LAYOUTS, RANDOM])
        raise ConfigError(f"{name}: no such scene; {meant}{known}")
    return LAYOUTS[name].make(rng)
