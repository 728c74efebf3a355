"""``seaclutter simulate``: labelled recordings of a lidar at sea."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, force_option, grouped, path_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.simulation import SimulateOptions

_OPTIONS = (
    click.option(
        "--format",
        "form",
        type=click.Choice(["mcap", "pcap"]),
        help="MCAP with PointCloud2, or packets of a RoboSense lidar; by default as LOG ends.",
    ),
    force_option,
    click.option("-n", "--frames", type=click.IntRange(min=1), metavar="N", help="Turns, whatever the scene says."),
    click.option(
        "--seed", type=click.IntRange(min=0), metavar="N", help="Seed, whatever the scene says; of a layout 1."
    ),
    click.option("--lidar", metavar="NAME", help="Lidar, whatever the scene says."),
    path_option("--scene-file", metavar="YAML", help="Save the scene as a file that can be edited."),
)


@click.command(name="simulate", short_help="Make a labelled lidar recording of a scene at sea.")
@click.argument("scene")
@path_option("-o", "--output", metavar="LOG.mcap", required=True, help="The recording; a tile ends in .las or .laz.")
@grouped("options", "runs.simulation:SimulateOptions", _OPTIONS)
@console_options
def command(scene: str, output: Path, options: "SimulateOptions", console: Console) -> None:
    """Make a labelled lidar recording of SCENE: a scene file (YAML), or the name of a built-in scene or layout.

    Writes LOG.mcap, whose clouds have a field `label` (0 clutter, 65535 own vessel or ignored, else the target), and
    LOG.labels.csv with a box for each target and frame. LOG.pcap holds packets instead, which have no labels. A layout
    is a kind of scenes, of which each seed makes another. Of a scene with a section `tile`, seen from the air, it
    writes a LAS or LAZ file with the truth of each point: classification, object_class, object_id. `seaclutter config
    sensors` lists scenes, layouts, tiles, lidars.
    """
    from seaclutter_cli.runs.simulate import simulate_scene

    console.finish(simulate_scene(scene, output, options, console))
