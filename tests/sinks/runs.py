"""Helpers that run filters and read the resulting files with independent libraries."""

import base64
import json
import struct
from collections import defaultdict
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.config import load_config
from seaclutter_cli.pipeline import run
from seaclutter_cli.selection import Selection
from seaclutter_cli.sinks.log import LogSink
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.sources.formats import open_source
from tests.logs import CLOUD_KINDS, START_NS, cloud_topic, foxglove_class, write_log
from tests.logs import Entry as LogEntry

STORES = {"ros1": get_typestore(Stores.ROS1_NOETIC), "ros2": get_typestore(Stores.ROS2_HUMBLE)}
KINDS = pytest.mark.parametrize("kind", CLOUD_KINDS)
DIAGNOSTICS = "/seaclutter/diagnostics"


def log_of(path, messages, kind="ros2", topic="/points"):
    """Write a log with the given cloud messages."""
    entries = [LogEntry(topic, START_NS + k, data, sequence=k) for k, data in enumerate(messages)]
    return write_log(path, [cloud_topic(topic, kind)], entries, profile=kind if "ros" in kind else "")


@dataclass
class FakeSource:
    """A source that provides only channels."""

    channels: tuple
    name: str = "log"
    profile: str = "ros2"
    compression: str | None = None
    metadata: tuple = ()


def filter_log(path, target, *, topics=(), method="joint", overrides=(), sinks=(), **options):
    """Filter a log; return the result of each frame."""
    config = load_config(method=method, overrides=overrides)
    with (
        closing(open_source(Path(path))) as source,
        LogSink(Path(target), McapOptions(config=config.to_yaml(), **options)) as sink,
    ):
        selection = Selection(topics=topics)
        results = [_detached(one) for one in run(source, config.make_filter, [sink, *sinks], selection, {})]
        assert not source.damage
    return results


class Result(NamedTuple):
    """Result of a frame, without references to its file."""

    topic: str
    data: bytes
    reason: np.ndarray
    rings: Any

    @property
    def counts(self):
        return [int((self.reason == number).sum()) for number in range(7)]


def _detached(result):
    frame = result.frame
    return Result(frame.topic, bytes(frame.message.data), result.reason.copy(), result.rings)


class Entry(NamedTuple):
    """A message as the ``mcap`` library reads it."""

    log_time: int
    publish_time: int
    sequence: int
    data: bytes


@dataclass
class Contents:
    """Contents of an MCAP file."""

    profile: str = ""
    compressions: set = field(default_factory=set)
    topics: dict = field(default_factory=lambda: defaultdict(list))
    order: list = field(default_factory=list)
    channels: dict = field(default_factory=dict)
    attachments: list = field(default_factory=list)
    metadata: list = field(default_factory=list)
    statistics: Any = None


def contents(path):
    """Read a file with the ``mcap`` library and verify its checksums."""
    found = Contents()
    with Path(path).open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found.profile = reader.get_header().profile
        summary = reader.get_summary()
        found.compressions = {chunk.compression for chunk in summary.chunk_indexes}
        found.statistics = summary.statistics
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            described = (schema.name, schema.encoding, schema.data) if schema else None
            found.channels[channel.id] = (channel.topic, channel.message_encoding, described, channel.metadata)
        for _, channel, message in reader.iter_messages():
            entry = Entry(message.log_time, message.publish_time, message.sequence, bytes(message.data))
            found.topics[channel.topic].append(entry)
            found.order.append((message.log_time, channel.topic))
        found.attachments = [
            (a.log_time, a.create_time, a.name, a.media_type, a.data) for a in reader.iter_attachments()
        ]
        found.metadata = [(record.name, record.metadata) for record in reader.iter_metadata()]
    return found


class Decoded(NamedTuple):
    """A cloud as read by an independent library."""

    header: tuple
    shape: tuple
    fields: list
    point_step: int
    big_endian: bool
    data: bytes

    @property
    def description(self):
        """Return everything except the points: header, layout, byte order."""
        return self._replace(shape=None, data=None)

    @property
    def points(self):
        """Return the bytes of each point; rows must not be padded."""
        step = self.point_step
        return [self.data[at : at + step] for at in range(0, len(self.data), step)]

    def column(self, name):
        """Return the values of a field, read with ``struct``."""
        offset, code = next((offset, code) for field_name, offset, code, _ in self.fields if field_name == name)
        order = ">" if self.big_endian else "<"
        return [struct.unpack_from(order + code, point, offset)[0] for point in self.points]


_ROS_CODES = dict(enumerate("bBhHiIfd", 1))
_FOXGLOVE_CODES = dict(enumerate("BbHhIifd", 1))


def decode(data, kind="ros2"):
    """Read a cloud with rosbags or protobuf."""
    if kind in ("ros1", "ros2"):
        store = STORES[kind]
        deserialise = store.deserialize_cdr if kind == "ros2" else store.deserialize_ros1
        message = deserialise(data, "sensor_msgs/msg/PointCloud2")
        header, stamp = message.header, message.header.stamp
        head = (getattr(header, "seq", None), stamp.sec, stamp.nanosec, header.frame_id, bool(message.is_dense))
        fields = [(f.name, f.offset, _ROS_CODES[f.datatype], f.count) for f in message.fields]
        shape = (message.height, message.width)
        return Decoded(head, shape, fields, message.point_step, bool(message.is_bigendian), message.data.tobytes())
    if kind == "json":
        return _decode_json(data)
    message = foxglove_class().FromString(data)
    fields = [(f.name, f.offset, _FOXGLOVE_CODES[f.type], 1) for f in message.fields]
    head = (message.timestamp.seconds, message.timestamp.nanos, message.frame_id)
    size = len(message.data) // message.point_stride
    return Decoded(head, (1, size), fields, message.point_stride, False, message.data)


def _decode_json(data):
    message = json.loads(data)
    fields = [(f["name"], f["offset"], _FOXGLOVE_CODES[f["type"]], 1) for f in message["fields"]]
    head = (message["timestamp"]["sec"], message["timestamp"]["nsec"], message["frame_id"])
    points = base64.b64decode(message["data"])
    return Decoded(head, (1, len(points) // message["point_stride"]), fields, message["point_stride"], False, points)
