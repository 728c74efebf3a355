"""Options of the scene classifier, and of use cases that work on airborne tiles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

from seaclutter_cli.errors import UsageError
from seaclutter_cli.options import Converted, Kind, Number, OptionalPath, Place, UseCase, Whole, option, optional
from seaclutter_cli.runs.options import BatchOptions, Observed, OfLogs, Places, ReadOptions, Replacing, Settings
from seaclutter_cli.scenes import TrainingParams

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from seaclutter_cli.airborne.settings import TileSettings
    from seaclutter_cli.urls import PathLike


class LabelledLogs(ReadOptions, Observed):
    """Logs by the class of their scene, and how they are read."""

    folders: Converted[PathLike | Sequence[PathLike], tuple[Path, ...]] = option(
        "FOLDERS",
        "Folders that each contain a folder of recordings for each class, named after the class.",
        default=(),
        kind=Place(),
        kw_only=False,
    )
    scenes: Converted[str | Sequence[str], tuple[str, ...]] = option(
        "--scene CLASS=LOGS", "A class, and the file, folder or glob of its logs; repeatable.", default=()
    )


class ClassifierOptions(Replacing):
    """Options of a trained scene classifier."""

    model: str = option(
        "--model FILE", "ONNX file of a classifier, or the name of a built-in one.", default="open_confined"
    )
    every: int = option("--every", "Classify one frame in N; the others keep its scene.", default=1, kind=Whole(1))
    hold: int = option(
        "--hold M",
        "Change the scene only after M consecutive classifications agree on another one.",
        default=1,
        kind=Whole(1),
    )
    csv_file: OptionalPath = optional("--csv", "Write a CSV table with a line for each frame.")


class TrainScenesOptions(Replacing, TrainingParams, LabelledLogs):
    """Train a classifier on logs with known scenes, and write it as an ONNX file.

    FOLDERS contain one folder of logs per class, named after the class (open/, confined/); --scene gives classes
    and logs one by one. A frame with nothing in view gets the first class. Logs, never frames, are split into three
    parts: 60 % for training, 20 % for choosing the best epoch, and 20 % for the test, which gives the confusion
    matrix.
    """

    use_case = UseCase(
        "scene train", "runs.scenes.train_scenes", short_help="Train a classifier on logs with known scenes."
    )

    output: Converted[PathLike, Path] = option("-o --output MODEL.onnx", "Model file to write.")
    plot_file: OptionalPath = optional("--plot", "Draw loss and precision over the epochs, as PNG or SVG.")
    extent_m: float = option(
        "--extent METRES", "Half the side of the square in the top view.", default=60.0, kind=Number(0, above=True)
    )
    every: int = option(
        "--every", "Use one frame in N; consecutive frames are nearly the same.", default=1, kind=Whole(1)
    )

    @property
    def training(self) -> TrainingParams:
        """Parameters of the training alone."""
        return self.part(TrainingParams())


class EvaluateScenesOptions(ClassifierOptions, LabelledLogs):
    """Evaluate a classifier on logs with known scenes: confusion matrix, precision and recall of each class.

    FOLDERS contain one folder of logs per class, named after the class (open/, confined/); --scene gives classes
    and logs one by one. With --every and --hold, the evaluated scene is the one that a filter would use.
    """

    use_case = UseCase(
        "scene evaluate", "runs.scenes.evaluate_scenes", short_help="Evaluate a classifier on logs with known scenes."
    )


class PredictScenesOptions(ClassifierOptions, OfLogs):
    """Predict the scenes of LOGS: a line for each log and topic, with the share of frames of each class.

    --csv writes the scene of each frame and the probabilities of the classes.
    """

    use_case = UseCase("scene predict", "runs.scenes.predict_scenes", short_help="Predict the scenes of logs.")


class OfTiles(Replacing, Observed):
    """What every function for airborne tiles takes; settings are defaults < file < single keys."""

    words: ClassVar[Mapping[str, str]] = {"recording": "tile"}

    tiles: PathLike | Sequence[PathLike] = option(
        "TILE...", "Files, folders or globs of tiles.", kind=Places(), kw_only=False
    )
    config: OptionalPath = optional("-c --config", "Settings file.", kind=Place())
    settings: Converted[Sequence[str] | Mapping[str, Any], tuple[str, ...]] = option(
        "-s --set KEY=VALUE", "Set a key, such as separation.window_m=30; repeatable.", default=(), kind=Settings()
    )

    def loaded(self, base: TileSettings | None = None) -> TileSettings:
        """Return the settings, on top of ``base`` or the defaults; raise `ConfigError` if any is invalid."""
        from seaclutter_cli.airborne.settings import load_settings

        return load_settings(self.config, self.settings, base)


class WritingTiles(OfTiles):
    """What functions take that write a tile for each tile."""

    output: PathLike = option(
        "-o --output OUT",
        "Output file for one tile; folder for several, or with a slash at its end: LAS, LAZ, PCD, PLY or MCAP.",
        kind=Place(output=True, or_folder=True),
        kw_only=False,
    )


class _Classes(Kind):
    """Classes 2 and 9, on the command line separated by commas."""

    def parse(self, text: str) -> Any:
        given = {one.strip() for one in text.split(",")}
        if not given <= {"2", "9"}:
            raise ValueError("must be 2, 9, or 2,9")
        return tuple(sorted(map(int, given)))

    def check(self, value: Any, name: str) -> Any:
        if not set(value) <= {2, 9}:
            raise UsageError(f"{name}: must be 2, 9, or both, got {value!r}")
        return tuple(value)


class SeparateTilesOptions(BatchOptions, WritingTiles):
    """Separate each TILE into sea and non-sea points by morphological opening; on rough water, follow the waves.

    Sea points get the ASPRS class 9 (water), all others 1; land is recognised by its level, flatness and echoes.
    Everything else in a LAS or LAZ file is kept; a record says which waves were found. Several tiles are a survey:
    each is separated with a margin from its neighbours. TILE is a LAS or LAZ file, or a
    PCD, PLY, NPY, KITTI or CSV file in metres with z upwards, or a folder or glob of such files.
    """

    use_case = UseCase(
        "classify separate",
        "runs.classify.separate.separate_tiles",
        short_help="Separate tiles into sea and non-sea points.",
    )

    with_height: bool = optional("--with-height", "Also write each point's height above the sea surface.")
    land: Literal["keep", "class2", "ignore"] | None = optional(
        "--land",
        "Low and flat land: non-sea points; ASPRS class 2 on the ground; or not looked for, so that it is sea."
        " [default: keep]",
    )
    margin_m: float = option(
        "--margin METRES",
        "Width of the margin in which points of neighbouring tiles count; 0 for none.",
        default=100.0,
        kind=Number(0, 1000),
    )
    trust_classes: tuple[Literal[2, 9], ...] | None = optional(
        "--trust-classes CLASSES",
        "Classes of the input that are right: 2 (ground), 9 (water), or 2,9. Their points keep them, and show"
        " where land and water are. [default: none]",
        kind=_Classes(),
    )
    window_m: float | None = optional(
        "--window METRES",
        "Read COPC files in windows of this width, and write a tile for each; for files larger than memory.",
        kind=Number(50, 100_000),
    )
    plot_file: OptionalPath = optional("--plot", "Draw a map with water level, land and objects, as PNG or SVG.")
    geojson_file: OptionalPath = optional("--geojson", "Also write the shoreline and the boxes of objects as GeoJSON.")


class TrainForestOptions(OfTiles):
    """Train a random forest on labelled TILEs to classify objects.

    Part of the tiles, or of the objects if there are fewer than four tiles, is held out for a test, which the
    report shows. Classes are 1 ship, 2 reef, 3 shoal, 4 aquaculture, 5 seaweed, 6 island, 7 fishing fence, 8
    garbage patch. Needs the extra classify.
    """

    use_case = UseCase(
        "classify train", "runs.classify.train.train_forest", short_help="Train a random forest on labelled tiles."
    )

    output: Converted[PathLike, Path] = option("-o --output MODEL", "Model file to write.")
    class_field: str = option(
        "--class-field NAME", "Field with the class of each point, 1 to 8; 0 for none.", default="object_class"
    )
    object_field: str = option(
        "--object-field NAME",
        "Field with object numbers; without it, clusters of a class are objects.",
        default="object_id",
    )
    plot_file: OptionalPath = optional("--plot", "Draw the confusion matrix, as PNG or SVG.")


class ClassifyTilesOptions(BatchOptions, WritingTiles):
    """Classify the non-sea points of each TILE with a trained model, and find the objects.

    Each point gets the additional dimensions predicted_class (0 for none, otherwise as in train), probability and
    predicted_object, and the same classification as by separate. The CSV table has the coordinates of the tile;
    GeoJSON is in WGS 84 if the tile states its coordinate reference system.
    """

    use_case = UseCase(
        "classify predict",
        "runs.classify.predict.classify_tiles",
        short_help="Classify points and objects with a trained model.",
    )
    left_out = ("fail_fast", "resume", "manifest", "cluster", "cluster_insecure")

    model: Converted[PathLike, Path] = option("--model MODEL", "Model file from classify train.", kind=Place())
    csv_file: OptionalPath = optional("--csv", "Also write a CSV table with a line for each object.")
    geojson_file: OptionalPath = optional("--geojson", "Also write the boxes of the objects as GeoJSON.")
    plot_file: OptionalPath = optional("--plot", "Draw a top view of the tile, as PNG or SVG.")
