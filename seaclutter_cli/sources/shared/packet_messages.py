"""Messages of lidar drivers that contain packets: their layouts and readers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from struct import unpack_from

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError
from seaclutter_cli.records import Buffer, Channel, Message
from seaclutter_cli.sensors.packets import Packets
from seaclutter_cli.text import count

NANO = 1_000_000_000
LATEST_NS = np.iinfo(np.int64).max
_MAX_SLACK = 8


@dataclass(frozen=True)
class Layout:
    """Fields of a packet message.

    Parameters
    ----------
    header : bool, optional
        Whether it begins with a ``std_msgs/Header``.
    flags : int, optional
        Bytes after the header.
    many : bool, optional
        Whether it contains a sequence of packets instead of one.
    stamp : bool, optional
        Whether each packet begins with a time.
    length : int, optional
        Bytes reserved for each packet; None if its length precedes it.
    sized : bool, optional
        Whether the number of used bytes follows each packet.
    spare : bool, optional
        Whether some drivers append an unused byte to packets, whose lengths are multiples of 4.
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


@dataclass(frozen=True)
class PacketMessage:
    """The packets in a message.

    Parameters
    ----------
    frame_id : str or None
        Coordinate frame; None if the message names none.
    times_ns : sequence of int
        Time of each packet in nanoseconds of Unix time; the log time if the message has none.
    payloads : sequence of bytes, memoryview or ndarray
        UDP payloads.
    """

    frame_id: str | None
    times_ns: Sequence[int]
    payloads: Sequence[Buffer]

    @property
    def packets(self) -> list[Packets]:
        """The packets in order, in runs of equal length."""
        return list(runs(self.times_ns, self.payloads))


@dataclass(frozen=True)
class Places:
    """Where messages of equal length with one packet may differ.

    Parameters
    ----------
    payload : slice
        Bytes of the UDP payload.
    stamp : int or None
        Offset of the stamp: two integers of 32 bits, seconds and nanoseconds; None if there is none.
    order : str
        Byte order of the integers, ``<`` or ``>``.
    fixed : ndarray, shape (F,)
        Bytes that do not differ: all but payload, stamp, sequence number and flags.
    """

    payload: slice
    stamp: int | None
    order: str
    fixed: NDArray[np.intp]


def runs(times_ns: Sequence[int], payloads: Sequence[Buffer]) -> Iterator[Packets]:
    """Yield packets in order, in runs of equal length."""
    sizes = np.array([len(payload) for payload in payloads], np.int64)
    for part in np.split(np.arange(len(sizes)), np.flatnonzero(np.diff(sizes)) + 1):
        if len(part):
            first, end = int(part[0]), int(part[-1]) + 1
            data = np.frombuffer(b"".join(payloads[first:end]), np.uint8).reshape(len(part), int(sizes[first]))
            yield Packets(np.array(times_ns[first:end], np.int64), data)


def read_packets(message: Message) -> PacketMessage:
    """Return the packets in a message; `CloudError` if it is truncated or has another layout."""
    return _read(message)[0]


def read_places(message: Message) -> tuple[PacketMessage, Places]:
    """Return the packet in a message that has one, and its place; `CloudError` as from `read_packets`."""
    read, reader = _read(message)
    is_fixed = np.ones(len(message.data), np.bool_)
    for place in (reader.payload, *reader.other):
        is_fixed[place] = False
    if reader.stamp is not None:
        is_fixed[reader.stamp : reader.stamp + 8] = False
    return read, Places(reader.payload, reader.stamp, reader.order, np.flatnonzero(is_fixed))


def _read(message: Message) -> tuple[PacketMessage, "_Reader"]:
    first: CloudError | None = None
    for layout in PACKET_LAYOUTS[packet_type(message.channel) or ""]:
        try:
            reader = _Reader(message)
            return reader.read(layout), reader
        except CloudError as error:
            first = first or error
    raise first or CloudError("the message has no known layout")


class _Reader:
    """Reader of the fields of a message, in order."""

    def __init__(self, message: Message) -> None:
        data = message.data
        self._data, self._size, self._log_ns = data, len(data), min(message.log_time_ns, LATEST_NS)
        self._ros1 = message.channel.message_encoding == "ros1"
        if not self._ros1 and (len(data) < 4 or data[0] != 0 or data[1] > 1):
            raise CloudError("the message does not start with a plain CDR header")
        self._start, self._align = (0, 1) if self._ros1 else (4, 4)
        self.order = "<" if self._ros1 or data[1] else ">"
        self._at = self._start
        self.payload = slice(0)
        self.stamp: int | None = None
        self.other: list[slice] = []

    def read(self, layout: Layout) -> PacketMessage:
        """Return the packets in the message."""
        frame_id, stamp_ns = self._header() if layout.header else (None, 0)
        self.other.append(slice(self._at, self._at + layout.flags))
        self._at += layout.flags
        number = self._number() if layout.many else 1
        if layout.length is not None:
            times_ns, payloads = self._reserved(layout, layout.length, number)
        else:
            times_ns, payloads = self._counted(layout, number, stamp_ns)
        return PacketMessage(frame_id, times_ns, payloads)

    def _numbers(self, number: int) -> tuple[int, ...]:
        """Return unsigned integers of 32 bits, which are aligned."""
        at = self._at + -(self._at - self._start) % self._align
        self._at = at + 4 * number
        if self._at > self._size:
            raise CloudError(f"the message is truncated at byte {self._size}")
        return unpack_from(f"{self.order}{number}I", self._data, at)

    def _number(self) -> int:
        return self._numbers(1)[0]

    def _header(self) -> tuple[str, int]:
        """Return the frame id and the stamp of a header."""
        if self._ros1:
            self.other.append(slice(self._at, self._at + 4))
            self._at += 4
        self.stamp = self._at
        sec, nanosec, size = self._numbers(3)
        begin, left = self._at, self._size - self._at
        if size > left:
            raise CloudError(
                f"the message declares a frame id of {count(size, 'byte')}, but contains only {left:,} more"
            )
        self._at += size
        name = bytes(self._data[begin : self._at]).decode(errors="surrogateescape")
        return name if self._ros1 else name.removesuffix("\0"), sec * NANO + nanosec

    def _reserved(self, layout: Layout, length: int, number: int) -> tuple[list[int], list[Buffer]]:
        """Return times and payloads of packets of a fixed size."""
        at = self._at + -(self._at - self._start) % self._align
        number_type = self.order + "u4"
        fields = [("sec", number_type), ("nanosec", number_type), ("data", "u1", (length,))]
        packet = np.dtype([*fields, ("size", number_type)] if layout.sized else fields)
        step = packet.itemsize + -packet.itemsize % self._align
        needed, found = (number - 1) * step + packet.itemsize if number else 0, self._size - at
        if not 0 <= found - needed <= _MAX_SLACK:
            declared = f"{count(number, 'packet')} of {count(needed, 'byte')} in all"
            raise CloudError(f"the message declares {declared}, but contains {found:,}")
        packets = np.ndarray((number,), packet, self._data, at, (step,))
        sizes = np.minimum(packets["size"], length).tolist() if layout.sized else [length] * number
        view, begin = memoryview(self._data), at + 8
        self.stamp, self.payload = at, slice(begin, begin + length)
        spans = zip(range(begin, begin + number * step, step), sizes, strict=True)
        return self._times(packets), [view[start : start + size] for start, size in spans]

    def _times(self, packets: NDArray[np.void]) -> list[int]:
        times_ns = packets["sec"].astype(np.int64) * NANO + packets["nanosec"]
        times_ns[times_ns == 0] = self._log_ns
        times: list[int] = times_ns.tolist()
        return times

    def _counted(self, layout: Layout, number: int, stamp_ns: int) -> tuple[list[int], list[Buffer]]:
        """Return times and payloads of packets whose lengths precede them."""
        times_ns: list[int] = []
        payloads: list[Buffer] = []
        view = memoryview(self._data)
        for _ in range(number):
            if layout.stamp:
                sec, nanosec, size = self._numbers(3)
                stamp_ns = sec * NANO + nanosec
            else:
                size = self._number()
            begin, self._at = self._at, self._at + size
            if self._at > self._size:
                left = self._size - begin
                raise CloudError(
                    f"the message declares a packet of {count(size, 'byte')}, but contains only {left:,} more"
                )
            if layout.sized:
                size = min(self._number(), size)
            if layout.spare and size % 4 == 1:
                size -= 1
            self.payload = slice(begin, begin + size)
            times_ns.append(stamp_ns or self._log_ns)
            payloads.append(view[begin : begin + size])
        if self._size - self._at > _MAX_SLACK:
            raise CloudError(f"{count(self._size - self._at, 'byte')} follow the packets in the message")
        return times_ns, payloads
