"""Layouts of ROS messages: how definitions describe the values of a message in both serialisations.

A message is read into values and written from them. A value is a piece of the message where possible: an array of
numbers is one block. Definitions are parsed, and hashed, by rosbags. Its converters are not
used: they are Python code made from definitions, and nothing in a log should become code.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from seaclutter_cli.errors import SeaclutterError
from seaclutter_cli.messages.definitions import full_name, typestore
from seaclutter_cli.messages.serialisation import Reader, Ros, Writer
from seaclutter_cli.records import Buffer, Schema

Types = Mapping[str, tuple[Any, Any]]
"""Constants and fields of message types by their full name, as rosbags describes them."""

_HEADER, _TIME = "std_msgs/msg/Header", "builtin_interfaces/msg/Time"
_SIZES = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}
_PLACEHOLDER = "structure_needs_at_least_one_member"
_MAX_DEFINITION = 2**18
_MAX_FIELDS, _MAX_DEPTH = 10_000, 50
_MORE_ITEMS = 10_000


class TranslationError(SeaclutterError):
    """A message, or a type of messages, that cannot be translated."""


class ItemReader(Reader):
    """Reader that bounds the number of items, since a definition can make items without any bytes."""

    def __init__(self, data: Buffer, ros: Ros) -> None:
        super().__init__(data, ros)
        self._items = len(data) + _MORE_ITEMS

    def count(self, items: int) -> None:
        """Raise `TranslationError` if a message of this size cannot have as many items."""
        self._items -= items
        if self._items < 0:
            raise TranslationError("the message declares more items than it has bytes")


class _Zeros(ItemReader):
    """Reader of a message that is all zeros, which has the values of fields that the other version of ROS lacks."""

    def take(self, size: int, *, is_declared: bool = False) -> memoryview:  # noqa: ARG002
        return memoryview(bytes(size))


@dataclass(frozen=True, slots=True)
class _Block:
    """A number, or an array of several, of some type and size."""

    kind: str
    size: int
    count: int = 1

    def read(self, read: Reader, times: int = 1) -> Buffer:
        """Return the bytes of one or several such blocks, in little endian."""
        read.align(self.size)
        data = read.take(self.size * self.count * times)
        if read.big_endian and self.size > 1:
            return np.frombuffer(data, f">u{self.size}").astype(f"<u{self.size}").tobytes()
        return data

    def write(self, write: Writer, value: Buffer) -> None:
        write.align(self.size)
        write.raw(value)


@dataclass(frozen=True, slots=True)
class _Seconds(_Block):
    """Seconds of a time: ROS 1 has those up to 2106 and none before 1970, ROS 2 those from 1901 to 2038."""

    def write(self, write: Writer, value: Buffer) -> None:
        if value[3] & 0x80:
            year = "before 1970" if write.ros == 1 else "after 2038"
            raise TranslationError(f"a time {year} does not fit into messages of ROS {write.ros}")
        _Block.write(self, write, value)


@dataclass(frozen=True, slots=True)
class _Text:
    """A string, which ends in a zero in ROS 2."""

    def read(self, read: Reader) -> Buffer:
        data = read.take(read.number("I"))
        return data[:-1] if read.ros == 2 and len(data) and data[-1] == 0 else data

    def write(self, write: Writer, value: Buffer) -> None:
        end = b"\0" if write.ros == 2 else b""
        write.number("I", len(value) + len(end))
        write.raw(value)
        write.raw(end)


@dataclass(frozen=True, slots=True)
class _Absent:
    """Bytes that only one version of ROS has: the sequence number of a ROS 1 header, the byte of an empty struct."""

    size: int
    ros: Ros

    def read(self, read: Reader) -> Buffer:
        return read.take(self.size) if read.ros == self.ros else bytes(self.size)

    def write(self, write: Writer, value: Buffer) -> None:
        if write.ros == self.ros:
            write.raw(value)


@dataclass(frozen=True, slots=True)
class Struct:
    """Fields of a message, in order; layouts with other names are equal, because messages do not contain names."""

    names: tuple[str, ...] = field(compare=False)
    nodes: "tuple[_Node, ...]"

    def read(self, read: ItemReader) -> list[Any]:
        """Return the values of the fields."""
        return [node.read(read) for node in self.nodes]

    def write(self, write: Writer, value: Sequence[Any]) -> None:
        """Add the values of the fields."""
        for node, part in zip(self.nodes, value, strict=True):
            node.write(write, part)


@dataclass(frozen=True, slots=True)
class _Items:
    """A sequence, or an array of fixed ``length``; numbers are one piece of bytes."""

    item: "_Node"
    length: int | None = None

    def read(self, read: ItemReader) -> Any:
        length = read.number("I") if self.length is None else self.length
        if isinstance(self.item, _Block):
            return self.item.read(read, length) if length else b""
        read.count(length)
        return [self.item.read(read) for _ in range(length)]

    def write(self, write: Writer, value: Any) -> None:
        block = self.item if isinstance(self.item, _Block) else None
        if self.length is None:
            write.number("I", len(value) // (block.size * block.count) if block else len(value))
        if block is None:
            for one in value:
                self.item.write(write, one)
        elif len(value):
            block.write(write, value)


_Node = _Block | _Text | _Absent | Struct | _Items

Change = Callable[[Any], Any]
"""Function from values of one layout to those of another."""


def as_is(value: Any) -> Any:
    """Return a value unchanged."""
    return value


def change_between(source: Struct, target: Struct) -> tuple[Change, list[str]]:
    """Return the change from one layout to another, by the names of fields, and the names of those that are lost."""
    places = {name: place for place, name in enumerate(source.names)}
    nested: dict[str, list[str]] = {}
    parts: list[tuple[int | None, Any, Change]] = []
    for name, node in zip(target.names, target.nodes, strict=True):
        place = places.get(name)
        found = None if place is None else _change(source.nodes[place], node)
        parts.append((place, None, found[0]) if found else (None, node.read(_Zeros(b"", 1)), as_is))
        nested |= {name: found[1]} if found else {}
    lost = [name for name in source.names if name not in nested]
    lost += [f"{name}.{inner}" for name in source.names for inner in nested.get(name, ())]
    return lambda values: [then if at is None else change(values[at]) for at, then, change in parts], lost


def _change(source: _Node, target: _Node) -> tuple[Change, list[str]] | None:
    """Return what `change_between` does for any layouts; None if there is no change between them."""
    if source == target:
        return as_is, []
    if isinstance(source, Struct) and isinstance(target, Struct):
        return change_between(source, target)
    if isinstance(source, _Items) and isinstance(target, _Items) and source.length == target.length:
        found = None if isinstance(source.item, _Block) else _change(source.item, target.item)
        return (lambda values: [found[0](value) for value in values], found[1]) if found else None
    return None


def known_types(ros: Ros) -> Types:
    """Return the types of the last release of ROS 1 or of ROS 2."""
    types: Types = typestore(ros).fielddefs
    return types


@lru_cache(maxsize=256)
def types_of(schema: Schema) -> Types:
    """Return the types that a schema defines, and known ones; `TranslationError` if it is no definition of ROS.

    A known type may lack its definition, or have only its name for one.
    """
    name, known = full_name(schema.name), known_types(1 if schema.encoding == "ros1msg" else 2)
    try:
        return {**known, **_defined(schema, name)}
    except TranslationError:
        if name in known:
            return known
        raise


def _defined(schema: Schema, name: str) -> Types:
    """Return the types that a schema defines; `TranslationError` if it is no definition of ROS."""
    if len(schema.data) > _MAX_DEFINITION:
        raise TranslationError(f"the definition of {schema.name} is longer than {_MAX_DEFINITION:,} bytes")
    text = schema.data.decode("utf-8", "replace").replace("\r\n", "\n")
    try:
        if schema.encoding == "ros2idl":
            return get_types_from_idl(text)
        if schema.encoding in ("ros1msg", "ros2msg") and text.strip():
            return get_types_from_msg(text, name)
    except (TypesysError, RecursionError, ValueError, LookupError, AttributeError) as error:
        raise TranslationError(f"the definition of {schema.name} is not valid") from error
    raise TranslationError(f"the definition of {schema.name} is unknown")


def definition_of(types: Types, name: str, ros: Ros) -> tuple[Schema, str]:
    """Return schema and checksum (MD5 or RIHS01) of a type for a ROS; `TranslationError` if a type is unknown."""
    store = get_typestore(Stores.EMPTY)
    store.fielddefs.update({**types, _HEADER: known_types(ros)[_HEADER]})
    try:
        text, checksum = store.generate_msgdef(name, ros_version=ros)
        if ros == 2:
            return Schema(name, "ros2msg", text.encode()), store.hash_rihs01(name)
    except (TypesysError, RecursionError, KeyError) as error:
        raise TranslationError(f"the definition of {name} is not complete") from error
    return Schema(name.replace("/msg/", "/", 1), "ros1msg", text.encode()), checksum


class Layouts:
    """Layouts of types that contain each other, which could be more than any memory holds."""

    def __init__(self, types: Types) -> None:
        self._types = types
        self._left = _MAX_FIELDS

    def struct(self, name: str, depth: int = 0) -> Struct:
        """Return the layout of messages of a type; `TranslationError` if it is unknown, too large or unsupported."""
        if name not in self._types or depth > _MAX_DEPTH:
            raise TranslationError(f"the definition of {name} is not complete")
        fields: list[tuple[str, _Node]] = []
        for field_name, kind in self._types[name][1]:
            self._left -= 1
            if self._left < 0:
                raise TranslationError(f"messages of more than {_MAX_FIELDS:,} fields are not supported")
            if field_name == _PLACEHOLDER or (name == _HEADER and field_name == "seq"):
                continue
            fields.append((field_name.lower(), self._node(kind, depth)))
        if name == _TIME and fields:
            fields[0] = (fields[0][0], _Seconds("int32", 4))
        if name == _HEADER:
            fields.insert(0, ("seq", _Absent(4, ros=1)))
        if not fields:
            fields.append(("", _Absent(1, ros=2)))
        return Struct(*zip(*fields, strict=True))

    def _node(self, kind: Any, depth: int) -> _Node:
        base, detail = kind
        if base == Nodetype.BASE:
            if detail[0] == "string":
                return _Text()
            if detail[0] not in _SIZES:
                raise TranslationError(f"values of the type {detail[0]} are not supported")
            return _Block("uint8" if detail[0] in ("byte", "char", "bool") else detail[0], _SIZES[detail[0]])
        if base == Nodetype.NAME:
            return self.struct(detail, depth + 1)
        item, length = detail
        node = self._node(item, depth)
        if base == Nodetype.SEQUENCE:
            return _Items(node)
        return _Block(node.kind, node.size, node.count * length) if isinstance(node, _Block) else _Items(node, length)
