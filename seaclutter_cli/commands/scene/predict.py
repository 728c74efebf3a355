"""``seaclutter scene predict``: which scenes logs show."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, logs_argument, reading_options
from seaclutter_cli.commands.scene.options import classifier_options

if TYPE_CHECKING:
    from seaclutter_cli.runs.recordings import ReadOptions
    from seaclutter_cli.runs.scene.logs import ClassifierOptions


@click.command(name="predict", short_help="Tell which scenes logs show.")
@logs_argument
@classifier_options
@reading_options
@console_options
def command(logs: tuple[str, ...], options: "ClassifierOptions", reading: "ReadOptions", console: Console) -> None:
    """Tell which scenes LOGS show: a line for each log and topic, with the shares of its frames.

    --csv writes the scene of each frame and the probabilities that the classifier gave.
    """
    from seaclutter_cli.runs.scene.predict import predict_scenes

    console.finish(predict_scenes(logs, options, reading, console))
