"""Groups of commands, which import a command only when it is called, to keep help fast."""

import importlib
from collections.abc import Mapping, Sequence
from typing import Any

import click

from seaclutter_cli.text import suggestion


class CommandGroup(click.Group):
    """Group of commands in a given order.

    Parameters
    ----------
    name : str
        Name of the group; ``cli`` is the program itself.
    lines : mapping of str to str
        Names of the commands and their short help.
    modules : mapping of str to str, optional
        Modules in this package whose ``COMMANDS`` have the commands; by default the one named like the group.
    former : mapping of str to str, optional
        Former names of commands, which still work but are not listed, and the present ones.
    **options : optional
        As for `click.Group`.
    """

    def __init__(
        self,
        name: str | None = None,
        lines: Mapping[str, str] | None = None,
        modules: Mapping[str, str] | None = None,
        former: Mapping[str, str] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(name, **options)
        self._lines, self._modules, self._former = lines or {}, modules or {}, former or {}
        self._path = ("seaclutter",) if name in (None, "cli") else ("seaclutter", str(name))

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names of the commands in their order."""
        return list(self._lines)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import and return a command, with its environment variables; None if there is no such command."""
        name = self._former.get(cmd_name, cmd_name)
        if name not in self._lines:
            return None
        module = importlib.import_module(f"seaclutter_cli.commands.{self._modules.get(name, self._path[-1])}")
        command: click.Command = module.COMMANDS[name]
        command.short_help = self._lines[name]
        for parameter in command.params:
            if isinstance(parameter, click.Option) and parameter.expose_value:
                longest = max(parameter.opts, key=len).strip("-")
                parameter.envvar = "_".join((*self._path, name, longest)).replace("-", "_").upper()
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that arguments name; suggest a similar one if there is no such command."""
        known: Sequence[str] = [*self._lines, *self._former]
        if args and not args[0].startswith("-") and args[0] not in known:
            meant = suggestion(args[0], self._lines)
            listed = f"choose from: {', '.join(self._lines)}"
            raise click.UsageError(f"No such command {args[0]!r}; {meant}{listed}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the commands with their short help, without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self._lines.items()))
