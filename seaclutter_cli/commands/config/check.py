"""``seaclutter config check``: validation of configuration files."""

from pathlib import Path

import click

from seaclutter_cli.commands.options import debug_option
from seaclutter_cli.errors import ConfigError


@click.command(name="check")
@click.argument("files", metavar="FILES...", nargs=-1, required=True, type=click.Path(path_type=Path))
@debug_option
def command(files: tuple[Path, ...]) -> None:
    """Check configuration files and list all errors."""
    from seaclutter_cli.config import load_config

    problems = []
    for file in files:
        try:
            config = load_config(file)
        except ConfigError as error:
            problems.append(str(error))
        else:
            click.echo(f"{file}: valid, method {config.method}")
    if problems:
        raise ConfigError("\n".join(problems))
