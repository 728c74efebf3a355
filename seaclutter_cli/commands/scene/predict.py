"""``seaclutter scene predict``: scenes of logs."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, logs_argument, reading_options
from seaclutter_cli.commands.scene.options import classifier_options

if TYPE_CHECKING:
    from seaclutter_cli.runs.recordings import ReadOptions
    from seaclutter_cli.runs.scene.logs import ClassifierOptions


@click.command(name="predict", short_help="Predict the scenes of logs.")
@logs_argument
@classifier_options
@reading_options
@console_options
def command(logs: tuple[str, ...], options: "ClassifierOptions", reading: "ReadOptions", console: Console) -> None:
    """Predict the scenes of LOGS: a line for each log and topic, with the share of frames of each class.

    --csv writes the scene of each frame and the probabilities of the classes.
    """
    from seaclutter_cli.runs.scene.classify import predict_scenes

    console.finish(predict_scenes(logs, options, reading, console))
