"""``seaclutter config check``: validation of configuration files."""

from pathlib import Path

import click

from seaclutter_cli.commands.console import DEBUG
from seaclutter_cli.commands.options import debug_option
from seaclutter_cli.commands.printer import show, show_error
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.text import printable


@click.command(name="check")
@click.argument("files", metavar="FILES...", nargs=-1, required=True, type=click.Path(path_type=Path))
@debug_option
@click.pass_context
def command(context: click.Context, files: tuple[Path, ...]) -> None:
    """Check configuration files and list all errors."""
    from seaclutter_cli.config import load_config

    valid = True
    for file in files:
        try:
            config = load_config(file)
        except ConfigError as error:
            if DEBUG in context.meta:
                raise
            show_error(error)
            valid = False
        else:
            show(f"{printable(str(file))}: valid, method {config.method}")
    if not valid:
        context.exit(ConfigError.exit_code)
