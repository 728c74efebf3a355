"""What ``seaclutter simulate`` does for a tile."""

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import click
import numpy as np

from seaclutter_cli.commands.console import table
from seaclutter_cli.commands.outputs import refuse_replacing
from seaclutter_cli.errors import UsageError
from seaclutter_cli.simulation.airborne.recording import record_tile
from seaclutter_cli.simulation.airborne.scene import load_tile_scene
from seaclutter_cli.simulation.marine.scene import write_scene
from seaclutter_cli.truth import OBJECT_CLASSES


def run(scene: str, output: Path, options: Mapping[str, Any]) -> None:
    """Make a tile and print what is in it."""
    for name in ("frames", "lidar", "form"):
        if options[name] is not None:
            said = {"form": "format"}.get(name, name)
            raise UsageError(
                f"--{said}: tiles have none; height, density and returns stand in the scene's lidar section"
            )
    chosen = load_tile_scene(scene).with_tile(seed=options["seed"])
    scene_file = options["scene_file"]
    given = [Path(scene)] if Path(scene).exists() else []
    refuse_replacing([output, *([scene_file] if scene_file else [])], given, force=options["force"])
    if scene_file:
        write_scene(chosen.as_dict(), scene_file)
    points: Counter[int] = Counter()
    started = perf_counter()

    def on_strip(echoes: Any) -> None:
        points.update(dict(enumerate(np.bincount(echoes["object_class"]).tolist())))

    record_tile(chosen, output, on_strip)
    objects = Counter(thing.kind for thing in chosen.objects)
    rows = [(name, objects[name], points[code]) for code, name in enumerate(OBJECT_CLASSES, 1) if objects[name]]
    if options["as_json"]:
        listed = [{"class": name, "objects": many, "points": count} for name, many, count in rows]
        click.echo(json.dumps({"output": str(output), "sea": points[0], "objects": listed}, indent=2))
        return
    shown = [("sea", "", f"{points[0]:,}"), *((name, many, f"{count:,}") for name, many, count in rows)]
    indented = "\n".join("  " + line for line in table(("what", "objects", "points"), shown).splitlines())
    click.echo(f"{output}\n{indented}\n{points.total():,} points in {perf_counter() - started:.1f} s")
