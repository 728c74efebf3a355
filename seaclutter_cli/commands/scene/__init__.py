"""``seaclutter scene``: the classifier of open and confined water."""

from seaclutter_cli.commands.lazy import LazyGroup

command = LazyGroup(
    "scene",
    commands={
        "train": "Train a classifier on logs with known scenes.",
        "evaluate": "Evaluate a classifier on logs with known scenes.",
        "predict": "Predict the scenes of logs.",
    },
    short_help="Train, evaluate and use the scene classifier.",
    help="""Train, evaluate and use the classifier that recognises the scene of a frame in its top view.

    The built-in model distinguishes open water (separate objects) from confined water (continuous facades: quay walls,
    moored rows, the banks of a channel). It needs the extra `scene`; training needs the extra `train`.
    """,
)
