"""Groups of commands, and the versions of the program and its parts."""

import platform
import re
import textwrap
from collections.abc import Mapping
from importlib import metadata
from typing import Any

import click

from seaclutter_cli import __version__
from seaclutter_cli.commands.printer import show
from seaclutter_cli.registry import packages
from seaclutter_cli.text import suggestion

_NAME = re.compile(r"[\w.-]+")
_EXTRA = re.compile(r"extra\s*==\s*[\"']([\w-]+)[\"']")
_TOOLS = ("dev", "docs")


class CommandGroup(click.Group):
    """Group of commands in their order; ``former`` names of commands still work, but are not listed."""

    def __init__(self, *arguments: Any, former: Mapping[str, str] = {}, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._former = former

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names of the commands in their order."""
        return list(self.commands)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command; None if there is no such command."""
        return super().get_command(ctx, self._former.get(cmd_name, cmd_name))

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that arguments name; suggest a similar one if there is no such command."""
        known = self.list_commands(ctx)
        if args and not args[0].startswith("-") and args[0] not in (*known, *self._former):
            meant = f"{suggestion(args[0], known)}choose from: {', '.join(known)}"
            raise click.UsageError(f"No such command {args[0]!r}; {meant}", ctx)
        return super().resolve_command(ctx, args)


def _show_versions(context: click.Context, _: click.Parameter, value: bool) -> None:
    if value and not context.resilient_parsing:
        show(f"seaclutter, version {__version__}")
        show(f"Python {platform.python_version()} on {platform.platform(terse=True)}")
        installed, missing = {}, {}
        for requirement in sorted(metadata.requires("seaclutter") or (), key=str.casefold):
            name, extra = _NAME.match(requirement), _EXTRA.search(requirement)
            if name is None or name[0] == "seaclutter" or (extra and extra[1] in _TOOLS):
                continue
            try:
                installed[name[0]] = metadata.version(name[0])
            except metadata.PackageNotFoundError:
                missing[name[0]] = extra[1] if extra else "none"
        show(_listed("with", [f"{name} {version}" for name, version in installed.items()]))
        if added := packages():
            show(_listed("plug-ins", added))
        if missing:
            show(_listed("without", [f"{name} (extra {extra})" for name, extra in missing.items()]))
        context.exit()


def _listed(head: str, items: list[str]) -> str:
    return textwrap.fill(f"{head} {', '.join(items)}", 79, subsequent_indent="  ", break_on_hyphens=False)


VERSION = click.Option(
    ["--version"],
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_versions,
    help="Show the versions of the program and its parts.",
)
