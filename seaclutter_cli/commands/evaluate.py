"""``seaclutter evaluate``: false and omitted alarms of one method or several."""

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from seaclutter_cli.commands.options import (
    force_option,
    logs_argument,
    methods_options,
    output_options,
    selection_options,
)
from seaclutter_cli.commands.truths import label_options
from seaclutter_cli.errors import UsageError

if TYPE_CHECKING:
    from seaclutter_cli.commands.comparison import Comparison


@click.command(name="evaluate", short_help="Count false and omitted alarms against labels; compare methods.")
@logs_argument
@label_options(required=True)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="FRAMES.csv",
    help="Write a line a frame and method.",
)
@click.option(
    "--summary", "summary_file", type=click.Path(path_type=Path), metavar="FILE.json", help="Write all figures as JSON."
)
@force_option
@methods_options
@click.option(
    "--clustering",
    type=click.Choice(["euclidean", "dbscan"]),
    help="Kind of clusters; by default that of the configuration. With dbscan, its measures are shown too.",
)
@selection_options
@output_options
def command(logs: tuple[str, ...], **options: Any) -> None:
    """Filter LOGS, cluster what is left and compare it with labels.

    LOGS are MCAP files, ROS bags, rosbag2 folders, captures of packets (PCAP, PCAPNG), folders of frames, or globs.
    Several methods are run in one pass. Frames without a label are counted and left out of every rate.
    """
    from seaclutter_cli.commands.comparison import Comparison
    from seaclutter_cli.commands.frame_table import FrameTable
    from seaclutter_cli.commands.judging import Job
    from seaclutter_cli.commands.outputs import refuse_overwriting
    from seaclutter_cli.commands.truths import labels_for
    from seaclutter_cli.commands.variants import choose_variants
    from seaclutter_cli.sinks.atomic import AtomicFile
    from seaclutter_cli.sources import find_recordings

    overrides = [*options["overrides"]]
    if options["clustering"]:
        overrides.append(f"evaluation.clustering={options['clustering']}")
    job = Job.of(options, choose_variants(_names(options), options["config_file"], overrides))
    recordings = find_recordings(logs)
    output, summary_file = options["output"], options["summary_file"]
    targets = [path for path in (output, summary_file) if path]
    refuse_overwriting(targets, recordings, force=options["force"])
    _refuse_mixing(targets, options["label_paths"])
    truths = labels_for(recordings, options["label_paths"], options)
    with ExitStack() as stack:
        tables = [stack.enter_context(FrameTable(output))] if output else []
        summary = stack.enter_context(AtomicFile(summary_file)) if summary_file else None
        outcomes = [job.run(recording, labels, tables) for recording, labels in zip(recordings, truths, strict=True)]
        comparison = Comparison(job.variants, outcomes)
        if summary:
            summary.stream.write(json.dumps(comparison.as_dict(), indent=2).encode() + b"\n")
    _tell(comparison, as_json=options["as_json"])


def _names(options: Mapping[str, Any]) -> list[str]:
    """Return the variants that the command line names."""
    from seaclutter_cli.commands.variants import COMPARISONS

    compared = [name for comparison in options["comparisons"] for name in COMPARISONS[comparison]]
    return [*compared, *options["methods"]]


def _refuse_mixing(targets: Sequence[Path], labels: Sequence[Path]) -> None:
    """Raise `UsageError` if outputs would overwrite each other or the labels."""
    if len({target.resolve() for target in targets}) < len(targets):
        raise UsageError(f"{targets[0]}: --output and --summary name one file for both")
    for target in targets:
        if target.resolve() in {path.resolve() for path in labels}:
            raise UsageError(f"{target}: these are the labels; choose another output")


def _tell(comparison: "Comparison", *, as_json: bool) -> None:
    """Print what came out, and end with the status that fits."""
    outcomes = comparison.recordings
    if as_json:
        click.echo(json.dumps(comparison.as_dict(), indent=2))
    elif not all(outcome.error for outcome in outcomes):
        click.echo(comparison.as_text())
    if any(outcome.error for outcome in outcomes):
        raise click.exceptions.Exit(1)
    if any(outcome.damage for outcome in outcomes):
        raise click.exceptions.Exit(3)
