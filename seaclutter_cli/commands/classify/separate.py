"""``seaclutter classify separate``: separation of tiles into sea and non-sea points."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.classify.options import (
    settings_options,
    tiles_argument,
    tiles_output_option,
)
from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, force_option, grouped, resumable_batch_options_for
from seaclutter_cli.commands.places import output_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.classify.separate import SeparateTilesOptions


def _classes(_: click.Context, parameter: click.Parameter, text: str | None) -> tuple[int, ...] | None:
    if text is None:
        return None
    given = {one.strip() for one in text.split(",")}
    if not given <= {"2", "9"}:
        raise click.BadParameter("must be 2, 9, or 2,9", param=parameter)
    return tuple(sorted(map(int, given)))


_OPTIONS = (
    click.option("--with-height", is_flag=True, help="Also write each point's height above the sea surface."),
    click.option(
        "--land",
        type=click.Choice(["keep", "class2", "ignore"]),
        help="Low and flat land: non-sea points; ASPRS class 2 on the ground; or not looked for, so that it is sea."
        " [default: keep]",
    ),
    click.option(
        "--margin",
        "margin_m",
        type=click.FloatRange(min=0, max=1000),
        default=100.0,
        metavar="METRES",
        show_default=True,
        help="Width of the margin in which points of neighbouring tiles count; 0 for none.",
    ),
    click.option(
        "--trust-classes",
        callback=_classes,
        metavar="CLASSES",
        help="Classes of the input that are right: 2 (ground), 9 (water), or 2,9. Their points keep them, and show"
        " where land and water are.  [default: none]",
    ),
    click.option(
        "--window",
        "window_m",
        type=click.FloatRange(min=50, max=100_000),
        metavar="METRES",
        help="Read COPC files in windows of this width, and write a tile for each; for files larger than memory.",
    ),
    grouped(
        "maps",
        "runs.classify.maps:MapOptions",
        (
            output_option("--plot", "plot_file", help="Draw a map with water level, land and objects, as PNG or SVG."),
            output_option(
                "--geojson", "geojson_file", help="Also write the shoreline and the boxes of objects as GeoJSON."
            ),
            output_option(
                "--gpkg", "gpkg_file", help="Also write the shoreline and the boxes of objects as GeoPackage."
            ),
        ),
    ),
    force_option,
    settings_options,
    resumable_batch_options_for("tile"),
)


@click.command(name="separate", short_help="Separate tiles into sea and non-sea points.")
@tiles_argument
@tiles_output_option
@grouped("options", "runs.classify.separate:SeparateTilesOptions", _OPTIONS)
@console_options
def command(tiles: tuple[str, ...], output: str, options: "SeparateTilesOptions", console: Console) -> None:
    """Separate each TILE into sea and non-sea points by morphological opening; on rough water, follow the waves.

    Sea points get the ASPRS class 9 (water), all others 1; land is recognised by its level, flatness and echoes.
    Everything else in a LAS or LAZ file is kept; a record says which waves were found. Several tiles are a survey:
    each is separated with a margin from its neighbours. TILE is a LAS or LAZ file, or a
    PCD, PLY, NPY, KITTI or CSV file in metres with z upwards, or a folder or glob of such files.
    """
    from seaclutter_cli.runs.classify.separate import separate_tiles

    console.finish(separate_tiles(tiles, output, options, console))
