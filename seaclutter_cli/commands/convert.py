"""``seaclutter convert``: logs in other formats."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    console_options,
    dry_run_option,
    force_option,
    grouped,
    logs_argument,
    reading_options_without_intensity,
    resumable_batch_options,
)
from seaclutter_cli.commands.places import output_or_folder_option
from seaclutter_cli.commands.written import format_option, log_options

if TYPE_CHECKING:
    from seaclutter_cli.runs.convert import ConvertOptions

_OPTIONS = (
    force_option,
    reading_options_without_intensity,
    format_option,
    grouped("written", "sinks.options:McapOptions", log_options),
    resumable_batch_options,
)


@click.command(name="convert", short_help="Convert logs to another format, whole or in part.")
@logs_argument
@output_or_folder_option("Output of one recording; folder for several, or with a slash at its end.", remote=True)
@grouped("options", "runs.convert:ConvertOptions", _OPTIONS)
@dry_run_option
@console_options
def command(logs: tuple[str, ...], output: str, options: "ConvertOptions", dry_run: bool, console: Console) -> None:
    """Convert LOGS to another format, without filtering.

    LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs. All
    topics are converted, messages between ROS 1 and ROS 2 with their definitions; what a format cannot keep is named
    in a warning. A ROS 2 recording is a folder. PCD, LAS, LAZ and NPZ are folders with a file for each frame of one
    topic, or a file if the recording has one frame.
    """
    if dry_run:
        from seaclutter_cli.runs.plan import plan_conversion

        console.finish(plan_conversion(logs, output, options, console))
    from seaclutter_cli.runs.convert import convert_logs

    console.finish(convert_logs(logs, output, options, console))
