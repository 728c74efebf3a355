"""``seaclutter config``: configurations, and lists of built-in sensors, methods and scenes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.printer import show, show_exactly
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.options import Anything, Choice, Options, UseCase, option
from seaclutter_cli.runs.options import ConfigOptions
from seaclutter_cli.text import printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seaclutter_cli.commands.console import Console

_KINDS = ("sensors", "methods", "formats", "configs", "scenes", "layouts", "tiles", "lidars", "plugins")


def _show(console: Console, **sources: Any) -> None:
    from seaclutter_cli.runs.methods import configured

    effective = configured(ConfigOptions(**sources))
    if console.as_json:
        show_exactly(json.dumps(effective.as_dict(), indent=2))  # a configuration, which has no version of a schema
    else:
        show_exactly(effective.to_yaml(comments=True).rstrip("\n"))


def _check(console: Console, files: Sequence[str]) -> None:
    from seaclutter_cli.config import load_config

    valid = True
    for file in files:
        try:
            config = load_config(Path(file))
        except ConfigError as error:
            console.fail(error)
            valid = False
        else:
            show(f"{printable(file)}: valid, method {config.method}")
    if not valid:
        raise click.exceptions.Exit(ConfigError.exit_code)


class _ShowOptions(ConfigOptions):
    """Print the effective configuration, ready to save and edit."""

    use_case = UseCase("config show", _show, messages=("as_json",))


class _CheckOptions(Options):
    """Check configuration files and list all errors."""

    use_case = UseCase("config check", _check, messages=())

    files: Sequence[str] = option("FILES...", "Configuration files.", kind=Anything())


class _ListOptions(Options):
    """List built-in items, by default of every KIND.

    KIND is sensors, methods, formats, configs, scenes, layouts, tiles (scenes from the air), lidars (to simulate), or
    plugins (of installed packages).
    """

    use_case = UseCase(
        "config list",
        "runs.builtin.list_builtin",
        messages=("as_json",),
        short_help="List built-in sensors, methods, formats, configurations, scenes and lidars.",
    )

    kinds: Sequence[str] = option("[KIND]...", "Kinds of items.", default=(), kind=Choice(_KINDS))
