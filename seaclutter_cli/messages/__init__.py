"""Codecs for the point cloud messages of logs."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from seaclutter_cli.interfaces import CloudCodec
from seaclutter_cli.messages.foxglove import JsonPointCloud, ProtobufPointCloud, RosFoxglovePointCloud
from seaclutter_cli.messages.pointcloud2 import CompressedPointCloud2, PointCloud2
from seaclutter_cli.messages.scans import LaserScan, LivoxCustomMsg, MultiEchoLaserScan
from seaclutter_cli.messages.serialisation import RosCodec
from seaclutter_cli.records import Channel
from seaclutter_cli.registry import Registry

_ROS: Mapping[str, type[RosCodec]] = {
    "sensor_msgs/PointCloud2": PointCloud2,
    "foxglove_msgs/PointCloud": RosFoxglovePointCloud,
    "point_cloud_interfaces/CompressedPointCloud2": CompressedPointCloud2,
    "livox_interfaces/CustomMsg": LivoxCustomMsg,
    "livox_ros_driver/CustomMsg": LivoxCustomMsg,
    "livox_ros_driver2/CustomMsg": LivoxCustomMsg,
    "sensor_msgs/LaserScan": LaserScan,
    "sensor_msgs/MultiEchoLaserScan": MultiEchoLaserScan,
}

_BUILT_IN: Mapping[tuple[str, str], CloudCodec] = {
    **{(name.replace("/", "/msg/"), "cdr"): codec(2) for name, codec in _ROS.items()},
    **{(name, "cdr"): codec(2) for name, codec in _ROS.items()},  # as the first versions of ROS 2 named them
    **{(name, "ros1"): codec(1) for name, codec in _ROS.items()},
    ("foxglove.PointCloud", "protobuf"): ProtobufPointCloud(),
    ("foxglove.PointCloud", "json"): JsonPointCloud(),
}
"""Codecs by schema name and message encoding. To add an encoding, add a line here, or to the messages of ROS."""


def _of_plugin(_: str, kind: Any) -> Mapping[tuple[str, str], CloudCodec]:
    if lacking := [one for one in ("messages", "decode", "encode") if not hasattr(kind, one)]:
        raise TypeError(f"must be a CloudCodec with messages; it lacks {', '.join(lacking)}")
    return dict.fromkeys(kind.messages, kind())


CODECS = Registry("clouds", _BUILT_IN, _of_plugin)
"""Codecs by schema name and message encoding."""

_TRANSIENT_LOCAL = re.compile(r"durability:\s*(1\b|transient_local)")
_SECONDARY = (RosFoxglovePointCloud, CompressedPointCloud2, LaserScan | MultiEchoLaserScan)


def find_codec(channel: Channel) -> CloudCodec | None:
    """Return the codec of a channel; None if the channel contains no supported point clouds."""
    if channel.schema is None:
        return None
    return CODECS.get((channel.schema.name, channel.message_encoding))


def main_clouds(channels: Iterable[Channel]) -> Sequence[Channel]:
    """Return the channels of the clouds that are meant if no topic is named.

    Recorders also store copies of clouds for viewers, compressed ones, and the scans of other sensors: the first of
    these kinds that a recording has counts.
    """
    ranks: dict[Channel, int] = {}
    for channel in channels:
        if codec := find_codec(channel):
            ranks[channel] = next((rank for rank, kind in enumerate(_SECONDARY, 1) if isinstance(codec, kind)), 0)
    first = min(ranks.values(), default=0)
    return [channel for channel, rank in ranks.items() if rank == first]


def has_fixed_fields(channel: Channel) -> bool:
    """Return whether the points in the messages of a channel have no room for further fields."""
    return isinstance(find_codec(channel), LaserScan | LivoxCustomMsg | MultiEchoLaserScan)


def declares_latched(channel: Channel) -> bool:
    """Return whether a channel has the ROS 1 header ``latching`` or the ROS 2 durability ``transient_local``."""
    metadata = dict(channel.metadata)
    return metadata.get("latching") == "1" or bool(_TRANSIENT_LOCAL.search(metadata.get("offered_qos_profiles", "")))
