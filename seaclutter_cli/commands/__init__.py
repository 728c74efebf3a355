"""Command line. Each command is a module of this package, imported only when it is called, to keep help fast."""

import io
import os
import sys
import warnings
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import click

from seaclutter_cli import __version__
from seaclutter_cli.commands.console import DEBUG, show_error, show_renamed
from seaclutter_cli.commands.interrupts import handle_interrupts, ignore_interrupts
from seaclutter_cli.commands.lazy import LazyGroup
from seaclutter_cli.errors import RenamedKeyWarning, SeaclutterError

COMMANDS: Mapping[str, str] = {
    "info": "Show the content of logs and the settings that a filter run needs.",
    "filter": "Filter logs into drop-in MCAP files.",
    "calibrate": "Find thresholds and the far limit for a sensor, and write a configuration.",
    "evaluate": "Count false alarms and missed targets against labels; compare methods.",
    "tune": "Sweep parameters over labelled logs and report the best values.",
    "report": "Write a page that shows the effect and quality of a filter.",
    "view": "Open logs in the Rerun viewer.",
    "simulate": "Simulate a labelled lidar recording of a scene.",
    "scene": "Train, evaluate and use the scene classifier.",
    "classify": "Separate sea from objects in airborne lidar tiles, and classify the objects.",
    "config": "Show and check configurations; list built-in sensors, methods and scenes.",
}
"""Commands and their short help. To add a command, add a line here and a module of the same name."""


class _Program(LazyGroup):
    """Root group, which reports errors as one line and an exit status."""

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
            ignore_interrupts()
            with suppress(OSError):  # a hang-up closes the terminal
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

    Waves, wakes and spray cause false alarms in the detection of ships and buoys. seaclutter removes their points from
    MCAP files, ROS bags, packet captures and folders of frames. Every other topic, field and time stamp is kept.
    """


def main() -> None:
    """Run the program."""
    try:
        handle_interrupts()
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")  # names of files and topics need not be valid text
        cli(windows_expand_args=False)  # the program expands globs itself, alike on all systems
    except BrokenPipeError:
        # The reader of the pipe has closed it, as in `seaclutter info … | head`.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(1)
    finally:
        ignore_interrupts()
