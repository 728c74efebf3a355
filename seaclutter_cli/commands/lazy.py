"""Command groups that import a command only when it is called, to keep help fast."""

import importlib
from collections.abc import Mapping
from typing import Any

import click

from seaclutter_cli.text import suggestion


class LazyGroup(click.Group):
    """Group whose commands are modules, each with an attribute ``command``.

    Parameters
    ----------
    name : str
        Subpackage of the modules; for ``cli``, the program itself, they are in this package.
    commands : mapping of str to str
        Modules and their short help. To add a command, add an entry here and a module of the same name.
    former : mapping of str to str
        Former names of commands, which still work but are not listed, and their modules.
    **options : optional
        As for `click.Group`.
    """

    def __init__(
        self,
        name: str | None = None,
        commands: Mapping[str, str] | None = None,
        former: Mapping[str, str] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(name, **options)
        self._is_root = name in (None, "cli")
        self._package = "seaclutter_cli.commands" if self._is_root else f"seaclutter_cli.commands.{name}"
        self._commands, self._modules = commands or {}, former or {}

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names of the commands in their order."""
        return list(self._commands)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import and return a command; None if there is no such command."""
        if cmd_name not in self._commands and cmd_name not in self._modules:
            return None
        name = self._modules.get(cmd_name, cmd_name)
        module = importlib.import_module(f"{self._package}.{name}")
        command: click.Command = module.command
        for parameter in command.params:
            if isinstance(parameter, click.Option) and parameter.expose_value:
                parameter.envvar = self._variable(name, parameter)
        return command

    def _variable(self, command: str, option: click.Option) -> str:
        """Return the environment variable of an option: ``SEACLUTTER_<COMMAND>_<OPTION>``."""
        path = (
            "seaclutter",
            *([] if self._is_root else [str(self.name)]),
            command,
            max(option.opts, key=len).strip("-"),
        )
        return "_".join(path).replace("-", "_").upper()

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that arguments name; suggest a similar one if there is no such command."""
        known = [*self._commands, *self._modules]
        if args and not args[0].startswith("-") and args[0] not in known:
            meant = suggestion(args[0], self._commands)
            listed = f"choose from: {', '.join(self._commands)}"
            raise click.UsageError(f"No such command {args[0]!r}; {meant}{listed}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the commands with their short help, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self._commands.items()))
