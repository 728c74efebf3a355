"""Commands that consist of commands."""

from seaclutter_cli.commands.groups import CommandGroup

_LABELS = {"check": "Find mistakes in labels that would give wrong rates without an error."}
_SCENE = {
    "train": "Train a classifier on logs with known scenes.",
    "evaluate": "Evaluate a classifier on logs with known scenes.",
    "predict": "Predict the scenes of logs.",
}
_CLASSIFY = {
    "separate": "Separate tiles into sea and non-sea points.",
    "train": "Train a random forest on labelled tiles.",
    "predict": "Classify points and objects with a trained model.",
}
_CONFIG = {
    "show": "Print the effective configuration, ready to save and edit.",
    "check": "Check configuration files and list all errors.",
    "list": "List built-in sensors, methods, formats, configurations, scenes and lidars.",
}

COMMANDS = {
    "labels": CommandGroup("labels", _LABELS, {"check": "studies"}, help="Check labels of recordings."),
    "scene": CommandGroup(
        "scene",
        _SCENE,
        help="""Train, evaluate and use the classifier that recognises the scene of a frame in its top view.

        The built-in model distinguishes open water (separate objects) from confined water (continuous facades: quay
        walls, moored rows, the banks of a channel). It needs the extra `scene`; training needs the extra `train`.
        """,
    ),
    "classify": CommandGroup(
        "classify",
        _CLASSIFY,
        help="Separate sea from objects in airborne lidar tiles, and classify the objects.",
    ),
    "config": CommandGroup(
        "config",
        _CONFIG,
        former={"sensors": "list"},
        help="Show and check configurations; list built-in sensors, methods and scenes.",
    ),
}
