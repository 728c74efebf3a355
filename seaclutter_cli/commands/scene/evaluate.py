"""``seaclutter scene evaluate``: evaluation of a classifier on logs with known scenes."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, reading_options
from seaclutter_cli.commands.scene.options import classifier_options, labelled_logs

if TYPE_CHECKING:
    from seaclutter_cli.runs.recordings import ReadOptions
    from seaclutter_cli.runs.scene.logs import ClassifierOptions, LabelledLogs


@click.command(name="evaluate", short_help="Evaluate a classifier on logs with known scenes.")
@labelled_logs
@classifier_options
@reading_options
@console_options
def command(logs: "LabelledLogs", options: "ClassifierOptions", reading: "ReadOptions", console: Console) -> None:
    """Evaluate a classifier on logs with known scenes: confusion matrix, precision and recall of each class.

    FOLDERS contain one folder of logs per class, named after the class (open/, confined/); --scene gives classes and
    logs one by one. With --every and --hold, the evaluated scene is the one that a filter would use.
    """
    from seaclutter_cli.runs.scene.classify import evaluate_scenes

    result = evaluate_scenes(logs, options, reading, console)
    console.finish(result, result.as_text(verbose=console.verbose))
