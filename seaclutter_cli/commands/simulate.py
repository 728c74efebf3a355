"""``seaclutter simulate``: labelled recordings of a lidar at sea."""

import json
from collections import Counter
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.console import Progress, count, table
from seaclutter_cli.commands.options import force_option, output_options
from seaclutter_cli.errors import UsageError

if TYPE_CHECKING:
    from seaclutter_cli.simulation.marine.render import Turn
    from seaclutter_cli.simulation.marine.scene import Scene


@click.command(name="simulate", short_help="Make a labelled lidar recording of a scene at sea.")
@click.argument("scene")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="LOG.mcap",
    help="The recording; a tile ends in .las or .laz.",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(["mcap", "pcap"]),
    help="MCAP with PointCloud2, or packets of a RoboSense lidar; by default as LOG ends.",
)
@force_option
@click.option("-n", "--frames", type=click.IntRange(min=1), metavar="N", help="Turns, whatever the scene says.")
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Seed, whatever the scene says; of a layout 1.")
@click.option("--lidar", metavar="NAME", help="Lidar, whatever the scene says.")
@click.option(
    "--scene-file", type=click.Path(path_type=Path), metavar="YAML", help="Save the scene as a file that can be edited."
)
@output_options
def command(scene: str, output: Path, **options: Any) -> None:
    """Make a labelled lidar recording of SCENE: a scene file (YAML), or the name of a built-in scene or layout.

    Writes LOG.mcap, whose clouds have a field `label` (0 clutter, 65535 own vessel or ignored, else the target), and
    LOG.labels.csv with a box for each target and frame. LOG.pcap holds packets instead, which have no labels. A layout
    is a kind of scenes, of which each seed makes another. Of a scene with a section `tile`, seen from the air, it
    writes a LAS or LAZ file with the truth of each point: classification, object_class, object_id. `seaclutter config
    sensors` lists scenes, layouts, tiles, lidars.
    """
    if output.suffix.lower() in (".las", ".laz"):
        from seaclutter_cli.commands.simulate_tile import run

        run(scene, output, options)
        return
    from seaclutter_cli.commands.outputs import refuse_overwriting
    from seaclutter_cli.simulation.airborne.scene import is_tile_scene
    from seaclutter_cli.simulation.layouts import find_scene
    from seaclutter_cli.simulation.marine.formats import FORMATS
    from seaclutter_cli.simulation.marine.recording import record
    from seaclutter_cli.simulation.marine.scene import save_scene

    if is_tile_scene(scene):
        raise UsageError(f"{output}: {scene} is seen from the air; the name of its tile must end in .las or .laz")
    chosen = find_scene(scene, options["seed"]).with_recording(frames=options["frames"], lidar=options["lidar"])
    form = options["form"] or output.suffix.removeprefix(".")
    if form not in FORMATS or output.suffix != f".{form}":
        endings = " or ".join(f".{name}" for name in ([form] if options["form"] else FORMATS))
        raise UsageError(f"{output}: the name of the recording must end in {endings}")
    labels = output.with_suffix(".labels.csv")
    scene_file = options["scene_file"]
    refuse_overwriting([output, labels, *([scene_file] if scene_file else [])], [], force=options["force"])
    if scene_file:
        save_scene(chosen, scene_file)
    tally = _Tally()
    started = perf_counter()
    with Progress(chosen.recording.frames, output.stem, quiet=options["quiet"]) as progress:

        def on_turn(turn: "Turn") -> None:
            tally.add(turn)
            progress.step()

        record(chosen, output, labels, on_turn)
    seconds = perf_counter() - started
    if options["as_json"]:
        click.echo(json.dumps(tally.as_dict(chosen, output, labels), indent=2))
    else:
        click.echo(tally.as_text(chosen, output, labels, seconds))


_MOST_TARGETS = 12


class _Tally:
    """Points of the recording by what they belong to."""

    def __init__(self) -> None:
        self.frames = 0
        self.points: Counter[int] = Counter()

    def add(self, turn: "Turn") -> None:
        import numpy as np

        self.frames += 1
        labels, counts = np.unique(turn.points["label"], return_counts=True)
        self.points.update(dict(zip(labels.tolist(), counts.tolist(), strict=True)))

    def _rows(self, scene: "Scene") -> list[tuple[str, int]]:
        from seaclutter_cli.truth import CLUTTER, IGNORED

        targets = [(f"{item.class_name or item.shape}, track {item.track_id}", item) for item in scene.objects]
        rows = [("clutter", self.points[CLUTTER])]
        shown = [(name, self.points[item.track_id]) for name, item in targets if not item.ignore]
        if len(shown) > _MOST_TARGETS:
            shown = self._by_class(scene)
        rows += shown
        return [*rows, ("own vessel or ignored", self.points[IGNORED])]

    def _by_class(self, scene: "Scene") -> list[tuple[str, int]]:
        points, targets = Counter[str](), Counter[str]()
        for item in scene.objects:
            if not item.ignore:
                name = item.class_name or item.shape
                targets[name] += 1
                points[name] += self.points[item.track_id]
        return [(f"{name}, {number} of them", points[name]) for name, number in sorted(targets.items())]

    def as_dict(self, scene: "Scene", log: Path, labels: Path) -> dict[str, Any]:
        rows = [{"what": name, "points": points} for name, points in self._rows(scene)]
        return {"output": str(log), "labels": str(labels), "frames": self.frames, "points": rows}

    def as_text(self, scene: "Scene", log: Path, labels: Path, seconds: float) -> str:
        rows = [(name, f"{points / self.frames:,.0f}") for name, points in self._rows(scene)]
        shown = table(("what", "points a frame"), rows)
        indented = "\n".join("  " + line for line in shown.splitlines())
        pace = f"{count(self.frames)} in {seconds:.1f} s ({self.frames / seconds:.0f} frames/s)"
        return f"{log}, {labels}\n{indented}\n{pace}"
