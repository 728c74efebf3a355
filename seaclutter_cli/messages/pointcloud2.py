"""Codecs for ``sensor_msgs/PointCloud2`` in ROS 2 (CDR) and ROS 1 serialisation."""

import struct

from seaclutter_cli.cloud import FIELD_TYPES, Cloud, PointField
from seaclutter_cli.errors import CloudError
from seaclutter_cli.records import Buffer
from seaclutter_cli.text import count

_NANO = 1_000_000_000
_MAX_FIELDS = 1024


class _Reader:
    """Reader for the values of a message; ``align`` is false for ROS 1, which packs its fields."""

    def __init__(self, data: Buffer, *, start: int, order: str, align: bool, terminated: bool) -> None:
        self._data = memoryview(data)
        self._at = self._start = start
        self._order = order
        self._align = align
        self._terminated = terminated

    def number(self, code: str) -> int:
        size = struct.calcsize(code)
        if self._align:
            self._at += -(self._at - self._start) % size
        try:
            value: int = struct.unpack_from(self._order + code, self._data, self._at)[0]
        except struct.error:
            raise CloudError(f"the message is truncated at byte {len(self._data)}") from None
        self._at += size
        return value

    def blob(self) -> memoryview:
        size = self.number("I")
        if size > len(self._data) - self._at:
            left = len(self._data) - self._at
            raise CloudError(f"the message declares {count(size, 'byte')}, but contains only {left:,} more")
        self._at += size
        return self._data[self._at - size : self._at]

    def text(self) -> str:
        raw = bytes(self.blob())
        return (raw[:-1] if self._terminated else raw).decode(errors="surrogateescape")


def _decode(read: _Reader, *, with_sequence: bool) -> Cloud:
    extra = read.number("I") if with_sequence else None
    seconds = read.number("I" if with_sequence else "i")
    stamp_ns = seconds * _NANO + read.number("I")
    frame_id = read.text()
    height, width = read.number("I"), read.number("I")
    number = read.number("I")
    if number > _MAX_FIELDS:
        raise CloudError(f"the message declares {number:,} fields, at most {_MAX_FIELDS} are supported")
    fields = tuple(_field(read) for _ in range(number))
    big_endian = bool(read.number("B"))
    point_step, row_step = read.number("I"), read.number("I")
    data = read.blob()
    dense = bool(read.number("B"))
    return Cloud(stamp_ns, frame_id, height, width, fields, point_step, row_step, big_endian, dense, data, extra)


def _field(read: _Reader) -> PointField:
    name, offset, datatype, count = read.text(), read.number("I"), read.number("B"), read.number("I")
    if not 1 <= datatype <= len(FIELD_TYPES):
        raise CloudError(f"field {name!r} has unknown type {datatype}")
    return PointField(name, offset, FIELD_TYPES[datatype - 1], count)


def _split(stamp_ns: int, least: int, most: int) -> tuple[int, int]:
    """Return seconds and nanoseconds; a stamp from a faulty clock may have up to 4 s in nanoseconds."""
    seconds = min(max(stamp_ns // _NANO, least), most)
    nanoseconds = stamp_ns - seconds * _NANO
    if not 0 <= nanoseconds < 2**32:
        raise CloudError(f"stamp {stamp_ns} ns does not fit into a ROS header")
    return seconds, nanoseconds


class _Writer:
    """Writer for the values of a message; the counterpart of `_Reader`."""

    def __init__(self, *, align: bool, terminated: bool) -> None:
        self._parts: list[Buffer] = []
        self._size = 0
        self._align = align
        self._terminated = terminated

    def number(self, code: str, value: int) -> None:
        size = struct.calcsize(code)
        padding = -self._size % size if self._align else 0
        self.raw(bytes(padding) + struct.pack("<" + code, value))

    def text(self, value: str) -> None:
        raw = value.encode(errors="surrogateescape") + (b"\0" if self._terminated else b"")
        self.number("I", len(raw))
        self.raw(raw)

    def raw(self, data: Buffer) -> None:
        self._parts.append(data)
        self._size += len(data)

    def message(self, prefix: bytes = b"") -> bytes:
        return b"".join((prefix, *self._parts))


def _encode(write: _Writer, cloud: Cloud, *, with_sequence: bool) -> None:
    if with_sequence:
        write.number("I", cloud.extra or 0)
    seconds, nanoseconds = _split(cloud.stamp_ns, *((0, 2**32 - 1) if with_sequence else (-(2**31), 2**31 - 1)))
    write.number("I" if with_sequence else "i", seconds)
    write.number("I", nanoseconds)
    write.text(cloud.frame_id)
    for value in (cloud.height, cloud.width, len(cloud.fields)):
        write.number("I", value)
    for field in cloud.fields:
        write.text(field.name)
        write.number("I", field.offset)
        write.number("B", FIELD_TYPES.index(field.type) + 1)
        write.number("I", field.count)
    write.number("B", cloud.big_endian)
    for value in (cloud.point_step, cloud.row_step, len(cloud.data)):
        write.number("I", value)
    write.raw(cloud.data)
    write.number("B", cloud.dense)


_CDR_BIG_ENDIAN, _CDR_LITTLE_ENDIAN = 0, 1


class CdrPointCloud2:
    """Codec for ROS 2: aligned CDR, read in either byte order, written in little endian."""

    def decode(self, data: Buffer) -> Cloud:
        """Return a cloud whose points are a view of the message.

        Raises
        ------
        CloudError
            If the bytes are not a valid PointCloud2 in plain CDR.
        """
        if len(data) < 4 or data[0] != 0 or data[1] not in (_CDR_BIG_ENDIAN, _CDR_LITTLE_ENDIAN):
            raise CloudError("the message does not start with a plain CDR header")
        order = "<" if data[1] == _CDR_LITTLE_ENDIAN else ">"
        return _decode(_Reader(data, start=4, order=order, align=True, terminated=True), with_sequence=False)

    def encode(self, cloud: Cloud) -> bytes:
        """Return a cloud as the bytes of a message."""
        write = _Writer(align=True, terminated=True)
        _encode(write, cloud, with_sequence=False)
        return write.message(prefix=bytes((0, _CDR_LITTLE_ENDIAN, 0, 0)))


class Ros1PointCloud2:
    """Codec for ROS 1: packed, little endian; ``Cloud.extra`` contains the sequence number of the header."""

    def decode(self, data: Buffer) -> Cloud:
        """Return a cloud whose points are a view of the message.

        Raises
        ------
        CloudError
            If the bytes are not a valid PointCloud2.
        """
        return _decode(_Reader(data, start=0, order="<", align=False, terminated=False), with_sequence=True)

    def encode(self, cloud: Cloud) -> bytes:
        """Return a cloud as the bytes of a message."""
        write = _Writer(align=False, terminated=False)
        _encode(write, cloud, with_sequence=True)
        return write.message()
