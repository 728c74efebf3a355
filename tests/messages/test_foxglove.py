"""Codecs for foxglove.PointCloud against the protobuf library, the json module and rosbags."""

import base64
import json
import math
import struct
import tracemalloc
from contextlib import suppress

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_protobuf.decoder import DecoderFactory

from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages.foxglove import JsonPointCloud, ProtobufPointCloud, RosFoxglovePointCloud
from tests.messages import wrapped
from tests.messages.clouds import TYPES, Field, Plain, layouts, plain_clouds

PROTOBUF, JSON = ProtobufPointCloud(), JsonPointCloud()
NUMBERS = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}
FIELDS = (Field("x", 0, "f4"), Field("y", 4, "f4"), Field("z", 8, "f4"), Field("ring", 12, "u2"), Field("t", 14, "f8"))
KIND = descriptor_pb2.FieldDescriptorProto


def foxglove_file():
    """Return the definition published by Foxglove, with an additional field of a later version."""
    file = descriptor_pb2.FileDescriptorProto(name="PointCloud.proto", package="foxglove", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    for name, axes in (("Vector3", "xyz"), ("Quaternion", "xyzw")):
        message = file.message_type.add(name=name)
        for number, axis in enumerate(axes, 1):
            message.field.add(name=axis, number=number, type=KIND.TYPE_DOUBLE, label=1)
    pose = file.message_type.add(name="Pose")
    pose.field.add(name="position", number=1, type=11, label=1, type_name=".foxglove.Vector3")
    pose.field.add(name="orientation", number=2, type=11, label=1, type_name=".foxglove.Quaternion")
    element = file.message_type.add(name="PackedElementField")
    types = element.enum_type.add(name="NumericType")
    types.value.add(name="UNKNOWN", number=0)
    for name, number in NUMBERS.items():
        types.value.add(name=name.upper(), number=number)
    element.field.add(name="name", number=1, type=KIND.TYPE_STRING, label=1)
    element.field.add(name="offset", number=2, type=KIND.TYPE_FIXED32, label=1)
    numeric = ".foxglove.PackedElementField.NumericType"
    element.field.add(name="type", number=3, type=KIND.TYPE_ENUM, label=1, type_name=numeric)
    cloud = file.message_type.add(name="PointCloud")
    cloud.field.add(name="timestamp", number=1, type=11, label=1, type_name=".google.protobuf.Timestamp")
    cloud.field.add(name="frame_id", number=2, type=KIND.TYPE_STRING, label=1)
    cloud.field.add(name="pose", number=3, type=11, label=1, type_name=".foxglove.Pose")
    cloud.field.add(name="point_stride", number=4, type=KIND.TYPE_FIXED32, label=1)
    cloud.field.add(name="fields", number=5, type=11, label=3, type_name=".foxglove.PackedElementField")
    cloud.field.add(name="data", number=6, type=KIND.TYPE_BYTES, label=1)
    cloud.field.add(name="later", number=1000, type=KIND.TYPE_STRING, label=3)
    return file


FILES = descriptor_pb2.FileDescriptorSet()
timestamp_pb2.DESCRIPTOR.CopyToProto(FILES.file.add())
FILES.file.append(foxglove_file())
POOL = descriptor_pool.DescriptorPool()
for described in FILES.file:
    POOL.Add(described)
PointCloud = message_factory.GetMessageClass(POOL.FindMessageTypeByName("foxglove.PointCloud"))


def message_of(fields, stride, data, stamp_ns=0, frame_id="", later=()):
    """Return a cloud as an object of the protobuf library, with a pose."""
    message = PointCloud(frame_id=frame_id, point_stride=stride, data=data, later=later)
    message.timestamp.seconds, message.timestamp.nanos = divmod(stamp_ns, 10**9)
    message.pose.position.x, message.pose.orientation.w = 1.5, math.nan
    for field in fields:
        message.fields.add(name=field.name, offset=field.offset, type=NUMBERS[field.type])
    return message


def json_of(fields, stride, data, stamp_ns=0, frame_id="", later=()):
    """Return a cloud as Foxglove writes it in JSON."""
    return {
        "timestamp": {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9},
        "frame_id": frame_id,
        "pose": {"position": {"x": 1.5, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}},
        "point_stride": stride,
        "fields": [{"name": field.name, "offset": field.offset, "type": NUMBERS[field.type]} for field in fields],
        "data": base64.b64encode(data).decode(),
        "later": list(later),
    }


@st.composite
def parts(draw):
    """Return the arguments of `message_of` and `json_of`."""
    fields, stride = draw(layouts(counts=False))
    data = draw(st.binary(min_size=stride * 4, max_size=stride * 4)) if stride else b""
    # The range of stamps in nanoseconds: years 1677 to 2262.
    stamp_ns = draw(st.integers(-(2**63), 2**63 - 1))
    text = st.text(st.characters(codec="utf-8"), max_size=9)
    return fields, stride, data, stamp_ns, draw(text), draw(st.lists(text, max_size=2))


def check_against(cloud, fields, stride, data, stamp_ns, frame_id, later):
    assert tuple(Field(f.name, f.offset, f.type, f.count) for f in cloud.fields) == fields
    assert (cloud.point_step, bytes(cloud.data), cloud.size) == (stride, data, 4 if stride else 0)
    assert (cloud.stamp_ns, cloud.frame_id, cloud.height, cloud.row_step) == (stamp_ns, frame_id, 1, len(data))
    assert (cloud.big_endian, cloud.dense) == (False, False)


@settings(max_examples=200, deadline=None)
@given(parts())
def test_protobuf_round_trip(made):
    message = message_of(*made)
    cloud = PROTOBUF.decode(message.SerializeToString())
    check_against(cloud, *made)
    again = PointCloud.FromString(PROTOBUF.encode(cloud))
    assert again.SerializeToString(deterministic=True) == message.SerializeToString(deterministic=True)


@settings(max_examples=150, deadline=None)
@given(parts())
def test_json_round_trip(made):
    message = json_of(*made)
    cloud = JSON.decode(json.dumps(message).encode())
    check_against(cloud, *made)
    assert json.loads(JSON.encode(cloud)) == message


def test_a_selection_keeps_pose_and_unknown_fields():
    data = bytes(range(88))
    keep = np.array([True, False, False, True])
    kept = data[:22] + data[66:]
    message = message_of(FIELDS, 22, data, 5, "map", ["a", "b"])
    selected = PointCloud.FromString(PROTOBUF.encode(PROTOBUF.decode(message.SerializeToString()).select(keep)))
    message.data = kept
    assert selected.SerializeToString(deterministic=True) == message.SerializeToString(deterministic=True)
    described = json_of(FIELDS, 22, data, 5, "map", ["a", "b"])
    cloud = JSON.decode(json.dumps(described).encode())
    assert json.loads(JSON.encode(cloud.select(keep))) == {**described, "data": base64.b64encode(kept).decode()}


def test_other_readers_can_read_the_reason():
    cloud = PROTOBUF.decode(message_of(FIELDS, 22, bytes(66)).SerializeToString())
    encoded = PROTOBUF.encode(cloud.with_field("reason", np.array([1, 2, 5], np.uint8)))
    decode = DecoderFactory().decoder_for("protobuf", _Schema())
    message = decode(encoded)
    assert (message.point_stride, len(message.data)) == (23, 69)
    assert [(f.name, f.offset, f.type) for f in message.fields][-1] == ("reason", 22, NUMBERS["u1"])
    assert list(message.data[22::23]) == [1, 2, 5]


class _Schema:
    id, name, encoding, data = 1, "foxglove.PointCloud", "protobuf", FILES.SerializeToString()


@pytest.mark.parametrize("kind", TYPES)
def test_protobuf_points_are_a_view_on_the_message(kind):
    fields = (Field("a", 0, "u1"), Field("v", 1, kind), Field("w", 9, "f8"))
    data = message_of(fields, 17, bytes(range(170))).SerializeToString()
    points = PROTOBUF.decode(data).points
    assert np.shares_memory(points, np.frombuffer(data, np.uint8))
    assert points["v"].tobytes() == b"".join(bytes(range(k * 17 + 1, k * 17 + 1 + int(kind[1]))) for k in range(10))


def test_missing_fields_have_default_values():
    assert (PROTOBUF.decode(b"").size, PROTOBUF.decode(b"").stamp_ns) == (0, 0)
    assert PointCloud.FromString(PROTOBUF.encode(PROTOBUF.decode(b""))).data == b""
    for fields in ((), FIELDS):
        cloud = PROTOBUF.decode(message_of(fields, 0, b"").SerializeToString())
        assert (cloud.size, len(cloud.points)) == (0, 0)
    with pytest.raises(CloudError, match="point stride must be positive, got 0 bytes"):
        PROTOBUF.decode(message_of((), 0, b"data").SerializeToString())
    with pytest.raises(CloudError, match="field 'x' has unknown type 0"):
        PROTOBUF.decode(PointCloud(point_stride=4, fields=[{"name": "x"}]).SerializeToString())


def test_the_last_of_repeated_fields_counts():
    data = PointCloud(point_stride=4, data=b"12345678", frame_id="a").SerializeToString()
    data += PointCloud(point_stride=2, data=b"1234", frame_id="b").SerializeToString()
    cloud = PROTOBUF.decode(data)
    assert (cloud.point_step, cloud.size, cloud.frame_id) == (2, 2, "b")
    assert PointCloud.FromString(PROTOBUF.encode(cloud)) == PointCloud.FromString(data)


def test_unknown_fields_of_every_kind_are_preserved_in_order():
    unknown = [b"\xc1\x3e" + bytes(range(8)), b"\xc8\x3e\x85\x01", b"\xd5\x3e" + bytes(range(4)), b"\xda\x3e\x01z"]
    known = message_of(FIELDS, 22, bytes(range(22)), 5).SerializeToString()
    cloud = PROTOBUF.decode(unknown[0] + unknown[1] + known + unknown[2] + unknown[3])
    assert (cloud.size, cloud.stamp_ns, cloud.fields[4].name) == (1, 5, "t")
    at = [PROTOBUF.encode(cloud).index(part) for part in unknown]
    assert at == sorted(at)
    assert PointCloud.FromString(PROTOBUF.encode(cloud)).pose.position.x == 1.5


@pytest.mark.parametrize("size", [1, 126, 127, 128, 129, 16383, 16384])
def test_sizes_have_the_shortest_encoding(size):
    data = message_of(FIELDS[:0], 1, bytes(size)).SerializeToString()
    assert len(PROTOBUF.encode(PROTOBUF.decode(data))) == len(data)


@pytest.mark.parametrize("field", [b"\x12\x04abcd\x18\x07", b"\x15\0\0\0\0\x1a\x01a"])
def test_a_field_with_an_invalid_offset_or_type(field):
    data = PointCloud(point_stride=4, data=bytes(4)).SerializeToString()
    with pytest.raises(CloudError, match="field '' has an invalid offset or type"):
        PROTOBUF.decode(data + b"\x2a" + bytes((len(field),)) + field)


@pytest.mark.parametrize("wire", [3, 4, 6, 7])
def test_unsupported_wire_types(wire):
    with pytest.raises(CloudError, match=f"wire type {wire}"):
        PROTOBUF.decode(bytes((8 | wire, 0)))


def test_invalid_integers():
    for data in (b"\x80", b"\xff" * 20, b"\x32\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01abc"):
        with pytest.raises(CloudError):
            PROTOBUF.decode(data)


@pytest.mark.parametrize(
    ("timestamp", "stamp_ns"),
    [
        (None, 0),
        ({}, 0),
        ({"sec": 3, "nsec": 4}, 3_000_000_004),
        ({"sec": 1.5}, 1_500_000_000),
        ({"sec": "3", "nanos": 4}, 3_000_000_004),
        ({"sec": -2, "nsec": 500_000_000}, -1_500_000_000),
        ({"sec": 2**31 + 5, "nsec": 1}, (2**31 + 5) * 10**9 + 1),
        ("2023-11-14T22:13:20Z", 1_700_000_000 * 10**9),
        ("2023-11-14T22:13:20.123456789Z", 1_700_000_000 * 10**9 + 123_456_789),
        ("2023-11-14T22:13:20.5", 1_700_000_000 * 10**9 + 500_000_000),
        ("2023-11-15T00:13:20.000000001+02:00", 1_700_000_000 * 10**9 + 1),
        ("1969-12-31T23:59:58.5Z", -1_500_000_000),
        ("2100-01-01T00:00:00Z", 4_102_444_800 * 10**9),
    ],
)
def test_times_in_json(timestamp, stamp_ns):
    message = {**json_of(FIELDS, 22, bytes(22)), "timestamp": timestamp}
    cloud = JSON.decode(json.dumps(message).encode())
    assert cloud.stamp_ns == stamp_ns
    assert json.loads(JSON.encode(cloud)) == message


@pytest.mark.parametrize(
    "changes",
    [
        {"data": None},
        {"data": 5},
        {"data": "no base64!"},
        {"data": "AAA"},
        {"fields": None},
        {"fields": 3},
        {"fields": [1]},
        {"fields": [{"name": "x"}]},
        {"fields": [{"name": "x", "offset": 0, "type": "FLOAT"}]},
        {"fields": [{"name": "x", "offset": -4, "type": 7}]},
        {"fields": [{"name": "x", "offset": 10**400, "type": 7}]},
        {"fields": [{"name": "x", "offset": math.inf, "type": 7}]},
        {"fields": [{"name": "x", "offset": 0, "type": 9}]},
        {"fields": [{"name": "x", "offset": 19, "type": 7}]},
        {"point_stride": None},
        {"point_stride": -1},
        {"point_stride": math.nan},
        {"timestamp": "yesterday"},
        {"timestamp": "2023-11-14\n"},
        {"timestamp": {"sec": math.inf}},
        {"timestamp": [1, 2]},
    ],
)
def test_json_with_invalid_fields(changes):
    message = {**json_of(FIELDS, 22, bytes(44)), **changes}
    with pytest.raises(CloudError):
        JSON.decode(json.dumps(message).encode())


@pytest.mark.parametrize(
    "data", [b"", b"{}", b"[]", b"3", b"null", b"\xff\xfe", b'"\xe9"', b"[" * 100_000, b"1" * 9000]
)
def test_text_that_is_not_a_cloud(data):
    with pytest.raises(CloudError, match="not a valid JSON foxglove"):
        JSON.decode(data)


SAMPLE = {
    "protobuf": (PROTOBUF, message_of(FIELDS, 22, bytes(range(88)), 7, "map", ["a"]).SerializeToString()),
    "json": (JSON, json.dumps(json_of(FIELDS, 22, bytes(range(88)), 7, "map", ["a"])).encode()),
}


def test_large_declared_sizes_allocate_no_memory():
    _, source = SAMPLE["protobuf"]
    tracemalloc.start()
    for at in range(len(source) - 5):
        for size in (b"\xff\xff\xff\xff\x07", struct.pack("<I", 2**31 - 1)):
            with suppress(CloudError):
                PROTOBUF.encode(PROTOBUF.decode(source[:at] + size + source[at + len(size) :]))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**20


def test_names_that_are_not_utf8_are_preserved():
    data = SAMPLE["protobuf"][1].replace(b"ring", b"r\xefng").replace(b"map", b"m\xe4p")
    assert PROTOBUF.encode(PROTOBUF.decode(data)).count(b"r\xefng") == 1
    assert PROTOBUF.encode(PROTOBUF.decode(data)).count(b"m\xe4p") == 1


ROS = {"cdr": RosFoxglovePointCloud(2), "ros1": RosFoxglovePointCloud(1)}
ENCODINGS = pytest.mark.parametrize("encoding", ["cdr", "ros1"])
ROS_FIELDS = (Field("x", 0, "f4"), Field("intensity", 4, "u1"), Field("t", 5, "f8"))
ROS_CLOUD = Plain(1, 3, ROS_FIELDS, 13, 39, False, bytes(range(39)), False, 1_700_000_000_123_456_789, "lidär")


@ENCODINGS
@settings(max_examples=100, deadline=None)
@given(st.data())
def test_ros_round_trip_of_messages_from_rosbags(encoding, data):
    plain = data.draw(plain_clouds(encoding, counts=False))
    message = wrapped.foxglove(plain, encoding)
    cloud = ROS[encoding].decode(message)
    assert (cloud.stamp_ns, cloud.frame_id) == (plain.stamp_ns, plain.frame_id)
    assert [(f.name, f.offset, f.type) for f in cloud.fields] == [tuple(f)[:3] for f in plain.fields]
    assert cloud.size == (len(plain.data) // plain.point_step if plain.point_step else 0)
    assert ROS[encoding].encode(cloud) == message


@ENCODINGS
def test_ros_rosbags_reads_a_selection(encoding):
    cloud = ROS[encoding].decode(wrapped.foxglove(ROS_CLOUD, encoding))
    data = ROS[encoding].encode(cloud.select(np.array([True, False, True])))
    found = wrapped.deserialised(encoding, wrapped.FOXGLOVE, data)
    assert (found.timestamp.sec, found.timestamp.nanosec, found.frame_id) == (1_700_000_000, 123_456_789, "lidär")
    assert (found.pose.position.x, found.pose.orientation.w, found.point_stride) == (1.0, 0.8, 13)
    assert found.data.tobytes() == ROS_CLOUD.data[:13] + ROS_CLOUD.data[26:]


def test_ros_big_endian_cdr():
    cloud = ROS["cdr"].decode(wrapped.foxglove(ROS_CLOUD, "cdr", little=False))
    assert (bytes(cloud.data), cloud.pose[:3]) == (ROS_CLOUD.data, (1.0, 2.0, 3.0))


def test_ros_truncated_messages_are_errors():
    data = wrapped.foxglove(ROS_CLOUD, "cdr")
    for size in range(len(data)):
        with pytest.raises(CloudError):
            ROS["cdr"].decode(data[:size])
