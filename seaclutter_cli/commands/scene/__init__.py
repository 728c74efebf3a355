"""``seaclutter scene``: the classifier that tells open water from confined."""

from seaclutter_cli.commands.lazy import LazyGroup

command = LazyGroup(
    "scene",
    commands={
        "train": "Train a classifier on logs whose scenes are known.",
        "evaluate": "Test a classifier on logs whose scenes are known.",
        "predict": "Tell which scenes logs show.",
    },
    short_help="Train, test and use the classifier of scenes.",
    help="""Train, test and use the classifier that looks at a frame from above and tells its scene.

    The model that comes with the program tells open water (separate objects) from confined water (quay walls, moored
    rows, the banks of a channel). It needs the extra `scene`, training the extra `train`.
    """,
)
