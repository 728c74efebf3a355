"""SemanticKITTI: a ``.label`` file a frame, with the class and instance of each point."""

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import LabelError
from seaclutter_cli.frame import Frame
from seaclutter_cli.labels.files import FileLabels, by_name, by_order, clouds_beside, files_in, label_folder
from seaclutter_cli.labels.options import LabelOptions
from seaclutter_cli.truth import CLUTTER, IGNORED, Truth

_NAME, _SUFFIX = "labels", ".label"
_CLASS_BITS = 0xFFFF
_FIRST_TRACK = 2**16


def matches(path: Path) -> bool:
    """Tell whether a path is a folder of ``.label`` files, or has one in it that is called ``labels``."""
    return label_folder(path, _NAME, _SUFFIX) is not None


def open_semantickitti(path: Path, options: LabelOptions) -> FileLabels:
    """Open a folder of ``.label`` files, or the sequence that it is in.

    Each frame has one. Where clouds lie beside, in ``velodyne``, both have to bear the same names; else files belong to
    frames in their order.

    Raises
    ------
    LabelError
        If it is no such folder, or clouds and labels do not fit each other.
    """
    folder = label_folder(path, _NAME, _SUFFIX)
    if folder is None:
        raise LabelError(f"{path}: no {_SUFFIX} files in it")
    files, clouds = files_in(folder, (_SUFFIX,)), clouds_beside(folder, "velodyne")
    places = by_name(files, clouds, complete=True) if clouds else by_order(files)
    return FileLabels(folder, places, partial(_read, options=options), options)


def _read(path: Path, frame: Frame, options: LabelOptions) -> Truth:
    count, rest = divmod(path.stat().st_size, 4)
    if rest:
        raise LabelError("no whole number of labels (4 bytes each)")
    if count != frame.size:
        raise LabelError(f"{count} labels for {frame.size} points")
    return Truth(None, points=point_truth(np.frombuffer(path.read_bytes(), "<u4"), options))


def point_truth(labels: NDArray[np.uint32], options: LabelOptions) -> NDArray[np.int64]:
    """Return what each point belongs to.

    Parameters
    ----------
    labels : ndarray, shape (N,), uint32
        Class in the lower 16 bits, instance in the upper.
    options : LabelOptions
        Which classes are what; the others are targets, an object for each class and instance.

    Returns
    -------
    ndarray, shape (N,), int64
        `CLUTTER`, `IGNORED`, or a number above 65535 that is the target's alone.

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
