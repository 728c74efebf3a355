"""Command line: groups of commands, errors and versions. A command and what it calls are imported when it is called."""

import io
import logging
import os
import platform
import re
import sys
import textwrap
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import metadata
from typing import Any

import click

from seaclutter_cli import __version__
from seaclutter_cli.commands.console import ARGUMENTS, DEBUG, LOG, show_each_warning_once
from seaclutter_cli.commands.options import commands_of
from seaclutter_cli.commands.printer import LogHandler, close_output, show, show_error, show_traceback
from seaclutter_cli.errors import OWN_WARNINGS, SeaclutterError
from seaclutter_cli.interrupts import exit_status, handle_interrupts, ignore_interrupts
from seaclutter_cli.registry import packages
from seaclutter_cli.text import printable, suggestion

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

COMMANDS: Mapping[str, str] = {
    "info": "Show the content of logs and the settings that a filter run needs.",
    "filter": "Filter logs into drop-in logs, MCAP or another format.",
    "convert": "Convert logs to another format, whole or in part.",
    "calibrate": "Find thresholds and the far limit for a sensor, and write a configuration.",
    "objects": "Follow objects over time: a table of boxes, velocities and ids.",
    "suspects": "List what a filter removed that may have been a target, and clutter that it kept.",
    "mask": "Propose a mask of own ship's structure.",
    "labels": "Check, propose and compare labels of recordings.",
    "evaluate": "Count false alarms and missed targets against labels; compare methods.",
    "tune": "Compare methods and parameter values on labelled logs and report the best.",
    "report": "Write a page that shows the effect and quality of a filter.",
    "view": "Open logs in the Rerun viewer.",
    "simulate": "Simulate a labelled lidar recording of a scene.",
    "scene": "Train, evaluate and use the scene classifier.",
    "classify": "Separate sea from objects in airborne lidar tiles, and classify the objects.",
    "config": "Show and check configurations; list built-in sensors, methods and scenes.",
}
"""Commands and their short help. To add one, add a line here, and a class of options with a `UseCase`."""

_MODULES = {"config": "commands.config", **dict.fromkeys(("scene", "classify"), "runs.options.classifiers")}
"""Modules of the options of commands, if it is not that of the commands for logs."""
_SCENE = """Train, evaluate and use the classifier that recognises the scene of a frame in its top view.

The built-in model distinguishes open water (separate objects) from confined water (continuous facades: quay walls,
moored rows, the banks of a channel). It needs the extra `scene`; training needs the extra `train`.
"""
_GROUPS: Mapping[str, Mapping[str, Any]] = {"scene": {"help": _SCENE}, "config": {"former": {"sensors": "list"}}}
"""What groups have besides their commands."""
_LITTLE_MEMORY = "not enough memory; close other programs, or raise the limit of this process (ulimit -v)"
_NAME = re.compile(r"[\w.-]+")
_EXTRA = re.compile(r"extra\s*==\s*[\"']([\w-]+)[\"']")
_TOOLS = ("dev", "docs")
_SIGNS_OF_LITTLE_MEMORY = ("can't start new thread", "failed to map segment", "cannot allocate memory")


class _Group(click.Group):
    """Group of commands in their order; ``former`` names of commands still work, but are not listed."""

    def __init__(self, *arguments: Any, former: Mapping[str, str] = {}, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._former = former

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(self.commands)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
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


class _Program(_Group):
    """Root group, which imports a command when it is needed, and reports errors as one line and an exit status."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in COMMANDS and cmd_name not in self.commands:
            command, *others = commands_of(_MODULES.get(cmd_name, "runs.options.logs"), cmd_name)
            if command.name != cmd_name:
                kept = {"help": COMMANDS[cmd_name], **_GROUPS.get(cmd_name, {})}
                command = _Group(cmd_name, [command, *others], **kept)
            command.short_help = COMMANDS[cmd_name]
            self.add_command(command)
        return super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        given = list(args)
        with _reported_errors():
            context = super().make_context(info_name, args, parent, **extra)
        context.meta[ARGUMENTS] = given
        return context

    def invoke(self, ctx: click.Context) -> Any:
        with _reported_errors(), warnings.catch_warnings():
            for category in OWN_WARNINGS:
                warnings.simplefilter("always", category)
            warnings.showwarning = show_each_warning_once()
            return super().invoke(ctx)


@contextmanager
def _reported_errors() -> Iterator[None]:
    try:
        yield
    except click.exceptions.NoArgsIsHelpError as error:
        show(error.format_message(), err=True)
        raise click.exceptions.Exit(error.exit_code) from error
    except click.ClickException as error:
        text = io.StringIO()
        error.show(file=text)
        message = error.format_message()
        show(text.getvalue().rstrip("\n").replace(message, printable(message)), err=True)
        raise click.exceptions.Exit(error.exit_code) from error
    except BrokenPipeError:
        raise
    except (SeaclutterError, OSError, MemoryError, RuntimeError, ImportError) as error:
        context, shown = click.get_current_context(silent=True), error
        if not isinstance(error, SeaclutterError | OSError):  # perhaps memory, of data, a thread, or a library
            if not isinstance(error, MemoryError) and not any(one in str(error) for one in _SIGNS_OF_LITTLE_MEMORY):
                raise
            shown = SeaclutterError(_LITTLE_MEMORY)
        if context and LOG in context.meta:
            context.meta[LOG].record(str(shown), "ERROR")
        if context and DEBUG in context.meta:
            raise
        show_error(shown)
        raise click.exceptions.Exit(getattr(shown, "exit_code", 1)) from error
    except KeyboardInterrupt as interrupt:
        ignore_interrupts()
        removed = "; incomplete output was removed" if hasattr(interrupt, "__notes__") else ""
        with suppress(OSError):  # a hang-up closes the terminal
            show(f"\nInterrupted{removed}.", err=True)
        raise click.exceptions.Exit(exit_status()) from interrupt


_NEEDED_MB: Mapping[str, int] = {"numpy": 140, "scipy": 140}
"""Address space that packages take with one thread; each has an OpenBLAS, which ends the process if it lacks room."""


class _RoomFinder:
    """Finder that finds nothing, and checks the address space instead, where that of the process is limited."""

    def find_spec(self, name: str, *_: object) -> None:
        """Return None; raise `MemoryError` if there is no room for a package."""
        if name in _NEEDED_MB:
            import mmap  # only needed here

            try:
                mmap.mmap(-1, _NEEDED_MB[name] * 2**20).close()
            except OSError as error:
                raise MemoryError(f"no room for {name}") from error


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
        show(_named("with", [f"{name} {version}" for name, version in installed.items()]))
        if added := packages():
            show(_named("plug-ins", added))
        if missing:
            show(_named("without", [f"{name} (extra {extra})" for name, extra in missing.items()]))
        context.exit()


def _named(head: str, items: list[str]) -> str:
    return textwrap.fill(f"{head} {', '.join(items)}", 79, subsequent_indent="  ", break_on_hyphens=False)


cli = _Program(
    "cli",
    params=[
        click.Option(
            ["--version"],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_show_versions,
            help="Show the versions of the program and its parts.",
        )
    ],
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    help="""Filter sea clutter out of recorded marine lidar logs.

    Waves, wakes and spray cause false alarms in the detection of ships and buoys. seaclutter removes their points from
    MCAP files, ROS bags, packet captures and folders of frames. Every other topic, field and time stamp is kept.
    """,
)


def main() -> None:
    """Run the program."""
    # OpenBLAS would start a thread for each core when numpy and scipy load it, and reserve memory for each. The program
    # has threads of its own, and its matrices are small.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if resource is not None and resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY:
        sys.meta_path.insert(0, _RoomFinder())
    sys.excepthook = show_traceback
    logging.getLogger().addHandler(LogHandler())
    try:
        handle_interrupts()
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")  # names of files and topics need not be valid text
        cli(windows_expand_args=False)  # the program expands globs itself, alike on all systems
    except BrokenPipeError:
        sys.exit(1)  # the reader of the pipe has closed it, as in `seaclutter info … | head`
    except KeyboardInterrupt:
        sys.exit(exit_status())
    finally:
        ignore_interrupts()
        close_output()
