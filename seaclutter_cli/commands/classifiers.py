"""``seaclutter scene`` and ``seaclutter classify``: open and confined water; sea and objects in airborne tiles."""

from seaclutter_cli.commands.groups import CommandGroup
from seaclutter_cli.commands.options import command
from seaclutter_cli.runs.options import classifiers

_SCENE = [
    command(
        "scene train",
        "runs.scenes.train_scenes",
        classifiers.TrainScenesOptions,
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
        "runs.scenes.evaluate_scenes",
        classifiers.EvaluateScenesOptions,
        """Evaluate a classifier on logs with known scenes: confusion matrix, precision and recall of each class.

        FOLDERS contain one folder of logs per class, named after the class (open/, confined/); --scene gives classes
        and logs one by one. With --every and --hold, the evaluated scene is the one that a filter would use.
        """,
        short_help="Evaluate a classifier on logs with known scenes.",
    ),
    command(
        "scene predict",
        "runs.scenes.predict_scenes",
        classifiers.PredictScenesOptions,
        """Predict the scenes of LOGS: a line for each log and topic, with the share of frames of each class.

        --csv writes the scene of each frame and the probabilities of the classes.
        """,
        short_help="Predict the scenes of logs.",
    ),
]

_CLASSIFY = [
    command(
        "classify separate",
        "runs.classify.separate.separate_tiles",
        classifiers.SeparateTilesOptions,
        """Separate each TILE into sea and non-sea points by morphological opening; on rough water, follow the waves.

        Sea points get the ASPRS class 9 (water), all others 1; land is recognised by its level, flatness and echoes.
        Everything else in a LAS or LAZ file is kept; a record says which waves were found. Several tiles are a survey:
        each is separated with a margin from its neighbours. TILE is a LAS or LAZ file, or a
        PCD, PLY, NPY, KITTI or CSV file in metres with z upwards, or a folder or glob of such files.
        """,
        short_help="Separate tiles into sea and non-sea points.",
    ),
    command(
        "classify train",
        "runs.classify.train.train_forest",
        classifiers.TrainForestOptions,
        """Train a random forest on labelled TILEs to classify objects.

        Part of the tiles, or of the objects if there are fewer than four tiles, is held out for a test, which the
        report shows. Classes are 1 ship, 2 reef, 3 shoal, 4 aquaculture, 5 seaweed, 6 island, 7 fishing fence, 8
        garbage patch. Needs the extra classify.
        """,
        short_help="Train a random forest on labelled tiles.",
    ),
    command(
        "classify predict",
        "runs.classify.predict.classify_tiles",
        classifiers.ClassifyTilesOptions,
        """Classify the non-sea points of each TILE with a trained model, and find the objects.

        Each point gets the additional dimensions predicted_class (0 for none, otherwise as in train), probability and
        predicted_object, and the same classification as by separate. The CSV table has the coordinates of the tile;
        GeoJSON is in WGS 84 if the tile states its coordinate reference system.
        """,
        short_help="Classify points and objects with a trained model.",
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
    CommandGroup("classify", _CLASSIFY),
)
