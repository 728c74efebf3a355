"""Options shared by the classify commands."""

import click

from seaclutter_cli.commands.options import grouped, jobs_option_for, set_option
from seaclutter_cli.commands.places import config_file_option, output_or_folder_option

tiles_argument = click.argument("tiles", metavar="TILE...", nargs=-1, required=True)
tiles_output_option = output_or_folder_option(
    "Output file for one tile; folder for several, or with a slash at its end: LAS, LAZ, PCD, PLY or MCAP."
)
settings_options = grouped(
    "settings",
    "runs.classify.tiles:TileSettingsOptions",
    (config_file_option("Settings file."), set_option("separation.window_m=30")),
)
"""Sources of the settings; passed as ``settings``."""
tile_jobs_option = jobs_option_for("tiles")
"""Option for the number of processes; passed as ``batch``."""
