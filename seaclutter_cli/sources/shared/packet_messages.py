"""Messages of lidar drivers that contain packets: their layouts, and their packets."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages.definitions import full_name
from seaclutter_cli.messages.serialisation import reader_of
from seaclutter_cli.records import Buffer, Channel, Message
from seaclutter_cli.sensors.packets import Packets
from seaclutter_cli.text import count

_LATEST_NS = np.iinfo(np.int64).max
_MAX_SLACK = 8
_MAX_DIMENSIONS = 16


@dataclass(frozen=True)
class Layout:
    """Fields of a packet message: a ``std_msgs/Header``, ``flags`` bytes, and one packet, or a sequence of ``many``.

    Each packet begins with a ``stamp`` and ``marks`` bytes, and has ``length`` reserved bytes, or is preceded by its
    length. If ``sized``, the number of used bytes follows it; if ``spare``, some drivers append a byte to lengths that
    are multiples of 4.
    """

    header: bool = True
    flags: int = 0
    many: bool = True
    stamp: bool = True
    marks: int = 0
    length: int | None = None
    sized: bool = False
    spare: bool = False


@dataclass(frozen=True)
class DriverMessage:
    """A message of a driver: the families whose packets it may contain, and its layouts, which its length tells apart.

    A companion is a topic with the calibration of the same sensor: its type, and a word in its name.
    """

    families: tuple[str, ...]
    layouts: tuple[Layout, ...]
    companion: tuple[str, str] | None = None


_HESAI, _RAW = ("hesai",), Layout(header=False, many=False, stamp=False, spare=True)
_SINGLE, _FIXED = Layout(flags=2, many=False, stamp=False), Layout(header=False, many=False, length=1248)
_OUSTER = DriverMessage(("ouster",), (_RAW,), ("std_msgs/msg/String", "metadata"))
_UDP_FRAMES = tuple(
    Layout(header=header, stamp=stamp, sized=True) for header in (True, False) for stamp in (True, False)
)
DRIVER_MESSAGES: Mapping[str, DriverMessage] = {
    "velodyne_msgs/msg/VelodyneScan": DriverMessage(("velodyne",), (Layout(length=1206),)),
    "pandar_msgs/msg/PandarScan": DriverMessage(_HESAI, (Layout(length=1500, sized=True),)),
    "rslidar_msg/msg/RslidarPacket": DriverMessage(("robosense",), (_SINGLE, _FIXED)),
    "rslidar_msg/msg/RslidarScan": DriverMessage(
        ("robosense",), (Layout(length=1248),), ("rslidar_msg/msg/RslidarPacket", "difop")
    ),
    "rslidar_msgs/msg/rslidarScan": DriverMessage(
        ("robosense",), (Layout(length=1248),), ("rslidar_msgs/msg/rslidarPacket", "")
    ),
    "rslidar_msgs/msg/rslidarPacket": DriverMessage(("robosense",), (_FIXED, _SINGLE)),
    "robosense_msgs/msg/RobosenseScan": DriverMessage(
        ("robosense",), (Layout(marks=1, length=1500, sized=True), Layout(length=1248, sized=True))
    ),
    "ouster_ros/msg/PacketMsg": _OUSTER,
    "ouster_sensor_msgs/msg/PacketMsg": _OUSTER,
    "hesai_lidar/msg/PandarScan": DriverMessage(_HESAI, (Layout(sized=True), Layout(length=1500, sized=True))),
    "nebula_msgs/msg/NebulaPackets": DriverMessage(("robosense", "velodyne", "hesai"), (Layout(),)),
    "hesai_ros_driver/msg/UdpFrame": DriverMessage(_HESAI, _UDP_FRAMES, ("std_msgs/msg/UInt8MultiArray", "correction")),
}
"""Messages of drivers by their ROS 2 type. Add new ones here."""

_MAKERS = "hesai|innoviz|innovusion|livox|lslidar|nebula|pandar|robosense|seyond|vanjee|velodyne"
_UNDECODED = re.compile(
    rf"({_MAKERS})\w*/msg/\w*(Packet|Scan)|sensor_msgs/msg/PointCloud|foxglove(_msgs/msg/|\.)LaserScan", re.IGNORECASE
)
"""Messages of lidar drivers, and clouds, that are not decoded unless they are in `DRIVER_MESSAGES`."""


def ros2_type(channel: Channel) -> str | None:
    """Return the ROS 2 name of the type of a channel's messages; None if they are not ROS messages."""
    if channel.schema is None or channel.message_encoding not in ("cdr", "ros1"):
        return None
    return full_name(channel.schema.name)


def is_undecoded(channel: Channel) -> bool:
    """Return whether the messages of a channel are known, but not decoded."""
    name = ros2_type(channel) or (channel.schema.name if channel.schema else "")
    return name not in DRIVER_MESSAGES and _UNDECODED.fullmatch(name) is not None


def packet_type(channel: Channel) -> str | None:
    """Return the ROS 2 name of the type of a channel's messages; None if they are not packets of a known layout."""
    typename = ros2_type(channel)
    return typename if typename in DRIVER_MESSAGES else None


def has_single_packets(channel: Channel) -> bool:
    """Return whether each message of a channel contains one packet."""
    return not DRIVER_MESSAGES[packet_type(channel) or ""].layouts[0].many


def runs(times_ns: Sequence[int], payloads: Sequence[Buffer]) -> Iterator[Packets]:
    """Yield packets in order, in runs of equal length."""
    sizes = np.array([len(payload) for payload in payloads], np.int64)
    for part in np.split(np.arange(len(sizes)), np.flatnonzero(np.diff(sizes)) + 1):
        if len(part):
            first, end = int(part[0]), int(part[-1]) + 1
            data = np.frombuffer(b"".join(payloads[first:end]), np.uint8).reshape(len(part), int(sizes[first]))
            yield Packets(np.array(times_ns[first:end], np.int64), data)


@dataclass(frozen=True)
class PacketMessage:
    """The packets in a message, and its frame id, None if it names none.

    Times are in Unix time, and the log time where the message has none.
    """

    times_ns: list[int]
    payloads: list[memoryview]
    frame_id: str | None

    @property
    def packets(self) -> list[Packets]:
        """The packets in order, in runs of equal length."""
        return list(runs(self.times_ns, self.payloads))


def read_packets(message: Message) -> PacketMessage:
    """Return the packets in a message; `CloudError` if it is truncated or has another layout."""
    first: CloudError | None = None
    for layout in DRIVER_MESSAGES[packet_type(message.channel) or ""].layouts:
        try:
            return _read(message, layout)
        except CloudError as error:
            first = first or error
    raise first or CloudError("the message has no known layout")


def _read(message: Message, layout: Layout) -> PacketMessage:
    read = reader_of(message)
    header = read.header() if layout.header else None
    read.take(layout.flags)
    times_ns, payloads = list[int](), list[memoryview]()
    for _ in range(read.number("I") if layout.many else 1):
        stamp_ns = read.time_ns() if layout.stamp else header.stamp_ns if header else 0
        read.take(layout.marks)
        packet = read.blob() if layout.length is None else read.take(layout.length)
        size = min(read.number("I"), len(packet)) if layout.sized else len(packet)
        payloads.append(packet[: size - (layout.spare and size % 4 == 1)])
        times_ns.append(stamp_ns or min(message.log_time_ns, _LATEST_NS))
    if read.left > _MAX_SLACK:
        raise CloudError(f"{count(read.left, 'byte')} follow the packets in the message")
    return PacketMessage(times_ns, payloads, header.frame_id if header else None)


def read_recorded(message: Message) -> bytes:
    """Return the file in a ``std_msgs/String`` or ``std_msgs/UInt8MultiArray``; `CloudError` if it is damaged."""
    read = reader_of(message)
    if ros2_type(message.channel) == "std_msgs/msg/String":
        return read.text().encode(errors="surrogateescape")
    for _ in range(read.length(_MAX_DIMENSIONS, "dimension")):
        read.text()
        read.numbers("II")
    read.number("I")
    return bytes(read.blob())
