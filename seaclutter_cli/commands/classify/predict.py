"""``seaclutter classify predict``: names of points and objects, by a model."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.classify.options import output_option, settings_options, tiles_argument
from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, force_option, grouped, path_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.classify.predict import NameTilesOptions

_OPTIONS = (
    click.option(
        "--model",
        required=True,
        type=click.Path(path_type=Path, dir_okay=False),
        metavar="MODEL",
        help="A model that train has written.",
    ),
    path_option("--csv", "csv_file", help="Also write a line for each object."),
    path_option("--geojson", "geojson_file", help="Also write the objects' boxes."),
    path_option("--plot", "plot_file", help="Draw the tile from above, as PNG or SVG."),
    force_option,
    settings_options,
)


@click.command(name="predict", short_help="Name points and objects, by a model.")
@tiles_argument
@output_option
@grouped("options", "runs.classify.predict:NameTilesOptions", _OPTIONS)
@console_options
def command(tiles: tuple[str, ...], output: Path, options: "NameTilesOptions", console: Console) -> None:
    """Name what stands out of the sea in each TILE, by a model, and find the objects.

    Each point gets predicted_class (0 none, else as in train), probability and predicted_object as further
    dimensions, and classification as by separate. Boxes are in the tile's own coordinates.
    """
    from seaclutter_cli.runs.classify.predict import name_tiles

    console.finish(name_tiles(tiles, output, options, console))
