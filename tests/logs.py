"""Small MCAP logs and point-cloud messages, made by libraries that share no code with the program.

``mcap`` writes the logs, ``rosbags`` the ROS messages, ``protobuf`` the protobuf messages. `records_of` and `join`
split and assemble logs, for invalid logs that no writer produces.
"""

import base64
import json
import math
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap import records as mcap_records
from mcap.data_stream import RecordBuilder
from mcap.records import McapRecord
from mcap.writer import CompressionType, IndexType, Writer

from seaclutter_cli.messages.definitions import ros2_schema

START_NS = 1_700_000_000 * 10**9
PERIOD_NS = 100_000_000
MAGIC = b"\x89MCAP0\r\n"
HEADER = mcap_records.Header("ros2", "by hand")
POINT = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")]
)
"""A point as RoboSense drivers write it: packed, with an unaligned time."""


@dataclass(frozen=True)
class Layout:
    """Layout of a log in its file."""

    compression: str = "zstd"
    chunked: bool = True
    chunk_size: int = 4000
    message_index: bool = True
    chunk_index: bool = True
    summary: bool = True
    crcs: bool = True

    def writer(self, stream: BinaryIO) -> Writer:
        """Return a writer that is not started."""
        index = IndexType.ATTACHMENT | IndexType.METADATA if self.summary else IndexType.NONE
        index |= IndexType.MESSAGE if self.message_index else IndexType.NONE
        index |= IndexType.CHUNK if self.chunk_index else IndexType.NONE
        return Writer(
            stream,
            chunk_size=self.chunk_size,
            compression=_COMPRESSIONS[self.compression],
            index_types=index,
            repeat_channels=self.summary,
            repeat_schemas=self.summary,
            use_chunking=self.chunked,
            use_statistics=self.summary,
            use_summary_offsets=self.summary,
            enable_crcs=self.crcs,
        )


_COMPRESSIONS = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "": CompressionType.NONE}

LAYOUTS: Mapping[str, Layout] = {
    "zstd": Layout("zstd"),
    "lz4": Layout("lz4"),
    "none": Layout(""),
    "unchunked": Layout("", chunked=False),
    "one chunk": Layout(chunk_size=2**30),
    "no message index": Layout(message_index=False),
    "no chunk index": Layout(chunk_index=False),
    "no index": Layout("lz4", message_index=False, chunk_index=False),
    "no summary": Layout(chunk_index=False, summary=False),
    "chunk index only": Layout("", summary=False),
    "bare": Layout("", message_index=False, chunk_index=False, summary=False, crcs=False),
    "unchunked, bare": Layout("", chunked=False, message_index=False, chunk_index=False, summary=False, crcs=False),
    "no checksums": Layout(crcs=False),
}
"""The layouts that writers produce."""


@dataclass(frozen=True)
class Topic:
    """A topic of a log; ``schema`` contains name, encoding and data."""

    name: str
    encoding: str = "cdr"
    schema: tuple[str, str, bytes] | None = ("test/msg/Note", "ros2msg", b"string text")
    metadata: dict[str, str] = field(default_factory=dict)


class Entry(NamedTuple):
    """A message of a log."""

    topic: str
    log_time_ns: int
    data: bytes
    publish_time_ns: int = 0
    sequence: int = 0


class Extra(NamedTuple):
    """An attachment if ``data`` is given, otherwise a metadata record; precedes the message with index ``before``."""

    name: str
    before: int = 0
    data: bytes | None = None
    entries: Mapping[str, str] = {}


def write_log(
    path: Path,
    topics: Sequence[Topic],
    entries: Iterable[Entry],
    layout: Layout = Layout(),
    *,
    extras: Sequence[Extra] = (),
    profile: str = "ros2",
) -> Path:
    """Write a log of arbitrary messages and return its path."""
    with path.open("wb") as stream:
        _write(layout.writer(stream), topics, entries, extras, profile)
    return path


def log_bytes(topics: Sequence[Topic], entries: Iterable[Entry], layout: Layout, extras: Sequence[Extra]) -> bytes:
    """Return a log of arbitrary messages as bytes."""
    stream = BytesIO()
    _write(layout.writer(stream), topics, entries, extras, "ros2")
    return stream.getvalue()


def _write(
    writer: Writer, topics: Sequence[Topic], entries: Iterable[Entry], extras: Sequence[Extra], profile: str
) -> None:
    writer.start(profile)
    channels, schemas = {}, {None: 0}
    for topic in topics:
        if topic.schema not in schemas:
            schemas[topic.schema] = writer.register_schema(*topic.schema)
        schema = schemas[topic.schema]
        channels[topic.name] = writer.register_channel(topic.name, topic.encoding, schema, topic.metadata)
    waiting = sorted(extras, key=lambda extra: extra.before, reverse=True)
    for number, entry in enumerate(entries):
        while waiting and waiting[-1].before <= number:
            _write_extra(writer, waiting.pop())
        publish_time_ns = entry.publish_time_ns or entry.log_time_ns
        writer.add_message(channels[entry.topic], entry.log_time_ns, entry.data, publish_time_ns, entry.sequence)
    while waiting:
        _write_extra(writer, waiting.pop())
    writer.finish()


def _write_extra(writer: Writer, extra: Extra) -> None:
    if extra.data is None:
        writer.add_metadata(extra.name, dict(extra.entries))
    else:
        writer.add_attachment(START_NS + 1, START_NS, extra.name, "application/octet-stream", extra.data)


CLOUD_KINDS = ("ros2", "ros1", "protobuf", "json")


def cloud_log(
    path: Path,
    layout: Layout = Layout(),
    *,
    kind: str = "ros2",
    frames: int = 6,
    points: int = 300,
    topics: Sequence[str] = ("/points",),
) -> Path:
    """Write a log of point clouds with two IMU messages per frame, an attachment and a metadata record."""
    clouds = {name: cloud_messages(kind, frames, points, seed=number) for number, name in enumerate(topics)}
    entries = []
    for number in range(frames):
        time_ns = START_NS + number * PERIOD_NS
        for name, messages in clouds.items():
            entries.append(Entry(name, time_ns, messages[number], time_ns - 1_000_000, number + 100))
        for late_ns in (10_000_000, 60_000_000):
            data = struct.pack("<4xQ", time_ns + late_ns)
            entries.append(Entry("/imu", time_ns + late_ns, data, sequence=number))
    extras = (
        Extra("calibration.bin", frames // 2, bytes(range(256))),
        Extra("vessel", 1, entries={"name": "Sjöfågel", "length": "7.5"}),
    )
    described = [cloud_topic(name, kind) for name in topics] + [Topic("/imu", metadata={"rate": "20"})]
    return write_log(path, described, entries, layout, extras=extras, profile=kind if "ros" in kind else "")


def cloud_topic(name: str, kind: str = "ros2") -> Topic:
    """Return a topic of point clouds in one of the encodings `CLOUD_KINDS`."""
    if kind == "ros2":
        whole = ros2_schema("sensor_msgs/msg/PointCloud2")
        return Topic(name, "cdr", (whole.name, whole.encoding, whole.data))
    if kind == "ros1":
        definition, _ = _store("ros1").generate_msgdef("sensor_msgs/msg/PointCloud2", ros_version=1)
        schema = ("sensor_msgs/PointCloud2", "ros1msg", definition.encode())
    elif kind == "json":
        schema = ("foxglove.PointCloud", "jsonschema", b'{"type": "object"}')
    else:
        schema = ("foxglove.PointCloud", "protobuf", _foxglove_files().SerializeToString())
    return Topic(name, kind, schema)


def cloud_messages(kind: str, frames: int, points: int, *, seed: int = 0) -> list[bytes]:
    """Return the messages of a sea with a few targets."""
    stamps = [START_NS + number * PERIOD_NS - 5_000_000 for number in range(frames)]
    return [cloud_message(kind, sea_points(points, (seed, number)), ns) for number, ns in enumerate(stamps)]


def sea_points(size: int, seed: Sequence[int] = (0,)) -> np.ndarray:
    """Return points around a vessel: weak clutter that decreases with range, bright targets, a few invalid points."""
    random = np.random.default_rng(seed)
    points = np.zeros(size, POINT)
    range_m = 5 + 30 * random.weibull(1.2, size)
    bearing = random.uniform(0, 2 * np.pi, size)
    points["intensity"] = random.exponential(4, size)
    on_target = random.random(size) < 0.5
    target = random.integers(0, 4, size)
    range_m[on_target] = (np.array([15, 30, 48, 80])[target] + random.normal(0, 0.5, size))[on_target]
    bearing[on_target] = (target + random.normal(0, 0.02, size))[on_target]
    points["intensity"][on_target] = (30 + random.normal(0, 8, size))[on_target]
    points["x"], points["y"] = range_m * np.cos(bearing), range_m * np.sin(bearing)
    points["z"] = random.normal(0, 0.3, size)
    for axis in "xyz":
        points[axis][:: size // 20 or 1] = np.nan
    points["ring"], points["timestamp"] = np.arange(size) % 32, np.arange(size) * 1e-6
    return points


def cloud_message(kind: str, points: np.ndarray, stamp_ns: int, **changes: Any) -> bytes:
    """Return the message of a structured array; ``changes`` to attributes make it invalid (ROS 2 only)."""
    if kind in ("ros2", "ros1"):
        return _ros_message(kind, points, stamp_ns, changes)
    if kind == "json":
        return _json_message(points, stamp_ns)
    return _protobuf_message(points, stamp_ns)


@cache
def _store(kind: str) -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)


_ROS_TYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def _ros_message(kind: str, points: np.ndarray, stamp_ns: int, changes: Mapping[str, Any]) -> bytes:
    store = _store(kind)
    types = store.types
    names = points.dtype.fields
    fields = [
        types["sensor_msgs/msg/PointField"](name, offset, _ROS_TYPES[dtype.base.str[1:]], math.prod(dtype.shape))
        for name, (dtype, offset) in names.items()
    ]
    stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    sequence = {"seq": 7} if kind == "ros1" else {}
    values = {
        "header": types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="lidar"),
        "height": 1,
        "width": len(points),
        "fields": fields,
        "is_bigendian": False,
        "point_step": points.dtype.itemsize,
        "row_step": points.nbytes,
        "data": points.reshape(-1).view(np.uint8),
        "is_dense": False,
    }
    message = types["sensor_msgs/msg/PointCloud2"](**{**values, **changes})
    serialise = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    return bytes(serialise(message, "sensor_msgs/msg/PointCloud2"))


_FOXGLOVE_TYPES = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}


def _foxglove_fields(points: np.ndarray) -> list[dict[str, Any]]:
    return [
        {"name": name, "offset": offset, "type": _FOXGLOVE_TYPES[dtype.str[1:]]}
        for name, (dtype, offset) in points.dtype.fields.items()
    ]


def _json_message(points: np.ndarray, stamp_ns: int) -> bytes:
    message = {
        "timestamp": {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9},
        "frame_id": "lidar",
        "point_stride": points.dtype.itemsize,
        "fields": _foxglove_fields(points),
        "data": base64.b64encode(points.tobytes()).decode(),
    }
    return json.dumps(message).encode()


def _protobuf_message(points: np.ndarray, stamp_ns: int) -> bytes:
    message = foxglove_class()(frame_id="lidar", point_stride=points.dtype.itemsize, data=points.tobytes())
    message.timestamp.seconds, message.timestamp.nanos = divmod(stamp_ns, 10**9)
    for values in _foxglove_fields(points):
        message.fields.add(**values)
    return bytes(message.SerializeToString())


@cache
def foxglove_class() -> Any:
    """Return the generated class of ``foxglove.PointCloud``."""
    from google.protobuf import descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    for file in _foxglove_files().file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("foxglove.PointCloud"))


@cache
def _foxglove_files() -> Any:
    from google.protobuf import descriptor_pb2, timestamp_pb2

    kinds = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(name="foxglove/PointCloud.proto", package="foxglove", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    element, cloud = file.message_type.add(name="PackedElementField"), file.message_type.add(name="PointCloud")
    for number, (name, kind) in enumerate((("name", "STRING"), ("offset", "FIXED32"), ("type", "INT32")), 1):
        element.field.add(name=name, number=number, type=kinds.Type.Value(f"TYPE_{kind}"), label=1)
    cloud.field.add(name="timestamp", number=1, type=11, label=1, type_name=".google.protobuf.Timestamp")
    cloud.field.add(name="frame_id", number=2, type=kinds.TYPE_STRING, label=1)
    cloud.field.add(name="point_stride", number=4, type=kinds.TYPE_FIXED32, label=1)
    cloud.field.add(name="fields", number=5, type=11, label=3, type_name=".foxglove.PackedElementField")
    cloud.field.add(name="data", number=6, type=kinds.TYPE_BYTES, label=1)
    files = descriptor_pb2.FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(files.file.add())
    files.file.append(file)
    return files


class Piece(NamedTuple):
    """A record of a file: offset, opcode, content."""

    offset: int
    op: int
    content: bytes

    @property
    def end(self) -> int:
        """Offset of the first byte after the record."""
        return self.offset + 9 + len(self.content)


def records_of(data: bytes) -> list[Piece]:
    """Return the records of an intact file."""
    pieces, at = [], len(MAGIC)
    while at < len(data) - len(MAGIC):
        op, size = struct.unpack_from("<BQ", data, at)
        pieces.append(Piece(at, op, data[at + 9 : at + 9 + size]))
        at += 9 + size
    return pieces


def join(*parts: McapRecord | Piece | bytes) -> bytes:
    """Return a file of records; bytes are inserted unchanged."""
    return MAGIC + b"".join(map(_bytes_of, parts)) + MAGIC


def _bytes_of(part: McapRecord | Piece | bytes) -> bytes:
    if isinstance(part, bytes):
        return part
    if isinstance(part, Piece):
        return struct.pack("<BQ", part.op, len(part.content)) + part.content
    builder = RecordBuilder()
    part.write(builder)
    return builder.end()


def chunk_of(*parts: McapRecord | bytes, compression: str = "zstd", **changes: Any) -> mcap_records.Chunk:
    """Return a chunk of records; ``changes`` to its attributes make it invalid."""
    records = b"".join(map(_bytes_of, parts))
    compress = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}[compression]
    times = [part.log_time for part in parts if isinstance(part, mcap_records.Message)]
    values = {
        "message_start_time": min(times, default=0),
        "message_end_time": max(times, default=0),
        "uncompressed_size": len(records),
        "uncompressed_crc": zlib.crc32(records),
        "compression": compression,
        "data": compress(records),
    }
    return mcap_records.Chunk(**{**values, **changes})


def valid_end() -> tuple[McapRecord, McapRecord]:
    """Return the records that close a file without a summary."""
    return mcap_records.DataEnd(0), mcap_records.Footer(0, 0, 0)
