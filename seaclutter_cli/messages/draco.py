"""Clouds compressed with Draco: the attributes that ``draco_point_cloud_transport`` makes of the fields of a cloud."""

from collections.abc import Sequence
from io import SEEK_CUR, BytesIO
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
    such as times, are left out. The attribute of each field has its index. `CloudError` if the data are damaged, or are
    not those of the cloud; `MissingExtraError` if the extra ``draco`` is not installed.
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


def _declared_points(data: bytes) -> int:
    """Return the number of points that Draco data declare."""
    if data[: len(_MAGIC)] != _MAGIC or len(data) < _HEADER:
        raise CloudError("the Draco data have no header")
    kind, flags = data[7], int.from_bytes(data[9:11], "little")
    if kind != 0:
        raise CloudError("the Draco data are not those of a point cloud")
    stream = BytesIO(data)
    stream.seek(_HEADER)
    if flags & _HAS_METADATA:
        for _ in range(_varint(stream)):
            _varint(stream)
            _skip_metadata(stream)
        _skip_metadata(stream)
    return _number(stream, 4)


def _number(stream: BytesIO, size: int) -> int:
    raw = stream.read(size)
    if len(raw) < size:
        raise CloudError("the Draco data are truncated")
    return int.from_bytes(raw, "little")


def _varint(stream: BytesIO) -> int:
    value = shift = 0
    while True:
        byte = _number(stream, 1)
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128 or shift > 35:
            return value


def _skip_metadata(stream: BytesIO, depth: int = 0) -> None:
    """Skip the named entries of an element, and those of its parts."""
    if depth > _MAX_DEPTH:
        raise CloudError("the metadata of the Draco data are nested too deeply")
    for _ in range(_varint(stream)):
        stream.seek(_number(stream, 1), SEEK_CUR)
        stream.seek(_varint(stream), SEEK_CUR)
    for _ in range(_varint(stream)):
        stream.seek(_number(stream, 1), SEEK_CUR)
        _skip_metadata(stream, depth + 1)
