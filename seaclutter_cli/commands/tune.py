"""``seaclutter tune``: which parameter values do best on labelled logs."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.options import (
    config_options,
    force_option,
    logs_argument,
    output_options,
    selection_options,
)
from seaclutter_cli.commands.truths import label_options

if TYPE_CHECKING:
    from seaclutter_cli.commands.thresholds import ThresholdHistory
    from seaclutter_cli.commands.tuned import Tuned


@click.command(name="tune", short_help="Sweep parameters over labelled logs and report the best.")
@logs_argument
@label_options(required=True)
@click.option(
    "--sweep",
    "sweeps",
    multiple=True,
    required=True,
    metavar="KEY=VALUES",
    help="Filter key and what to try: V1,V2,... or START:STOP:STEP. Repeated: all combinations.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="CONFIG.yaml",
    help="Write the configuration with the best values.",
)
@click.option(
    "--csv", "csv_file", type=click.Path(path_type=Path), metavar="FILE", help="Write a line for each combination."
)
@click.option(
    "--plot",
    "curve_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Draw the rates over the values of a single --sweep, as PNG or SVG.",
)
@click.option(
    "--plot-thresholds",
    "thresholds_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Draw a ring's threshold over the frames for each combination beside the ideal one, as PNG or SVG.",
)
@click.option(
    "--ring",
    type=click.IntRange(min=1),
    default=2,
    metavar="K",
    show_default=True,
    help="Ring of --plot-thresholds, from 1.",
)
@force_option
@config_options
@selection_options
@output_options
def command(logs: tuple[str, ...], **options: Any) -> None:
    """Filter LOGS with every combination of parameter values, and tell which has the fewest false and omitted alarms.

    Best is the combination with the fewest bad frames, those with a false alarm and those with an omitted one counted
    alike; among equals the one with the fewest alarms of both kinds, then the first.
    """
    tuned, history = _run(logs, options)
    if options["output"] and tuned.best:
        _write(options["output"], tuned.best_config().encode())
    if options["csv_file"]:
        _write(options["csv_file"], tuned.as_csv().encode())
    if options["curve_file"]:
        _write(options["curve_file"], tuned.curve(options["curve_file"].suffix))
    if options["thresholds_file"] and history:
        _write(options["thresholds_file"], history.picture(options["thresholds_file"].suffix))
    click.echo(json.dumps(tuned.as_dict(), indent=2) if options["as_json"] else tuned.as_text())
    if any(outcome.error for outcome in tuned.outcomes):
        raise click.exceptions.Exit(1)
    if any(outcome.damage for outcome in tuned.outcomes):
        raise click.exceptions.Exit(3)


def _run(logs: Sequence[str], options: Mapping[str, Any]) -> "tuple[Tuned, ThresholdHistory | None]":
    from seaclutter_cli.commands.judging import Job
    from seaclutter_cli.commands.outputs import refuse_overwriting
    from seaclutter_cli.commands.sweep import grid, parse_sweep
    from seaclutter_cli.commands.thresholds import ThresholdHistory
    from seaclutter_cli.commands.truths import labels_for
    from seaclutter_cli.commands.tuned import Tuned
    from seaclutter_cli.sources import find_recordings

    sweeps = [parse_sweep(text) for text in options["sweeps"]]
    variants = grid(sweeps, options["config_file"], options["method"], options["overrides"])
    recordings = find_recordings(logs)
    targets = [options[name] for name in ("output", "csv_file", "curve_file", "thresholds_file") if options[name]]
    refuse_overwriting(targets, recordings, force=options["force"])
    _check_pictures(options, len(sweeps), len(recordings))
    history = ThresholdHistory(list(variants.values()), options["ring"]) if options["thresholds_file"] else None
    job = Job.of(options, list(variants.values()))
    truths = labels_for(recordings, options["label_paths"], options)
    watchers = [history] if history else []
    outcomes = [job.run(recording, labels, [], watchers) for recording, labels in zip(recordings, truths, strict=True)]
    return Tuned(sweeps, list(variants.values()), outcomes), history


def _check_pictures(options: Mapping[str, Any], sweeps: int, recordings: int) -> None:
    from seaclutter_cli.errors import UsageError
    from seaclutter_cli.plots.figure import check_target

    for name in ("curve_file", "thresholds_file"):
        if options[name]:
            check_target(options[name])
    if options["curve_file"] and sweeps > 1:
        raise UsageError("--plot: a curve needs a single --sweep")
    if options["thresholds_file"] and recordings > 1:
        raise UsageError("--plot-thresholds: one recording at a time")


def _write(path: Path, data: bytes) -> None:
    from seaclutter_cli.sinks.atomic import AtomicFile

    with AtomicFile(path) as file:
        file.stream.write(data)
