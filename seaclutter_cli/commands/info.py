"""``seaclutter info``: the content of logs."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import batch_options, console_options, logs_argument, reading_options

if TYPE_CHECKING:
    from seaclutter_cli.runs.batch import BatchOptions
    from seaclutter_cli.runs.recordings import ReadOptions


@click.command(name="info", short_help="Show the content of logs and the settings that a filter run needs.")
@logs_argument
@reading_options
@batch_options
@console_options
def command(logs: tuple[str, ...], reading: "ReadOptions", batch: "BatchOptions", console: Console) -> None:
    """Show the content of LOGS: topics, frames, fields, extents, and the settings that a filter run needs.

    Every frame is read; -n N stops after the first N. Of an MCAP file of more than 16 MB in object storage, the summary
    and the first frames are read, unless -n or a time is given.
    """
    from seaclutter_cli.runs.info import describe_logs

    console.finish(describe_logs(logs, reading, console, batch))
