"""``seaclutter filter``: filtered copies of logs."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    config_options,
    console_options,
    dry_run_option,
    force_option,
    grouped,
    label_options,
    logs_argument,
    reading_options,
    resumable_batch_options,
)
from seaclutter_cli.commands.places import output_option, output_or_folder_option
from seaclutter_cli.commands.written import format_option, log_options

if TYPE_CHECKING:
    from seaclutter_cli.runs.filter import FilterOptions

_WRITTEN = (
    click.option(
        "--keep-raw", is_flag=True, help="Keep the raw cloud on its topic; write the filtered one to TOPIC/filtered."
    ),
    click.option("--with-removed", is_flag=True, help="Write removed points to TOPIC/removed, with the reason."),
    click.option(
        "--keep-organized", is_flag=True, help="Keep the shape of organised clouds; set removed points to NaN."
    ),
    click.option(
        "--diagnostics/--no-diagnostics", default=True, help="Write the topic /seaclutter/diagnostics, or leave it out."
    ),
    *log_options,
)
_OPTIONS = (
    force_option,
    config_options,
    reading_options,
    output_option("--csv", "csv_file", help="Also write a table with a row for each frame.", remote=True),
    format_option,
    grouped("written", "sinks.options:McapOptions", _WRITTEN),
    click.option("--with-scene", is_flag=True, help="Write boxes around clusters to /seaclutter/scene, for 3D panels."),
    label_options(required=False),
    resumable_batch_options,
)


@click.command(name="filter", short_help="Filter logs into drop-in logs, MCAP or another format.")
@logs_argument
@output_or_folder_option("Output of one recording; folder for several, or with a slash at its end.", remote=True)
@grouped("options", "runs.filter:FilterOptions", _OPTIONS)
@dry_run_option
@console_options
def command(logs: tuple[str, ...], output: str, options: "FilterOptions", dry_run: bool, console: Console) -> None:
    """Filter each frame of LOGS and write filtered logs, by default MCAP files.

    LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs. Every
    other topic, attachment and metadata record is copied unchanged: the output is a drop-in replacement for the input.
    What another format cannot keep is named in a warning. A ROS 2 recording is a folder; PCD, LAS, LAZ and NPZ are
    folders with a file for each frame.
    """
    if dry_run:
        from seaclutter_cli.runs.plan import plan_filter

        console.finish(plan_filter(logs, output, options, console))
    from seaclutter_cli.runs.filter import filter_logs

    console.finish(filter_logs(logs, output, options, console))
