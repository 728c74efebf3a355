"""``seaclutter scene train``: training of a classifier on logs with known scenes."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import (
    console_options,
    force_option,
    grouped,
    reading_options,
)
from seaclutter_cli.commands.places import output_option
from seaclutter_cli.commands.scene.options import labelled_logs

if TYPE_CHECKING:
    from seaclutter_cli.runs.scene.logs import LabelledLogs
    from seaclutter_cli.runs.scene.train import TrainSceneOptions

_TRAINING = (
    click.option(
        "--epochs",
        type=click.IntRange(min=1),
        default=30,
        metavar="N",
        show_default=True,
        help="Passes over all training frames.",
    ),
    click.option(
        "--batch", type=click.IntRange(min=2), default=32, metavar="N", show_default=True, help="Frames per step."
    ),
    click.option(
        "--learning-rate",
        type=click.FloatRange(min=0, min_open=True),
        default=0.005,
        metavar="RATE",
        show_default=True,
        help="Initial learning rate of Adam; it falls to 0 along half a cosine.",
    ),
    click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=1,
        metavar="N",
        show_default=True,
        help="Seed of split, initial weights, order and rotations.",
    ),
)
_OPTIONS = (
    output_option("-o", "--output", metavar="MODEL.onnx", required=True, help="Model file to write."),
    force_option,
    output_option("--plot", "plot_file", help="Draw loss and precision over the epochs, as PNG or SVG."),
    click.option(
        "--extent",
        "extent_m",
        type=click.FloatRange(min=0, min_open=True),
        default=60.0,
        metavar="METRES",
        show_default=True,
        help="Half the side of the square in the top view.",
    ),
    click.option(
        "--every",
        type=click.IntRange(min=1),
        default=1,
        metavar="N",
        show_default=True,
        help="Use one frame in N; consecutive frames are nearly the same.",
    ),
    grouped("training", "scenes.training:TrainingParams", _TRAINING),
    reading_options,
)


@click.command(name="train", short_help="Train a classifier on logs with known scenes.")
@labelled_logs
@grouped("options", "runs.scene.train:TrainSceneOptions", _OPTIONS)
@console_options
def command(logs: "LabelledLogs", options: "TrainSceneOptions", console: Console) -> None:
    """Train a classifier on logs with known scenes, and write it as an ONNX file.

    FOLDERS contain one folder of logs per class, named after the class (open/, confined/); --scene gives classes and
    logs one by one. A frame with nothing in view gets the first class. Logs, never frames, are split into three parts:
    60 % for training, 20 % for choosing the best epoch, and 20 % for the test, which gives the confusion matrix.
    """
    from seaclutter_cli.runs.scene.train import train_scenes

    console.finish(train_scenes(logs, options, console))
