"""``seaclutter evaluate``: false alarms and missed targets of one or several methods."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    console_options,
    force_option,
    grouped,
    label_options,
    logs_argument,
    manifest_batch_options,
    methods_options,
    reading_options,
)
from seaclutter_cli.commands.places import output_option

if TYPE_CHECKING:
    from seaclutter_cli.runs.evaluate import EvaluateOptions

_OPTIONS = (
    label_options(required=True),
    output_option(
        "-o",
        "--output",
        "frames_file",
        metavar="FRAMES.csv",
        help="Write a table with a row for each frame and method.",
        remote=True,
    ),
    output_option("--summary", "summary_file", metavar="FILE.json", help="Write all results as JSON.", remote=True),
    force_option,
    methods_options,
    click.option(
        "--clustering",
        type=click.Choice(["euclidean", "dbscan"]),
        help="Clustering algorithm; by default that of the configuration. With dbscan, also show its measures.",
    ),
    reading_options,
    manifest_batch_options,
)


@click.command(name="evaluate", short_help="Count false alarms and missed targets against labels; compare methods.")
@logs_argument
@grouped("options", "runs.evaluate:EvaluateOptions", _OPTIONS)
@console_options
def command(logs: tuple[str, ...], options: "EvaluateOptions", console: Console) -> None:
    """Filter LOGS, cluster the remaining points and compare the clusters with labels.

    LOGS are MCAP files, ROS bags, rosbag2 folders, packet captures (PCAP, PCAPNG), folders of frames, or globs.
    Several methods run in one pass. Frames without a label are counted, but left out of every rate.
    """
    from seaclutter_cli.runs.evaluate import evaluate_logs

    console.finish(evaluate_logs(logs, options, console))
