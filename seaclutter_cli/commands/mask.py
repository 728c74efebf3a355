"""``seaclutter mask``: a mask of own ship's structure."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, force_option, grouped, logs_argument, reading_options
from seaclutter_cli.commands.places import output_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.mask import MaskOptions

_OPTIONS = (
    output_option(
        "-o", "--output", metavar="MASK.csv", help="Write the mask, for the configuration key filter.mask.", remote=True
    ),
    output_option("--plot", "plot_file", help="Draw the mask (.png or .svg).", remote=True),
    click.option(
        "--reach",
        "reach_m",
        type=float,
        default=20.0,
        metavar="METRES",
        show_default=True,
        help="Range up to which structure is searched; somewhat more than own ship's length.",
    ),
    force_option,
    reading_options,
)


@click.command(name="mask", short_help="Propose a mask of own ship's structure.")
@logs_argument
@grouped("options", "runs.mask:MaskOptions", _OPTIONS)
@console_options
def command(logs: tuple[str, ...], options: "MaskOptions", console: Console) -> None:
    """Find own ship's masts, rails and roofs in LOGS, and write a mask of them.

    Own structure returns in the same directions at the same ranges while all else changes, so use a log under way. A
    mask has directions, by beam and azimuth, with a span of ranges; points behind the structure are kept. Several LOGS
    must be of the same lidar in the same place. Nothing is masked if the vessel seems to be at rest.

    `filter -s filter.mask=MASK.csv`, or `mask: MASK.csv` in a configuration, uses it.
    """
    from seaclutter_cli.runs.mask import find_mask

    console.finish(find_mask(logs, options, console))
