"""``seaclutter simulate``: labelled lidar recordings of simulated scenes."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, force_option, grouped, output_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.simulation import SimulateOptions

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
    output_option("--scene-file", metavar="YAML", help="Save the scene as an editable file."),
)


@click.command(name="simulate", short_help="Simulate a labelled lidar recording of a scene.")
@click.argument("scene")
@output_option("-o", "--output", metavar="LOG.mcap", required=True, help="Recording to write; .las or .laz for a tile.")
@grouped("options", "runs.simulation:SimulateOptions", _OPTIONS)
@console_options
def command(scene: str, output: Path, options: "SimulateOptions", console: Console) -> None:
    """Simulate a labelled lidar recording of SCENE: a scene file (YAML), or the name of a built-in scene or layout.

    LOG.mcap has clouds with a field `label`: 0 for clutter, 65535 for own ship or ignored points, otherwise the number
    of the target. LOG.labels.csv has a box for each target and frame. LOG.pcap has packets, which carry no labels. A
    layout generates a different scene for each seed. A scene with a section `tile` is recorded from the air: the output
    is a LAS or LAZ file with the true class of each point (classification, object_class, object_id). `seaclutter
    config sensors` lists the built-in scenes, layouts, tiles and lidars.
    """
    from seaclutter_cli.runs.simulate import simulate_scene

    console.finish(simulate_scene(scene, output, options, console))
