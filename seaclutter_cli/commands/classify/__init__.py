"""``seaclutter classify``: sea and objects in tiles of an airborne lidar."""

from seaclutter_cli.commands.lazy import LazyGroup

command = LazyGroup(
    "classify",
    commands={
        "separate": "Tell sea from what stands out of it.",
        "train": "Train a random forest on labelled tiles.",
        "predict": "Name points and objects, by a model.",
    },
    help="Take the sea out of airborne lidar tiles and name what is in it.",
)
