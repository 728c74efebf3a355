"""NumPy ``.npy`` files: one row per point, or a structured array."""

import os
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.sources.frame_files.guard import check_size, reading
from seaclutter_cli.sources.frame_files.tables import column_names


def read_npy(path: Path) -> Cloud:
    """Return the points of an array of shape (N, 3) or wider, or of a structured array of shape (N,).

    Columns without names are x, y, z, intensity, ring, field_5 and so on; all keep their type.

    Raises
    ------
    CloudError
        If the file does not contain such an array, or is truncated.
    """
    with reading("NPY"), path.open("rb") as file:
        return from_array(_structured(read_checked(file, os.fstat(file.fileno()).st_size)))


def read_checked(file: IO[bytes], size: int) -> NDArray[Any]:
    """Return the array in a file of ``size`` bytes, after a check that it can contain as much as it declares.

    Raises
    ------
    CloudError
        If it cannot.
    """
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(file)
    if not dtype.hasobject:
        check_size(file.tell() + prod(shape) * dtype.itemsize, size)
    file.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
    return array


def _structured(array: NDArray[Any]) -> NDArray[Any]:
    if array.dtype.names and array.ndim == 1:
        return array
    if array.dtype.names or array.ndim != 2:
        raise CloudError(f"expected an array of shape (N, 3) or wider, got shape {array.shape} and type {array.dtype}")
    dtype = np.dtype([(name, array.dtype) for name in column_names(array.shape[1])])
    return np.ascontiguousarray(array).view(dtype).reshape(-1)
