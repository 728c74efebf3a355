"""``seaclutter config sensors``: what is built in."""

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import debug_option, grouped, json_option


@click.command(name="sensors")
@grouped("console", "commands.console:Console", (json_option, debug_option))
def command(console: Console) -> None:
    """List what is built in: sensors, methods, formats, configurations, scenes, layouts and lidars to simulate."""
    from seaclutter_cli.runs.builtin import list_builtin

    console.finish(list_builtin())
