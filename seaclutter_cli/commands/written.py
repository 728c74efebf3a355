"""Options of commands that write logs: the format of the outputs, and what is written of a log."""

import re
from collections.abc import Callable
from typing import Any

import click

FORMATS = ("mcap", "bag", "rosbag2-db3", "rosbag2-mcap", "pcd", "las", "laz", "npz")
"""The keys of `OUTPUT_FORMATS`, whose import would slow down the help."""

_COMPRESSIONS = {"zstd": "zstd", "lz4": "lz4", "none": ""}

Option = Callable[[Any], Any]


def _compression(_: click.Context, __: click.Parameter, value: str | None) -> str | None:
    """Return the compression by its name in MCAP."""
    return None if value is None else _COMPRESSIONS[value]


def _patterns(_: click.Context, __: click.Parameter, values: tuple[str, ...]) -> tuple[str, ...]:
    for value in values:
        try:
            re.compile(value)
        except re.error as error:
            raise click.BadParameter(f"{value}: not a regular expression ({error})") from error
    return values


def _split(_: click.Context, __: click.Parameter, value: str | None) -> Any:
    if value is None:
        return None
    from seaclutter_cli.runs.output_plan import parse_split

    try:
        return parse_split(value)
    except ValueError:
        raise click.BadParameter(f"{value}: expected a size such as 2GB, or a duration such as 10min") from None


format_option = click.option(
    "--to",
    type=click.Choice(FORMATS),
    help="Format of the output. [default: by the suffix of OUT, or mcap]",
)
log_options: tuple[Option, ...] = (
    click.option(
        "--compression",
        type=click.Choice(list(_COMPRESSIONS)),
        callback=_compression,
        help="Compression of the output; by default that of the input, or the usual one of the format.",
    ),
    click.option(
        "--split",
        metavar="LIMIT",
        callback=_split,
        help="Write parts of at most this size before compression (500MB, 2GiB) or duration (30s, 10min, 1h).",
    ),
    click.option(
        "--include",
        multiple=True,
        metavar="REGEX",
        callback=_patterns,
        help="Of the other topics, write only those whose name contains a match; repeatable.",
    ),
    click.option(
        "--exclude",
        multiple=True,
        metavar="REGEX",
        callback=_patterns,
        help="Leave out other topics whose name contains a match; repeatable.",
    ),
    click.option(
        "--latched",
        multiple=True,
        metavar="TOPIC",
        help="Keep the last message of TOPIC before --start, as of /tf_static and other latched topics; repeatable.",
    ),
)
