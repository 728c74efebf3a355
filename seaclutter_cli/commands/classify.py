"""``seaclutter classify``: sea and objects in tiles of an airborne lidar."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from seaclutter_cli.commands.options import output_options

F = TypeVar("F", bound=Callable[..., Any])


@click.group(name="classify")
def command() -> None:
    """Take the sea out of airborne lidar tiles and name what is in it."""


def _setting_options(command: F) -> F:
    """Add the options that make up the settings."""
    for option in reversed(_SETTINGS):
        command = option(command)
    return command


_SETTINGS = (
    click.option("-c", "--config", "config_file", type=click.Path(path_type=Path), metavar="FILE", help="Settings."),
    click.option(
        "-s",
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help="Set a key, as in separation.window_m=30; repeatable.",
    ),
)
_tiles_argument = click.argument("tiles", metavar="TILE...", nargs=-1, required=True)
_force_option = click.option("--force", is_flag=True, help="Replace existing output.")


@command.command()
@_tiles_argument
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="File for one tile, folder for several: LAS, LAZ, PCD, PLY or MCAP.",
)
@click.option("--with-height", is_flag=True, help="Also write each point's height above the sea surface.")
@_force_option
@_setting_options
@output_options
def separate(tiles: tuple[str, ...], output: Path, **options: Any) -> None:
    """Tell the sea in each TILE from what stands out of it, by morphological opening.

    Points of the sea get the ASPRS class 9 (water), all others 1. Everything else of a LAS or LAZ file stays as it is.
    TILE is a LAS or LAZ file, or a PCD, PLY, NPY, KITTI or CSV file in metres with z upwards; folders and globs stand
    for the tiles in them.
    """
    from seaclutter_cli.commands.classify_separate import run

    run(tiles, output, options)
