"""SeePerSea: a sequence folder with ``annotations/*.json`` as 3D BAT writes them.

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
    """Tell whether a path is a sequence, or its folder of annotations: JSON with ``labels``."""
    return json_folder(path, _NAME, b"{", b'"labels"') is not None


def open_seepersea(path: Path, options: LabelOptions) -> FileLabels:
    """Open a sequence or its folder of annotations.

    Each frame has one annotation. Where the clouds of the sequence lie beside, in ``point_clouds``, both have to bear
    the same names; else annotations belong to frames in their order.

    Raises
    ------
    LabelError
        If it is no such folder, or clouds and annotations do not fit each other.
    """
    folder = json_folder(path, _NAME, b"{", b'"labels"')
    if folder is None:
        raise LabelError(f"{path}: no SeePerSea annotations in it")
    files, clouds = files_in(folder, (".json",)), clouds_beside(folder, "point_clouds")
    places = by_name(files, clouds, complete=True) if clouds else by_order(files)
    return FileLabels(folder, places, _read, options)


def _read(path: Path, frame: Frame) -> Truth | None:  # noqa: ARG001 - boxes need no points
    content = read_json(path)
    if not content:
        return None
    labels = part(content, "labels")
    if not isinstance(labels, list):
        raise LabelError("'labels' is no list")
    return truth_from(labels, _labelled)


def _labelled(item: Any) -> Labelled:
    box = part(item, "box3d")
    return Labelled(
        text(item, "trackId") or text(item, "id"),
        text(item, "category"),
        numbers(part(box, "location"), ("x", "y", "z")),
        numbers(part(box, "dimension"), ("width", "length", "height")),  # their viewer lays the width along x
        number(part(box, "orientation"), "rotationYaw"),
    )
