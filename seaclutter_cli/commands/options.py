"""Options that several commands share."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from seaclutter_cli.sensors.packets import DecoderOptions

F = TypeVar("F", bound=Callable[..., Any])


def _remember_debug(context: click.Context, _: click.Parameter, value: bool) -> None:
    if value:
        context.meta[DEBUG] = True


DEBUG = "seaclutter.debug"
"""Key in a context's ``meta`` that is set where tracebacks are wanted."""

debug_option = click.option(
    "--debug",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_remember_debug,
    help="Show the traceback of an error.",
)
force_option = click.option("--force", is_flag=True, help="Replace existing output.")
logs_argument = click.argument("logs", metavar="LOGS...", nargs=-1, required=True)


def _known_sensor(_: click.Context, __: click.Parameter, value: str | None) -> str | None:
    """Return a sensor's name as it is written."""
    from seaclutter_cli.sensors.catalog import SENSORS

    names = {name.casefold(): name for name in SENSORS}
    if value is not None and value.casefold() not in names:
        raise click.BadParameter(f"{value} is not known; choose from: {', '.join(SENSORS)}")
    return value and names[value.casefold()]


def selection_options(command: F) -> F:
    """Add the options that choose a part of a recording."""
    for option in reversed(_SELECTION):
        command = option(command)
    return command


_SELECTION = (
    click.option("-t", "--topic", "topics", multiple=True, metavar="NAME", help="Point-cloud topic; repeatable."),
    click.option("--start", "start_s", type=float, metavar="SECONDS", help="Begin here, from the recording's start."),
    click.option("--end", "end_s", type=float, metavar="SECONDS", help="End here, from the recording's start."),
    click.option("-n", "--frames", type=click.IntRange(min=1), metavar="N", help="Stop after N frames of each topic."),
    click.option("--intensity-field", metavar="NAME", help="Intensity field, where it has no usual name."),
    click.option(
        "--rate",
        "rate_hz",
        type=click.FloatRange(min=0, min_open=True),
        default=10.0,
        metavar="HZ",
        show_default=True,
        help="Frames per second where nothing carries a time.",
    ),
    click.option(
        "--calibration",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Angles or metadata of the sensor, where recorded packets lack them.",
    ),
    click.option(
        "--sensor", metavar="MODEL", callback=_known_sensor, help="Sensor model, where packets of several look alike."
    ),
)


def decoding_options(options: Mapping[str, Any]) -> "DecoderOptions":
    """Return what the command line says of sensors whose packets are to be decoded."""
    from seaclutter_cli.sensors.packets import DecoderOptions

    return DecoderOptions(options["calibration"], options["sensor"])


def output_options(command: F) -> F:
    """Add the options that say how much is told, and how."""
    for option in reversed(_OUTPUT):
        command = option(command)
    return command


_OUTPUT = (
    click.option("--json", "as_json", is_flag=True, help="Print results as JSON."),
    click.option("-q", "--quiet", is_flag=True, help="No progress, no warnings."),
    click.option("-v", "--verbose", is_flag=True, help="Tell more."),
    debug_option,
)


def config_file_option(said: str) -> Callable[[F], F]:
    """Return the option for a file of settings."""
    return click.option("-c", "--config", "config_file", type=click.Path(path_type=Path), metavar="FILE", help=said)


def set_option(example: str, what: str = "a key") -> Callable[[F], F]:
    """Return the option for single settings."""
    said = f"Set {what}, as in {example}; repeatable."
    return click.option("-s", "--set", "overrides", multiple=True, metavar="KEY=VALUE", help=said)


def config_options(command: F) -> F:
    """Add the options that make up the configuration."""
    for option in reversed(_CONFIG):
        command = option(command)
    return command


_CONFIG_FILE = config_file_option("Configuration file.")
_CONFIG = (
    _CONFIG_FILE,
    click.option("-m", "--method", metavar="NAME", help="Filter method, whatever the configuration says."),
    set_option("filter.start_m=5"),
)


def methods_options(command: F) -> F:
    """Add the options that choose several methods and make up their configurations."""
    for option in reversed(_METHODS):
        command = option(command)
    return command


_METHODS = (
    _CONFIG_FILE,
    click.option(
        "-m",
        "--method",
        "methods",
        multiple=True,
        metavar="NAME",
        help="Filter method, none for the logs as they are; repeatable. By default that of the configuration.",
    ),
    click.option(
        "--compare",
        "comparisons",
        multiple=True,
        type=click.Choice(["paper", "peers", "all"]),
        help="Compare the stages of the joint method as its paper does, or its peers, or all and none.",
    ),
    set_option("filter.start_m=5", "a key for every method that has it"),
)
