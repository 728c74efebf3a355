"""``seaclutter labels check``: probable mistakes in labels."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    batch_options,
    console_options,
    label_options,
    logs_argument,
    reading_options,
)

if TYPE_CHECKING:
    from seaclutter_cli.runs.batch import BatchOptions
    from seaclutter_cli.runs.labels import LabelSources
    from seaclutter_cli.runs.recordings import ReadOptions


@click.command(name="check", short_help="Find mistakes in labels that would give wrong rates without an error.")
@logs_argument
@label_options(required=True)
@reading_options
@batch_options
@console_options
def command(
    logs: tuple[str, ...], labels: "LabelSources", reading: "ReadOptions", batch: "BatchOptions", console: Console
) -> None:
    """Compare labels with the points of LOGS, and name probable mistakes with their remedies.

    Found are yaws in degrees or in the other direction, length and width or x and y swapped, centimetres and
    millimetres, positions off by a distance, boxes too small or too large, duplicates, misspelt classes, and labels of
    another recording. These are guesses from up to twelve frames. The exit status is 1 if there are any. `evaluate`,
    `tune` and `report` give the same as warnings.
    """
    from seaclutter_cli.runs.label_check import check_label_files

    console.finish(check_label_files(logs, labels, reading, batch, console))
