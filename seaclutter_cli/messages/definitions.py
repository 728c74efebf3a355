"""Definitions for messages that the program creates and for bags without message definitions."""

from functools import cache, lru_cache
from typing import Any

from seaclutter_cli.records import Schema

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


@lru_cache(maxsize=64)
def ros2_schema(typename: str) -> Schema:
    r"""Return the schema of a known ROS 2 message, including the definitions of nested messages.

    Parameters
    ----------
    typename : str
        Full name, such as ``sensor_msgs/msg/PointCloud2``.

    Raises
    ------
    KeyError
        If the type is unknown.

    Examples
    --------
    >>> ros2_schema("std_msgs/msg/Bool").data
    b'bool data\n'
    """
    from rosbags.typesys import TypesysError

    try:
        definition, _ = _typestore().generate_msgdef(typename, ros_version=2)
    except TypesysError as error:
        raise KeyError(typename) from error
    return Schema(typename, "ros2msg", definition.encode())


def ros2_types() -> Any:
    """Return constants and fields of the known ROS 2 messages by their full names, as rosbags describes them."""
    return _typestore().fielddefs


@cache
def _typestore() -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # takes 0.1 s, which most runs do not need

    store = get_typestore(Stores.LATEST)
    for name, text in _PACKET_MESSAGES.items():
        store.register(get_types_from_msg(text, name))
    return store
