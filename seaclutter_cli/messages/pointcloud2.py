"""Codecs for ``sensor_msgs/PointCloud2`` and its compressed form, in ROS 2 (CDR) and ROS 1 serialisation.

The plugins of ``point_cloud_transport`` publish ``point_cloud_interfaces/CompressedPointCloud2``: zstd and zlib
compress the bytes of the points; Draco compresses fields as attributes.
"""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import SEEK_CUR, BytesIO
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes
from seaclutter_cli.cloud import Cloud, PointField
from seaclutter_cli.errors import CloudError, UnsupportedCloudError, requiring
from seaclutter_cli.limits import above, limits
from seaclutter_cli.messages.serialisation import Header, Reader, RosCodec, Writer
from seaclutter_cli.records import Buffer
from seaclutter_cli.text import count

ZSTD, ZLIB, DRACO = "zstd", "zlib", "draco"
_ZSTD_LEVEL, _ZLIB_LEVEL = 3, 6
_GZIP, _GZIP_OR_ZLIB = 31, 47
"""Window sizes of zlib that also say which header follows; the plugin writes gzip."""
_MAGIC = b"DRACO"
_HEADER = len(_MAGIC) + 6
_HAS_METADATA = 0x8000
_MAX_DEPTH = 8
_COLORS = 4
"""Values of a colour in one number: the transport stores ``rgb`` as four attributes of a byte."""
_CONVERT = {"cloudini": "; convert the log with cloudini_rosbag_converter of cloudini_ros"}


class PointCloud2(RosCodec):
    """Codec for PointCloud2; ``Cloud.extra`` contains the sequence number of a ROS 1 header."""

    def _read(self, read: Reader) -> Cloud:
        values, sequence = _read_values(read)
        return Cloud(**values, extra=sequence)

    def _write(self, write: Writer, cloud: Cloud) -> None:
        sequence = cloud.extra if isinstance(cloud.extra, int) else None  # of another message
        _write_values(write, cloud, sequence, cloud.data)


def _read_values(read: Reader) -> tuple[dict[str, Any], int | None]:
    """Return the values of a `Cloud`, its data as they are, and the sequence number of a ROS 1 header."""
    header, values = read.header(), dict(zip(("height", "width"), read.numbers("II"), strict=True))
    values |= {"stamp_ns": header.stamp_ns, "frame_id": header.frame_id, "fields": read.fields()}
    values["big_endian"] = bool(read.number("B"))
    values["point_step"], values["row_step"] = read.numbers("II")
    values |= {"data": read.blob(), "dense": bool(read.number("B"))}
    return values, header.sequence


def _write_values(write: Writer, cloud: Cloud, sequence: int | None, data: Buffer) -> None:
    write.header(Header(cloud.stamp_ns, cloud.frame_id, sequence))
    write.numbers("II", (cloud.height, cloud.width))
    write.fields(cloud.fields)
    write.number("B", cloud.big_endian)
    write.numbers("II", (cloud.point_step, cloud.row_step))
    write.blob(data)
    write.number("B", cloud.dense)


@dataclass(frozen=True, slots=True)
class _Wrapping:
    """``Cloud.extra`` of compressed clouds: the compression and the sequence number of a ROS 1 header."""

    format: str
    sequence: int | None = None


class CompressedPointCloud2(RosCodec):
    """Codec for compressed clouds.

    Clouds are written in the compression that they came in, except Draco: its library can write neither the attributes
    of the plugin nor exact values, so they are written in zstd, which is lossless.
    """

    def _read(self, read: Reader) -> Cloud:
        values, sequence = _read_values(read)
        extra = _Wrapping(read.text(), sequence)
        height, width, step, packed = (values[name] for name in ("height", "width", "point_step", "data"))
        size = height * width * step
        if extra.format == DRACO:
            _room(size, len(packed))
            fields, big_endian = values["fields"], values["big_endian"]
            fields, data = _unpack_draco(packed, height * width, fields, step, big_endian=big_endian)
            return Cloud(**values | {"fields": fields, "row_step": width * step, "data": data}, extra=extra)
        values["data"] = _unpacked(extra.format, packed, size, height * values["row_step"])
        return Cloud(**values, extra=extra)

    def _write(self, write: Writer, cloud: Cloud) -> None:
        extra = cloud.extra if isinstance(cloud.extra, _Wrapping) else _Wrapping(ZSTD)
        written = _written_format(extra.format)
        _write_values(write, cloud, extra.sequence, _PACK[written](cloud.data))
        write.text(written)


def _written_format(read: str) -> str:
    return read if read in _PACK else ZSTD


def rewrapped(cloud: Cloud) -> str | None:
    """Return how a cloud's message changes when it is written again; None if it keeps its form."""
    extra = cloud.extra
    if not isinstance(extra, _Wrapping) or _written_format(extra.format) == extra.format:
        return None
    return f"clouds compressed with {extra.format} are written as the same messages with {ZSTD} compression"


def _unpacked(kind: str, packed: Buffer, size: int, padded: int) -> Buffer:
    """Return the bytes of the points, which occupy ``size`` bytes, or ``padded`` with spare bytes in each row."""
    if kind not in _UNPACK:
        raise UnsupportedCloudError(f"clouds compressed with {kind[:40]!r} are not supported{_CONVERT.get(kind, '')}")
    if not packed and not size:
        return b""
    most = max(size, min(padded, _room(size, len(packed))))
    try:
        data = _UNPACK[kind](packed, most)
    except (zstandard.ZstdError, zlib.error) as error:
        raise CloudError(f"the {kind} data are damaged ({error})") from error
    if len(data) > most:
        raise CloudError(f"the {kind} data have more than the {count(most, 'byte')} that the points occupy")
    return data


def _room(size: int, packed: int) -> int:
    """Return how many bytes a compressed cloud may have; raise `CloudError` if its points have more."""
    most = limits().packed_message_bytes(packed)
    if size > most:
        name = "message_mib" if most == limits().message_bytes else "file_ratio"
        raise CloudError(f"the points occupy {above(count(size, 'byte'), name)}")
    return most


def _unpack_zstd(packed: Buffer, size: int) -> bytes:
    with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
        data = stream.read(size + 1)
    if len(data) < min(zstandard.frame_content_size(packed), size):
        raise zstandard.ZstdError("incomplete")
    return data


def _unpack_zlib(packed: Buffer, size: int) -> bytes:
    stream = zlib.decompressobj(_GZIP_OR_ZLIB)
    data = stream.decompress(packed, size + 1)
    if not stream.eof and len(data) <= size:
        raise zlib.error("incomplete")
    return data


def _unpack_draco(
    packed: Buffer, points: int, fields: Sequence[PointField], point_step: int, *, big_endian: bool
) -> tuple[tuple[PointField, ...], memoryview]:
    """Return the fields of a cloud that can be read, and the bytes of its points.

    The library reads float64 attributes in single precision, which is enough for coordinates. Other float64 fields,
    such as times, are left out. The attribute of each field has its index. `CloudError` if the data are damaged, or are
    not those of the cloud; `MissingExtraError` if the extra ``draco`` is not installed.
    """
    with requiring("a cloud compressed with Draco", "draco"):
        import DracoPy
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


def _copy(values: NDArray[Any], field: PointField, out: Bytes, *, order: str) -> None:
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
    if depth > _MAX_DEPTH:
        raise CloudError("the metadata of the Draco data are nested too deeply")
    for _ in range(_varint(stream)):
        stream.seek(_number(stream, 1), SEEK_CUR)
        stream.seek(_varint(stream), SEEK_CUR)
    for _ in range(_varint(stream)):
        stream.seek(_number(stream, 1), SEEK_CUR)
        _skip_metadata(stream, depth + 1)


_UNPACK: Mapping[str, Callable[[Buffer, int], bytes]] = {ZSTD: _unpack_zstd, ZLIB: _unpack_zlib}
_PACK: Mapping[str, Callable[[Buffer], bytes]] = {
    ZSTD: lambda data: zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compress(data),
    ZLIB: lambda data: zlib.compress(data, _ZLIB_LEVEL, _GZIP),
}
