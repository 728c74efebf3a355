"""``seaclutter tune``: the best methods and parameter values on labelled logs."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    batch_options,
    console_options,
    force_option,
    grouped,
    label_options,
    logs_argument,
    methods_options,
    reading_options,
)
from seaclutter_cli.commands.places import output_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.sweep import Sweep
    from seaclutter_cli.runs.tune import TuneOptions


def _sweeps(_: click.Context, __: click.Parameter, texts: tuple[str, ...]) -> "tuple[Sweep, ...]":
    from seaclutter_cli.runs.sweep import parse_sweep

    return tuple(parse_sweep(text) for text in texts)


_OPTIONS = (
    label_options(required=True),
    click.option(
        "--sweep",
        "sweeps",
        multiple=True,
        metavar="KEY=VALUES",
        callback=_sweeps,
        help="Filter key and values to try: V1,V2,... or START:STOP:STEP. Repeatable, for all combinations. Of several "
        "methods, those that have the key; METHOD.KEY for one.",
    ),
    click.option(
        "--hold-out",
        type=click.FloatRange(0, 1, max_open=True),
        default=0.25,
        metavar="SHARE",
        show_default=True,
        help="Share of the recordings, or of fewer than four the last frames of each, on which the best combination is "
        "judged but not chosen; 0 for none.",
    ),
    output_option(
        "-o", "--output", metavar="CONFIG.yaml", help="Write the configuration with the best values.", remote=True
    ),
    output_option("--csv", "csv_file", help="Write a table with a row for each combination.", remote=True),
    output_option(
        "--plot", "curve_file", help="Plot the rates over the values of a single --sweep (.png or .svg).", remote=True
    ),
    output_option(
        "--plot-thresholds",
        "thresholds_file",
        help="Plot the threshold of a range ring over the frames for each combination and the ideal one (.png, .svg).",
        remote=True,
    ),
    click.option(
        "--ring",
        type=click.IntRange(min=1),
        default=2,
        metavar="K",
        show_default=True,
        help="Range ring of --plot-thresholds, from 1.",
    ),
    force_option,
    methods_options,
    reading_options,
    batch_options,
)


@click.command(name="tune", short_help="Compare methods and parameter values on labelled logs and report the best.")
@logs_argument
@grouped("options", "runs.tune:TuneOptions", _OPTIONS)
@console_options
def command(logs: tuple[str, ...], options: "TuneOptions", console: Console) -> None:
    """Filter LOGS with every combination of methods and parameter values, and report the best one.

    The best combination has the fewest bad frames: those with a false alarm plus those with a missed target. Ties go
    to the combination with the fewest false alarms and missed targets, then to the first. Some of the labelled frames
    are held out: they do not take part in the choice and show what the best combination is worth on new data.
    """
    from seaclutter_cli.runs.tune import tune

    console.finish(tune(logs, options, console))
