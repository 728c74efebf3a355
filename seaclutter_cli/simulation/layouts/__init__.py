"""Layouts: kinds of random scenes, each of one class, to train and test on."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.layouts import confined_water, open_water, plantations
from seaclutter_cli.simulation.layouts.rule import scene_class
from seaclutter_cli.simulation.marine.scene import Scene, builtin_scenes, load_scene

_TRIES = 200
Maker = Callable[[np.random.Generator], Scene]


@dataclass(frozen=True)
class Layout:
    """A kind of random scenes.

    Parameters
    ----------
    scene_class : str
        ``open`` or ``confined`` on water, ``dense`` or ``sparse`` in a plantation.
    about : str
        What its scenes show.
    draw : callable
        Makes a scene, which need not be of the class.
    """

    scene_class: str
    about: str
    draw: Maker

    def make(self, rng: np.random.Generator) -> Scene:
        """Return a random scene that is of the class by the rule of `scene_class`, over all its frames."""
        for _ in range(_TRIES):
            scene = self.draw(rng)
            if scene_class(scene) == self.scene_class:
                return scene
        raise AssertionError(f"no scene is {self.scene_class} in {_TRIES} draws")


def _layout(kind: str, draw: Maker) -> Layout:
    return Layout(kind, (draw.__doc__ or "").removeprefix("Make ").split("\n")[0], draw)


LAYOUTS: Mapping[str, Layout] = {
    "open_sea": _layout("open", open_water.open_sea),
    "anchorage": _layout("open", open_water.anchorage),
    "fairway": _layout("open", open_water.fairway),
    "regatta": _layout("open", open_water.regatta),
    "coast": _layout("open", open_water.coast),
    "rough_sea": _layout("open", open_water.rough_sea),
    "pile_field": _layout("open", open_water.pile_field),
    "harbour_basin": _layout("confined", confined_water.harbour_basin),
    "moored_boats": _layout("confined", confined_water.moored_rows),
    "channel": _layout("confined", confined_water.narrow_channel),
    "lock_chamber": _layout("confined", confined_water.lock),
    "river": _layout("confined", confined_water.river),
    "apple_rows": _layout("dense", plantations.apple_rows),
    "poplar_grove": _layout("sparse", plantations.poplar_grove),
    "willow_grove": _layout("sparse", plantations.willow_grove),
}
"""Layouts by name; a new one is a line here."""


def find_scene(name: str, seed: int | None = None) -> Scene:
    """Return a scene by its file or name, or a random one of a layout.

    Parameters
    ----------
    name : str
        A scene file, a built-in scene, or a layout.
    seed : int, optional
        Takes the place of the scene's own; of a layout it is what everything comes from, by default 1.

    Raises
    ------
    ConfigError
        If there is no such scene, or anything is wrong with it.
    """
    if Path(name).exists() or name in builtin_scenes():
        return load_scene(name).with_recording(seed=seed)
    if name not in LAYOUTS:
        known = f"built in are {', '.join(builtin_scenes())}; layouts are {', '.join(LAYOUTS)}"
        raise ConfigError(f"{name}: there is no such scene file; {known}")
    return LAYOUTS[name].make(np.random.default_rng(1 if seed is None else seed))
