"""Labels of points: in a field ``label`` of the clouds, as written by the simulator, or in files of SemanticKITTI."""

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Ints
from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.labels.boxes import FileLabels, LabelOptions, label_folder
from seaclutter_cli.paths import open_regular, read_whole
from seaclutter_cli.text import count, printable
from seaclutter_cli.truth import CLUTTER, IGNORED, Truth

_FIELD = "label"
_CLASS_BITS = 0xFFFF
_FIRST_TRACK = 2**16
_MAGIC = (b"\x89MCAP0\r\n", b"#ROSBAG V", b"SQLite format 3\0")
_SUFFIXES = (".mcap", ".bag", ".bag.active", ".db3", ".mcap.zstd", ".db3.zstd")


def find_log(path: Path) -> Path | None:
    """Return the path if it is a log (MCAP, ROS 1 bag or rosbag2), whose clouds may have labels."""
    if path.is_dir():
        found = (path / "metadata.yaml").is_file() or any(_is_log(file) for file in path.iterdir())
        return path if found else None
    with open_regular(path) as file:
        return path if file.read(16).startswith(_MAGIC) or _is_log(path) else None


def _is_log(path: Path) -> bool:
    return path.name.lower().endswith(_SUFFIXES)


def point_labels(frame: Frame) -> Ints | None:
    """Return the ``label`` of each point, shape (N,), also of a float field; None unless whole numbers from 0."""
    points = frame.cloud.points
    if _FIELD not in (points.dtype.names or ()) or points.dtype[_FIELD].shape:
        return None
    values = points[_FIELD]
    with np.errstate(invalid="ignore"):
        labels: Ints = values.astype(np.int64)
        whole = bool((labels == values).all() and (labels >= 0).all())
    return labels if whole else None


class CloudLabels(Labels):
    """Labels inside the clouds of a log: 0 is clutter, 65535 is ignored or own ship, others are track numbers."""

    def __init__(self, path: Path, _: LabelOptions) -> None:
        self._path = path

    def truth(self, frame: Frame) -> Truth:
        """Return the truth of the points of a frame; `LabelError` if the cloud has no labels."""
        if (points := point_labels(frame)) is None:
            names = printable(", ".join(frame.cloud.dtype.names or ())) or "no fields"
            raise LabelError(
                f"{self._path}: frame {frame.index} of {printable(frame.topic)}: no field {_FIELD!r} with a whole "
                "number per point (0 for clutter, 65535 for ignored, otherwise the track of the target); "
                f"the cloud has {names}"
            )
        return Truth(None, points=points)


def find_semantickitti(path: Path) -> Path | None:
    """Return the folder of ``.label`` files: the path itself or its subfolder ``labels``; None if there is none."""
    return label_folder(path, "labels", ".label")


def open_semantickitti(folder: Path, options: LabelOptions) -> FileLabels:
    """Return the labels in a folder of ``.label`` files.

    Each frame has one file. If the sequence has a folder ``velodyne``, both folders must have the same file names;
    otherwise label files are assigned to frames by order.
    """
    return FileLabels(folder, ".label", "velodyne", partial(_read, options=options), options, complete=True)


def _read(path: Path, frame: Frame, options: LabelOptions) -> Truth:
    size, rest = divmod(path.stat().st_size, 4)
    if rest:
        raise LabelError(f"size must be a multiple of 4 bytes, got {4 * size + rest}")
    if size != frame.size:
        raise LabelError(f"{count(size, 'label')} for {count(frame.size, 'point')}")
    return Truth(None, points=point_truth(np.frombuffer(read_whole(path), "<u4"), options))


def point_truth(labels: NDArray[np.uint32], options: LabelOptions) -> Ints:
    """Return the truth of each point: `CLUTTER`, `IGNORED`, or a number above 65535 that is unique to the target.

    Labels, shape (N,), uint32, have the class in the lower 16 bits and the instance in the upper.
    """
    classes = labels & _CLASS_BITS
    truth = labels.astype(np.int64) + _FIRST_TRACK
    truth[np.isin(classes, options.ignore_ids)] = IGNORED
    truth[np.isin(classes, options.clutter_ids)] = CLUTTER
    return truth
