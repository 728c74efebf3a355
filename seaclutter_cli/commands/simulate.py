"""``seaclutter simulate``: labelled lidar recordings of simulated scenes."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    batch_options,
    console_options,
    force_option,
    grouped,
)
from seaclutter_cli.commands.places import output_option, output_or_folder_option
from seaclutter_cli.errors import UsageError
from seaclutter_cli.text import named_folder

if TYPE_CHECKING:
    from seaclutter_cli.runs.batch import BatchOptions
    from seaclutter_cli.runs.simulate import SimulateOptions


def _seeds(_: click.Context, __: click.Parameter, text: str | None) -> tuple[int, ...] | None:
    if text is None:
        return None
    from seaclutter_cli.runs.simulate_seeds import parse_seeds

    return parse_seeds(text)


_OPTIONS = (
    click.option(
        "--format",
        "form",
        type=click.Choice(["mcap", "pcap"]),
        help="MCAP with PointCloud2, or packets of a RoboSense lidar; by default from the suffix of LOG.",
    ),
    force_option,
    click.option(
        "-n", "--frames", type=click.IntRange(min=1), metavar="N", help="Number of frames; overrides the scene."
    ),
    click.option(
        "--seed",
        type=click.IntRange(min=0),
        metavar="N",
        help="Random seed; overrides the scene. 1 by default for a layout.",
    ),
    click.option("--lidar", metavar="NAME", help="Lidar model; overrides the scene."),
    output_option("--scene-file", metavar="YAML", help="Save the scene with all defaults and comments, for editing."),
)


@click.command(name="simulate", short_help="Simulate a labelled lidar recording of a scene.")
@click.argument("scene")
@output_or_folder_option("Recording to write; .las or .laz for a tile; with --seeds, a folder.")
@grouped("options", "runs.simulate:SimulateOptions", _OPTIONS)
@click.option(
    "--seeds", metavar="SEEDS", callback=_seeds, help="Simulate a recording for each seed, such as 1..5 or 1,2,7."
)
@batch_options
@console_options
def command(
    scene: str,
    output: str,
    options: "SimulateOptions",
    seeds: tuple[int, ...] | None,
    batch: "BatchOptions",
    console: Console,
) -> None:
    """Simulate a labelled lidar recording of SCENE: a scene file (YAML), or the name of a built-in scene or layout.

    LOG.mcap has clouds with a field `label`: 0 for clutter, 65535 for own ship or ignored points, otherwise the number
    of the target. LOG.labels.csv has a box for each target and frame. LOG.pcap has packets, which carry no labels. A
    layout generates a different scene for each seed. A scene with a section `tile` is recorded from the air: the output
    is a LAS or LAZ file with the true class of each point (classification, object_class, object_id). `seaclutter
    config list` lists the built-in scenes, layouts, tiles and lidars. With --seeds, the recordings are
    OUT/SCENE_SEED.mcap, and tiles OUT/SCENE_SEED.laz.
    """
    if seeds is not None:
        if options.seed is not None:
            raise UsageError("--seed and --seeds: give one of them")
        from seaclutter_cli.runs.simulate_seeds import simulate_seeds

        console.finish(simulate_seeds(scene, output, seeds, options, batch, console))
    if named_folder(output):
        raise UsageError(f"{output}: names a folder by the slash at its end; -o takes a file, or a folder with --seeds")
    from seaclutter_cli.runs.simulate import simulate_scene

    console.finish(simulate_scene(scene, Path(output), options, console))
