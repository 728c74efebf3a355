"""``seaclutter scene evaluate``: how well a classifier tells the scenes of logs where they are known."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, reading_options
from seaclutter_cli.commands.scene.options import classifier_options, labelled_logs

if TYPE_CHECKING:
    from seaclutter_cli.runs.recordings import ReadOptions
    from seaclutter_cli.runs.scene.logs import ClassifierOptions, LabelledLogs


@click.command(name="evaluate", short_help="Test a classifier on logs whose scenes are known.")
@labelled_logs
@classifier_options
@reading_options
@console_options
def command(logs: "LabelledLogs", options: "ClassifierOptions", reading: "ReadOptions", console: Console) -> None:
    """Test a classifier on logs whose scenes are known: confusion matrix, precision and recall of each class.

    FOLDERS hold a folder of logs for each class, named like it (open/, confined/); --scene names classes and logs one
    by one. With --every and --hold, what counts is the scene that a filter would go by.
    """
    from seaclutter_cli.runs.scene.evaluate import evaluate_scenes

    result = evaluate_scenes(logs, options, reading, console)
    console.finish(result, result.as_text(verbose=console.verbose))
