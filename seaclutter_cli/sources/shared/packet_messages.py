"""Messages of lidar drivers that contain packets: their layouts, and their packets."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from struct import unpack_from

import numpy as np

from seaclutter_cli.errors import CloudError
from seaclutter_cli.records import Buffer, Channel, Message
from seaclutter_cli.sensors.packets import Packets
from seaclutter_cli.text import count

_NANO = 1_000_000_000
_LATEST_NS = np.iinfo(np.int64).max
_MAX_SLACK = 8


@dataclass(frozen=True)
class Layout:
    """Fields of a packet message: a ``std_msgs/Header``, ``flags`` bytes, and one packet, or a sequence of ``many``.

    Each packet begins with a ``stamp``, and has ``length`` reserved bytes, or is preceded by its length. If ``sized``,
    the number of used bytes follows it; if ``spare``, some drivers append a byte to lengths that are multiples of 4.
    """

    header: bool = True
    flags: int = 0
    many: bool = True
    stamp: bool = True
    length: int | None = None
    sized: bool = False
    spare: bool = False


_OUSTER = (Layout(header=False, many=False, stamp=False, spare=True),)
_ROBOSENSE = Layout(header=False, many=False, length=1248)

PACKET_LAYOUTS: Mapping[str, tuple[Layout, ...]] = {
    "velodyne_msgs/msg/VelodyneScan": (Layout(length=1206),),
    "pandar_msgs/msg/PandarScan": (Layout(length=1500, sized=True),),
    "rslidar_msg/msg/RslidarPacket": (Layout(flags=2, many=False, stamp=False), _ROBOSENSE),
    "rslidar_msg/msg/RslidarScan": (Layout(length=1248),),
    "rslidar_msgs/msg/rslidarScan": (Layout(length=1248),),
    "rslidar_msgs/msg/rslidarPacket": (_ROBOSENSE, Layout(flags=2, many=False, stamp=False)),
    "ouster_ros/msg/PacketMsg": _OUSTER,
    "ouster_sensor_msgs/msg/PacketMsg": _OUSTER,
    "hesai_lidar/msg/PandarScan": (Layout(sized=True), Layout(length=1500, sized=True)),
    "nebula_msgs/msg/NebulaPackets": (Layout(),),
    "hesai_ros_driver/msg/UdpFrame": tuple(
        Layout(header=header, stamp=stamp, sized=True) for header in (True, False) for stamp in (True, False)
    ),
}
"""Layouts by message type; add new ones here, and to a family's ``scan_types``.

The length of a message distinguishes versions of drivers that share a type name.
"""

_CLOUDS = "record the driver's sensor_msgs/PointCloud2"
_SCANS = f"{_CLOUDS}, or its messages of whole scans"
_CONVERT = "convert it to sensor_msgs/PointCloud2"
UNSUPPORTED: Mapping[str, str] = {
    "robosense_msgs/msg/RobosenseScan": f"{_CLOUDS}, or the packets with rslidar_sdk",
    **dict.fromkeys(
        (
            "innovusion_msgs/msg/InnovusionPacket",
            "innovusion_msgs/msg/InnovusionScan",
            "innoviz_msgs/msg/InnovizScan",
            "livox_msgs/msg/LidarScan",
            "lslidar_msgs/msg/LslidarPacket",
            "lslidar_msgs/msg/LslidarScan",
            "seyond/msg/SeyondScan",
            "vanjee_lidar_msg/msg/VanjeelidarPacket",
        ),
        _CLOUDS,
    ),
    **dict.fromkeys(
        (
            "hesai_lidar/msg/PandarPacket",
            "hesai_ros_driver/msg/UdpPacket",
            "nebula_msgs/msg/NebulaPacket",
            "pandar_msgs/msg/PandarJumboPacket",
            "pandar_msgs/msg/PandarPacket",
            "robosense_msgs/msg/RobosensePacket",
            "velodyne_msgs/msg/VelodynePacket",
        ),
        _SCANS,
    ),
    **dict.fromkeys(("sensor_msgs/msg/PointCloud", "foxglove_msgs/msg/LaserScan", "foxglove.LaserScan"), _CONVERT),
}
"""Known messages of lidar drivers and clouds that are not decoded, and what is needed instead."""


def ros2_type(channel: Channel) -> str | None:
    """Return the ROS 2 name of the type of a channel's messages; None if they are not ROS messages."""
    if channel.schema is None or channel.message_encoding not in ("cdr", "ros1"):
        return None
    return _ros2_name(channel.schema.name)


@lru_cache(maxsize=1024)
def _ros2_name(typename: str) -> str:
    package, _, name = typename.partition("/")
    return f"{package}/msg/{name.removeprefix('msg/')}"


def advice_on(channel: Channel) -> str | None:
    """Return what is needed instead of the messages of a channel; None if they are not known to be unsupported."""
    name = channel.schema.name if channel.schema else ""
    return UNSUPPORTED.get(ros2_type(channel) or name)


def packet_type(channel: Channel) -> str | None:
    """Return the ROS 2 name of the type of a channel's messages; None if they are not packets of a known layout."""
    typename = ros2_type(channel)
    return typename if typename in PACKET_LAYOUTS else None


def has_single_packets(channel: Channel) -> bool:
    """Return whether each message of a channel contains one packet."""
    return not PACKET_LAYOUTS[packet_type(channel) or ""][0].many


def runs(times_ns: Sequence[int], payloads: Sequence[Buffer]) -> Iterator[Packets]:
    """Yield packets in order, in runs of equal length."""
    sizes = np.array([len(payload) for payload in payloads], np.int64)
    for part in np.split(np.arange(len(sizes)), np.flatnonzero(np.diff(sizes)) + 1):
        if len(part):
            first, end = int(part[0]), int(part[-1]) + 1
            data = np.frombuffer(b"".join(payloads[first:end]), np.uint8).reshape(len(part), int(sizes[first]))
            yield Packets(np.array(times_ns[first:end], np.int64), data)


def read_packets(message: Message) -> "PacketMessage":
    """Return the packets in a message; `CloudError` if it is truncated or has another layout."""
    first: CloudError | None = None
    for layout in PACKET_LAYOUTS[packet_type(message.channel) or ""]:
        try:
            return PacketMessage(message, layout)
        except CloudError as error:
            first = first or error
    raise first or CloudError("the message has no known layout")


class PacketMessage:
    """The packets in a message, and its frame id, None if it names none.

    Times are in Unix time, and the log time where the message has none.
    """

    def __init__(self, message: Message, layout: Layout) -> None:
        data = message.data
        self._data, self._size, self._log_ns = memoryview(data), len(data), min(message.log_time_ns, _LATEST_NS)
        self._ros1 = message.channel.message_encoding == "ros1"
        if not self._ros1 and (len(data) < 4 or data[0] != 0 or data[1] > 1):
            raise CloudError("the message does not start with a plain CDR header")
        self._start, self._align = (0, 1) if self._ros1 else (4, 4)
        self._order = "<" if self._ros1 or data[1] else ">"
        self._at = self._start
        self.frame_id: str | None = None
        stamp_ns = self._read_header() if layout.header else 0
        self._at += layout.flags
        number = self._number() if layout.many else 1
        self.times_ns: list[int] = []
        self.payloads: list[Buffer] = []
        for _ in range(number):
            self._read_packet(layout, stamp_ns)
        if self._size - self._at > _MAX_SLACK:
            raise CloudError(f"{count(self._size - self._at, 'byte')} follow the packets in the message")

    @property
    def packets(self) -> list[Packets]:
        """The packets in order, in runs of equal length."""
        return list(runs(self.times_ns, self.payloads))

    def _numbers(self, number: int) -> tuple[int, ...]:
        """Return unsigned integers of 32 bits, which are aligned."""
        at = self._at + -(self._at - self._start) % self._align
        self._at = at + 4 * number
        if self._at > self._size:
            raise CloudError(f"the message is truncated at byte {self._size}")
        return unpack_from(f"{self._order}{number}I", self._data, at)

    def _number(self) -> int:
        return self._numbers(1)[0]

    def _read_header(self) -> int:
        """Read the frame id, and return the stamp."""
        self._at += 4 * self._ros1
        sec, nanosec, size = self._numbers(3)
        begin, left = self._at, self._size - self._at
        if size > left:
            raise CloudError(
                f"the message declares a frame id of {count(size, 'byte')}, but contains only {left:,} more"
            )
        self._at += size
        name = bytes(self._data[begin : self._at]).decode(errors="surrogateescape")
        self.frame_id = name if self._ros1 else name.removesuffix("\0")
        return sec * _NANO + nanosec

    def _read_packet(self, layout: Layout, stamp_ns: int) -> None:
        if layout.stamp:
            sec, nanosec = self._numbers(2)
            stamp_ns = sec * _NANO + nanosec
        size = self._number() if layout.length is None else layout.length
        begin, self._at = self._at, self._at + size
        if self._at > self._size:
            left = self._size - begin
            raise CloudError(f"the message declares a packet of {count(size, 'byte')}, but contains only {left:,} more")
        if layout.sized:
            size = min(self._number(), size)
        if layout.spare and size % 4 == 1:
            size -= 1
        self.times_ns.append(stamp_ns or self._log_ns)
        self.payloads.append(self._data[begin : begin + size])
