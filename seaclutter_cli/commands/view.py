"""``seaclutter view``: frames in a viewer that people already use."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    config_options,
    console_options_without_json,
    grouped,
    label_options,
    logs_argument,
    path_option,
    reading_options,
)

if TYPE_CHECKING:
    from seaclutter_cli.runs.view import ViewOptions

_OPTIONS = (
    path_option(
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


@click.command(name="view", short_help="Open logs in the viewer of Rerun.")
@logs_argument
@grouped("options", "runs.view:ViewOptions", _OPTIONS)
@console_options_without_json
def command(logs: tuple[str, ...], options: "ViewOptions", console: Console) -> None:
    """Show LOGS in the viewer of Rerun: raw, removed by reason, kept, boxes, clusters and threshold curves.

    LOGS are raw logs, which are filtered on the way, or logs that `filter --keep-raw --with-removed` has written. The
    viewer listens on this computer only. It comes with the extra `view`.
    """
    from seaclutter_cli.runs.view import view_logs

    console.finish(view_logs(logs, options, console))
