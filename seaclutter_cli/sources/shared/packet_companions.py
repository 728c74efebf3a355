"""Topics beside packet topics that contain the calibration of the same sensor."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

from seaclutter_cli.errors import CloudError
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.sources.shared.packet_messages import PACKET_LAYOUTS, ros2_type


@dataclass(frozen=True)
class Companion:
    """A kind of topic with calibrations.

    Parameters
    ----------
    typename : str
        ROS 2 name of its message type.
    word : str
        Part of its topic.
    serves : collection of str
        Message types of the packet topics beside which it is recorded.
    """

    typename: str
    word: str
    serves: Collection[str]


COMPANIONS = (
    Companion("rslidar_msgs/msg/rslidarPacket", "", ("rslidar_msgs/msg/rslidarScan",)),
    Companion("rslidar_msg/msg/RslidarPacket", "difop", ("rslidar_msg/msg/RslidarScan",)),
    Companion("std_msgs/msg/String", "metadata", ("ouster_ros/msg/PacketMsg", "ouster_sensor_msgs/msg/PacketMsg")),
    Companion("std_msgs/msg/UInt8MultiArray", "correction", ("hesai_ros_driver/msg/UdpFrame",)),
)
"""Kinds of topics with calibrations: packets, texts or bytes."""


def find_companion(packets: Channel, channels: Iterable[Channel]) -> Channel | None:
    """Return the topic with the calibration of a packet topic: of several, the one whose name begins most alike."""
    typename = ros2_type(packets)
    kinds = [kind for kind in COMPANIONS if typename in kind.serves]
    found = [channel for channel in channels if any(_is_of(channel, kind) for kind in kinds)]
    return max(found, key=lambda channel: _alike(channel.topic, packets.topic), default=None)


def _alike(one: str, other: str) -> int:
    """Return how many first characters two names share."""
    equal = [a == b for a, b in zip(one, other, strict=False)]
    return [*equal, False].index(False)


def _is_of(channel: Channel, kind: Companion) -> bool:
    return ros2_type(channel) == kind.typename and kind.word in channel.topic.lower()


def contains_packets(channel: Channel) -> bool:
    """Return whether the calibrations in a companion topic are packets."""
    return ros2_type(channel) in PACKET_LAYOUTS


def read_recorded(message: Message) -> bytes:
    """Return the file in a ``std_msgs/String`` or ``std_msgs/UInt8MultiArray``; `CloudError` if it is damaged."""
    store, typename = _typestore(), ros2_type(message.channel) or ""
    read = store.deserialize_ros1 if message.channel.message_encoding == "ros1" else store.deserialize_cdr
    try:
        data = read(bytes(message.data), typename).data
    except Exception as error:  # the library does not wrap errors of damaged messages
        raise CloudError(f"the message is not a valid {typename}: {error}") from error
    return data.encode(errors="surrogateescape") if isinstance(data, str) else data.tobytes()


def _typestore() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC)
