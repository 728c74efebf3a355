"""Clouds compressed with Draco: the attributes that ``draco_point_cloud_transport`` makes of the fields of a cloud."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import PointField
from seaclutter_cli.errors import CloudError, MissingExtraError
from seaclutter_cli.records import Buffer

_MAGIC = b"DRACO"
_HEADER = len(_MAGIC) + 6
_HAS_METADATA = 0x8000
_MAX_DEPTH = 8
_COLORS = 4
"""Values of a colour in one number: the transport stores ``rgb`` as four attributes of a byte."""


def unpack_draco(
    packed: Buffer, points: int, fields: Sequence[PointField], point_step: int, *, big_endian: bool
) -> tuple[tuple[PointField, ...], memoryview]:
    """Return the fields of a cloud that can be read, and the bytes of its points.

    The library reads float64 attributes in single precision, which is enough for coordinates. Other float64 fields,
    such as times, are left out. The attribute of each field has its index.

    Raises
    ------
    CloudError
        If the data are damaged, or are not those of the cloud.
    MissingExtraError
        If the extra ``draco`` is not installed.
    """
    try:
        import DracoPy
    except ImportError:
        raise MissingExtraError("a cloud compressed with Draco", "draco") from None
    data = bytes(packed)
    if (found := _declared_points(data)) != points:  # the library allocates memory for them before it reads any
        raise CloudError(f"the Draco data have {found:,} points, the message has {points:,}")
    try:
        attributes = DracoPy.decode(data).attributes
    except (DracoPy.FileTypeException, MemoryError, ValueError, RuntimeError, AttributeError) as error:
        raise CloudError(f"the Draco data are damaged ({error})") from error
    if len(attributes) != len(fields):
        raise CloudError(f"the Draco data have {len(attributes)} attributes, the message has {len(fields)} fields")
    out = np.zeros((points, point_step), np.uint8)
    kept = tuple(field for field in fields if field.type != "f8" or field.name in ("x", "y", "z"))
    for field, attribute in zip(fields, attributes, strict=True):
        if field in kept:
            _copy(np.asarray(attribute["data"]), field, out, order=">" if big_endian else "<")
    return kept, out.reshape(-1).data


def _copy(values: NDArray[Any], field: PointField, out: NDArray[np.uint8], *, order: str) -> None:
    """Write the values of an attribute, shape (N, K), into the bytes of the points, shape (N, point_step)."""
    number = max(field.count, 1)
    if not 0 <= field.offset < field.end <= out.shape[1]:
        raise CloudError(f"field {field.name!r} does not fit into a point of {out.shape[1]} bytes")
    if values.shape == (len(out), number):
        column = values.astype(order + field.type)
    elif values.shape == (len(out), _COLORS * number):
        column = values.astype("u1" if field.end - field.offset == _COLORS * number else order + "u2")
    else:
        raise CloudError(f"the Draco attribute of field {field.name!r} has the shape {values.shape}")
    raw = np.ascontiguousarray(column).view(np.uint8)
    if raw.shape[1] != field.end - field.offset:
        raise CloudError(f"the Draco attribute of field {field.name!r} has {raw.shape[1]} bytes a point")
    out[:, field.offset : field.end] = raw


class _Walk:
    """Reader of the parts of Draco data before its points."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data, self._at = data, at

    def number(self, size: int) -> int:
        if self._at + size > len(self._data):
            raise CloudError("the Draco data are truncated")
        self._at += size
        return int.from_bytes(self._data[self._at - size : self._at], "little")

    def varint(self) -> int:
        value = shift = 0
        while True:
            byte = self.number(1)
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128 or shift > 35:
                return value

    def skip(self, size: int) -> None:
        self._at = min(self._at + size, len(self._data))

    def skip_metadata(self, depth: int = 0) -> None:
        """Skip the named entries of an element, and those of its parts."""
        if depth > _MAX_DEPTH:
            raise CloudError("the metadata of the Draco data are nested too deeply")
        for _ in range(self.varint()):
            self.skip(self.number(1))
            self.skip(self.varint())
        for _ in range(self.varint()):
            self.skip(self.number(1))
            self.skip_metadata(depth + 1)


def _declared_points(data: bytes) -> int:
    """Return the number of points that Draco data declare."""
    if data[: len(_MAGIC)] != _MAGIC or len(data) < _HEADER:
        raise CloudError("the Draco data have no header")
    kind, flags = data[7], int.from_bytes(data[9:11], "little")
    if kind != 0:
        raise CloudError("the Draco data are not those of a point cloud")
    walk = _Walk(data, _HEADER)
    if flags & _HAS_METADATA:
        for _ in range(walk.varint()):
            walk.varint()
            walk.skip_metadata()
        walk.skip_metadata()
    return walk.number(4)
