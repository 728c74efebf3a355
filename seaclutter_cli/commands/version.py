"""``seaclutter --version``: versions of the program and its parts."""

import platform
import re
import textwrap
from importlib import metadata
from typing import Any

import click

from seaclutter_cli import __version__
from seaclutter_cli.commands.printer import show

_NAME = re.compile(r"[\w.-]+")
_EXTRA = re.compile(r"extra\s*==\s*[\"']([\w-]+)[\"']")
_TOOLS = ("dev", "docs")


def _show_versions(context: click.Context, _: click.Parameter, value: bool) -> None:
    if value and not context.resilient_parsing:
        show(f"seaclutter, version {__version__}")
        show(f"Python {platform.python_version()} on {platform.platform(terse=True)}")
        installed, missing = _parts()
        show(_listed("with", [f"{name} {version}" for name, version in installed.items()]))
        if missing:
            show(_listed("without", [f"{name} (extra {extra})" for name, extra in missing.items()]))
        context.exit()


def _parts() -> tuple[dict[str, str], dict[str, str]]:
    """Return the versions of the libraries that are installed, and the extras of the others."""
    installed, missing = {}, {}
    for requirement in sorted(metadata.requires("seaclutter") or (), key=str.casefold):
        name, extra = _NAME.match(requirement), _EXTRA.search(requirement)
        if name is None or name[0] == "seaclutter" or (extra and extra[1] in _TOOLS):
            continue
        try:
            installed[name[0]] = metadata.version(name[0])
        except metadata.PackageNotFoundError:
            missing[name[0]] = extra[1] if extra else "none"
    return installed, missing


def _listed(head: str, items: list[str]) -> str:
    return textwrap.fill(f"{head} {', '.join(items)}", 79, subsequent_indent="  ", break_on_hyphens=False)


def version_option(command: Any) -> Any:
    """Add the option ``--version``."""
    return click.option(
        "--version",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_show_versions,
        help="Show the versions of the program and its parts.",
    )(command)
