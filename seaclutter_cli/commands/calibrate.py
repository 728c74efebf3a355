"""``seaclutter calibrate``: thresholds and the far limit from recordings that contain clutter."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    config_options,
    console_options,
    force_option,
    grouped,
    jobs_option,
    label_options,
    logs_argument,
    reading_options,
)
from seaclutter_cli.commands.places import output_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.calibrate import CalibrateOptions

_OPTIONS = (
    output_option(
        "-o", "--output", metavar="CONFIG", required=True, help="Configuration to write, for filter -c.", remote=True
    ),
    force_option,
    click.option(
        "--filter-rate",
        type=click.FloatRange(min=0, max=1, min_open=True),
        default=0.8,
        metavar="SHARE",
        show_default=True,
        help="Share of the clutter points in each range ring that its threshold must remove.",
    ),
    click.option(
        "--choose",
        is_flag=True,
        help="With --labels: compare values of --filter-rate and --max-left on held-out frames, and use the one with "
        "the fewest frames with an error.",
    ),
    click.option(
        "--trade-off", is_flag=True, help="With --labels: show what these values cost and gain, without choosing."
    ),
    click.option(
        "--max-left",
        type=click.FloatRange(min=0, min_open=True),
        metavar="POINTS",
        help="Raise the filter rate of a range ring until at most POINTS clutter points per frame are left.",
    ),
    click.option(
        "--keep-end",
        is_flag=True,
        help="Keep the far limit end_m of the configuration; implied by -s filter.end_m=METRES.",
    ),
    output_option(
        "--plot", "plot_file", help="Also plot clutter and thresholds over range (.png or .svg).", remote=True
    ),
    label_options(required=False),
    config_options,
    reading_options,
    jobs_option,
)


@click.command(
    name="calibrate", short_help="Find thresholds and the far limit for a sensor, and write a configuration."
)
@logs_argument
@grouped("options", "runs.calibrate:CalibrateOptions", _OPTIONS)
@console_options
def command(logs: tuple[str, ...], options: "CalibrateOptions", console: Console) -> None:
    """Find the threshold of each range ring and the far limit of clutter in LOGS, and write a configuration.

    LOGS should contain sea clutter recorded by your sensor, and no targets; use --labels to leave targets out. All
    other settings, including the width of the range rings, come from the configuration given with -c. With
    -m confirmed, the mounting of the lidar is found as well.
    """
    from seaclutter_cli.runs.calibrate import calibrate_logs

    console.finish(calibrate_logs(logs, options, console))
