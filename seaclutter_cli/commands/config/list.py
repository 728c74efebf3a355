"""``seaclutter config list``: lists of built-in items."""

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import debug_option, grouped, json_option

_KINDS = ("sensors", "methods", "formats", "configs", "scenes", "layouts", "tiles", "lidars")


@click.command(name="list")
@click.argument("kinds", metavar="[KIND]...", nargs=-1, type=click.Choice(_KINDS))
@click.option(
    "--match", "text", metavar="TEXT", default="", help="List only names, makers and summaries that contain TEXT."
)
@grouped("console", "commands.console:Console", (json_option, debug_option))
def command(kinds: tuple[str, ...], text: str, console: Console) -> None:
    """List built-in items, by default of every KIND.

    KIND is sensors, methods, formats, configs, scenes, layouts, tiles (scenes from the air), or lidars (to simulate).
    """
    from seaclutter_cli.runs.builtin import list_builtin

    console.finish(list_builtin().only(kinds or _KINDS, text))
