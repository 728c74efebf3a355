"""``seaclutter config sensors``: lists of built-in items."""

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import debug_option, grouped, json_option


@click.command(name="sensors")
@grouped("console", "commands.console:Console", (json_option, debug_option))
def command(console: Console) -> None:
    """List built-in sensors, methods, formats, configurations, scenes, layouts, tiles and lidars to simulate."""
    from seaclutter_cli.runs.builtin import list_builtin

    console.finish(list_builtin())
