"""``seaclutter scene``: the classifier that tells open water from confined."""

import click

from seaclutter_cli.commands.scene_evaluate import evaluate
from seaclutter_cli.commands.scene_predict import predict
from seaclutter_cli.commands.scene_train import train


@click.group(name="scene", short_help="Train, test and use the classifier of scenes.")
def command() -> None:
    """Train, test and use the classifier that looks at a frame from above and tells its scene.

    The model that comes with the program tells open water (separate objects) from confined water (quay walls, moored
    rows, the banks of a channel). It needs the extra `scene`, training the extra `train`.
    """


for part in (train, evaluate, predict):
    command.add_command(part)
