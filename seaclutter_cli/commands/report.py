"""``seaclutter report``: the effect and quality of a filter, in a page that opens offline."""

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.command_line import command_line
from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    console_options,
    force_option,
    grouped,
    label_options,
    logs_argument,
    methods_options,
    reading_options,
)
from seaclutter_cli.commands.places import output_option, path_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.report import ReportOptions

_OPTIONS = (
    output_option(
        "-o",
        "--output",
        metavar="REPORT.html",
        required=True,
        help="HTML page to write; one file that opens offline in any browser.",
        remote=True,
    ),
    force_option,
    path_option(
        "--figures",
        "figure_folder",
        metavar="DIR",
        remote=True,
        help="Also write every figure as a separate file for print.",
    ),
    click.option(
        "--figure-format",
        type=click.Choice(["svg", "png"]),
        default="svg",
        show_default=True,
        help="Format of --figures.",
    ),
    click.option(
        "--show",
        "shown",
        type=click.IntRange(1, 100),
        default=12,
        metavar="N",
        show_default=True,
        help="Number of frames whose points are included in the page.",
    ),
    click.option(
        "--pick", "picks", multiple=True, type=click.IntRange(min=0), metavar="K", help="Also show frame K; repeatable."
    ),
    label_options(required=False),
    methods_options,
    reading_options,
)


@click.command(name="report", short_help="Write a page that shows the effect and quality of a filter.")
@logs_argument
@grouped("options", "runs.report:ReportOptions", _OPTIONS)
@console_options
def command(logs: tuple[str, ...], options: "ReportOptions", console: Console) -> None:
    """Write a page that shows the effect of a filter on LOGS and, with labels, its quality.

    LOGS are raw logs, which are filtered for the report, or logs written by `filter --keep-raw --with-removed`, which
    are not filtered again. The page shows the points of selected frames: the worst, the best, and some evenly spaced
    ones.
    """
    from seaclutter_cli.runs.report import report_on

    console.finish(report_on(logs, replace(options, command=command_line()), console))
