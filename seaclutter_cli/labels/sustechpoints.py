"""SUSTechPOINTS: a scene folder with ``label/*.json``, a list of boxes each.

See https://github.com/naurril/SUSTechPOINTS.
"""

from pathlib import Path
from typing import Any

from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.labels.boxes import Labelled
from seaclutter_cli.labels.files import FileLabels, by_name, by_number, clouds_beside, files_in
from seaclutter_cli.labels.json_files import json_folder, number, numbers, part, read_json, text, truth_from
from seaclutter_cli.labels.options import LabelOptions
from seaclutter_cli.truth import Truth

_NAME = "label"


def matches(path: Path) -> bool:
    """Tell whether a path is a scene, or its folder of labels: JSON lists of boxes."""
    return json_folder(path, _NAME, b"[", b'"psr"') is not None


def open_sustechpoints(path: Path, options: LabelOptions) -> FileLabels:
    """Open a scene or its folder of labels.

    The tool writes a file for a frame once it was edited, so frames without one are unlabelled. Where the scene's
    clouds lie beside, in ``lidar``, files belong to those of the same name. Else the name is the number of the frame,
    from 0; but names that are no numbers, or that count on from another one, belong to frames in their order, and
    then each frame has to have one.

    Raises
    ------
    LabelError
        If it is no such folder, or a label file has no cloud.
    """
    folder = json_folder(path, _NAME, b"[", b'"psr"')
    if folder is None:
        raise LabelError(f"{path}: no SUSTechPOINTS labels in it")
    files, clouds = files_in(folder, (".json",)), clouds_beside(folder, "lidar")
    places = by_name(files, clouds, complete=False) if clouds else by_number(files)
    return FileLabels(folder, places, _read, options)


def _read(path: Path, frame: Frame) -> Truth | None:  # noqa: ARG001 - boxes need no points
    content = read_json(path)
    if content is None:
        return None
    if not isinstance(content, list):
        raise LabelError("no list of boxes")
    return truth_from(content, _labelled)


def _labelled(item: Any) -> Labelled:
    psr = part(item, "psr")
    return Labelled(
        text(item, "obj_id"),
        text(item, "obj_type"),
        numbers(part(psr, "position"), ("x", "y", "z")),
        numbers(part(psr, "scale"), ("x", "y", "z")),
        number(part(psr, "rotation"), "z"),  # the tool can tilt boxes too, by a few degrees; here they are upright
    )
