"""Types of ROS messages: their definitions, and the layouts that follow from them.

Definitions are parsed, and hashed, by rosbags. Its converters are not used: they are Python code made from definitions,
and nothing in a log should become code.
"""

from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from seaclutter_cli.messages.definitions import ros2_types
from seaclutter_cli.messages.translation.wire import Absent, Block, Items, Node, Struct, Text, TranslationError
from seaclutter_cli.records import Schema

Types = Mapping[str, tuple[Any, Any]]
"""Constants and fields of message types by their full name, as rosbags describes them."""

HEADER = "std_msgs/msg/Header"
_SIZES = {
    **dict.fromkeys(("bool", "byte", "char", "int8", "uint8"), 1),
    **dict.fromkeys(("int16", "uint16"), 2),
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64"), 8),
}
_PLACEHOLDER = "structure_needs_at_least_one_member"
_RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
_MAX_DEFINITION = 2**18
_MAX_FIELDS = 10_000
_MAX_DEPTH = 50


def full_name(name: str) -> str:
    """Return the name of a type with its namespace, as in ROS 2.

    Examples
    --------
    >>> full_name("tf2_msgs/TFMessage"), full_name("std_msgs/msg/Bool")
    ('tf2_msgs/msg/TFMessage', 'std_msgs/msg/Bool')
    """
    package, _, rest = name.partition("/")
    full = name if "/" in rest or not rest else f"{package}/msg/{rest}"
    return _RENAMED.get(full, full)


@cache
def known_types(*, ros2: bool) -> Types:
    """Return the types of the last release of ROS 1 or of ROS 2."""
    types: Types = ros2_types() if ros2 else get_typestore(Stores.ROS1_NOETIC).fielddefs
    return types


@lru_cache(maxsize=256)
def types_of(schema: Schema) -> Types:
    """Return the types that a schema defines, and those that it only names if they are known.

    Raises
    ------
    TranslationError
        If the schema is not a definition of ROS, or has none.
    """
    name, ros2 = full_name(schema.name), schema.encoding != "ros1msg"
    known = known_types(ros2=ros2)
    if not schema.data and name in known:
        return known
    if len(schema.data) > _MAX_DEFINITION:
        raise TranslationError(f"the definition of {schema.name} is longer than {_MAX_DEFINITION:,} bytes")
    text = schema.data.decode("utf-8", "replace")
    try:
        if schema.encoding == "ros2idl":
            types = get_types_from_idl(text)
        elif schema.encoding in ("ros1msg", "ros2msg") and text.strip():
            types = get_types_from_msg(text, name)
        else:
            raise TranslationError(f"the definition of {schema.name} is unknown")
    except (TypesysError, RecursionError, ValueError, LookupError, AttributeError) as error:
        raise TranslationError(f"the definition of {schema.name} is not valid") from error
    return {**known, **types}


def definition_of(types: Types, name: str, *, ros2: bool) -> tuple[Schema, str]:
    """Return the schema of a type for ROS 1 or ROS 2, and its checksum: MD5 for ROS 1, RIHS01 for ROS 2.

    Raises
    ------
    TranslationError
        If a type that it contains is unknown, or contains itself.
    """
    store = get_typestore(Stores.EMPTY)
    store.fielddefs.update({**types, HEADER: known_types(ros2=ros2)[HEADER]})
    try:
        text, checksum = store.generate_msgdef(name, ros_version=2 if ros2 else 1)
        if ros2:
            return Schema(name, "ros2msg", text.encode()), store.hash_rihs01(name)
    except (TypesysError, RecursionError, KeyError) as error:
        raise TranslationError(f"the definition of {name} is not complete") from error
    return Schema(name.replace("/msg/", "/", 1), "ros1msg", text.encode()), checksum


def layout_of(types: Types, name: str, *, merged: bool = True) -> Struct:
    """Return the layout of the messages of a type.

    Parameters
    ----------
    types : mapping
        Types by name.
    name : str
        Full name of the type.
    merged : bool, optional
        Whether neighbouring numbers of one size become one block; otherwise every field keeps its name.

    Raises
    ------
    TranslationError
        If a type is unknown, contains itself or too many others, or has values that are not supported.
    """
    if name not in types:
        raise TranslationError(f"the definition of {name} is unknown")
    return _Layouts(types, merged=merged).struct(name)


class _Layouts:
    """Layouts of types that contain each other, which could be more than any memory holds."""

    def __init__(self, types: Types, *, merged: bool) -> None:
        self._types, self._merged = types, merged
        self._left = _MAX_FIELDS

    def struct(self, name: str, depth: int = 0) -> Struct:
        if name not in self._types or depth > _MAX_DEPTH:
            raise TranslationError(f"the definition of {name} is not complete")
        fields: list[tuple[str, Node]] = []
        for field, kind in self._types[name][1]:
            self._left -= 1
            if self._left < 0:
                raise TranslationError(f"messages of more than {_MAX_FIELDS:,} fields are not supported")
            if field == _PLACEHOLDER or (name == HEADER and field == "seq"):
                continue
            fields.append((field.lower(), self._node(kind, depth)))
        if name == HEADER:
            fields.insert(0, ("seq", Absent(4, in_cdr=False)))
        if not fields:
            fields.append(("", Absent(1, in_cdr=True)))
        return Struct(tuple(_joined(fields) if self._merged else fields))

    def _node(self, kind: Any, depth: int) -> Node:
        base, detail = kind
        if base == Nodetype.BASE:
            if detail[0] == "string":
                return Text()
            if detail[0] not in _SIZES:
                raise TranslationError(f"values of the type {detail[0]} are not supported")
            return Block(_SIZES[detail[0]], kind="uint8" if detail[0] in ("byte", "char", "bool") else detail[0])
        if base == Nodetype.NAME:
            inner = self.struct(detail, depth + 1)
            return inner.nodes[0] if self._merged and len(inner.nodes) == 1 else inner
        item, length = detail
        node = self._node(item, depth)
        if base == Nodetype.SEQUENCE:
            return Items(node)
        return Block(node.size, node.count * length, node.kind) if isinstance(node, Block) else Items(node, length)


def _joined(fields: list[tuple[str, Node]]) -> list[tuple[str, Node]]:
    joined: list[tuple[str, Node]] = []
    for name, node in fields:
        last = joined[-1][1] if joined else None
        if isinstance(node, Block) and isinstance(last, Block) and last.size == node.size:
            joined[-1] = joined[-1][0], Block(node.size, last.count + node.count)
        else:
            joined.append((name, node))
    return joined
