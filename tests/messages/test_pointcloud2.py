"""Codecs for PointCloud2 against rosbags, which shares no code with them."""

import struct
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages.pointcloud2 import PointCloud2
from tests.messages.clouds import TYPES, Field, Plain, plain_clouds

TYPE = "sensor_msgs/msg/PointCloud2"
STORES = {"cdr": get_typestore(Stores.ROS2_HUMBLE), "ros1": get_typestore(Stores.ROS1_NOETIC)}
CODECS = {"cdr": PointCloud2(2), "ros1": PointCloud2(1)}
DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
ENCODINGS = pytest.mark.parametrize("encoding", ["cdr", "ros1"])
FLOATS = tuple(Field(name, 4 * k, "f4") for k, name in enumerate(("x", "y", "z", "intensity")))
RSLIDAR = (*FLOATS, Field("ring", 16, "u2"), Field("timestamp", 18, "f8"))


def serialised(plain, encoding, *, little=True, sequence=3):
    """Return the message of a cloud, serialised by rosbags."""
    store = STORES[encoding]
    types = store.types
    seconds, nanoseconds = divmod(plain.stamp_ns, 10**9)
    if encoding == "ros1":  # rosbags packs seconds as signed numbers for both versions
        seconds = struct.unpack("<i", struct.pack("<I", seconds))[0]
    stamp = types["builtin_interfaces/msg/Time"](seconds, nanoseconds)
    header = types["std_msgs/msg/Header"](
        **{"seq": sequence} if encoding == "ros1" else {}, stamp=stamp, frame_id=plain.frame_id
    )
    fields = [types["sensor_msgs/msg/PointField"](f.name, f.offset, DATATYPES[f.type], f.count) for f in plain.fields]
    message = types[TYPE](
        header,
        plain.height,
        plain.width,
        fields,
        plain.big_endian,
        plain.point_step,
        plain.row_step,
        np.frombuffer(plain.data, np.uint8),
        plain.dense,
    )
    if encoding == "ros1":
        return bytes(store.serialize_ros1(message, TYPE))
    return bytes(store.serialize_cdr(message, TYPE, little_endian=little))


def attributes(cloud):
    """Return the attributes of a cloud for comparison with a `Plain` cloud."""
    return {
        **{name: getattr(cloud, name) for name in vars(PLAIN)},
        "fields": tuple(Field(f.name, f.offset, f.type, f.count) for f in cloud.fields),
        "data": bytes(cloud.data),
    }


def little_endian(column):
    return column.astype(column.dtype.newbyteorder("<")).tobytes()


PLAIN = Plain(1, 2, RSLIDAR, 26, 52, False, bytes(range(52)), True, 1_700_000_000_123_456_789, "lidar")


@ENCODINGS
@settings(max_examples=150, deadline=None)
@given(st.data())
def test_round_trip_of_messages_from_rosbags(encoding, data):
    plain = data.draw(plain_clouds(encoding))
    message = serialised(plain, encoding)
    cloud = CODECS[encoding].decode(message)
    assert attributes(cloud) == vars(plain)
    assert CODECS[encoding].encode(cloud) == message


@settings(max_examples=100, deadline=None)
@given(plain_clouds())
def test_reads_big_endian_cdr_and_writes_little_endian(plain):
    cloud = CODECS["cdr"].decode(serialised(plain, "cdr", little=False))
    assert attributes(cloud) == vars(plain)
    assert CODECS["cdr"].encode(cloud) == serialised(plain, "cdr")


@settings(max_examples=150, deadline=None)
@given(plain_clouds())
def test_values_of_all_fields(plain):
    points = CODECS["cdr"].decode(serialised(plain, "cdr")).points
    assert len(points) == len(plain.points)
    for field, name in zip(plain.fields, points.dtype.names, strict=True):
        assert little_endian(points[name]) == plain.values(field)


@ENCODINGS
def test_rosbags_reads_a_selection(encoding):
    plain = Plain(3, 4, RSLIDAR, 26, 110, True, bytes(i % 251 for i in range(330)), False, 5 * 10**9 + 7, "lidär")
    keep = np.arange(12) % 3 == 0
    data = CODECS[encoding].encode(CODECS[encoding].decode(serialised(plain, encoding, sequence=9)).select(keep))
    store = STORES[encoding]
    message = (store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1)(data, TYPE)
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 4, 26, 104)
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (5, 7, "lidär")
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        (f.name, f.offset, DATATYPES[f.type], 1) for f in RSLIDAR
    ]
    assert message.data.tobytes() == b"".join(plain.points[::3])
    assert (bool(message.is_bigendian), bool(message.is_dense)) == (True, False)
    assert encoding == "cdr" or message.header.seq == 9


@ENCODINGS
@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("big_endian", [False, True])
def test_points_are_a_view_on_the_message(encoding, kind, big_endian):
    fields = (Field("a", 1, "u1"), Field("v", 2, kind), Field("w", 10, "f8"))
    plain = Plain(2, 3, fields, 18, 54, big_endian, bytes(range(108)))
    data = serialised(plain, encoding)
    points = CODECS[encoding].decode(memoryview(data)).points
    assert np.shares_memory(points, np.frombuffer(data, np.uint8))
    assert little_endian(points["v"]) == plain.values(fields[1])


def test_unaligned_times_of_robosense():
    values = [(1.5, -2.5, 0.25, 77.0, 31, 1_700_000_000.123456), (np.inf, 0.0, -0.0, 255.0, 65535, 5e-324)]
    data = b"".join(struct.pack("<ffffHd", *value) for value in values)
    cloud = CODECS["cdr"].decode(serialised(Plain(1, 2, RSLIDAR, 26, 52, False, data), "cdr"))
    assert cloud.points.tolist() == values


def test_unusual_layouts():
    no_fields = Plain(1, 3, (), 5, 15, False, bytes(range(15)))
    cloud = CODECS["cdr"].decode(serialised(no_fields, "cdr"))
    assert cloud.size == 3
    assert bytes(cloud.select(np.array([False, True, True])).data) == bytes(range(5, 15))
    names = ("x", "", "x", "x_", "")
    same_names = Plain(1, 1, tuple(Field(name, k, "u1") for k, name in enumerate(names)), 5, 5, False, b"abcde")
    points = CODECS["cdr"].decode(serialised(same_names, "cdr")).points
    assert points.dtype.names == ("x", "unnamed", "x_", "x__", "unnamed_")
    assert points.tolist() == [tuple(b"abcde")]


@ENCODINGS
@pytest.mark.parametrize(("fields", "step"), [((), 0), ((), 26), (RSLIDAR, 0), (RSLIDAR, 26)])
@pytest.mark.parametrize("shape", [(0, 0), (1, 0), (5, 0), (0, 7)])
@pytest.mark.parametrize("row_step", [0, 26])
def test_clouds_without_points(encoding, fields, step, shape, row_step):
    plain = Plain(*shape, fields, step, row_step, False, b"")
    data = serialised(plain, encoding)
    cloud = CODECS[encoding].decode(data)
    assert (cloud.size, len(cloud.points), len(cloud.dtype.names)) == (0, 0, len(fields))
    assert CODECS[encoding].encode(cloud) == data
    nothing = np.zeros(0, np.bool_)
    less = cloud.select(nothing)
    blanked = [cloud.blank(nothing)] if fields else []
    for changed in (less, *blanked, less.with_field("reason", np.zeros(0, np.uint8))):
        assert CODECS[encoding].decode(CODECS[encoding].encode(changed)).size == 0


@ENCODINGS
def test_wrong_row_steps(encoding):
    points = bytes(range(52))
    for row_step in (0, 3, 1000):  # ignored for a single row
        cloud = CODECS[encoding].decode(serialised(Plain(1, 2, RSLIDAR, 26, row_step, False, points), encoding))
        assert cloud.points["ring"].tolist() == [0x1110, 0x2B2A]
        assert bytes(cloud.select(np.array([False, True])).data) == points[26:]
    left_out = CODECS[encoding].decode(serialised(Plain(2, 1, RSLIDAR, 26, 0, False, points), encoding))
    assert left_out.points["ring"].tolist() == [0x1110, 0x2B2A]
    wrong = CODECS[encoding].decode(serialised(Plain(2, 1, RSLIDAR, 26, 25, False, points), encoding))
    assert wrong.has_wrong_rows
    assert wrong.points["ring"].tolist() == [0x1110, 0x2B2A]
    with pytest.raises(CloudError, match="a row of 25 bytes cannot contain 1 point of 26 bytes"):
        CODECS[encoding].decode(serialised(Plain(2, 1, RSLIDAR, 26, 25, False, points + b"x"), encoding))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"point_step": 0}, "point_step must be positive for 2 points, got 0"),
        ({"point_step": 25}, "field 'timestamp' does not fit into a point of 25 bytes"),
        ({"width": 3}, "the points occupy 78 bytes, but the message has 52"),
        ({"width": 2**32 - 1, "height": 2**32 - 1, "row_step": 2**32 - 1}, "cannot contain"),
        ({"fields": (Field("x", 2**32 - 1, "f4"),)}, "does not fit into"),
        ({"fields": (Field("x", 0, "f8", 2**32 - 1),)}, "the fields overlap"),
        ({"width": 0, "fields": (Field("x", 0, "f8", 2**32 - 1),)}, "a point must have"),
        ({"width": 0, "data": b"", "point_step": 2**32 - 1}, "a point must have"),
        ({"fields": RSLIDAR[:1] * 1025}, "declares 1,025 fields, at most 1024"),
    ],
)
def test_impossible_layouts(changes, message):
    with pytest.raises(CloudError, match=message):
        CODECS["cdr"].decode(serialised(Plain(**{**vars(PLAIN), **changes}), "cdr"))


def test_the_maximum_number_of_fields():
    fields = tuple(Field(f"v{k}", k, "u1") for k in range(1024))
    plain = Plain(1, 2, fields, 1024, 2048, False, bytes(2048))
    assert len(CODECS["cdr"].decode(serialised(plain, "cdr")).fields) == 1024


def test_unknown_type_of_a_field():
    data = bytearray(serialised(PLAIN, "ros1"))
    at = data.index(b"timestamp") + len(b"timestamp") + 4
    for kind in (0, 9, 255):
        data[at] = kind
        with pytest.raises(CloudError, match=f"field 'timestamp' has unknown type {kind}"):
            CODECS["ros1"].decode(bytes(data))


@pytest.mark.parametrize("start", [b"", b"\0\1", b"\0\x07\0\0", b"\0\2\0\0", b"\1\1\0\0"])
def test_other_encapsulations_than_plain_cdr(start):
    with pytest.raises(CloudError, match="plain CDR header"):
        CODECS["cdr"].decode(start + (serialised(PLAIN, "cdr")[4:] if len(start) == 4 else b""))


@ENCODINGS
def test_truncated_messages_are_errors(encoding):
    data = serialised(PLAIN, encoding)
    for size in range(len(data)):
        with pytest.raises(CloudError):
            CODECS[encoding].decode(data[:size])
    assert CODECS[encoding].decode(data + bytes(3)).size == 2, "some middleware pads messages at the end"


@ENCODINGS
def test_large_declared_sizes_allocate_no_memory(encoding):
    data = serialised(PLAIN, encoding)
    tracemalloc.start()
    for at in range(len(data) - 3):
        changed = data[:at] + b"\xff\xff\xff\x7f" + data[at + 4 :]
        try:
            cloud = CODECS[encoding].decode(changed)
            CODECS[encoding].encode(cloud.select(np.ones(cloud.size, np.bool_)))
        except CloudError:
            pass
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**20


@pytest.mark.parametrize("stamp_ns", [0, 1, 10**9 - 1, 10**9, 2**31 * 10**9 - 1])
@ENCODINGS
def test_stamps(encoding, stamp_ns):
    plain = Plain(**{**vars(PLAIN), "stamp_ns": stamp_ns})
    data = serialised(plain, encoding)
    assert CODECS[encoding].decode(data).stamp_ns == stamp_ns
    assert CODECS[encoding].encode(CODECS[encoding].decode(data)) == data


def test_stamps_that_only_one_encoding_can_represent():
    first, last = -(2**31) * 10**9, 2**32 * 10**9 - 1
    around = [(-1, "cdr", "ros1"), (first, "cdr", "ros1"), ((2**31 + 5) * 10**9, "ros1", "cdr"), (last, "ros1", "cdr")]
    for stamp_ns, encoding, other in around:
        data = serialised(Plain(**{**vars(PLAIN), "stamp_ns": stamp_ns}), encoding)
        cloud = CODECS[encoding].decode(data)
        assert cloud.stamp_ns == stamp_ns
        assert CODECS[encoding].encode(cloud) == data
        with pytest.raises(CloudError, match=f"stamp {stamp_ns} ns does not fit into a ROS header"):
            CODECS[other].encode(cloud)
    for codec in CODECS.values():
        for stamp_ns in (first - 1, last + 5 * 10**9):
            with pytest.raises(CloudError, match="does not fit into a ROS header"):
                codec.encode(replace(cloud, stamp_ns=stamp_ns))


@ENCODINGS
@pytest.mark.parametrize("seconds", [0, 2**31 - 1])
def test_nanoseconds_beyond_a_second(encoding, seconds):
    data = serialised(PLAIN, encoding)
    cloud = CODECS[encoding].decode(data[:4] + struct.pack("<II", seconds, 2**32 - 1) + data[12:])
    assert cloud.stamp_ns == seconds * 10**9 + 2**32 - 1
    assert CODECS[encoding].decode(CODECS[encoding].encode(cloud)).stamp_ns == cloud.stamp_ns


@ENCODINGS
def test_text_that_is_not_utf8_is_preserved(encoding):
    data = serialised(PLAIN, encoding).replace(b"lidar", b"l\xefd\xe4r").replace(b"intensity", b"intensit\xe9")
    cloud = CODECS[encoding].decode(data)
    assert CODECS[encoding].encode(cloud) == data
    assert cloud.dtype.names[3].startswith("intensit")


def test_invalid_points_keep_their_bits():
    nan = struct.pack("<I", 0x7FA0_1234)  # a signalling NaN with a payload
    plain = Plain(1, 2, (Field("x", 0, "f4"),), 4, 8, False, nan + struct.pack("<f", 1))
    cloud = CODECS["cdr"].decode(serialised(plain, "cdr"))
    assert np.isnan(cloud.points["x"]).tolist() == [True, False]
    assert bytes(cloud.select(np.array([True, False])).data) == nan


def test_a_cloud_from_an_array():
    array = np.array([(1.0, 2, True), (np.nan, 3, False)], [("x", "f8"), ("n", "i8"), ("b", "?")])
    cloud = from_array(array, stamp_ns=10**9, frame_id="map")
    message = STORES["cdr"].deserialize_cdr(CODECS["cdr"].encode(cloud), TYPE)
    assert [(f.name, f.offset, f.datatype) for f in message.fields] == [("x", 0, 8), ("n", 8, 8), ("b", 16, 2)]
    assert message.data.tobytes() == struct.pack("<ddB", 1, 2, 1) + struct.pack("<ddB", np.nan, 3, 0)
    message = STORES["ros1"].deserialize_ros1(CODECS["ros1"].encode(cloud), TYPE)
    assert (message.header.seq, message.header.frame_id, message.header.stamp.sec) == (0, "map", 1)
