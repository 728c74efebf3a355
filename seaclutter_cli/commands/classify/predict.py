"""``seaclutter classify predict``: classes of points and objects from a trained model."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.classify.options import (
    settings_options,
    tile_jobs_option,
    tiles_argument,
    tiles_output_option,
)
from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, force_option, grouped
from seaclutter_cli.commands.places import output_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.classify.predict import ClassifyTilesOptions

_OPTIONS = (
    click.option(
        "--model",
        required=True,
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="MODEL",
        help="Model file from classify train.",
    ),
    output_option("--csv", "csv_file", help="Also write a CSV table with a line for each object."),
    output_option("--geojson", "geojson_file", help="Also write the boxes of the objects as GeoJSON."),
    output_option("--gpkg", "gpkg_file", help="Also write the boxes and the shoreline as GeoPackage."),
    output_option("--plot", "plot_file", help="Draw a top view of the tile, as PNG or SVG."),
    force_option,
    settings_options,
    tile_jobs_option,
)


@click.command(name="predict", short_help="Classify points and objects with a trained model.")
@tiles_argument
@tiles_output_option
@grouped("options", "runs.classify.predict:ClassifyTilesOptions", _OPTIONS)
@console_options
def command(tiles: tuple[str, ...], output: str, options: "ClassifyTilesOptions", console: Console) -> None:
    """Classify the non-sea points of each TILE with a trained model, and find the objects.

    Each point gets the additional dimensions predicted_class (0 for none, otherwise as in train), probability and
    predicted_object, and the same classification as by separate. The CSV table has the coordinates of the tile;
    GeoJSON and GeoPackage are in WGS 84 if the tile states its coordinate reference system.
    """
    from seaclutter_cli.runs.classify.predict import classify_tiles

    console.finish(classify_tiles(tiles, output, options, console))
