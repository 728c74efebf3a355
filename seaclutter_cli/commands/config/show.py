"""``seaclutter config show``: the effective configuration."""

import json
from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import config_options, debug_option, grouped, json_option
from seaclutter_cli.commands.printer import show_exactly

if TYPE_CHECKING:
    from seaclutter_cli.runs.methods import ConfigOptions


@click.command(name="show")
@config_options
@grouped("console", "commands.console:Console", (json_option, debug_option))
def command(config: "ConfigOptions", console: Console) -> None:
    """Print the effective configuration, ready to save and edit."""
    effective = config.load()
    if console.as_json:
        show_exactly(json.dumps(effective.as_dict(), indent=2))  # a configuration, which has no version of a schema
    else:
        show_exactly(effective.to_yaml(comments=True).rstrip("\n"))
