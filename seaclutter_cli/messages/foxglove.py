"""Codecs for ``foxglove.PointCloud`` in protobuf and JSON, and for the ROS message ``foxglove_msgs/PointCloud``.

Only the pose and the fields that describe points are decoded; others are kept unchanged in ``Cloud.extra``, also the
pose unless it was applied to the points. The protobuf wire format is parsed directly, since a generated class would
copy the points and could drop unknown fields.
"""

import base64
import json
import re
import struct
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

from seaclutter_cli.cloud import MAX_FIELDS, Cloud, PointField
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages.serialisation import NANO, Reader, RosCodec, Writer, field_type
from seaclutter_cli.records import Buffer

_TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8")
"""Types of fields in the order of their numbers, from 1."""
_MASK = 2**64 - 1
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_TIMESTAMP, _FRAME_ID, _POSE, _STRIDE, _FIELDS, _DATA = 1, 2, 3, 4, 5, 6
_POSITION, _ORIENTATION = ("position", "xyz"), ("orientation", "xyzw")
_NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_NOTHING = memoryview(b"")
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def _unorganised(
    stamp_ns: int, frame_id: str, stride: int, fields: tuple[PointField, ...], data: Buffer, extra: Any
) -> Cloud:
    if stride <= 0 and len(data):
        raise CloudError(f"the point stride must be positive, got {stride} bytes")
    size = len(data) // stride if stride > 0 else 0
    return Cloud(stamp_ns, frame_id, 1, size, fields, stride, size * stride, False, False, data, extra)


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while at < len(data) and shift < 70:
        byte = data[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return value & _MASK, at
    raise CloudError("the message contains an invalid protobuf integer")


def _walk(data: memoryview) -> Iterator[tuple[int, int, int | memoryview, memoryview]]:
    at = 0
    while at < len(data):
        start = at
        key, at = _varint(data, at)
        number, wire = key >> 3, key & 7
        value: int | memoryview
        if wire == _VARINT:
            value, at = _varint(data, at)
        elif wire == _BYTES:
            size, at = _varint(data, at)
            value = data[at : at + size]
            at += size
        elif wire in (_FIXED32, _FIXED64):
            size = 4 if wire == _FIXED32 else 8
            value = int.from_bytes(data[at : at + size], "little")
            at += size
        else:
            raise CloudError(f"the message contains unsupported protobuf wire type {wire}")
        if at > len(data):
            raise CloudError("the protobuf message is truncated")
        yield number, wire, value, data[start:at]


def _packed(number: int, wire: int, value: int | Buffer) -> bytes:
    key = bytes((number << 3 | wire,))
    if isinstance(value, int):
        return key + struct.pack("<I", value) if wire == _FIXED32 else key + _to_varint(value)
    return key + _to_varint(len(value)) + value


def _to_varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


class ProtobufPointCloud:
    """Codec for protobuf; ``Cloud.extra`` contains the bytes of all fields that do not describe points."""

    def decode(self, data: Buffer) -> Cloud:
        """Return a cloud whose points are a view of the message; `CloudError` if it is not a valid PointCloud."""
        stamp_ns, frame_id, stride, points = 0, "", 0, memoryview(b"")
        fields: list[PointField] = []
        others: list[bytes] = []
        pose = None
        for number, wire, value, whole in _walk(memoryview(data)):
            if number == _DATA and isinstance(value, memoryview):
                points = value
            elif number == _STRIDE and wire == _FIXED32:
                stride = int(value)
            elif number == _FIELDS and isinstance(value, memoryview):
                if len(fields) <= MAX_FIELDS:  # one too many is an error of the cloud
                    fields.append(self._field(value))
            else:
                others.append(bytes(whole))
                if number == _TIMESTAMP and isinstance(value, memoryview):
                    parts = {key: part for key, _, part, _ in _walk(value) if isinstance(part, int)}
                    seconds, nanoseconds = (parts.get(key, 0) - (parts.get(key, 0) >> 63 << 64) for key in (1, 2))
                    stamp_ns = seconds * NANO + nanoseconds
                elif number == _FRAME_ID and isinstance(value, memoryview):
                    frame_id = bytes(value).decode("utf-8", "replace")
                elif number == _POSE and isinstance(value, memoryview):
                    pose = self._pose(value)
        cloud = _unorganised(stamp_ns, frame_id, stride, tuple(fields), points, b"".join(others))
        return replace(cloud, pose=pose)

    def _pose(self, data: memoryview) -> tuple[float, ...]:
        parts = {number: value for number, _, value, _ in _walk(data) if isinstance(value, memoryview)}
        pose: list[float] = []
        for number, (_, axes) in enumerate((_POSITION, _ORIENTATION), 1):
            values = {at: raw[-8:] for at, wire, _, raw in _walk(parts.get(number, _NOTHING)) if wire == _FIXED64}
            pose += (struct.unpack("<d", values.get(at, bytes(8)))[0] for at in range(1, len(axes) + 1))
        return tuple(pose)

    def _field(self, data: memoryview) -> PointField:
        parts = {number: value for number, _, value, _ in _walk(data)}
        raw = parts.get(1, b"")
        name = "" if isinstance(raw, int) else bytes(raw).decode(errors="surrogateescape")
        offset, kind = parts.get(2, 0), parts.get(3, 0)
        if not (isinstance(offset, int) and isinstance(kind, int)):
            raise CloudError(f"field {name!r} has an invalid offset or type")
        return PointField(name, offset, field_type(kind, name, _TYPES))

    def encode(self, cloud: Cloud) -> bytes:
        """Return a cloud as the bytes of a message."""
        fields = [
            _packed(1, _BYTES, field.name.encode(errors="surrogateescape"))
            + _packed(2, _FIXED32, field.offset)
            + _packed(3, _VARINT, _TYPES.index(field.type) + 1)
            for field in cloud.fields
        ]
        extra = cloud.extra or b""
        if cloud.pose is None:
            extra = b"".join(whole for number, _, _, whole in _walk(memoryview(extra)) if number != _POSE)
        parts = [extra, _packed(_STRIDE, _FIXED32, cloud.point_step)]
        parts += [_packed(_FIELDS, _BYTES, field) for field in fields]
        return b"".join((*parts, _packed(_DATA, _BYTES, cloud.data)))


# Raised for wrong types, missing keys, excessively large numbers and excessive nesting.
_BAD_JSON = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError)


class JsonPointCloud:
    """Codec for JSON with points in base64; ``Cloud.extra`` contains the object without its data."""

    def decode(self, data: Buffer) -> Cloud:
        """Return the cloud in a message; `CloudError` if it is not a valid PointCloud."""
        try:
            message = load_json(bytes(data), max_bytes=len(data))  # a message is bounded by its log
            points = base64.b64decode(message.pop("data"), validate=True)
            fields = tuple(
                PointField(
                    str(field["name"]), int(field["offset"]), field_type(int(field["type"]), field["name"], _TYPES)
                )
                for field in message["fields"]
            )
            stride, stamp_ns = int(message["point_stride"]), _stamp_ns(message.get("timestamp"))
            pose = message.get("pose") and tuple(
                float((message["pose"].get(part) or {}).get(axis) or 0)
                for part, axes in (_POSITION, _ORIENTATION)
                for axis in axes
            )
        except _BAD_JSON as error:
            raise CloudError(f"not a valid JSON foxglove.PointCloud: {error!r}") from error
        cloud = _unorganised(stamp_ns, str(message.get("frame_id", "")), stride, fields, points, message)
        return replace(cloud, pose=pose or None)

    def encode(self, cloud: Cloud) -> bytes:
        """Return a cloud as the bytes of a message."""
        fields = [{"name": f.name, "offset": f.offset, "type": _TYPES.index(f.type) + 1} for f in cloud.fields]
        described = {"point_stride": cloud.point_step, "fields": fields, "data": base64.b64encode(cloud.data).decode()}
        extra = {name: value for name, value in (cloud.extra or {}).items() if name != "pose" or cloud.pose is not None}
        return json.dumps({**extra, **described}).encode()


def _stamp_ns(timestamp: Any) -> int:
    """Return a JSON time in nanoseconds: an object with seconds and nanoseconds, or text in RFC 3339 format."""
    if isinstance(timestamp, dict):
        seconds, part = timestamp.get("sec") or 0, int(timestamp.get("nsec") or timestamp.get("nanos") or 0)
        whole = int(seconds)
        return whole * NANO + part + (round((seconds - whole) * NANO) if isinstance(seconds, float) else 0)
    if not timestamp:
        return 0
    whole, fraction, zone = re.findall(r"^(.*?)(?:\.(\d+))?(Z|[+-]\d\d:\d\d)?$", str(timestamp))[0]
    seconds = (datetime.fromisoformat(whole + (zone or "Z")) - _EPOCH) // timedelta(seconds=1)
    return seconds * NANO + int(fraction[:9].ljust(9, "0"))


class RosFoxglovePointCloud(RosCodec):
    """Codec for Foxglove's cloud as a ROS message."""

    def _read(self, read: Reader) -> Cloud:
        stamp_ns, frame_id, pose = read.time_ns(), read.text(), read.numbers("ddddddd")
        stride, fields = read.number("I"), read.fields(_TYPES, counted=False)
        cloud = _unorganised(stamp_ns, frame_id, stride, fields, read.blob(), None)
        return replace(cloud, pose=tuple(map(float, pose)))

    def _write(self, write: Writer, cloud: Cloud) -> None:
        write.time_ns(cloud.stamp_ns)
        write.text(cloud.frame_id)
        write.numbers("ddddddd", cloud.pose or _NO_POSE)
        write.number("I", cloud.point_step)
        write.fields(cloud.fields, _TYPES, counted=False)
        write.blob(cloud.data)
