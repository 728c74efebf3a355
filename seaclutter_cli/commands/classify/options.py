"""Options shared by the classify commands."""

import click

from seaclutter_cli.commands.options import config_file_option, grouped, path_option, set_option

tiles_argument = click.argument("tiles", metavar="TILE...", nargs=-1, required=True)
output_option = path_option(
    "-o",
    "--output",
    metavar="OUT",
    required=True,
    help="Output file for one tile, folder for several: LAS, LAZ, PCD, PLY or MCAP.",
)
settings_options = grouped(
    "settings",
    "runs.classify.tiles:TileSettingsOptions",
    (config_file_option("Settings file."), set_option("separation.window_m=30")),
)
"""Sources of the settings; passed as ``settings``."""
