"""``seaclutter report``: what a filter did and how well, as one page that opens offline."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    console_options,
    force_option,
    grouped,
    label_options,
    logs_argument,
    methods_options,
    path_option,
    reading_options,
)

if TYPE_CHECKING:
    from seaclutter_cli.runs.report import ReportOptions

_OPTIONS = (
    path_option(
        "-o",
        "--output",
        metavar="REPORT.html",
        required=True,
        help="The page: one file that opens in any browser, without a network.",
    ),
    force_option,
    path_option("--figures", "figure_folder", metavar="DIR", help="Also write every figure as a picture for print."),
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
        help="Frames whose points go into the page.",
    ),
    click.option(
        "--pick", "picks", multiple=True, type=click.IntRange(min=0), metavar="K", help="Show frame K too; repeatable."
    ),
    label_options(required=False),
    methods_options,
    reading_options,
)


@click.command(name="report", short_help="Show what a filter did, and how well, in one page.")
@logs_argument
@grouped("options", "runs.report:ReportOptions", _OPTIONS)
@console_options
def command(logs: tuple[str, ...], options: "ReportOptions", console: Console) -> None:
    """Write a page that shows what a filter did to LOGS and, with labels, how well.

    LOGS are raw logs, which are filtered for the report; or logs that `filter --keep-raw --with-removed` has written,
    of which nothing is computed again. The page shows points of some frames: of the worst, the best, and of some evenly
    spread between.
    """
    from seaclutter_cli.runs.report import report_on

    console.finish(report_on(logs, options, console))
