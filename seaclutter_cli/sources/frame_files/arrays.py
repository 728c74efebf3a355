"""Points as arrays of numbers: NumPy's ``.npy`` and ``.npz`` files, and ``.bin`` files without a header."""

import os
import zipfile
from collections.abc import Sequence
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.limits import above, limits
from seaclutter_cli.paths import open_regular, read_whole
from seaclutter_cli.sources.frame_files.headerless import check_usual, points_of, recognise
from seaclutter_cli.sources.frame_files.reading import check_size, column_names
from seaclutter_cli.text import count

_MAX_ARRAYS = 1024


def read_bin(path: Path, layout: np.dtype[np.void] | None = None, *, is_given: bool = False) -> Cloud:
    """Return the points of a file of a layout, by default the only one that its bytes can have; `CloudError` if none.

    Points that are implausible in their layout are refused, unless it ``is_given``.
    """
    layout = recognise([path])[0] if layout is None else layout
    points = points_of(read_whole(path), layout)
    return from_array(points if is_given else check_usual(points))


def read_npy(path: Path, columns: Sequence[str] = ()) -> Cloud:
    """Return the points of an array of shape (N, 3) or wider, or of a structured one, (N,); `CloudError` for others.

    ``columns`` are the names of those of an array that is not structured.
    """
    with open_regular(path) as file:
        array = _checked(file, os.fstat(file.fileno()).st_size)
        if array.dtype.names and array.ndim == 1:
            return from_array(array)
        if array.dtype.names or array.ndim != 2:
            found = f"shape {array.shape} and type {array.dtype}"
            raise CloudError(f"expected an array of shape (N, 3) or wider, got {found}")
        if array.dtype.kind not in "biuf":
            raise CloudError(f"expected numbers, got the type {array.dtype}")
        names = columns or column_names(array.shape[1])
        if len(names) != array.shape[1]:
            raise CloudError(f"{count(array.shape[1], 'column')}, but --columns names {len(names)}")
        dtype = np.dtype([(name, array.dtype) for name in names])
        points = np.ascontiguousarray(array).view(dtype).reshape(-1)
        return from_array(points if columns else check_usual(points))


def _checked(file: IO[bytes], size: int) -> NDArray[Any]:
    """Return the array in a file of ``size`` bytes, after a check that it can contain as much as it declares."""
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(file)
    if not dtype.hasobject:
        check_size(file.tell() + prod(shape) * dtype.itemsize, size)
    file.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
    return array


def read_npz(path: Path) -> Cloud:
    """Return the points of an archive with arrays ``x``, ``y``, ``z`` and others of their shape; `CloudError` if not.

    The shape is (N,), or (height, width) for an organised cloud; one more axis are several values of a field.
    """
    with zipfile.ZipFile(path) as archive:
        entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
        size = sum(entry.file_size for entry in entries)
        if size > limits().file_bytes(path.stat().st_size):
            raise CloudError(f"the arrays have {above(count(size, 'byte'), 'file_ratio')}")
        if len(entries) > _MAX_ARRAYS:
            raise CloudError(f"{len(entries):,} arrays; at most {_MAX_ARRAYS} are supported")
        arrays = {}
        for entry in entries:
            with archive.open(entry) as file:
                arrays[entry.filename.removesuffix(".npy")] = _checked(file, entry.file_size)
    return _cloud(arrays)


def _cloud(arrays: dict[str, NDArray[Any]]) -> Cloud:
    if missing := [axis for axis in "xyz" if axis not in arrays]:
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
