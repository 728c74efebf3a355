"""Messages of all types of both ROS versions, translated and compared with what rosbags makes of them."""

import numpy as np
import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.cloud import from_array
from seaclutter_cli.messages import CODECS, find_codec
from seaclutter_cli.messages.definitions import full_name
from seaclutter_cli.messages.layouts import TranslationError
from seaclutter_cli.messages.translation import CDR, ROS1, translator
from seaclutter_cli.records import Channel, Schema

NOETIC, LATEST = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.LATEST)


def same_fields(name):
    """Return whether a type has the same fields in both versions, but for the sequence number of headers."""
    if name == "std_msgs/msg/Header":
        return True
    one, other = ([kind for _, kind in store.fielddefs[name][1]] for store in (NOETIC, LATEST))
    return one == other and all(
        same_fields(inner) for kind in one for base, inner in [kind if kind[0] < 3 else kind[1][0]] if base == 2
    )


COMMON = [name for name in NOETIC.fielddefs if name in LATEST.fielddefs and "/msg/" in name]
SAME = [name for name in COMMON if same_fields(name)]


def random_message(store, name, rng):
    """Return a message of random values, with sequences of up to three items."""
    values = {field: random_value(store, kind, rng) for field, kind in store.fielddefs[name][1]}
    return store.types[name](*values.values())


def random_value(store, kind, rng):
    base, detail = kind
    if base == Nodetype.NAME:
        if detail in ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
            return store.types[detail](int(rng.integers(2**31)), int(rng.integers(10**9)))
        return random_message(store, detail, rng)
    if base == Nodetype.BASE:
        return random_number(detail[0], rng)
    item, length = detail
    count = length if base == Nodetype.ARRAY else int(rng.integers(4))
    values = [random_value(store, item, rng) for _ in range(count)]
    if item[0] == Nodetype.BASE and item[1][0] != "string":
        kind = {"byte": "uint8", "char": "uint8"}.get(item[1][0], item[1][0])
        return np.array(values, np.dtype(kind))
    return values


def random_number(kind, rng):
    if kind == "string":
        return "".join(rng.choice(list("abcå ")) for _ in range(int(rng.integers(7))))
    if kind == "bool":
        return bool(rng.integers(2))
    return int(rng.integers(100)) if "float" not in kind else float(rng.integers(1000)) / 8


def ros1_channel(name, store=NOETIC):
    text, md5 = store.generate_msgdef(name)
    schema = Schema(name.replace("/msg/", "/"), "ros1msg", text.encode())
    return Channel(1, "/topic", ROS1, schema, (("md5sum", md5), ("topic", "/topic"), ("type", schema.name)))


def ros2_channel(name, metadata=()):
    text, _ = LATEST.generate_msgdef(name, ros_version=2)
    return Channel(1, "/topic", CDR, Schema(name, "ros2msg", text.encode()), metadata)


@pytest.mark.parametrize("name", SAME)
def test_messages_become_those_of_rosbags_in_both_directions(name):
    rng = np.random.default_rng(len(name))
    there, back = translator(ros1_channel(name), CDR), translator(ros2_channel(name), ROS1)
    for _ in range(5):
        raw = bytes(NOETIC.serialize_ros1(random_message(NOETIC, name, rng), name))
        cdr = bytes(LATEST.ros1_to_cdr(raw, name)) if name != "std_msgs/msg/Header" else None
        ours = bytes(there.translate(raw))
        assert ours == cdr if cdr else LATEST.deserialize_cdr(ours, name)
        assert bytes(back.translate(ours)) == without_sequence_numbers(raw, name)


def without_sequence_numbers(raw, name):
    """Return a ROS 1 message whose headers have the sequence number 0, by way of ROS 2."""
    message = NOETIC.deserialize_ros1(raw, name)
    clear(message)
    return bytes(NOETIC.serialize_ros1(message, name))


def clear(message):
    if type(message).__name__ == "std_msgs__msg__Header":
        message.seq = 0
    for value in list(getattr(message, "__dict__", {}).values()):
        for one in value if isinstance(value, list) else [value]:
            if hasattr(one, "__msgtype__"):
                clear(one)


@pytest.mark.parametrize("name", COMMON)
def test_definitions_are_those_of_the_other_version(name):
    there, back = translator(ros1_channel(name), CDR).channel, translator(ros2_channel(name), ROS1).channel
    assert there.schema.data.decode() == LATEST.generate_msgdef(name, ros_version=2)[0]
    assert dict(there.metadata)["topic_type_hash"] == LATEST.hash_rihs01(name)
    text, md5 = NOETIC.generate_msgdef(name)
    assert (back.schema.data.decode(), dict(back.metadata)["md5sum"]) == (text, md5)
    assert back.schema.name == name.replace("/msg/", "/")


def test_big_endian_messages_are_read():
    name, rng = "sensor_msgs/msg/Imu", np.random.default_rng(1)
    message = random_message(LATEST, name, rng)
    little, big = (LATEST.serialize_cdr(message, name, little_endian=little) for little in (True, False))
    change = translator(ros2_channel(name), ROS1)
    assert change.translate(big) == change.translate(little)


def test_fields_that_only_one_version_has_are_empty_or_named_as_lost():
    name, rng = "visualization_msgs/msg/Marker", np.random.default_rng(2)
    message = random_message(NOETIC, name, rng)
    change = translator(ros1_channel(name), CDR)
    found = LATEST.deserialize_cdr(bytes(change.translate(NOETIC.serialize_ros1(message, name))), name)
    assert (found.ns, found.id, found.mesh_resource, found.texture_resource) == (
        message.ns,
        message.id,
        message.mesh_resource,
        "",
    )
    assert [(p.x, p.y, p.z) for p in found.points] == [(p.x, p.y, p.z) for p in message.points]
    assert change.lost == ()
    back = translator(ros2_channel(name), ROS1)
    assert "uv_coordinates" in back.lost
    again = NOETIC.deserialize_ros1(bytes(back.translate(LATEST.serialize_cdr(found, name))), name)
    assert again.color == message.color


def test_types_of_one_s_own_keep_their_fields():
    text = "Header header\nInner[] inner\nuint8 KIND=3\nfloat64 value\nchar[3] code\n" + "=" * 80
    text += "\nMSG: my_msgs/Inner\nuint8 a\nfloat64 b\nstring c\n"
    channel = Channel(1, "/own", ROS1, Schema("my_msgs/Own", "ros1msg", text.encode()), (("latching", "1"),))
    there = translator(channel, CDR)
    raw = bytes.fromhex("0700000001000000020000000100000061") + bytes.fromhex("02000000")
    raw += b"\x01" + np.float64(2.5).tobytes() + b"\x01\0\0\0x" + b"\x02" + np.float64(-1).tobytes() + bytes(4)
    raw += np.float64(9).tobytes() + b"abc"
    back = translator(there.channel, ROS1)
    assert bytes(back.translate(there.translate(raw))) == bytes(4) + raw[4:]
    assert dict(back.channel.metadata)["latching"] == "1"
    assert "uint8 KIND=3" in there.channel.schema.data.decode()


@pytest.mark.parametrize("encoding", [ROS1, CDR])
@pytest.mark.parametrize("kind", ["protobuf", "json"])
def test_clouds_in_other_encodings_become_pointcloud2(kind, encoding):
    channel = Channel(1, "/points", kind, Schema("foxglove.PointCloud", "jsonschema", b"{}"))
    points = np.array([(1, 2, 3, 4)], [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "u2")])
    change = translator(channel, encoding)
    cloud = find_codec(change.channel).decode(change.translate(find_codec(channel).encode(from_array(points))))
    assert cloud.points.tolist() == points.tolist()


def test_clouds_are_those_of_the_codecs():
    cloud = from_array(
        np.arange(24).astype("u1").view([("x", "f4"), ("i", "u1", 4)]), stamp_ns=5_000_000_007, frame_id="a"
    )
    name = "sensor_msgs/msg/PointCloud2"
    ros1, cdr = CODECS["sensor_msgs/PointCloud2", "ros1"].encode(cloud), CODECS[name, "cdr"].encode(cloud)
    assert bytes(translator(ros1_channel(name), CDR).translate(ros1)) == cdr
    assert bytes(translator(ros2_channel(name), ROS1).translate(cdr)) == ros1


def test_a_latched_topic_stays_latched():
    qos = (("offered_qos_profiles", "- durability: transient_local"),)
    assert dict(translator(ros2_channel("std_msgs/msg/String", qos), ROS1).channel.metadata)["latching"] == "1"
    channel = ros1_channel("std_msgs/msg/String")
    plain = translator(channel, CDR).channel
    assert dict(plain.metadata)["offered_qos_profiles"] == ""


@pytest.mark.parametrize("cut", [0, 3, 20, 40])
def test_truncated_messages_are_errors(cut):
    name = "sensor_msgs/msg/Imu"
    cdr = bytes(LATEST.serialize_cdr(random_message(LATEST, name, np.random.default_rng(3)), name))
    with pytest.raises(TranslationError):
        translator(ros2_channel(name), ROS1).translate(cdr[:cut])


def test_longer_messages_are_errors():
    with pytest.raises(TranslationError, match="3 bytes more"):
        translator(ros1_channel("std_msgs/msg/Bool"), CDR).translate(b"\1\0\0\0")


def test_few_bytes_cannot_declare_billions_of_empty_items():
    schema = Schema("my_msgs/Many", "ros1msg", b"std_msgs/Empty[] items")
    with pytest.raises(TranslationError, match="more items"):
        translator(Channel(1, "/many", ROS1, schema), CDR).translate(b"\xff" * 4)


def doubling(types):
    """Return definitions of types of which each contains two of the next."""
    parts = [f"MSG: my_msgs/A{n}\nmy_msgs/A{n + 1} a\nmy_msgs/A{n + 1} b" for n in range(1, types)]
    parts = ["my_msgs/A1 a\nmy_msgs/A1 b", *parts, f"MSG: my_msgs/A{types}\nuint8 a"]
    return f"\n{'=' * 80}\n".join(parts).encode()


@pytest.mark.parametrize(
    ("schema", "problem"),
    [
        (None, "no definition"),
        (Schema("my_msgs/A", "ros1msg", b""), "unknown"),
        (Schema("my_msgs/A", "ros1msg", b"!"), "not valid"),
        (Schema("my_msgs/A", "ros1msg", b"my_msgs/A a"), "not complete"),
        (Schema("my_msgs/A", "ros1msg", b"my_msgs/B b"), "not complete"),
        (Schema("my_msgs/A", "ros1msg", b"#" * 2_000_000), "longer"),
        (Schema("my_msgs/A0", "ros1msg", doubling(40)), "more than 10,000 fields"),
        (Schema("my_msgs/A", "ros2msg", b"wstring a"), "not complete"),
    ],
)
def test_types_that_cannot_be_translated_are_errors(schema, problem):
    with pytest.raises(TranslationError, match=problem):
        translator(Channel(1, "/a", ROS1, schema), CDR)


def test_names_of_types():
    assert full_name("tf/tfMessage") == "tf2_msgs/msg/TFMessage"
