"""``seaclutter info``: what a log holds."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, logs_argument, reading_options

if TYPE_CHECKING:
    from seaclutter_cli.runs.recordings import ReadOptions


@click.command(short_help="Show what a log holds and what a filter run would need to be told.")
@logs_argument
@reading_options
@console_options
def command(logs: tuple[str, ...], reading: "ReadOptions", console: Console) -> None:
    """Show what LOGS hold: topics, frames, fields, extents, and what a filter run would need to be told.

    Every frame is read; -n N stops after the first N.
    """
    from seaclutter_cli.runs.survey import survey_logs

    console.finish(survey_logs(logs, reading, console))
