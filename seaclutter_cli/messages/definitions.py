"""Definitions for messages that the program creates and for bags without message definitions.

Messages that are added to a log are in an encoding that matches its clouds: one content, three encodings.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any

from seaclutter_cli.messages.serialisation import NANO, Ros
from seaclutter_cli.records import Channel, Schema

_PACKET_MESSAGES = {
    "velodyne_msgs/msg/VelodynePacket": "builtin_interfaces/Time stamp\nuint8[1206] data\n",
    "velodyne_msgs/msg/VelodyneScan": "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n",
    "pandar_msgs/msg/PandarPacket": "builtin_interfaces/Time stamp\nuint8[1500] data\nuint32 size\n",
    "pandar_msgs/msg/PandarScan": "std_msgs/Header header\npandar_msgs/PandarPacket[] packets\n",
    "rslidar_msg/msg/RslidarPacket": "std_msgs/Header header\nuint8 is_difop\nuint8 is_frame_begin\nuint8[] data\n",
    "ouster_ros/msg/PacketMsg": "uint8[] buf\n",
    "ouster_sensor_msgs/msg/PacketMsg": "uint8[] buf\n",
    "nebula_msgs/msg/NebulaPacket": "builtin_interfaces/Time stamp\nuint8[] data\n",
    "nebula_msgs/msg/NebulaPackets": "std_msgs/Header header\nnebula_msgs/NebulaPacket[] packets\n",
}
"""Packet messages of lidar drivers, which no ROS distribution defines."""

_CLOUD_MESSAGES = {
    "point_cloud_interfaces/msg/CompressedPointCloud2": "std_msgs/Header header\nuint32 height\nuint32 width\n"
    "sensor_msgs/PointField[] fields\nbool is_bigendian\nuint32 point_step\nuint32 row_step\n"
    "uint8[] compressed_data\nbool is_dense\nstring format\n",
    "foxglove_msgs/msg/PackedElementField": "uint8 UNKNOWN=0\nuint8 UINT8=1\nuint8 INT8=2\nuint8 UINT16=3\n"
    "uint8 INT16=4\nuint8 UINT32=5\nuint8 INT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\n"
    "string name\nuint32 offset\nuint8 type\n",
    "foxglove_msgs/msg/PointCloud": "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\n"
    "uint32 point_stride\nfoxglove_msgs/PackedElementField[] fields\nuint8[] data\n",
}
"""Cloud messages that no ROS distribution defines."""

_LIVOX_MESSAGES = {
    f"{driver}/msg/{name}": text.format(driver=driver)
    for driver in ("livox_ros_driver2", "livox_interfaces")
    for name, text in {
        "CustomPoint": "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n"
        "uint8 reflectivity\nuint8 tag\nuint8 line\n",
        "CustomMsg": "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
        "{driver}/CustomPoint[] points\n",
    }.items()
}
"""Clouds of Livox's drivers for ROS 2."""

_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}


@lru_cache(maxsize=1024)
def full_name(name: str) -> str:
    """Return the name of a type with its namespace, as in ROS 2; ROS 1 and the first versions of ROS 2 left it out."""
    package, _, rest = name.partition("/")
    full = name if "/" in rest or not rest else f"{package}/msg/{rest}"
    return _RENAMED.get(full, full)


@lru_cache(maxsize=64)
def ros2_schema(typename: str) -> Schema:
    """Return the schema of a known ROS 2 message with those of nested messages; `KeyError` if it is unknown."""
    from rosbags.typesys import TypesysError

    try:
        definition, _ = typestore(2).generate_msgdef(typename, ros_version=2)
    except TypesysError as error:
        raise KeyError(typename) from error
    return Schema(typename, "ros2msg", definition.encode())


@cache
def _cloud_schema(encoding: str) -> Schema:
    """Return the schema of ``sensor_msgs/PointCloud2`` in the version of ROS of a message encoding."""
    if encoding != "ros1":
        return ros2_schema("sensor_msgs/msg/PointCloud2")
    definition, _ = typestore(1).generate_msgdef("sensor_msgs/msg/PointCloud2", ros_version=1)
    return Schema("sensor_msgs/PointCloud2", "ros1msg", definition.encode())


def points_channel(channel: Channel) -> Channel:
    """Return a channel of ``sensor_msgs/PointCloud2`` in place of one of other ROS messages."""
    return replace(channel, schema=_cloud_schema(channel.message_encoding))


@cache
def typestore(ros: Ros) -> Any:
    """Return a type store of rosbags with the messages of the last release of ROS 1, or of ROS 2 and its drivers."""
    if ros == 1:
        return make_typestore({}, "ROS1_NOETIC")
    return make_typestore(_PACKET_MESSAGES | _CLOUD_MESSAGES | _LIVOX_MESSAGES)


def make_typestore(definitions: Mapping[str, str], base: str = "LATEST") -> Any:
    """Return a type store of rosbags with the messages of a release, or of ``EMPTY``, and others by their names."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # takes 0.1 s, which most runs do not need

    store = get_typestore(Stores[base])
    for name, text in definitions.items():
        store.register(get_types_from_msg(text, name))
    return store


Content = Mapping[str, Any]
"""Values of a message by field: numbers, strings, arrays, `Time`, and lists and mappings of these."""


@dataclass(frozen=True, slots=True)
class Time:
    """A time or duration in nanoseconds; outside the range of ROS times it is clipped."""

    ns: int


def companion_format(
    cloud_encoding: str, kind: str, typestore: Callable[[], Any], json_schema: Callable[[], Content]
) -> tuple[str, Schema, Callable[[Content], bytes]]:
    """Return the message encoding, schema and serialiser for a log, given the encoding of its clouds.

    Messages in ROS logs must use a ROS encoding, otherwise players and readers reject the log; other logs get JSON. The
    message has a ROS type (``package/msg/Name``) in a type store of ``rosbags``, and a JSON schema whose title is its
    name.
    """
    if cloud_encoding not in ("cdr", "ros1"):
        schema = json_schema()
        return "json", Schema(schema["title"], "jsonschema", json.dumps(schema).encode()), _json
    store, version = typestore(), 2 if cloud_encoding == "cdr" else 1
    text = store.generate_msgdef(kind, ros_version=version)[0].encode()
    schema_name = kind if version == 2 else kind.replace("/msg", "")
    serialise, least_s = (store.serialize_cdr, -(2**31)) if version == 2 else (store.serialize_ros1, 0)

    def ros(content: Content) -> bytes:
        return bytes(serialise(_message(store, content, kind, least_s), kind))

    return cloud_encoding, Schema(schema_name, f"ros{version}msg", text), ros


def _json(content: Content) -> bytes:
    values = content.items()
    # JSON has no NaN.
    finite = {name: None if isinstance(value, float) and not math.isfinite(value) else value for name, value in values}
    return json.dumps(finite, default=_plain).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, Time):
        seconds, nanoseconds = divmod(value.ns, NANO)
        return {"sec": min(max(seconds, -(2**63)), 2**63), "nsec": nanoseconds}
    return value.tolist()


def _message(store: Any, content: Any, kind: str, least_s: int) -> Any:
    from rosbags.interfaces import Nodetype

    if isinstance(content, Time):
        seconds, nanoseconds = divmod(content.ns, NANO)
        seconds = min(max(seconds, least_s), least_s + 2**32 - 1)
        # The type store has only the signed time of ROS 2; the bytes are the same.
        return store.types[kind](seconds - 2**32 if seconds >= 2**31 else seconds, nanoseconds)
    values = {}
    for field, (base, detail) in store.fielddefs[kind][1]:
        value = content[field]
        if base == Nodetype.NAME:
            value = _message(store, value, detail, least_s)
        elif base == Nodetype.SEQUENCE and detail[0][0] == Nodetype.NAME:
            value = [_message(store, item, detail[0][1], least_s) for item in value]
        values[field] = value
    return store.types[kind](**values)
