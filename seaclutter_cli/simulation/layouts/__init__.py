"""Layouts: generators of random scenes, each of one scene class, for training and tests."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.layouts import generators
from seaclutter_cli.simulation.layouts.generators import APPLE, POPLAR, WILLOW, plantation
from seaclutter_cli.simulation.layouts.plan import Plan
from seaclutter_cli.simulation.layouts.rule import scene_class
from seaclutter_cli.simulation.layouts.worlds import draw_world, with_wide_physics
from seaclutter_cli.simulation.marine.scene import Scene, builtin_scenes, load_scene
from seaclutter_cli.simulation.marine.sea import SeaParams
from seaclutter_cli.text import suggestion

_TRIES = 200


@dataclass(frozen=True)
class Layout:
    """A generator of random scenes of one class: ``open`` or ``confined`` water, a ``dense`` or ``sparse`` plantation.

    Scenes that are drawn are not necessarily of the class.
    """

    scene_class: str
    draw: Callable[[Plan], Scene]

    def make(self, rng: np.random.Generator) -> Scene:
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
