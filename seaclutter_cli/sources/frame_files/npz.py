"""NumPy ``.npz`` files: an array for each field."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.limits import above, limits
from seaclutter_cli.sources.frame_files.guard import reading
from seaclutter_cli.sources.frame_files.npy import read_checked
from seaclutter_cli.text import count

_MAX_ARRAYS = 1024


def read_npz(path: Path) -> Cloud:
    """Return the points of an archive with arrays ``x``, ``y``, ``z`` and others of the same shape.

    The shape is (N,), or (height, width) for an organised cloud; one more axis are several values of a field. Arrays of
    other shapes are left out.

    Raises
    ------
    CloudError
        If the file does not contain such arrays, or expands to more than the limits allow.
    """
    with reading("NPZ"), zipfile.ZipFile(path) as archive:
        entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
        size = sum(entry.file_size for entry in entries)
        if size > limits().file_bytes(path.stat().st_size):
            raise CloudError(f"the arrays have {above(count(size, 'byte'), 'file_ratio')}")
        if len(entries) > _MAX_ARRAYS:
            raise CloudError(f"{len(entries):,} arrays; at most {_MAX_ARRAYS} are supported")
        arrays = {entry.filename.removesuffix(".npy"): _array(archive, entry) for entry in entries}
    return _cloud(arrays)


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(entry) as file:
        return read_checked(file, entry.file_size)


def _cloud(arrays: dict[str, NDArray[Any]]) -> Cloud:
    missing = [axis for axis in "xyz" if axis not in arrays]
    if missing:
        found = ", ".join(sorted(arrays)) or "none"
        raise CloudError(f"no array {missing[0]!r}; the arrays are: {found}")
    shape = arrays["x"].shape
    if len(shape) not in (1, 2):
        raise CloudError(f"expected an array 'x' of shape (N,) or (height, width), got {shape}")
    axes = len(shape)
    fields = {
        name: values
        for name, values in arrays.items()
        if values.dtype.names is None and values.dtype.kind in "biuf" and values.shape[:axes] == shape
    }
    points = np.empty(int(np.prod(shape)), [(name, one.dtype, one.shape[axes:]) for name, one in fields.items()])
    for name, values in fields.items():
        points[name] = values.reshape(len(points), *values.shape[axes:])
    return from_array(points, height=shape[0] if axes > 1 else 1)
