"""SemanticKITTI labels: one ``.label`` file per frame, with class and instance of each point."""

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.labels.boxes import LabelOptions
from seaclutter_cli.labels.files import FileLabels, assigned, label_folder
from seaclutter_cli.text import count
from seaclutter_cli.truth import CLUTTER, IGNORED, Truth

_NAME, _SUFFIX = "labels", ".label"
_CLASS_BITS = 0xFFFF
_FIRST_TRACK = 2**16


def matches(path: Path) -> bool:
    """Return whether a path is a folder of ``.label`` files or has a subfolder ``labels`` with such files."""
    return label_folder(path, _NAME, _SUFFIX) is not None


def open_semantickitti(path: Path, options: LabelOptions) -> FileLabels:
    """Return the labels of a folder of ``.label`` files or of the sequence that contains it.

    Each frame has one file. If the sequence has a folder ``velodyne``, both folders must have the same file names;
    otherwise label files are assigned to frames by order.
    """
    folder = label_folder(path, _NAME, _SUFFIX)
    if folder is None:
        raise LabelError(f"{path}: contains no {_SUFFIX} files")
    files = assigned(folder, _SUFFIX, "velodyne", complete=True)
    return FileLabels(folder, files, partial(_read, options=options), options)


def _read(path: Path, frame: Frame, options: LabelOptions) -> Truth:
    size, rest = divmod(path.stat().st_size, 4)
    if rest:
        raise LabelError(f"size must be a multiple of 4 bytes, got {4 * size + rest}")
    if size != frame.size:
        raise LabelError(f"{count(size, 'label')} for {count(frame.size, 'point')}")
    return Truth(None, points=point_truth(np.frombuffer(path.read_bytes(), "<u4"), options))


def point_truth(labels: NDArray[np.uint32], options: LabelOptions) -> NDArray[np.int64]:
    """Return the truth of each point: `CLUTTER`, `IGNORED`, or a number above 65535 that is unique to the target.

    Labels, shape (N,), uint32, have the class in the lower 16 bits and the instance in the upper.

    Examples
    --------
    >>> point_truth(np.array([110, 0, 10, 10 + (7 << 16)], np.uint32), LabelOptions())
    array([     0,  65535,  65546, 524298])
    """
    classes = labels & _CLASS_BITS
    truth = labels.astype(np.int64) + _FIRST_TRACK
    truth[np.isin(classes, options.ignore_ids)] = IGNORED
    truth[np.isin(classes, options.clutter_ids)] = CLUTTER
    return truth
