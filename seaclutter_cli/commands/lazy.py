"""Command groups that import a command when it is called, so that help comes at once."""

import importlib
from collections.abc import Mapping
from typing import Any

import click


class LazyGroup(click.Group):
    """A group whose commands are modules, each with a ``command``.

    Parameters
    ----------
    name : str
        Package of the modules below this one; ``cli``, the program itself, has those of this one.
    commands : mapping of str to str
        Modules and their short help. A new command is an entry here and a file of the same name.
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
        """Import a command; None if there is no such one."""
        if cmd_name not in self._commands:
            return None
        command: click.Command = importlib.import_module(f"{self._package}.{cmd_name}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the commands with their short help, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self._commands.items()))
