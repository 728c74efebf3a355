"""Ground truth of the Autoferry sensor fusion data set: positions of the targets at the time of each detection.

See https://github.com/Autoferry/sensor_fusion_dataset. Targets have positions only, so their boxes have no size;
``evaluation.box_margin_m`` is the distance within which a detection belongs to them.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.labels.boxes import Labelled, LabelOptions
from seaclutter_cli.labels.json_boxes import number, part, read_json, text, truth_from
from seaclutter_cli.truth import Truth

_TRUTH, _DETECTIONS = "_groundTruth.json", "_detections.json"
_SENSORS = {"/lidar/detections": 1, "/radar/detections": 2}


class AutoferryLabels:
    """Labels of a scenario in its files of truth and of detections: targets by ``sensorID`` and time of a detection.

    `LabelError` if the files are not valid or do not belong together.
    """

    def __init__(self, files: tuple[Path, Path], _: LabelOptions) -> None:
        self._path, other = files
        truth, detections = map(_read, files)
        if not (isinstance(truth, list) and isinstance(detections, list) and len(truth) == len(detections)):
            raise LabelError(f"{self._path}: must be a list with an entry for each detection in {other.name}")
        try:
            keys = [(int(number(item, "sensorID")), round(number(item, "time") * 1e6) * 1000) for item in detections]
        except LabelError as error:
            raise LabelError(f"{other}: {error}") from error
        # MATLAB writes a list of one target as the target itself.
        targets = [[item] if isinstance(item, Mapping) else item for item in truth]
        self._targets = dict(zip(keys, zip(detections, targets, strict=True), strict=True))

    def truth(self, frame: Frame) -> Truth | None:
        """Return the targets relative to own ship; None if a frame has none, `LabelError` if they are not valid."""
        found = self._targets.get((_SENSORS.get(frame.topic, 0), frame.stamp_ns))
        if found is None:
            return None
        detections, targets = found
        try:
            north, east = (float(value) for value in part(detections, "ownshipPosition"))
            return truth_from(targets, lambda target: _labelled(target, north, east))
        except (TypeError, ValueError, OverflowError, LookupError, LabelError) as error:
            raise LabelError(f"{self._path}: frame {frame.index}: {error}") from error

    def finish(self) -> None:
        """Do nothing: the times of other sensors have no frames."""


def _read(path: Path) -> Any:
    try:
        return read_json(path)
    except LabelError as error:
        raise LabelError(f"{path}: {error}") from error


def find(path: Path) -> tuple[Path, Path] | None:
    """Return the file of the truth, which the path is or contains, and that of the detections beside it."""
    files = sorted(path.glob(f"*{_TRUTH}")) if path.is_dir() else [path]
    if len(files) != 1 or not files[0].name.endswith(_TRUTH):
        return None
    detections = files[0].with_name(files[0].name.removesuffix(_TRUTH) + _DETECTIONS)
    return (files[0], detections) if detections.is_file() else None


def _labelled(target: Any, north: float, east: float) -> Labelled:
    position = part(target, "position")
    place = (float(position[0]) - north, east - float(position[1]), 0.0)
    return Labelled(text(target, "targetID"), "vessel", place, (0.0, 0.0, 0.0), 0.0)
