"""Values of ROS messages in both serialisations: packed as in ROS 1, and aligned as in ROS 2 (CDR).

A message is read into values and written from them. A value is a piece of the message where possible: numbers that
follow each other without padding are one `Block`.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.records import Buffer

CDR_HEAD = bytes((0, 1, 0, 0))
"""Encapsulation of a message in little-endian CDR."""

_MORE_ITEMS = 10_000


class TranslationError(SeaclutterError):
    """A message, or a type of messages, that cannot be translated."""


class Reader:
    """Position in a message.

    Parameters
    ----------
    data : bytes or memoryview
        The message.
    cdr : bool
        Whether it is aligned and begins with an encapsulation.
    """

    def __init__(self, data: Buffer, *, cdr: bool) -> None:
        self.data, self.cdr = memoryview(data), cdr
        self.at = self.start = 4 if cdr else 0
        self.big_endian = False
        if cdr:
            if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
                raise TranslationError("the message does not start with a plain CDR header")
            self.big_endian = data[1] == 0
        # A definition can make items without any bytes, of which a few bytes could declare billions.
        self._items = len(data) + _MORE_ITEMS

    def align(self, size: int) -> None:
        """Skip padding before values of a size."""
        if self.cdr:
            self.at += -(self.at - self.start) % size

    def take(self, size: int) -> memoryview:
        """Return the next bytes."""
        if size > len(self.data) - self.at:
            raise TranslationError(f"the message is truncated at byte {len(self.data)}")
        self.at += size
        return self.data[self.at - size : self.at]

    def length(self) -> int:
        """Return the length of a text or sequence."""
        self.align(4)
        return int(struct.unpack(">I" if self.big_endian else "<I", self.take(4))[0])

    def count(self, items: int) -> None:
        """Raise `TranslationError` if a message of this size cannot have as many items."""
        self._items -= items
        if self._items < 0:
            raise TranslationError("the message declares more items than it has bytes")


class Writer:
    """Parts of a message that is written."""

    def __init__(self, *, cdr: bool) -> None:
        self.cdr = cdr
        self.parts: list[Buffer] = [CDR_HEAD] if cdr else []
        self._size = 0

    def align(self, size: int) -> None:
        """Add padding before values of a size."""
        if self.cdr and (padding := -self._size % size):
            self.put(bytes(padding))

    def put(self, data: Buffer) -> None:
        """Add bytes."""
        self.parts.append(data)
        self._size += len(data)

    def length(self, value: int) -> None:
        """Add the length of a text or sequence."""
        self.align(4)
        self.put(struct.pack("<I", value))


class Node(Protocol):
    """A part of the layout of a message."""

    @property
    def default(self) -> Any:
        """Value of a part that the other ROS version lacks."""
        ...

    def read(self, read: Reader) -> Any:
        """Return the value at the position of the reader."""
        ...

    def write(self, write: Writer, value: Any) -> None:
        """Add a value."""
        ...


@dataclass(frozen=True, slots=True)
class Block:
    """Numbers of one size, without padding between them; ``kind`` is their type, empty if they are of several."""

    size: int
    count: int = 1
    kind: str = ""

    @property
    def default(self) -> bytes:
        """Zeros."""
        return bytes(self.size * self.count)

    def read(self, read: Reader) -> Buffer:
        """Return the bytes of the numbers, in little endian."""
        return self.read_many(read, 1)

    def read_many(self, read: Reader, times: int) -> Buffer:
        """Return the bytes of several such blocks."""
        read.align(self.size)
        data = read.take(self.size * self.count * times)
        if read.big_endian and self.size > 1:
            return np.frombuffer(data, f">u{self.size}").astype(f"<u{self.size}").tobytes()
        return data

    def write(self, write: Writer, value: Buffer) -> None:
        """Add the numbers."""
        write.align(self.size)
        write.put(value)


@dataclass(frozen=True, slots=True)
class Text:
    """A string, which ends in a zero in CDR."""

    default = b""

    def read(self, read: Reader) -> Buffer:
        """Return the text without its end."""
        data = read.take(read.length())
        return data[:-1] if read.cdr and len(data) and data[-1] == 0 else data

    def write(self, write: Writer, value: Buffer) -> None:
        """Add the text."""
        write.length(len(value) + write.cdr)
        write.put(value)
        if write.cdr:
            write.put(b"\0")


@dataclass(frozen=True, slots=True)
class Absent:
    """Bytes that only one serialisation has: the sequence number of a ROS 1 header, the byte of an empty struct."""

    size: int
    in_cdr: bool

    @property
    def default(self) -> bytes:
        """Zeros."""
        return bytes(self.size)

    def read(self, read: Reader) -> Buffer:
        """Return the bytes, or zeros."""
        return read.take(self.size) if read.cdr == self.in_cdr else self.default

    def write(self, write: Writer, value: Buffer) -> None:
        """Add the bytes where the serialisation has them."""
        if write.cdr == self.in_cdr:
            write.put(value)


@dataclass(frozen=True)
class Struct:
    """Fields of a message, in order."""

    fields: tuple[tuple[str, Node], ...]

    @cached_property
    def nodes(self) -> tuple[Node, ...]:
        """Layouts of the fields."""
        return tuple(node for _, node in self.fields)

    @property
    def default(self) -> list[Any]:
        """Values of the fields."""
        return [node.default for node in self.nodes]

    def read(self, read: Reader) -> list[Any]:
        """Return the values of the fields."""
        return [node.read(read) for node in self.nodes]

    def write(self, write: Writer, value: Sequence[Any]) -> None:
        """Add the values of the fields."""
        for node, part in zip(self.nodes, value, strict=True):
            node.write(write, part)


@dataclass(frozen=True, slots=True)
class Items:
    """A sequence, or an array of fixed ``length``."""

    item: Node
    length: int | None = None

    @property
    def default(self) -> Any:
        """No items, or those of an array."""
        if isinstance(self.item, Block):
            return b""
        return [self.item.default for _ in range(self.length or 0)]

    def read(self, read: Reader) -> Any:
        """Return the items; numbers as one piece of bytes."""
        length = read.length() if self.length is None else self.length
        if isinstance(self.item, Block):
            return self.item.read_many(read, length) if length else b""
        read.count(length)
        return [self.item.read(read) for _ in range(length)]

    def write(self, write: Writer, value: Any) -> None:
        """Add the items."""
        block = self.item if isinstance(self.item, Block) else None
        if self.length is None:
            write.length(len(value) // (block.size * block.count) if block else len(value))
        if block is not None:
            if len(value):
                block.write(write, value)
            return
        for one in value:
            self.item.write(write, one)
