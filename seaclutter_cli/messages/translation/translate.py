"""Translators of the messages of a channel to the other version of ROS."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages import CODECS, find_codec
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.messages.quality import LATCHED_QOS, declares_latched
from seaclutter_cli.messages.translation.types import (
    Types,
    definition_of,
    full_name,
    known_types,
    layout_of,
    types_of,
)
from seaclutter_cli.messages.translation.wire import Block, Items, Node, Reader, Struct, TranslationError, Writer
from seaclutter_cli.records import Buffer, Channel, Schema

CDR, ROS1 = "cdr", "ros1"
"""Message encodings of ROS 2 and ROS 1."""

_CLOUD = "sensor_msgs/msg/PointCloud2"


@dataclass(frozen=True)
class Translator:
    """A channel for another version of ROS, and how its messages get there.

    Parameters
    ----------
    channel : Channel
        The channel with the schema and the metadata of that version.
    translate : callable
        Returns a message in its serialisation, or raises `TranslationError`.
    lost : tuple of str
        Fields that this version does not have.
    """

    channel: Channel
    translate: Callable[[Buffer], Buffer]
    lost: tuple[str, ...] = ()


def translator(channel: Channel, encoding: str) -> Translator:
    """Return how the messages of a channel become messages of an encoding, ``ros1`` or ``cdr``.

    Types that both versions of ROS have get the fields of the other version: what is new there is zero or empty. Clouds
    in other encodings become PointCloud2.

    Raises
    ------
    TranslationError
        If the messages cannot be translated.
    """
    if channel.message_encoding == encoding and channel.schema is not None:
        return Translator(_with_checksum(channel, encoding), _unchanged)
    if channel.schema is None:
        raise TranslationError("its messages have no definition")
    if channel.message_encoding not in (CDR, ROS1):
        return _cloud_translator(channel, encoding)
    cdr, name, types = encoding == CDR, full_name(channel.schema.name), types_of(channel.schema)
    known = known_types(ros2=cdr)
    schema, checksum = definition_of(known if name in known else types, name, ros2=cdr)
    out = _channel(channel, encoding, schema, checksum)
    if name not in known or _is_same(types, known, name):
        return Translator(out, partial(_translate, layout_of(types, name), cdr=cdr))
    source, target = (layout_of(some, name, merged=False) for some in (types, known))
    change, lost = _Change(source, target), tuple(_lost(source, target))
    return Translator(out, partial(_change, source, target, change, cdr=cdr), lost)


def _channel(channel: Channel, encoding: str, schema: Schema, checksum: str) -> Channel:
    latched = declares_latched(channel)
    if encoding == ROS1:
        metadata = {
            "md5sum": checksum,
            "topic": channel.topic,
            "type": schema.name,
            **({"latching": "1"} if latched else {}),
        }
    else:
        metadata = {"offered_qos_profiles": LATCHED_QOS if latched else "", "topic_type_hash": checksum}
    return replace(channel, message_encoding=encoding, schema=schema, metadata=tuple(sorted(metadata.items())))


def _with_checksum(channel: Channel, encoding: str) -> Channel:
    """Return a channel with the checksum of its definition, which logs without it would lack."""
    name = "md5sum" if encoding == ROS1 else "topic_type_hash"
    if channel.schema is None or dict(channel.metadata).get(name):
        return channel
    try:
        _, checksum = definition_of(types_of(channel.schema), full_name(channel.schema.name), ros2=encoding == CDR)
    except TranslationError:
        return channel
    return replace(channel, metadata=tuple(sorted({**dict(channel.metadata), name: checksum}.items())))


def _unchanged(data: Buffer) -> Buffer:
    return data


def _translate(layout: Node, data: Buffer, *, cdr: bool) -> bytes:
    read, write = Reader(data, cdr=not cdr), Writer(cdr=cdr)
    layout.write(write, _read(layout, read))
    return b"".join(write.parts)


def _change(source: Node, target: Node, change: "_Change", data: Buffer, *, cdr: bool) -> bytes:
    write = Writer(cdr=cdr)
    target.write(write, change(_read(source, Reader(data, cdr=not cdr))))
    return b"".join(write.parts)


def _read(layout: Node, read: Reader) -> Any:
    value = layout.read(read)
    left = len(read.data) - read.at
    if left > (3 if read.cdr else 0):  # writers of CDR may pad a message
        raise TranslationError(f"the message has {left} bytes more than its definition")
    return value


class _Change:
    """The values of one layout from those of another, by the names of the fields."""

    def __init__(self, source: Struct, target: Struct) -> None:
        places = {name: place for place, (name, _) in enumerate(source.fields)}
        self._parts: list[tuple[int | None, Any, Callable[[Any], Any]]] = []
        for name, node in target.fields:
            place = places.get(name)
            change = None if place is None else _changed(source.nodes[place], node)
            self._parts.append((None if change is None else place, node.default, change or _as_is))

    def __call__(self, values: Sequence[Any]) -> list[Any]:
        return [default if place is None else change(values[place]) for place, default, change in self._parts]


def _as_is(value: Any) -> Any:
    return value


def _changed(source: Node, target: Node) -> Callable[[Any], Any] | None:
    """Return the function from values of one layout to those of another; None if there is none."""
    if source == target:
        return _as_is
    if isinstance(source, Struct) and isinstance(target, Struct):
        return _Change(source, target)
    if isinstance(source, Items) and isinstance(target, Items) and source.length == target.length:
        item = _changed(source.item, target.item)
        return None if item is None or isinstance(source.item, Block) else partial(_each, item)
    return None


def _each(change: Callable[[Any], Any], values: Sequence[Any]) -> list[Any]:
    return [change(value) for value in values]


def _lost(source: Struct, target: Struct) -> list[str]:
    """Return the names of the fields that have no counterpart."""
    nodes = dict(target.fields)
    lost = [name for name, node in source.fields if name not in nodes or _changed(node, nodes[name]) is None]
    for name, node in source.fields:
        inner = [one.item if isinstance(one, Items) else one for one in (node, nodes.get(name))]
        if name not in lost and isinstance(inner[0], Struct) and isinstance(inner[1], Struct):
            lost += [f"{name}.{one}" for one in _lost(*inner)]  # type: ignore[arg-type]
    return lost


def _is_same(types: Types, known: Types, name: str) -> bool:
    one, other = (_unnamed(layout_of(some, name, merged=False)) for some in (types, known))
    return bool(one == other)


def _unnamed(node: Node) -> Any:
    """Return a layout without the names of fields, which messages do not contain."""
    if isinstance(node, Struct):
        return tuple(map(_unnamed, node.nodes))
    return (_unnamed(node.item), node.length) if isinstance(node, Items) else node


def _cloud_translator(channel: Channel, encoding: str) -> Translator:
    codec = find_codec(channel)
    if codec is None:
        raise TranslationError(f"its messages are encoded as {channel.message_encoding}")
    schema = ros2_schema(_CLOUD)
    if encoding == ROS1:
        schema, checksum = definition_of(known_types(ros2=False), _CLOUD, ros2=False)
    else:
        _, checksum = definition_of(known_types(ros2=True), _CLOUD, ros2=True)
    target = CODECS[schema.name, encoding]

    def encode(data: Buffer) -> bytes:
        try:
            return target.encode(replace(codec.decode(data), extra=None))
        except CloudError as error:
            raise TranslationError(str(error)) from error

    return Translator(_channel(channel, encoding, schema, checksum), encode)
