"""Codecs for the point cloud messages of logs."""

from collections.abc import Mapping

from seaclutter_cli.interfaces import CloudCodec
from seaclutter_cli.messages.foxglove import JsonPointCloud, ProtobufPointCloud
from seaclutter_cli.messages.pointcloud2 import CdrPointCloud2, Ros1PointCloud2
from seaclutter_cli.records import Channel

CODECS: Mapping[tuple[str, str], CloudCodec] = {
    ("sensor_msgs/msg/PointCloud2", "cdr"): CdrPointCloud2(),
    ("sensor_msgs/PointCloud2", "ros1"): Ros1PointCloud2(),
    ("foxglove.PointCloud", "protobuf"): ProtobufPointCloud(),
    ("foxglove.PointCloud", "json"): JsonPointCloud(),
}
"""Codecs by schema name and message encoding. To add an encoding, add a line here."""


def find_codec(channel: Channel) -> CloudCodec | None:
    """Return the codec of a channel; None if the channel contains no supported point clouds."""
    if channel.schema is None:
        return None
    return CODECS.get((channel.schema.name, channel.message_encoding))
