"""``seaclutter classify separate``: the sea apart from what stands out of it."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.classify.options import output_option, settings_options, tiles_argument
from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, force_option, grouped

if TYPE_CHECKING:
    from seaclutter_cli.runs.classify.separate import SeparateTilesOptions

_OPTIONS = (
    click.option("--with-height", is_flag=True, help="Also write each point's height above the sea surface."),
    force_option,
    settings_options,
)


@click.command(name="separate", short_help="Tell sea from what stands out of it.")
@tiles_argument
@output_option
@grouped("options", "runs.classify.separate:SeparateTilesOptions", _OPTIONS)
@console_options
def command(tiles: tuple[str, ...], output: Path, options: "SeparateTilesOptions", console: Console) -> None:
    """Tell the sea in each TILE from what stands out of it, by morphological opening.

    Points of the sea get the ASPRS class 9 (water), all others 1. Everything else of a LAS or LAZ file stays as it is.
    TILE is a LAS or LAZ file, or a PCD, PLY, NPY, KITTI or CSV file in metres with z upwards; folders and globs stand
    for the tiles in them.
    """
    from seaclutter_cli.runs.classify.separate import separate_tiles

    console.finish(separate_tiles(tiles, output, options))
