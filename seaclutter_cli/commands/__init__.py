"""The command line. Each command is a file here; it is imported when it is called, so that help comes at once."""

import io
import os
import signal
import sys
import warnings
from collections.abc import Mapping
from types import FrameType
from typing import Any

import click

from seaclutter_cli import __version__
from seaclutter_cli.commands.console import DEBUG, show_error, show_renamed
from seaclutter_cli.commands.lazy import LazyGroup
from seaclutter_cli.errors import RenamedKeyWarning, SeaclutterError

COMMANDS: Mapping[str, str] = {
    "info": "Show what a log holds and what a filter run would need to be told.",
    "filter": "Filter logs into drop-in MCAP files.",
    "calibrate": "Find thresholds and the far limit for a sensor, and write a configuration.",
    "evaluate": "Count false and omitted alarms against labels; compare methods.",
    "tune": "Sweep parameters over labelled logs and report the best.",
    "report": "Show what a filter did, and how well, in one page.",
    "view": "Open logs in the viewer of Rerun.",
    "simulate": "Make a labelled lidar recording of a scene at sea.",
    "scene": "Train, test and use the classifier of scenes.",
    "classify": "Take the sea out of airborne lidar tiles and name what is in it.",
    "config": "Show and check configurations; list what is built in.",
}
"""Commands and their short help. A new one is a line here and a file of the same name."""


class _Program(LazyGroup):
    """The program: turns errors into one line and an exit status."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("always", RenamedKeyWarning)
                warnings.showwarning = show_renamed(warnings.showwarning)
                return super().invoke(ctx)
        except SeaclutterError as error:
            if DEBUG in ctx.meta:
                raise
            show_error(error)
            ctx.exit(error.exit_code)
        except KeyboardInterrupt:
            click.echo("\nInterrupted; the output of the unfinished recording was removed.", err=True)
            ctx.exit(1)


@click.group(
    cls=_Program,
    commands=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="seaclutter")
def cli() -> None:
    """Filter sea clutter out of recorded marine lidar logs.

    Waves, wakes and spray drown ships and buoys in false alarms. seaclutter removes them from MCAP files, ROS bags and
    folders of frames, and keeps every other topic, field and time stamp as it was.
    """


def _interrupt(_number: int, _stack: FrameType | None) -> None:
    """Take a request to end like Ctrl-C, so that nothing unfinished is left behind."""
    raise KeyboardInterrupt


def main() -> None:
    """Run the program."""
    signal.signal(signal.SIGTERM, _interrupt)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files and topics need not be valid text
    try:
        cli(windows_expand_args=False)  # logs are globbed here, the same on every system
    except BrokenPipeError:
        # The reader of a pipe has gone, as with `seaclutter info … | head`: nothing to say to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
