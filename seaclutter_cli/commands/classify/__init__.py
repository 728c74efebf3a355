"""``seaclutter classify``: sea and objects in airborne lidar tiles."""

from seaclutter_cli.commands.lazy import LazyGroup

command = LazyGroup(
    "classify",
    commands={
        "separate": "Separate tiles into sea and non-sea points.",
        "train": "Train a random forest on labelled tiles.",
        "predict": "Classify points and objects with a trained model.",
    },
    help="Separate sea from objects in airborne lidar tiles, and classify the objects.",
)
