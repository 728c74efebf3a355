"""``seaclutter classify``: sea and objects in tiles of an airborne lidar."""

from pathlib import Path
from typing import Any

import click

from seaclutter_cli.commands.options import config_file_option, force_option, output_options, set_option


@click.group(name="classify")
def command() -> None:
    """Take the sea out of airborne lidar tiles and name what is in it."""


_path = click.Path(path_type=Path)
_file = click.Path(path_type=Path, dir_okay=False)
_tiles_argument = click.argument("tiles", metavar="TILE...", nargs=-1, required=True)
_output_option = click.option(
    "-o",
    "--output",
    required=True,
    type=_path,
    metavar="OUT",
    help="File for one tile, folder for several: LAS, LAZ, PCD, PLY or MCAP.",
)
_config_option = config_file_option("Settings.")
_set_option = set_option("separation.window_m=30")


@command.command(short_help="Tell sea from what stands out of it.")
@_tiles_argument
@_output_option
@click.option("--with-height", is_flag=True, help="Also write each point's height above the sea surface.")
@force_option
@_config_option
@_set_option
@output_options
def separate(tiles: tuple[str, ...], output: Path, **options: Any) -> None:
    """Tell the sea in each TILE from what stands out of it, by morphological opening.

    Points of the sea get the ASPRS class 9 (water), all others 1. Everything else of a LAS or LAZ file stays as it is.
    TILE is a LAS or LAZ file, or a PCD, PLY, NPY, KITTI or CSV file in metres with z upwards; folders and globs stand
    for the tiles in them.
    """
    from seaclutter_cli.commands.classify_separate import run

    run(tiles, output, options)


@command.command(short_help="Train a random forest on labelled tiles.")
@_tiles_argument
@click.option("-o", "--output", required=True, type=_path, metavar="MODEL", help="The model to write.")
@click.option(
    "--class-field",
    default="object_class",
    metavar="NAME",
    show_default=True,
    help="Field with classes, 1 to 8; 0 is none.",
)
@click.option(
    "--object-field",
    default="object_id",
    metavar="NAME",
    show_default=True,
    help="Field that tells objects apart; without it, clusters of a class do.",
)
@click.option("--plot", "plot_file", type=_path, metavar="FILE", help="Draw the confusion matrix, as PNG or SVG.")
@force_option
@_config_option
@_set_option
@output_options
def train(tiles: tuple[str, ...], output: Path, **options: Any) -> None:
    """Train a random forest on labelled TILEs to tell the classes of objects.

    A part of the tiles, or of the objects where there are fewer than four tiles, is held out, and the report is on
    these. Classes are 1 ship, 2 reef, 3 shoal, 4 aquaculture, 5 seaweed, 6 island, 7 fishing fence, 8 garbage patch.
    Needs the extra classify.
    """
    from seaclutter_cli.commands.classify_train import run

    run(tiles, output, options)


@command.command(short_help="Name points and objects, by a model.")
@_tiles_argument
@click.option("--model", required=True, type=_file, metavar="MODEL", help="A model that train has written.")
@_output_option
@click.option("--csv", "csv_file", type=_path, metavar="FILE", help="Also write a line for each object.")
@click.option("--geojson", "geojson_file", type=_path, metavar="FILE", help="Also write the objects' boxes.")
@click.option("--plot", "plot_file", type=_path, metavar="FILE", help="Draw the tile from above, as PNG or SVG.")
@force_option
@_config_option
@_set_option
@output_options
def predict(tiles: tuple[str, ...], output: Path, **options: Any) -> None:
    """Name what stands out of the sea in each TILE, by a model, and find the objects.

    Each point gets predicted_class (0 none, else as in train), probability and predicted_object as further
    dimensions, and classification as by separate. Boxes are in the tile's own coordinates.
    """
    from seaclutter_cli.commands.classify_predict import run

    run(tiles, output, options)
