"""Points as arrays of numbers: NumPy's ``.npy`` and ``.npz`` files, and ``.bin`` files without a header.

The content of a ``.bin`` file shows its layout: points of CANOE have the time in microseconds since 1970, those of
Pohang Canal their range in millimetres; all others are KITTI's, which SemanticKITTI and WADS use too.
"""

import os
import zipfile
from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.limits import above, limits
from seaclutter_cli.sources.frame_files.reading import check_size, column_names
from seaclutter_cli.text import count

_Points = NDArray[np.void]

_KITTI = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])
# github.com/utiasASRL/pycanoe, DATA_REFERENCE.md; times are in microseconds.
_CANOE = np.dtype(
    [
        *((axis, "<f8") for axis in "xyz"),
        *(("intensity", "<u2"), ("timestamp", "<u8"), ("reflectivity", "<u2"), ("ambient", "<u2")),
    ]
)
# As the Ouster driver publishes points: nanoseconds in the scan, range in millimetres.
_POHANG = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "intensity")),
        *(("t", "<u4"), ("reflectivity", "<u2"), ("ambient", "<u2"), ("range", "<u4")),
    ]
)
_FIRST_US, _LAST_US = 946_684_800_000_000, 4_102_444_800_000_000
"""The years 2000 and 2100."""
_LOOKED_AT = 4096
_MIN_RETURNS, _MIN_SHARE = 3, 0.9
_MAX_ARRAYS = 1024


def read_bin(path: Path) -> Cloud:
    """Return the points of a file of KITTI (x, y, z, intensity), CANOE or Pohang Canal; `CloudError` for others."""
    content = path.read_bytes()
    for dtype, fits in _LAYOUTS:
        if content and len(content) % dtype.itemsize == 0:
            points = np.frombuffer(content, dtype)
            step = max(len(points) // _LOOKED_AT, 1)
            if fits(points[::step]):
                return from_array(points)
    if len(content) % _KITTI.itemsize:
        raise CloudError(
            f"{len(content)} bytes is not a multiple of 16, the size of a KITTI point (x, y, z, intensity as float32)"
        )
    return from_array(np.frombuffer(content, _KITTI))


def _has_ranges(points: _Points) -> bool:
    """Return whether the ranges are those of the coordinates, within 2 % or 0.2 m."""
    with np.errstate(invalid="ignore", over="ignore"):
        distance: Any = np.sqrt(sum(points[axis].astype(np.float64) ** 2 for axis in "xyz"))
        range_m = points["range"] / 1000
        returns = distance > 0
        same = np.abs(distance - range_m) <= 0.2 + 0.02 * distance
    return int(np.count_nonzero(returns)) >= _MIN_RETURNS and float(same[returns].mean()) >= _MIN_SHARE


_LAYOUTS: tuple[tuple[np.dtype[np.void], Callable[[_Points], bool]], ...] = (
    (_CANOE, lambda points: bool(((points["timestamp"] >= _FIRST_US) & (points["timestamp"] < _LAST_US)).all())),
    (_POHANG, _has_ranges),
)


def read_npy(path: Path) -> Cloud:
    """Return the points of an array of shape (N, 3) or wider, or of a structured one, (N,); `CloudError` for others."""
    with path.open("rb") as file:
        array = _checked(file, os.fstat(file.fileno()).st_size)
        if array.dtype.names and array.ndim == 1:
            return from_array(array)
        if array.dtype.names or array.ndim != 2:
            found = f"shape {array.shape} and type {array.dtype}"
            raise CloudError(f"expected an array of shape (N, 3) or wider, got {found}")
        dtype = np.dtype([(name, array.dtype) for name in column_names(array.shape[1])])
        return from_array(np.ascontiguousarray(array).view(dtype).reshape(-1))


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
