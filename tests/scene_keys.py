"""Make ``docs/scene-keys.md``, the reference of scene keys: ``python -m tests.scene_keys``."""

from dataclasses import MISSING, fields
from typing import get_type_hints

from seaclutter_cli.simulation.airborne.scene import (
    LANDS,
    AirborneParams,
    LandParams,
    TileObjectParams,
    TileParams,
    WaterParams,
)
from seaclutter_cli.simulation.lidar import NoiseParams
from seaclutter_cli.simulation.marine.physics import PhysicsParams
from seaclutter_cli.simulation.marine.scene import RecordingParams, SceneObjectParams, VesselParams
from seaclutter_cli.simulation.marine.terrain import TERRAINS
from seaclutter_cli.validation import _in_words, descriptions, plain, summary, yaml_value
from tests.paths import ROOT

PAGE = ROOT / "docs" / "scene-keys.md"

INTRODUCTION = """\
# Keys of scenes

[Simulated recordings](guide/simulation.md) and [tiles](guide/tiles.md) are made of scenes: YAML files with these
sections and keys. Keys have defaults unless they are required. The quickest way to a scene of your own is a copy
of another one, which has all keys with their values and comments:

```sh
seaclutter simulate calm -n 1 -o calm.mcap --scene-file my.yaml
seaclutter simulate my.yaml -o my.mcap
```

A scene has either a sea or a ground. In the world frame, x is east and y is north, in metres.
"""

SCENE = {
    "recording": RecordingParams,
    **TERRAINS,
    "vessel": VesselParams,
    "noise": NoiseParams,
    "physics": PhysicsParams,
    "objects": SceneObjectParams,
}
NOTES = {
    "noise": "Without this section, the noise is that of the lidar.",
    "objects": "A list; each object has these keys.",
    "land": "A list; each piece of land covers those before it, and objects at random positions keep clear of all.",
}
TILE = {
    "tile": TileParams,
    "lidar": AirborneParams,
    "water": WaterParams,
    "land": LandParams,
    "objects": TileObjectParams,
}
RANDOM = """\
### random

Number of objects, from 0 to 50, of each class, at random places and of random sizes: `random: {ship: 3, reef: 2}`.
"""
LAND_KEYS = ("height_m", "slope", "crest_m", "relief_m", "ragged_m", "trees", "houses", "reflectivity")


def page():
    """Return the text of the page."""
    parts = [INTRODUCTION, "## Recordings\n", *(section(name, kind) for name, kind in SCENE.items())]
    parts += ["## Airborne tiles\n", *(section(name, kind) for name, kind in TILE.items()), RANDOM, land_kinds()]
    return "\n".join(parts)


def section(name, kind):
    described, hints = descriptions(kind), get_type_hints(kind, include_extras=True)
    rows = ["| key | default | values | meaning |", "|---|---|---|---|"]
    for field in fields(kind):
        default = "required" if field.default is MISSING else f"`{yaml_value(plain(field.default))}`"
        rows.append(f"| `{field.name}` | {default} | {_in_words(hints[field.name])} | {described[field.name]} |")
    text = " ".join(filter(None, (f"{summary(kind)}.", NOTES.get(name))))
    return "\n".join((f"### {name}\n", text, "", *rows, ""))


def land_kinds():
    rows = ["### Kinds of land\n", f"| kind | what it is | {' | '.join(f'`{key}`' for key in LAND_KEYS)} |"]
    rows.append("|---" * (len(LAND_KEYS) + 2) + "|")
    for name, kind in LANDS.items():
        values = " | ".join(f"{getattr(kind.typical, key):g}" for key in LAND_KEYS)
        rows.append(f"| {name} | {kind.meaning} | {values} |")
    return "\n".join((*rows, ""))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
