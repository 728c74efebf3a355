"""Definitions for messages that the program creates and for bags without message definitions.

Messages that are added to a log are in an encoding that matches its clouds: one content, three encodings.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any

from seaclutter_cli.messages.serialisation import NANO, Ros, version_of
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

POINT_CLOUD, POSE = "sensor_msgs/msg/PointCloud2", "geometry_msgs/msg/PoseStamped"

_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}


@lru_cache(maxsize=1024)
def full_name(name: str) -> str:
    """Return the name of a type with its namespace, as in ROS 2; ROS 1 and the first versions of ROS 2 left it out."""
    package, _, rest = name.partition("/")
    full = name if "/" in rest or not rest else f"{package}/msg/{rest}"
    return _RENAMED.get(full, full)


@lru_cache(maxsize=64)
def _schema(store: Any, typename: str, ros: Ros) -> Schema:
    """Return the schema of a message in a type store, with those of nested messages, for a version of ROS."""
    definition, _ = store.generate_msgdef(typename, ros_version=ros)
    return Schema(typename if ros == 2 else typename.replace("/msg/", "/"), f"ros{ros}msg", definition.encode())


def ros2_schema(typename: str) -> Schema:
    """Return the schema of a known ROS 2 message with those of nested messages; `KeyError` if it is unknown."""
    from rosbags.typesys import TypesysError

    try:
        return _schema(typestore(2), typename, 2)
    except TypesysError as error:
        raise KeyError(typename) from error


def points_channel(channel: Channel) -> Channel:
    """Return a channel of ``sensor_msgs/PointCloud2`` in place of one of other ROS messages."""
    ros = version_of(channel.message_encoding)
    return replace(channel, schema=_schema(typestore(ros), POINT_CLOUD, ros))


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
    store, version = typestore(), version_of(cloud_encoding)
    serialise, least_s = (store.serialize_cdr, -(2**31)) if version == 2 else (store.serialize_ros1, 0)

    def ros(content: Content) -> bytes:
        return bytes(serialise(_object(content, least_s), kind))

    return cloud_encoding, _schema(store, kind, version), ros


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


def _object(content: Any, least_s: int) -> Any:
    """Return values as what rosbags serialises: objects with the fields as attributes."""
    if isinstance(content, Time):
        seconds, nanoseconds = divmod(content.ns, NANO)
        seconds = min(max(seconds, least_s), least_s + 2**32 - 1)
        # The type store has only the signed time of ROS 2; the bytes are the same.
        return SimpleNamespace(sec=seconds - 2**32 if seconds >= 2**31 else seconds, nanosec=nanoseconds)
    if isinstance(content, Mapping):
        return SimpleNamespace(**{field: _object(value, least_s) for field, value in content.items()})
    return [_object(item, least_s) for item in content] if isinstance(content, list) else content
