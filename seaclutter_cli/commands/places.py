"""Options that take files, folders and URLs."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from seaclutter_cli.commands.console import NOTES
from seaclutter_cli.errors import ConfigError, UsageError
from seaclutter_cli.text import named_folder
from seaclutter_cli.urls import is_url, place

_WORKING_CONFIG = "seaclutter.yaml"

Option = Callable[[Any], Any]


class Place(click.Path):
    """A file or folder here, or a URL where a command can use one."""

    def __init__(self, *, remote: bool, output: bool = False) -> None:
        super().__init__()
        self._remote, self._output = remote, output

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ARG002
        """Return a path or URL; refuse what the option cannot use."""
        option = param.opts[0] if param else "the option"
        if value == "-":
            raise UsageError(f"-: {option} takes a file, not a standard stream (./- is a file of this name)")
        if self._output and named_folder(value):
            raise UsageError(f"{value}: names a folder by the slash at its end; {option} takes a file")
        found = place(value)
        if is_url(found) and not self._remote:
            raise UsageError(f"{found}: {option} takes a local path")
        return found


def path_option(
    *names: str,
    metavar: str = "FILE",
    required: bool = False,
    remote: bool = False,
    help: str,  # noqa: A002 - as in click
) -> Option:
    """Return an option that takes a path or, if ``remote``, a URL."""
    return click.option(*names, type=Place(remote=remote), metavar=metavar, required=required, help=help)


def output_option(
    *names: str,
    metavar: str = "FILE",
    required: bool = False,
    remote: bool = False,
    help: str,  # noqa: A002 - as in click
) -> Option:
    """Return an option that takes the path or, if ``remote``, the URL of a file to write."""
    kind = Place(remote=remote, output=True)
    return click.option(*names, type=kind, metavar=metavar, required=required, help=help)


class _FileOrFolder(Place):
    """An output as text: a slash at its end means a folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        super().convert(value, param, ctx)
        return value


def output_or_folder_option(text: str, *, remote: bool = False) -> Option:
    """Return the option for a file or a folder, as text: a slash at its end means a folder."""
    return click.option("-o", "--output", type=_FileOrFolder(remote=remote), metavar="OUT", required=True, help=text)


def config_file_option(text: str, *, remote: bool = False) -> Option:
    """Return the option for a file of settings, with ``text`` as its help."""
    return path_option("-c", "--config", "file", remote=remote, help=text)


class _ConfigFile(Place):
    """A configuration: a file, the name of a built-in one, or ``-`` for standard input."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value != "-":
            return super().convert(value, param, ctx)
        from seaclutter_cli.config import parse_sections
        from seaclutter_cli.documents import MAX_YAML_CHARACTERS

        try:
            text = sys.stdin.read(MAX_YAML_CHARACTERS + 1)
        except UnicodeDecodeError as error:
            raise ConfigError("standard input: not UTF-8 text") from error
        return parse_sections(text, "standard input")


def _of_working_folder(context: click.Context, _: click.Parameter, value: Any) -> Any:
    """Return the configuration in the working folder if none is given."""
    if value is not None or not Path(_WORKING_CONFIG).is_file():
        return value
    from seaclutter_cli.config import UnnamedFile

    context.meta[NOTES] = [f"using {_WORKING_CONFIG} in the working folder; -c chooses another configuration"]
    return UnnamedFile(_WORKING_CONFIG)


filter_config_option = click.option(
    "-c",
    "--config",
    "file",
    type=_ConfigFile(remote=True),
    metavar="FILE",
    callback=_of_working_folder,
    help="Configuration file, the name of a built-in one, or - for standard input. "
    f"[default: {_WORKING_CONFIG} in the working folder, if there is one]",
)
