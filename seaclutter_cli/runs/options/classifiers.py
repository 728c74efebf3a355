"""Options of the scene classifier, and of use cases that work on airborne tiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from seaclutter_cli.errors import UsageError
from seaclutter_cli.options import (
    Converted,
    Grouped,
    Kind,
    Number,
    OptionalPath,
    Options,
    Place,
    Whole,
    grouped,
    option,
)
from seaclutter_cli.runs.options import BatchOptions, ReadOptions, Replacing
from seaclutter_cli.scenes import TrainingParams

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from seaclutter_cli.airborne.settings import TileSettings
    from seaclutter_cli.sources.recordings import Recording
    from seaclutter_cli.urls import PathLike

_BATCH_HELP = "How several tiles are processed."


@dataclass(frozen=True)
class LabelledLog:
    """A recording and the true class of its scene."""

    recording: Recording
    scene: str


class LabelledLogs(Options):
    """Logs by the class of their scene.

    Examples
    --------
    >>> import seaclutter
    >>> [(log.scene, log.recording.name) for log in seaclutter.LabelledLogs(scenes=("open=samples/sea.mcap",)).find()]
    [('open', 'sea')]
    """

    folders: Converted[PathLike | Sequence[PathLike], tuple[Path, ...]] = option(
        "FOLDERS",
        "Folders that each contain a folder of recordings for each class, named after the class.",
        default=(),
        kind=Place(),
    )
    scenes: Converted[str | Sequence[str], tuple[str, ...]] = option(
        "--scene CLASS=LOGS", "A class, and the file, folder or glob of its logs; repeatable.", default=()
    )

    def find(self) -> list[LabelledLog]:
        """Return the recordings with their true classes; raise `UsageError` if there are none, or one has two."""
        from seaclutter_cli.sources.recordings import find_recordings

        named = []
        for text in self.scenes:
            scene, equals, pattern = text.partition("=")
            if not (equals and scene and pattern):
                raise UsageError(f"--scene {text}: write it as CLASS=LOGS, as in open=trials/offshore")
            named.append((scene, pattern))
        named += [(folder.name, str(folder)) for parent in self.folders for folder in _class_folders(parent)]
        if not named:
            raise UsageError("no logs: give a folder that contains a folder for each class, or --scene CLASS=LOGS")
        found: dict[Path, LabelledLog] = {}
        for scene, pattern in named:
            for recording in find_recordings([pattern]):
                first = found.setdefault(recording.key, LabelledLog(recording, scene))
                if first.scene != scene:
                    raise UsageError(f"{recording.paths[0]}: labelled as both {first.scene} and {scene}")
        return list(found.values())


def _class_folders(parent: Path) -> Sequence[Path]:
    from seaclutter_cli.sources.frame_files.folder import is_frame_folder
    from seaclutter_cli.sources.rosbag2 import is_rosbag2_folder

    if not parent.is_dir():
        raise UsageError(f"{parent}: no such folder")
    folders = [child for child in sorted(parent.iterdir()) if child.is_dir() and not child.name.startswith(".")]
    recording = next(
        (child for child in (parent, *folders) if is_rosbag2_folder(child) or is_frame_folder(child)), None
    )
    if recording or not folders:
        found = f"{recording} is a recording" if recording else "it contains no folders"
        raise UsageError(f"{parent}: must contain a folder of recordings for each class, but {found}")
    return folders


class ClassifierOptions(Replacing):
    """Options of a trained scene classifier.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.ClassifierOptions(every=10, hold=3).model
    'open_confined'
    """

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
    csv_file: OptionalPath = option("--csv", "Write a CSV table with a line for each frame.", default=None)


class TrainSceneOptions(Replacing):
    """Options of `train_scenes`.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.TrainSceneOptions(output=folder / "model.onnx").training.epochs
    30
    """

    output: Converted[PathLike, Path] = option("-o --output MODEL.onnx", "Model file to write.")
    plot_file: OptionalPath = option("--plot", "Draw loss and precision over the epochs, as PNG or SVG.", default=None)
    extent_m: float = option(
        "--extent METRES", "Half the side of the square in the top view.", default=60.0, kind=Number(0, above=True)
    )
    every: int = option(
        "--every", "Use one frame in N; consecutive frames are nearly the same.", default=1, kind=Whole(1)
    )
    training: Grouped[TrainingParams] = grouped(default=TrainingParams())
    reading: Grouped[ReadOptions] = grouped(default=ReadOptions())


class TileSettingsOptions(Options):
    """Sources of the settings of a run over tiles: defaults < file < single keys.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.TileSettingsOptions(overrides=("separation.window_m=30",)).load().separation.window_m
    30
    """

    file: OptionalPath = option("-c --config", "Settings file.", default=None, kind=Place())
    overrides: tuple[str, ...] = option(
        "-s --set KEY=VALUE", "Set a key, such as separation.window_m=30; repeatable.", default=()
    )

    def load(self, base: TileSettings | None = None) -> TileSettings:
        """Return the settings, on top of ``base`` or the defaults; raise `ConfigError` if any is invalid."""
        from seaclutter_cli.airborne.settings import load_settings

        return load_settings(self.file, self.overrides, base)


class MapOptions(Options):
    """Which maps a run over tiles draws and writes.

    Examples
    --------
    >>> import seaclutter
    >>> options = seaclutter.SeparateTilesOptions(maps=seaclutter.MapOptions(plot_file=folder / "map.png"))
    >>> _ = seaclutter.separate_tiles(["samples/tile.laz"], folder / "mapped.laz", options)
    >>> (folder / "map.png").exists()
    True
    """

    plot_file: OptionalPath = option(
        "--plot", "Draw a map with water level, land and objects, as PNG or SVG.", default=None, kw_only=False
    )
    geojson_file: OptionalPath = option(
        "--geojson", "Also write the shoreline and the boxes of objects as GeoJSON.", default=None, kw_only=False
    )

    @property
    def wanted(self) -> bool:
        """Whether there are any."""
        return bool(self.plot_file or self.geojson_file)


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


class SeparateTilesOptions(Replacing):
    """Options of `separate_tiles`.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.SeparateTilesOptions(with_height=True).settings.load().separation.window_m
    20.0
    """

    with_height: bool = option("--with-height", "Also write each point's height above the sea surface.", default=False)
    land: Literal["keep", "class2", "ignore"] | None = option(
        "--land",
        "Low and flat land: non-sea points; ASPRS class 2 on the ground; or not looked for, so that it is sea."
        " [default: keep]",
        default=None,
    )
    margin_m: float = option(
        "--margin METRES",
        "Width of the margin in which points of neighbouring tiles count; 0 for none.",
        default=100.0,
        kind=Number(0, 1000),
    )
    trust_classes: tuple[Literal[2, 9], ...] | None = option(
        "--trust-classes CLASSES",
        "Classes of the input that are right: 2 (ground), 9 (water), or 2,9. Their points keep them, and show"
        " where land and water are. [default: none]",
        default=None,
        kind=_Classes(),
    )
    window_m: float | None = option(
        "--window METRES",
        "Read COPC files in windows of this width, and write a tile for each; for files larger than memory.",
        default=None,
        kind=Number(50, 100_000),
    )
    maps: Grouped[MapOptions] = grouped(
        default=MapOptions(), help="Picture, and geodata of the shoreline and the objects."
    )
    settings: Grouped[TileSettingsOptions] = grouped(default=TileSettingsOptions(), help="Settings of the separation.")
    batch: Grouped[BatchOptions] = grouped(default=BatchOptions(), help=_BATCH_HELP, recording="tile")


class ClassifyTilesOptions(Replacing):
    """Options of `classify_tiles`: the model, its settings and additional outputs.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.ClassifyTilesOptions(model=folder / "model.skops", csv_file=folder / "objects.csv").force
    False
    """

    model: Converted[PathLike, Path] = option("--model MODEL", "Model file from classify train.", kind=Place())
    csv_file: OptionalPath = option("--csv", "Also write a CSV table with a line for each object.", default=None)
    geojson_file: OptionalPath = option("--geojson", "Also write the boxes of the objects as GeoJSON.", default=None)
    plot_file: OptionalPath = option("--plot", "Draw a top view of the tile, as PNG or SVG.", default=None)
    settings: Grouped[TileSettingsOptions] = grouped(
        default=TileSettingsOptions(), help="Settings that override those in the model, except for the features."
    )
    batch: Grouped[BatchOptions] = grouped(
        *("fail_fast", "resume", "manifest", "cluster", "cluster_insecure"),
        default=BatchOptions(),
        help=_BATCH_HELP,
        recording="tile",
    )


class TrainForestOptions(Replacing):
    """Options of `train_forest`.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.TrainForestOptions(output=folder / "model.skops").settings.load().forest.trees
    100
    """

    output: Converted[PathLike, Path] = option("-o --output MODEL", "Model file to write.")
    class_field: str = option(
        "--class-field NAME", "Field with the class of each point, 1 to 8; 0 for none.", default="object_class"
    )
    object_field: str = option(
        "--object-field NAME",
        "Field with object numbers; without it, clusters of a class are objects.",
        default="object_id",
    )
    plot_file: OptionalPath = option("--plot", "Draw the confusion matrix, as PNG or SVG.", default=None)
    settings: Grouped[TileSettingsOptions] = grouped(
        default=TileSettingsOptions(), help="Settings of separation, features and forest."
    )
