"""``seaclutter config``: show and check configurations, list what is built in."""

import json
import textwrap
from pathlib import Path

import click

from seaclutter_cli.commands.console import table
from seaclutter_cli.commands.options import config_options, debug_option
from seaclutter_cli.errors import ConfigError


@click.group(name="config")
def command() -> None:
    """Show and check configurations; list what is built in."""


@command.command()
@config_options
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
@debug_option
def show(config_file: Path | None, method: str | None, overrides: tuple[str, ...], as_json: bool) -> None:
    """Print the effective configuration, ready to be saved and changed."""
    from seaclutter_cli.config import load_config

    config = load_config(config_file, method=method, overrides=overrides)
    click.echo(json.dumps(config.as_dict(), indent=2) if as_json else config.to_yaml(comments=True), nl=as_json)


@command.command()
@click.argument("files", metavar="FILES...", nargs=-1, required=True, type=click.Path(path_type=Path))
@debug_option
def check(files: tuple[Path, ...]) -> None:
    """Tell whether configuration files are valid, with everything that is wrong."""
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


@command.command()
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
@debug_option
def sensors(as_json: bool) -> None:
    """List what is built in: sensors, methods, formats, configurations, scenes, layouts and lidars to simulate."""
    from seaclutter_cli.filters import FILTERS
    from seaclutter_cli.sensors.catalog import SENSORS
    from seaclutter_cli.simulation.airborne.scene import builtin_tiles
    from seaclutter_cli.simulation.layouts import LAYOUTS
    from seaclutter_cli.simulation.lidar.models import LIDARS
    from seaclutter_cli.simulation.marine.scene import builtin_scenes
    from seaclutter_cli.sources import SOURCES
    from seaclutter_cli.sources.frame_files import FRAME_READERS
    from seaclutter_cli.validation import builtin_files

    methods = {name: (kind.__doc__ or "").splitlines()[0] for name, kind in FILTERS.items()}
    lists = {
        "formats": [form.title for form in SOURCES.values()] + [f"*{suffix}" for suffix in FRAME_READERS],
        "configs": [path.name for path in builtin_files().values()],
        "scenes": list(builtin_scenes()),
        "layouts": list(LAYOUTS),
        "tiles": list(builtin_tiles()),
        "lidars": list(LIDARS),
    }
    if as_json:
        listed = {name: {"maker": s.maker, "beams": s.beams, "columns": s.columns} for name, s in SENSORS.items()}
        click.echo(json.dumps({"sensors": listed, "methods": methods, **lists}, indent=2))
        return
    rows = [(name, s.maker, s.beams, s.columns, s.intensity) for name, s in SENSORS.items()]
    click.echo(table(("sensor", "maker", "beams", "columns", "intensity"), rows))
    click.echo("\n" + table(("method", ""), [(f"{name:<24}{said}", "") for name, said in methods.items()]))
    click.echo()
    for name, values in lists.items():
        click.echo(textwrap.fill(f"{name:<9} {', '.join(values)}", 79, subsequent_indent=" " * 10))
