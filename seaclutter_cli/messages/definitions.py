"""Message definitions for the schemas of what this program writes itself."""

from functools import lru_cache

from seaclutter_cli.records import Schema


@lru_cache(maxsize=64)
def ros2_schema(typename: str) -> Schema:
    r"""Return the schema of a standard ROS 2 message, with the definitions of all messages in it.

    Parameters
    ----------
    typename : str
        Full name, such as ``sensor_msgs/msg/PointCloud2``.

    Raises
    ------
    KeyError
        If no standard message has this name.

    Examples
    --------
    >>> ros2_schema("std_msgs/msg/Bool").data
    b'bool data\n'
    """
    from rosbags.typesys import Stores, get_typestore  # 0.1 s that most runs do not need

    definition, _ = get_typestore(Stores.LATEST).generate_msgdef(typename, ros_version=2)
    return Schema(typename, "ros2msg", definition.encode())
