"""``seaclutter scene train``: a classifier from logs whose scenes are known."""

from typing import TYPE_CHECKING

import click

from seaclutter_cli.commands.console import Console
from seaclutter_cli.commands.options import console_options, force_option, grouped, path_option, reading_options
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
        help="Rounds through all frames.",
    ),
    click.option(
        "--batch", type=click.IntRange(min=2), default=32, metavar="N", show_default=True, help="Frames in a step."
    ),
    click.option(
        "--learning-rate",
        type=click.FloatRange(min=0, min_open=True),
        default=0.005,
        metavar="RATE",
        show_default=True,
        help="Of Adam in the beginning; it falls to 0 along half a cosine.",
    ),
    click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=1,
        metavar="N",
        show_default=True,
        help="Of split, first weights, order and turns.",
    ),
)
_OPTIONS = (
    path_option("-o", "--output", metavar="MODEL.onnx", required=True, help="Where it goes."),
    force_option,
    path_option("--plot", "plot_file", help="Draw loss and precision over the epochs, as PNG or SVG."),
    click.option(
        "--extent",
        "extent_m",
        type=click.FloatRange(min=0, min_open=True),
        default=60.0,
        metavar="METRES",
        show_default=True,
        help="Half the side of the square that is seen from above.",
    ),
    click.option(
        "--every",
        type=click.IntRange(min=1),
        default=1,
        metavar="N",
        show_default=True,
        help="Take one frame in N; those next to each other show the same.",
    ),
    grouped("training", "scenes.training:TrainingParams", _TRAINING),
    reading_options,
)


@click.command(name="train", short_help="Train a classifier on logs whose scenes are known.")
@labelled_logs
@grouped("options", "runs.scene.train:TrainSceneOptions", _OPTIONS)
@console_options
def command(logs: "LabelledLogs", options: "TrainSceneOptions", console: Console) -> None:
    """Train a classifier on logs whose scenes are known, and write it as an ONNX file.

    FOLDERS hold a folder of logs for each class, named like it (open/, confined/); --scene names classes and logs one
    by one. The first class is what a frame with nothing in view is taken for. Logs, never frames, are split into three
    parts: 60 % to train on, 20 % to choose the best epoch by, 20 % to test on; the confusion matrix is of the latter.
    """
    from seaclutter_cli.runs.scene.train import train_scenes

    console.finish(train_scenes(logs, options, console))
