"""Options of the scene classifier."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seaclutter_cli.options import (
    Converted,
    Grouped,
    Number,
    OptionalPath,
    Options,
    Place,
    Whole,
    grouped,
    option,
)
from seaclutter_cli.runs.options import ReadOptions, Replacing
from seaclutter_cli.scenes import TrainingParams

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from seaclutter_cli.runs.scene.logs import LabelledLog
    from seaclutter_cli.urls import PathLike


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
        default=(),
        kind=Place(),
        help="Folders that each contain a folder of recordings for each class, named after the class.",
    )
    scenes: Converted[str | Sequence[str], tuple[str, ...]] = option(
        "--scene CLASS=LOGS", default=(), help="A class, and the file, folder or glob of its logs; repeatable."
    )

    def find(self) -> list[LabelledLog]:
        """Return the recordings with their true classes; raise `UsageError` if there are none, or one has two."""
        from seaclutter_cli.runs.scene.logs import find_labelled

        return find_labelled(self.folders, self.scenes)


class ClassifierOptions(Replacing):
    """Options of a trained scene classifier.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.ClassifierOptions(every=10, hold=3).model
    'open_confined'
    """

    model: str = option(
        "--model FILE", default="open_confined", help="ONNX file of a classifier, or the name of a built-in one."
    )
    every: int = option("--every", default=1, kind=Whole(1), help="Classify one frame in N; the others keep its scene.")
    hold: int = option(
        "--hold M",
        default=1,
        kind=Whole(1),
        help="Change the scene only after M consecutive classifications agree on another one.",
    )
    csv_file: OptionalPath = option(
        "--csv", default=None, kind=Place(output=True), help="Write a CSV table with a line for each frame."
    )


class TrainSceneOptions(Replacing):
    """Options of `train_scenes`.

    Examples
    --------
    >>> import seaclutter
    >>> seaclutter.TrainSceneOptions(output=folder / "model.onnx").training.epochs
    30
    """

    output: Converted[PathLike, Path] = option(
        "-o --output MODEL.onnx", kind=Place(output=True), help="Model file to write."
    )
    plot_file: OptionalPath = option(
        "--plot", default=None, kind=Place(output=True), help="Draw loss and precision over the epochs, as PNG or SVG."
    )
    extent_m: float = option(
        "--extent METRES", default=60.0, kind=Number(0, above=True), help="Half the side of the square in the top view."
    )
    every: int = option(
        "--every", default=1, kind=Whole(1), help="Use one frame in N; consecutive frames are nearly the same."
    )
    training: Grouped[TrainingParams] = grouped(default=TrainingParams())
    reading: Grouped[ReadOptions] = grouped(default=ReadOptions())
