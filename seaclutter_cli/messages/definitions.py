"""Message definitions for the schemas of what this program writes itself, and of bags that carry none."""

from functools import cache, lru_cache
from typing import Any

from seaclutter_cli.records import Schema

_PACKET_MESSAGES = {
    "velodyne_msgs/msg/VelodynePacket": "builtin_interfaces/Time stamp\nuint8[1206] data\n",
    "velodyne_msgs/msg/VelodyneScan": "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n",
    "pandar_msgs/msg/PandarPacket": "builtin_interfaces/Time stamp\nuint8[1500] data\nuint32 size\n",
    "pandar_msgs/msg/PandarScan": "std_msgs/Header header\npandar_msgs/PandarPacket[] packets\n",
}
"""What lidar drivers record and no ROS distribution defines."""


@lru_cache(maxsize=64)
def ros2_schema(typename: str) -> Schema:
    r"""Return the schema of a known ROS 2 message, with the definitions of all messages in it.

    Parameters
    ----------
    typename : str
        Full name, such as ``sensor_msgs/msg/PointCloud2``.

    Raises
    ------
    KeyError
        If no message of this name is known.

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


@cache
def _typestore() -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # 0.1 s that most runs do not need

    store = get_typestore(Stores.LATEST)
    for name, text in _PACKET_MESSAGES.items():
        store.register(get_types_from_msg(text, name))
    return store
