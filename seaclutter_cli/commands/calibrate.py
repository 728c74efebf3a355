"""``seaclutter calibrate``: thresholds and the far limit from recordings that hold clutter."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    config_options,
    console_options,
    force_option,
    grouped,
    label_options,
    logs_argument,
    path_option,
    reading_options,
)

if TYPE_CHECKING:
    from seaclutter_cli.runs.calibrate import CalibrateOptions

_OPTIONS = (
    path_option("-o", "--output", metavar="CONFIG", required=True, help="Configuration to write, for filter -c."),
    force_option,
    click.option(
        "--filter-rate",
        type=click.FloatRange(min=0, max=1, min_open=True),
        default=0.8,
        metavar="SHARE",
        show_default=True,
        help="Share of the clutter points of each ring that are to be below its threshold.",
    ),
    click.option(
        "--keep-end",
        is_flag=True,
        help="Keep the configuration's far limit, end_m. -s filter.end_m=METRES does so too.",
    ),
    path_option("--plot", "plot_file", help="Also draw clutter and thresholds over range; .png or .svg."),
    label_options(required=False),
    config_options,
    reading_options,
)


@click.command(short_help="Find thresholds and the far limit for a sensor, and write a configuration.")
@logs_argument
@grouped("options", "runs.calibrate:CalibrateOptions", _OPTIONS)
@console_options
def command(logs: tuple[str, ...], options: "CalibrateOptions", console: Console) -> None:
    """Find the thresholds of each ring and the far limit of clutter in LOGS, and write a configuration.

    LOGS should hold sea clutter seen by your sensor, and no targets; where there are some, --labels leaves them out.
    The configuration given with -c is the starting point, for the rings and all that is not found here.
    """
    from seaclutter_cli.runs.calibrate import calibrate_logs

    console.finish(calibrate_logs(logs, options, console))
