"""Options shared by several commands. A command receives each group as one options object."""

import os
from collections.abc import Callable, Sequence
from functools import wraps
from importlib import import_module
from typing import Any, TypeVar

import click

from seaclutter_cli.commands.console import DEBUG
from seaclutter_cli.commands.places import Place, filter_config_option, output_option, path_option
from seaclutter_cli.parts import SCRATCH
from seaclutter_cli.text import suggestion

F = TypeVar("F", bound=Callable[..., Any])
Option = Callable[[Any], Any]


def grouped(name: str, kind: str, options: Sequence[Option]) -> Option:
    """Return a decorator that adds options to a command, which receives them as one object.

    Parameters
    ----------
    name : str
        Parameter of the command.
    kind : str
        Class of the object, as ``module:Class`` in the package ``seaclutter_cli``; imported when the command runs, to
        keep help fast. Its fields have the names of the options.
    options : sequence of callable
        Decorators of click, and other groups.
    """
    module, _, class_name = kind.partition(":")

    def add(command: F) -> F:
        names: list[str] = []

        @wraps(command)
        def wrapper(**values: Any) -> Any:
            own = {key: values.pop(key) for key in names}
            make = getattr(import_module(f"seaclutter_cli.{module}"), class_name)
            return command(**values, **{name: make(**own)})

        decorated: Any = wrapper
        for option in reversed(options):
            known = len(getattr(decorated, "__click_params__", ()))
            decorated = option(decorated)
            added = [p.name for p in decorated.__click_params__[known:] if p.expose_value]
            names.extend(getattr(option, "provides", added))
        result: F = decorated
        return result

    add.provides = (name,)  # type: ignore[attr-defined]
    return add


def _use_scratch(context: click.Context, _: click.Parameter, value: str | None) -> None:
    """Set the folder for this process and those that it starts, until the command ends."""
    if value is not None:
        before = os.environ.get(SCRATCH)
        os.environ[SCRATCH] = value
        context.call_on_close(lambda: os.environ.pop(SCRATCH) if before is None else _set(before))


def _set(folder: str) -> None:
    os.environ[SCRATCH] = folder


scratch_option = click.option(
    "--scratch",
    metavar="FOLDER",
    expose_value=False,
    callback=_use_scratch,
    help="Folder for copies of logs and outputs in object storage. [default: the system's for temporary files]",
)


def _remember_debug(context: click.Context, _: click.Parameter, value: bool) -> None:
    if value:
        context.meta[DEBUG] = True


debug_option = click.option(
    "--debug",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_remember_debug,
    help="Show the traceback of an error.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print results as JSON.")


def _make_parents(context: click.Context, _: click.Parameter, value: bool) -> None:
    if value:
        from seaclutter_cli.runs.outputs import making_parents

        context.with_resource(making_parents())


_force = click.option("--force", is_flag=True, help="Replace existing output files.")
_parents = click.option(
    "--parents",
    is_flag=True,
    expose_value=False,
    callback=_make_parents,
    help="Create all missing folders of outputs, not only the last of a path.",
)


def force_option(command: F) -> F:
    """Add the options that relax the checks of outputs; the command receives ``force``."""
    return _force(_parents(command))


dry_run_option = click.option(
    "--dry-run", is_flag=True, help="Show what would be done with each recording, and do nothing."
)
logs_argument = click.argument("logs", metavar="LOGS...", nargs=-1, required=True)

_TALK = (
    click.option(
        "-q", "--quiet", is_flag=True, help="Show no progress, no warnings, and no summary of what was written."
    ),
    click.option("-v", "--verbose", is_flag=True, help="Show details."),
    path_option("--log-file", help="Append all messages to FILE, with times and details."),
    debug_option,
)
console_options = grouped("console", "commands.console:Console", (json_option, *_TALK))
"""Options of the console output, as ``console``."""
console_options_without_json = grouped("console", "commands.console:Console", _TALK)


def _known_sensor(_: click.Context, __: click.Parameter, value: str | None) -> str | None:
    """Return the name of a sensor in its usual spelling."""
    if value is None:
        return None
    from seaclutter_cli.sensors.catalog import SENSORS

    names = {name.casefold(): name for name in SENSORS}
    if value.casefold() not in names:
        raise click.BadParameter(
            f"unknown sensor {value}; {suggestion(value, SENSORS)}choose from: {', '.join(SENSORS)}"
        )
    return names[value.casefold()]


def _moment(_: click.Context, parameter: click.Parameter, text: str | None) -> Any:
    """Return a point in time, as `parse_moment` does."""
    if text is None:
        return None
    from seaclutter_cli.selection import parse_moment

    try:
        return parse_moment(text)
    except (ValueError, OverflowError) as error:
        problem = "expected seconds from the start, a time such as 2026-05-01T12:30:00Z, or seconds since 1970"
        raise click.BadParameter(problem, param=parameter) from error


_PART = (
    click.option("-t", "--topic", "topics", multiple=True, metavar="NAME", help="Point-cloud topic; repeatable."),
    click.option(
        "--start",
        "start_s",
        callback=_moment,
        metavar="TIME",
        help="Start at TIME: seconds from the start of the recording, ISO 8601 (UTC), or seconds since 1970.",
    ),
    click.option(
        "--end",
        "end_s",
        callback=_moment,
        metavar="TIME",
        help="Stop before TIME.",
    ),
    click.option("-n", "--frames", type=click.IntRange(min=1), metavar="N", help="Stop after N frames of each topic."),
)
_HOW = (
    click.option(
        "--rate",
        "rate_hz",
        type=click.FloatRange(min=0, min_open=True),
        default=10.0,
        metavar="HZ",
        show_default=True,
        help="Frames per second of recordings without time stamps.",
    ),
    click.option(
        "--join/--no-join",
        default=None,
        help="Read the numbered files of a folder as one recording, or one by one. "
        "[default: as one if each begins where the one before ends]",
    ),
    click.option("--recursive", is_flag=True, help="Also search the folders in folders for recordings."),
    scratch_option,
    path_option("--calibration", help="Angles or metadata of the sensor, for packets that lack them."),
    click.option(
        "--sensor",
        metavar="MODEL",
        callback=_known_sensor,
        help="Sensor model, for packets that do not identify it.",
    ),
    click.option(
        "--integrate",
        "integrate_ms",
        type=click.FloatRange(min=1, max=2000),
        metavar="MS",
        help="Join the clouds of each MS milliseconds into one frame, for lidars whose scans do not repeat.",
    ),
)
_INTENSITY = click.option("--intensity-field", metavar="NAME", help="Intensity field, if it has no usual name.")
reading_options = grouped("reading", "runs.recordings:ReadOptions", (*_PART, _INTENSITY, *_HOW))
"""Options for the part of a recording to read, and how; as ``reading``."""
reading_options_without_intensity = grouped("reading", "runs.recordings:ReadOptions", (*_PART, *_HOW))
"""The same for commands that use no intensities."""


def set_option(example: str, subject: str = "a key") -> Option:
    """Return the option for single settings."""
    text = f"Set {subject}, such as {example}; repeatable."
    return click.option("-s", "--set", "overrides", multiple=True, metavar="KEY=VALUE", help=text)


config_options = grouped(
    "config",
    "runs.methods:ConfigOptions",
    (
        filter_config_option,
        click.option("-m", "--method", metavar="NAME", help="Filter method; overrides the configuration."),
        set_option("filter.start_m=5"),
    ),
)
"""Options for the configuration, as ``config``."""


methods_options = grouped(
    "methods",
    "runs.methods:MethodOptions",
    (
        filter_config_option,
        click.option(
            "-m",
            "--method",
            "methods",
            multiple=True,
            metavar="NAME",
            help="Filter method, or none for the unfiltered logs; repeatable. By default that of the configuration.",
        ),
        click.option(
            "--compare",
            "comparisons",
            multiple=True,
            type=click.Choice(["paper", "peers", "all"]),
            help="Compare the stages of joint as in its paper; joint, confirmed and their peers; or all and none.",
        ),
        set_option("filter.start_m=5", "a key for every method that has it"),
    ),
)
"""Options for methods to compare, and for their configurations; as ``methods``."""


def _jobs(_: click.Context, parameter: click.Parameter, text: str | None) -> int | None:
    if text is None or text == "auto":
        return None
    if not (text.isascii() and text.isdigit() and len(text) <= 4 and int(text)):
        raise click.BadParameter("expected a positive whole number or auto", param=parameter)
    return int(text)


def _jobs_option(what: str) -> Option:
    text = f"Process N {what} at the same time; by default as many as there are cores and memory for."
    return click.option("-j", "--jobs", metavar="N", callback=_jobs, help=text)


def _cluster(what: str) -> tuple[Option, ...]:
    text = f"Process {what} on the workers of a Dask cluster: tls://HOST:PORT, or slurm to start -j N workers."
    insecure = click.option(
        "--cluster-insecure", is_flag=True, help="Allow a cluster without encryption, tcp://HOST:PORT."
    )
    return click.option("--cluster", metavar="ADDRESS", help=text), insecure


def jobs_option_for(what: str) -> Option:
    """Return the option for the number of processes, as ``batch``, for results that need all inputs."""
    return grouped("batch", "runs.batch:BatchOptions", (_jobs_option(what),))


jobs_option = grouped("batch", "runs.batch:BatchOptions", (_jobs_option("recordings"), *_cluster("recordings")))
"""The options for the number of processes or workers for recordings, as ``batch``, for results that need all inputs."""


def _batch(what: str) -> tuple[Option, ...]:
    fail_fast = click.option("--fail-fast", is_flag=True, help=f"Stop after the first {what} with an error.")
    return _jobs_option(f"{what}s"), fail_fast, *_cluster(f"{what}s")


batch_options = grouped("batch", "runs.batch:BatchOptions", _batch("recording"))
"""Options for several recordings, as ``batch``."""


def _manifest(what: str) -> Option:
    return output_option("--manifest", help=f"Write a table with a row for each {what} (CSV or JSON).")


manifest_batch_options = grouped("batch", "runs.batch:BatchOptions", (*_batch("recording"), _manifest("recording")))
"""The same for runs that can also write a manifest."""


def resumable_batch_options_for(what: str) -> Option:
    """Return the same for runs that write an output for each recording, or for each of what they process."""
    resume = click.option("--resume", is_flag=True, help=f"Skip {what}s whose output of the same run is complete.")
    return grouped("batch", "runs.batch:BatchOptions", (*_batch(what), _manifest(what), resume))


resumable_batch_options = resumable_batch_options_for("recording")


def _ids(_: click.Context, parameter: click.Parameter, text: str | None) -> tuple[int, ...] | None:
    try:
        return None if text is None else tuple(int(number) for number in text.split(",") if number.strip())
    except ValueError as error:
        raise click.BadParameter("expected whole numbers separated by commas, such as 0,99", param=parameter) from error


def label_options(*, required: bool) -> Option:
    """Return a decorator that adds the options for labels, as ``labels``."""
    return grouped(
        "labels",
        "runs.labels:LabelSources",
        (
            click.option(
                "--labels",
                "paths",
                multiple=True,
                required=required,
                type=Place(remote=True),
                metavar="LABELS",
                help="Labels of LOGS in the same order, or a folder with RECORDING.labels.csv for each; repeatable.",
            ),
            click.option(
                "--clutter-ids",
                callback=_ids,
                metavar="IDS",
                help="Class ids of clutter in point labels, such as 110,111.  [default: 110]",
            ),
            click.option(
                "--ignore-ids",
                callback=_ids,
                metavar="IDS",
                help="Class ids to ignore in point labels.  [default: 0,99]",
            ),
        ),
    )
