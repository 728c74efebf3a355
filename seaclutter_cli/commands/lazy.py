"""Command groups that import a command only when it is called, to keep help fast."""

import importlib
from collections.abc import Mapping
from typing import Any

import click


class LazyGroup(click.Group):
    """Group whose commands are modules, each with an attribute ``command``.

    Parameters
    ----------
    name : str
        Subpackage of the modules; for ``cli``, the program itself, they are in this package.
    commands : mapping of str to str
        Modules and their short help. To add a command, add an entry here and a module of the same name.
    **options : optional
        As for `click.Group`.
    """

    def __init__(self, name: str | None = None, commands: Mapping[str, str] | None = None, **options: Any) -> None:
        super().__init__(name, **options)
        self._package = "seaclutter_cli.commands" if name in (None, "cli") else f"seaclutter_cli.commands.{name}"
        self._commands = commands or {}

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names of the commands in their order."""
        return list(self._commands)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import and return a command; None if there is no such command."""
        if cmd_name not in self._commands:
            return None
        command: click.Command = importlib.import_module(f"{self._package}.{cmd_name}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the commands with their short help, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self._commands.items()))
