"""``seaclutter view``: frames in the Rerun viewer."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    config_options,
    console_options_without_json,
    grouped,
    label_options,
    logs_argument,
    reading_options,
)
from seaclutter_cli.commands.places import output_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.view import ViewOptions

_OPTIONS = (
    output_option(
        "--save",
        "target",
        metavar="FILE.rrd",
        help="Write a file for the viewer instead of opening it; needs no display.",
    ),
    click.option("--force", is_flag=True, help="Replace an existing file."),
    click.option("--port", type=click.IntRange(1, 65535), default=9876, show_default=True, help="Port of the viewer."),
    label_options(required=False),
    config_options,
    reading_options,
)


@click.command(name="view", short_help="Open logs in the Rerun viewer.")
@logs_argument
@grouped("options", "runs.view:ViewOptions", _OPTIONS)
@console_options_without_json
def command(logs: tuple[str, ...], options: "ViewOptions", console: Console) -> None:
    """Show LOGS in the Rerun viewer: raw, removed and kept points, boxes, clusters and threshold curves.

    LOGS are raw logs, which are filtered first, or logs written by `filter --keep-raw --with-removed`. The viewer only
    listens on this computer. It needs the extra `view`.
    """
    from seaclutter_cli.runs.view import view_logs

    console.finish(view_logs(logs, options, console))
