"""``seaclutter scene``: the classifier of open and confined water."""

from seaclutter_cli.commands.groups import CommandGroup
from seaclutter_cli.commands.options import command
from seaclutter_cli.options import Anything, option
from seaclutter_cli.runs.options import ReadOptions
from seaclutter_cli.runs.options.scenes import ClassifierOptions, LabelledLogs, TrainSceneOptions

_SCENE = [
    command(
        "scene train",
        "runs.scene.train:train_scenes",
        {"logs": LabelledLogs, "options": TrainSceneOptions},
        """Train a classifier on logs with known scenes, and write it as an ONNX file.

        FOLDERS contain one folder of logs per class, named after the class (open/, confined/); --scene gives classes
        and logs one by one. A frame with nothing in view gets the first class. Logs, never frames, are split into three
        parts: 60 % for training, 20 % for choosing the best epoch, and 20 % for the test, which gives the confusion
        matrix.
        """,
        short_help="Train a classifier on logs with known scenes.",
    ),
    command(
        "scene evaluate",
        "runs.scene.classify:evaluate_scenes",
        {"logs": LabelledLogs, "options": ClassifierOptions, "reading": ReadOptions},
        """Evaluate a classifier on logs with known scenes: confusion matrix, precision and recall of each class.

        FOLDERS contain one folder of logs per class, named after the class (open/, confined/); --scene gives classes
        and logs one by one. With --every and --hold, the evaluated scene is the one that a filter would use.
        """,
        short_help="Evaluate a classifier on logs with known scenes.",
    ),
    command(
        "scene predict",
        "runs.scene.classify:predict_scenes",
        {
            "logs": option("LOGS...", kind=Anything(), help="Logs."),
            "options": ClassifierOptions,
            "reading": ReadOptions,
        },
        """Predict the scenes of LOGS: a line for each log and topic, with the share of frames of each class.

        --csv writes the scene of each frame and the probabilities of the classes.
        """,
        short_help="Predict the scenes of logs.",
    ),
]

COMMANDS = (
    CommandGroup(
        "scene",
        _SCENE,
        help="""Train, evaluate and use the classifier that recognises the scene of a frame in its top view.

        The built-in model distinguishes open water (separate objects) from confined water (continuous facades: quay
        walls, moored rows, the banks of a channel). It needs the extra `scene`; training needs the extra `train`.
        """,
    ),
)
