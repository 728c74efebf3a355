"""SeePerSea labels: a sequence folder with ``annotations/*.json`` in the format of 3D BAT.

See https://github.com/dartmouthrobotics/SeePerSea.
"""

from pathlib import Path
from typing import Any

from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.labels.boxes import Labelled
from seaclutter_cli.labels.files import FileLabels, by_name, by_order, clouds_beside, files_in
from seaclutter_cli.labels.json_files import json_folder, number, numbers, part, read_json, text, truth_from
from seaclutter_cli.labels.options import LabelOptions
from seaclutter_cli.truth import Truth

_NAME = "annotations"


def matches(path: Path) -> bool:
    """Return whether a path is a sequence or its annotation folder: JSON files with ``labels``."""
    return json_folder(path, _NAME, b"{", b'"labels"') is not None


def open_seepersea(path: Path, options: LabelOptions) -> FileLabels:
    """Return the labels of a sequence or its annotation folder.

    Each frame has one annotation file. If the sequence has a folder ``point_clouds``, both folders must have the same
    file names; otherwise annotation files are assigned to frames by order.

    Raises
    ------
    LabelError
        If the path has no annotations, or clouds and annotations do not match.
    """
    folder = json_folder(path, _NAME, b"{", b'"labels"')
    if folder is None:
        raise LabelError(f"{path}: contains no SeePerSea annotations")
    files, clouds = files_in(folder, (".json",)), clouds_beside(folder, "point_clouds")
    assigned = by_name(files, clouds, complete=True) if clouds else by_order(files)
    return FileLabels(folder, assigned, _read, options)


def _read(path: Path, frame: Frame) -> Truth | None:  # noqa: ARG001 - boxes need no points
    content = read_json(path)
    if not content:
        return None
    labels = part(content, "labels")
    if not isinstance(labels, list):
        raise LabelError("'labels' is not a list")
    return truth_from(labels, _labelled)


def _labelled(item: Any) -> Labelled:
    box = part(item, "box3d")
    return Labelled(
        text(item, "trackId") or text(item, "id"),
        text(item, "category"),
        numbers(part(box, "location"), ("x", "y", "z")),
        numbers(part(box, "dimension"), ("width", "length", "height")),  # in 3D BAT, the width is along x
        number(part(box, "orientation"), "rotationYaw"),
    )
