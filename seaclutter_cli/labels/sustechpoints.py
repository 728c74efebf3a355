"""SUSTechPOINTS labels: a scene folder with ``label/*.json``, each a list of boxes.

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
    """Return whether a path is a scene or its label folder: JSON lists of boxes."""
    return json_folder(path, _NAME, b"[", b'"psr"') is not None


def open_sustechpoints(path: Path, options: LabelOptions) -> FileLabels:
    """Return the labels of a scene or its label folder.

    The tool writes a file once a frame has been edited, so frames without a file are unlabelled. If the scene has a
    folder ``lidar``, label files belong to the clouds of the same name. Otherwise the file name is the frame number,
    from 0. Files whose names are not numbers, or are consecutive numbers that start above 0, are assigned to frames by
    order; in this case every frame must have a file.

    Raises
    ------
    LabelError
        If the path has no labels, or a label file has no cloud.
    """
    folder = json_folder(path, _NAME, b"[", b'"psr"')
    if folder is None:
        raise LabelError(f"{path}: contains no SUSTechPOINTS labels")
    files, clouds = files_in(folder, (".json",)), clouds_beside(folder, "lidar")
    assigned = by_name(files, clouds, complete=False) if clouds else by_number(files)
    return FileLabels(folder, assigned, _read, options)


def _read(path: Path, frame: Frame) -> Truth | None:  # noqa: ARG001 - boxes need no points
    content = read_json(path)
    if content is None:
        return None
    if not isinstance(content, list):
        raise LabelError("not a list of boxes")
    return truth_from(content, _labelled)


def _labelled(item: Any) -> Labelled:
    psr = part(item, "psr")
    return Labelled(
        text(item, "obj_id"),
        text(item, "obj_type"),
        numbers(part(psr, "position"), ("x", "y", "z")),
        numbers(part(psr, "scale"), ("x", "y", "z")),
        number(part(psr, "rotation"), "z"),  # boxes are upright here; the tool can also tilt them by a few degrees
    )
