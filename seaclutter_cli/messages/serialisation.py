"""ROS serialisation: aligned CDR of ROS 2, packed bytes of ROS 1."""

import struct
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import FIELD_TYPES, MAX_FIELDS, Cloud, PointField
from seaclutter_cli.errors import CloudError
from seaclutter_cli.records import Buffer, Message
from seaclutter_cli.text import count

Ros = Literal[1, 2]
"""Major version of ROS, which determines the serialisation."""

NANO = 1_000_000_000
_CDR_BIG_ENDIAN, _CDR_LITTLE_ENDIAN = 0, 1


def version_of(encoding: str) -> Ros:
    """Return the version of ROS whose messages have an encoding, ``ros1`` or ``cdr``."""
    return 1 if encoding == "ros1" else 2


@dataclass(frozen=True, slots=True)
class Header:
    """A ``std_msgs/Header``; ``sequence`` is None in ROS 2, which has none."""

    stamp_ns: int
    frame_id: str
    sequence: int | None = None


def field_type(number: int, name: str, types: Sequence[str]) -> str:
    """Return the type of a field with a number from 1."""
    if not 1 <= number <= len(types):
        raise CloudError(f"field {name!r} has unknown type {number}")
    return types[number - 1]


class Reader:
    """Reader for the values of a message of a version of ROS; `CloudError` if it is truncated or not in plain CDR."""

    def __init__(self, data: Buffer, ros: Ros) -> None:
        self.ros = ros
        self._data = memoryview(data)
        self._at, self._order = 0, "<"
        if ros == 2:
            if len(data) < 4 or data[0] != 0 or data[1] not in (_CDR_BIG_ENDIAN, _CDR_LITTLE_ENDIAN):
                raise CloudError("the message does not start with a plain CDR header")
            self._at, self._order = 4, "<" if data[1] == _CDR_LITTLE_ENDIAN else ">"
        self._start = self._at

    def number(self, code: str) -> Any:
        """Return a number of a type of `struct`."""
        size = struct.calcsize(code)
        self.align(size)
        return struct.unpack(self._order + code, self.take(size))[0]

    def numbers(self, codes: str) -> tuple[Any, ...]:
        """Return several numbers."""
        return tuple(self.number(code) for code in codes)

    def blob(self, bytes_each: int = 1) -> memoryview:
        """Return a sequence of bytes, or of values of several bytes."""
        if size := bytes_each * self.number("I"):
            self.align(bytes_each)
        return self.take(size, is_declared=True)

    def floats(self) -> NDArray[np.float32]:
        """Return a sequence of float32 numbers as a view."""
        return np.frombuffer(self.blob(4), self._order + "f4")

    def text(self) -> str:
        """Return a string; bytes that are not UTF-8 become surrogates."""
        raw = bytes(self.blob())
        return (raw[:-1] if self.ros == 2 else raw).decode(errors="surrogateescape")

    def time_ns(self) -> int:
        """Return a time in nanoseconds."""
        seconds = self.number("I" if self.ros == 1 else "i")
        return int(seconds * NANO + self.number("I"))

    def header(self) -> Header:
        """Return a header."""
        sequence = self.number("I") if self.ros == 1 else None
        return Header(self.time_ns(), self.text(), sequence)

    def length(self, most: int, what: str) -> int:
        """Return the length of a sequence of structures, which must not exceed ``most``."""
        number = int(self.number("I"))
        if number > most:
            raise CloudError(f"the message declares {count(number, what)}, at most {most} are supported")
        return number

    def fields(self, types: Sequence[str] = FIELD_TYPES, *, counted: bool = True) -> tuple[PointField, ...]:
        """Return a sequence of fields, whose types have numbers from 1; without counts, each has one value."""
        found = []
        for _ in range(self.length(MAX_FIELDS, "field")):
            name, offset, kind = self.text(), self.number("I"), self.number("B")
            number = self.number("I") if counted else 1
            found.append(PointField(name, offset, field_type(kind, name, types), number))
        return tuple(found)

    def align(self, size: int) -> None:
        """Skip padding before values of a size."""
        if self.ros == 2:
            self._at += -(self._at - self._start) % size

    def take(self, size: int, *, is_declared: bool = False) -> memoryview:
        """Return the next bytes, whose number the message may declare."""
        if size > self.left:
            if is_declared:
                left = max(self.left, 0)
                raise CloudError(f"the message declares {count(size, 'byte')}, but contains only {left:,} more")
            raise CloudError(f"the message is truncated at byte {len(self._data)}")
        self._at += size
        return self._data[self._at - size : self._at]

    @property
    def big_endian(self) -> bool:
        """Whether the most significant byte of a number comes first."""
        return self._order == ">"

    @property
    def left(self) -> int:
        """Number of bytes that are not read yet."""
        return len(self._data) - self._at


def reader_of(message: Message) -> Reader:
    """Return a reader of a ROS message."""
    return Reader(message.data, version_of(message.channel.message_encoding))


class Writer:
    """Writer for the values of a message, the counterpart of `Reader`; CDR is written in little endian."""

    def __init__(self, ros: Ros) -> None:
        self.ros = ros
        self._parts: list[Buffer] = []
        self._size = 0

    def number(self, code: str, value: float) -> None:
        """Write a number."""
        self.align(struct.calcsize(code))
        self.raw(struct.pack("<" + code, value))

    def numbers(self, codes: str, values: Sequence[float]) -> None:
        """Write several numbers."""
        for code, value in zip(codes, values, strict=True):
            self.number(code, value)

    def blob(self, data: Buffer) -> None:
        """Write a sequence of bytes."""
        self.number("I", len(data))
        self.raw(data)

    def floats(self, values: NDArray[np.float32]) -> None:
        """Write a sequence of float32 numbers."""
        self.number("I", len(values))
        self.raw(values.astype("<f4", copy=False).tobytes())

    def text(self, value: str) -> None:
        """Write a string."""
        self.blob(value.encode(errors="surrogateescape") + (b"\0" if self.ros == 2 else b""))

    def time_ns(self, stamp_ns: int) -> None:
        """Write a time in nanoseconds; a stamp from a faulty clock may have up to 4 s in nanoseconds."""
        least, most = (0, 2**32 - 1) if self.ros == 1 else (-(2**31), 2**31 - 1)
        seconds = min(max(stamp_ns // NANO, least), most)
        nanoseconds = stamp_ns - seconds * NANO
        if not 0 <= nanoseconds < 2**32:
            raise CloudError(f"stamp {stamp_ns} ns does not fit into a ROS header")
        self.number("I" if self.ros == 1 else "i", seconds)
        self.number("I", nanoseconds)

    def header(self, header: Header) -> None:
        """Write a header."""
        if self.ros == 1:
            self.number("I", header.sequence or 0)
        self.time_ns(header.stamp_ns)
        self.text(header.frame_id)

    def fields(self, fields: Sequence[PointField], types: Sequence[str] = FIELD_TYPES, *, counted: bool = True) -> None:
        """Write a sequence of fields, as `Reader.fields` reads it."""
        self.number("I", len(fields))
        for field in fields:
            self.text(field.name)
            self.number("I", field.offset)
            self.number("B", types.index(field.type) + 1)
            if counted:
                self.number("I", field.count)

    def raw(self, data: Buffer) -> None:
        """Write bytes as they are."""
        self._parts.append(data)
        self._size += len(data)

    def message(self) -> bytes:
        """Return the message."""
        prefix = bytes((0, _CDR_LITTLE_ENDIAN, 0, 0)) if self.ros == 2 else b""
        return b"".join((prefix, *self._parts))

    def align(self, size: int) -> None:
        """Write padding before values of a size."""
        if self.ros == 2 and (padding := -self._size % size):
            self.raw(bytes(padding))


class RosCodec(ABC):
    """Base of the codecs for messages of a version of ROS; those of ROS 2 are read in either byte order."""

    def __init__(self, ros: Ros) -> None:
        self._ros: Ros = ros

    def decode(self, data: Buffer) -> Cloud:
        """Return the cloud in a message, a view of points that are not compressed; `CloudError` if it is not valid."""
        return self._read(Reader(data, self._ros))

    def encode(self, cloud: Cloud) -> bytes:
        """Return a cloud as the bytes of a message."""
        write = Writer(self._ros)
        self._write(write, cloud)
        return write.message()

    @abstractmethod
    def _read(self, read: Reader) -> Cloud: ...

    @abstractmethod
    def _write(self, write: Writer, cloud: Cloud) -> None: ...
