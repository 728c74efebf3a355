"""Make the man pages of the wheel from the command line, which click-man describes."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_FOLDER = "share/man/man1"


class ManPages(BuildHookInterface[Any]):
    """Add a man page for each command to the wheel."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the pages, unless the wheel only refers to the checkout."""
        if version == "editable":
            return
        self._pages = TemporaryDirectory(prefix="seaclutter-man-")
        folder = Path(self._pages.name)
        sys.path.insert(0, self.root)
        write_pages(folder)
        build_data["shared_data"].update({str(page): f"{_FOLDER}/{page.name}" for page in sorted(folder.iterdir())})

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the pages."""
        del build_data, artifact_path
        if version != "editable":
            self._pages.cleanup()


def write_pages(folder: Path) -> None:
    """Write the page of each command to a folder, such as ``seaclutter-filter.1``."""
    import click
    from click_man.core import write_man_pages

    from seaclutter_cli import __version__
    from seaclutter_cli.commands import cli

    def load(command: click.Command) -> None:
        """Put the commands of groups, which are imported when they are called, where click-man looks for them."""
        first = " ".join((command.help or "").partition("\n\n")[0].split())
        command.short_help = command.short_help or first  # click-man would cut it
        if isinstance(command, click.Group):
            context = click.Context(command)
            found = {name: command.get_command(context, name) for name in command.list_commands(context)}
            command.commands = {name: one for name, one in found.items() if one}
            for one in command.commands.values():
                load(one)

    load(cli)
    # A space is no date: the bytes of a version must not depend on the day.
    write_man_pages("seaclutter", cli, version=__version__, target_dir=str(folder), date=" ")
