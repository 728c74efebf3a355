"""Labels in JSON: a file for each frame (SeePerSea, SUSTechPOINTS), or for a scenario (Autoferry)."""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seaclutter_cli.documents import MAX_JSON_BYTES, DocumentError, load_json
from seaclutter_cli.errors import LabelError, about
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.labels.boxes import (
    FileLabels,
    Labelled,
    LabelOptions,
    Proposal,
    checked,
    files_in,
    label_folder,
    truth_of,
)
from seaclutter_cli.paths import open_regular
from seaclutter_cli.truth import Truth

ANNOTATOR, PROPOSER = "annotator", "seaclutter"
"""Key of boxes that tools keep until a person edits them, and its value in those that the program proposed."""

_HEAD_BYTES = 1024
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class JsonForm:
    """Form of labels: a folder with a JSON file for each frame, in a scene that may also have a folder of clouds.

    Every JSON file starts with ``mark`` (a regular expression), and contains ``key`` near its start. In a ``complete``
    form, every frame must have a file; in others, frames without a file are unlabelled. ``objects`` returns the objects
    in the content of a file, or None if the frame is not labelled. The first of the keys ``tracks`` that has a text
    names an object, the key ``kind`` its class; below ``box`` are position, size along x, y and z, and yaw, each a key
    with keys.
    """

    folder: str
    clouds: str
    mark: bytes
    key: bytes
    complete: bool
    objects: Callable[[Any], list[Any] | None]
    tracks: tuple[str, ...]
    kind: str
    box: str
    position: str
    size: tuple[str, tuple[str, str, str]]
    yaw: tuple[str, str]

    def open(self, folder: Path, options: LabelOptions) -> FileLabels:
        """Return the labels in a folder of label files; `LabelError` if clouds and labels do not match."""
        return FileLabels(folder, ".json", self.clouds, self._read, options, complete=self.complete)

    def find(self, path: Path) -> Path | None:
        """Return the folder of label files: the subfolder of this name or the path itself; None if neither fits.

        A folder of the right name needs no typical file, because all files may be empty or broken, but no file may
        start with the mark of the other form.
        """
        if (folder := label_folder(path, self.folder, ".json")) is None:
            return None
        files = files_in(folder, (".json",))
        starts = re.compile(self.mark)
        if any(starts.match(head) and self.key in head for head in map(_head, files)):
            return folder
        named = folder.resolve().name == self.folder
        others = (head for head in map(_head, files) if head[:1] in (b"[", b"{") and not starts.match(head))
        return folder if named and not any(others) else None

    def _read(self, path: Path, _: Frame) -> Truth | None:
        objects = self.objects(read_json(path))
        return None if objects is None else truth_from(objects, self._labelled)

    def _labelled(self, item: Any) -> Labelled:
        box = part(item, self.box)
        track = next(filter(None, (text(item, key) for key in self.tracks)), "")
        x, y, z = (number(part(box, self.position), axis) for axis in "xyz")
        length, width, height = (number(part(box, self.size[0]), name) for name in self.size[1])
        yaw, proposed = number(part(box, self.yaw[0]), self.yaw[1]), text(item, ANNOTATOR).startswith(PROPOSER)
        return Labelled(track, text(item, self.kind), (x, y, z), (length, width, height), yaw, proposed)

    def content(self, objects: Sequence[Proposal]) -> Any:
        """Return the content of the file of a frame."""
        names, x_axis = self.size[1], dict.fromkeys(("x", "y") if self.yaw[1] == "z" else (), 0.0)
        items = [
            {
                self.tracks[-1]: one.labelled.track,
                self.kind: one.labelled.kind,
                self.box: {
                    self.position: dict(zip("xyz", one.labelled.center, strict=True)),
                    self.size[0]: dict(zip(names, one.labelled.size, strict=True)),
                    self.yaw[0]: {**x_axis, self.yaw[1]: one.labelled.yaw},
                },
                ANNOTATOR: f"{PROPOSER}, {one.mark}",
                "score": one.score,
            }
            for one in objects
        ]
        return {"labels": items} if self.complete else items


def _head(path: Path) -> bytes:
    with open_regular(path) as file:
        return file.read(_HEAD_BYTES).removeprefix(_BOM).lstrip()


def read_json(path: Path) -> Any:
    """Return the content of a JSON file; None if the file is empty, `LabelError` if it is not valid."""
    with open_regular(path) as file:
        content = file.read(MAX_JSON_BYTES + 1).removeprefix(_BOM)
    if not content.strip():
        return None
    try:
        return load_json(content)
    except DocumentError as error:
        raise LabelError(str(error)) from error


def truth_from(items: Iterable[Any], parse: Callable[[Any], Labelled]) -> Truth:
    """Return the truth of a frame from the JSON of its objects; `LabelError` names the number of an invalid one."""
    objects = []
    for number, item in enumerate(items):
        with about(f"object {number}", LabelError):
            objects.append(checked(parse(item)))
    return truth_of(objects)


def part(item: Any, key: str) -> Any:
    """Return the value of a key; `LabelError` if it is missing or the item is not a JSON object."""
    if not isinstance(item, Mapping) or key not in item:
        raise LabelError(f"missing key {key!r}")
    return item[key]


def number(item: Any, key: str) -> float:
    """Return the finite number at a key; `LabelError` if there is none."""
    value = part(item, key)
    try:
        result = math.nan if isinstance(value, str | bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        raise LabelError(f"{key!r} is not a finite number")
    return result


def text(item: Any, key: str) -> str:
    """Return the text or whole number at a key as text; empty if there is neither."""
    value = item.get(key) if isinstance(item, Mapping) else None
    return str(value) if isinstance(value, str | int) and not isinstance(value, bool) else ""


def _seepersea_objects(content: Any) -> list[Any] | None:
    if not content:
        return None
    labels = part(content, "labels")
    if not isinstance(labels, list):
        raise LabelError("'labels' is not a list")
    return labels


SEEPERSEA = JsonForm(
    folder="annotations",
    clouds="point_clouds",
    mark=rb"\{(?!\s*\"objs\")",
    key=b'"labels"',
    complete=True,
    objects=_seepersea_objects,
    tracks=("trackId", "id"),
    kind="category",
    box="box3d",
    position="location",
    size=("dimension", ("width", "length", "height")),  # in 3D BAT, the width is along x
    yaw=("orientation", "rotationYaw"),
)
"""Sequences of https://github.com/dartmouthrobotics/SeePerSea, in the format of 3D BAT."""


def _sustechpoints_objects(content: Any) -> list[Any] | None:
    objects = content.get("objs") if isinstance(content, Mapping) else content  # as older versions write them
    if objects is not None and not isinstance(objects, list):
        raise LabelError("not a list of boxes")
    return objects


SUSTECHPOINTS = JsonForm(
    folder="label",
    clouds="lidar",
    mark=rb"\[|\{\s*\"objs\"",
    key=b'"psr"',
    complete=False,  # the tool writes a file once a frame has been edited
    objects=_sustechpoints_objects,
    tracks=("obj_id",),
    kind="obj_type",
    box="psr",
    position="position",
    size=("scale", ("x", "y", "z")),
    yaw=("rotation", "z"),  # boxes are upright here; the tool can also tilt them by a few degrees
)
"""Scenes of https://github.com/naurril/SUSTechPOINTS."""

_TRUTH, _DETECTIONS = "_groundTruth.json", "_detections.json"
_SENSORS = {"/lidar/detections": 1, "/radar/detections": 2}


class AutoferryLabels(Labels):
    """Labels of a scenario of https://github.com/Autoferry/sensor_fusion_dataset, in its files of truth and detections.

    Targets at the time of each detection have positions only, so their boxes have no size; ``evaluation.box_margin_m``
    is the distance within which a detection belongs to them. `LabelError` if the files are not valid or do not belong
    together. No label needs a frame, since the times of other sensors have none.
    """

    def __init__(self, files: tuple[Path, Path], _: LabelOptions) -> None:
        self._path, other = files
        truth, detections = map(_read, files)
        if not (isinstance(truth, list) and isinstance(detections, list) and len(truth) == len(detections)):
            raise LabelError(f"{self._path}: must be a list with an entry for each detection in {other.name}")
        with about(other, LabelError):
            keys = [(int(number(item, "sensorID")), round(number(item, "time") * 1e6) * 1000) for item in detections]
        # MATLAB writes a list of one target as the target itself.
        targets = [[item] if isinstance(item, Mapping) else item for item in truth]
        self._targets = dict(zip(keys, zip(detections, targets, strict=True), strict=True))

    def truth(self, frame: Frame) -> Truth | None:
        """Return the targets relative to own ship; None if a frame has none, `LabelError` if they are not valid."""
        if (found := self._targets.get((_SENSORS.get(frame.topic, 0), frame.stamp_ns))) is None:
            return None
        detections, targets = found
        try:
            north, east = (float(value) for value in part(detections, "ownshipPosition"))
            return truth_from(targets, lambda target: _labelled(target, north, east))
        except (TypeError, ValueError, OverflowError, LookupError, LabelError) as error:
            raise LabelError(f"{self._path}: frame {frame.index}: {error}") from error


def _read(path: Path) -> Any:
    with about(path, LabelError):
        return read_json(path)


def find_scenario(path: Path) -> tuple[Path, Path] | None:
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
