"""Translators of the messages of a channel to the other version of ROS, with their definitions."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from seaclutter_cli.errors import CloudError, FieldError
from seaclutter_cli.messages import CODECS, declares_latched, find_codec, layouts
from seaclutter_cli.messages.definitions import POINT_CLOUD, full_name
from seaclutter_cli.messages.layouts import Struct, TranslationError
from seaclutter_cli.messages.serialisation import Ros, Writer, version_of
from seaclutter_cli.records import Buffer, Channel, Schema

CDR, ROS1 = "cdr", "ros1"
"""Message encodings of ROS 2 and ROS 1."""

_LATCHED_QOS = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: 1
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""
"""Quality of service of a latched topic in ROS 2, as rosbag2 stores it: reliable, transient local, depth 1."""


class Translations:
    """Channels and messages in the encoding of one version of ROS, ``ros1`` or ``cdr``."""

    def __init__(self, encoding: str) -> None:
        self._encoding = encoding
        self._translators: dict[int, Translator | None] = {}
        self._topics: dict[str, None] = {}
        self.broken = Counter[str]()
        """Number of messages by topic that could not be translated."""

    @property
    def lost(self) -> Sequence[str]:
        """What the encoding cannot keep, in words."""
        found = filter(None, self._translators.values())
        lost = dict.fromkeys(f"{name} of {one.channel.topic}" for one in found for name in one.lost)
        return [*lost, *self._topics]

    def channel(self, channel: Channel) -> Channel | None:
        """Return a channel in this encoding, under the same id; None if its messages cannot be translated."""
        try:
            found = translator(channel, self._encoding)
        except TranslationError as error:
            self._topics[f"{channel.topic} ({error})"] = None
            self._translators[channel.id] = None
            return None
        self._translators[channel.id] = found
        return found.channel

    def message(self, channel: int, data: Buffer, *, is_frame: bool) -> Buffer | None:
        """Return a message of a channel in this encoding; None if it cannot be translated, or an error for a frame."""
        if (found := self._translators[channel]) is None:
            return None
        try:
            return found.translate(data)
        except TranslationError as error:
            if is_frame:
                raise TranslationError(f"{found.channel.topic}: {error}; write MCAP instead") from error
            self.broken[found.channel.topic] += 1
            return None


class Translator(NamedTuple):
    """A channel of another version of ROS, the translation of its messages, and what is lost, as far as is known."""

    channel: Channel
    translate: Callable[[Buffer], Buffer]
    lost: Sequence[str] = ()


def translator(channel: Channel, encoding: str) -> Translator:
    """Return how the messages of a channel become messages of an encoding, ``ros1`` or ``cdr``.

    Types that both versions of ROS have get the fields of the other version: what is new there is zero or empty. Clouds
    in other encodings become PointCloud2. `TranslationError` if the messages cannot be translated.
    """
    if channel.message_encoding == encoding and channel.schema is not None:
        return Translator(_with_checksum(channel, encoding), layouts.as_is)
    if channel.schema is None:
        raise TranslationError("its messages have no definition")
    if channel.message_encoding not in (CDR, ROS1):
        return _cloud_translator(channel, encoding)
    ros, name = version_of(encoding), full_name(channel.schema.name)
    known, before = layouts.known_types(ros), layouts.known_types(1 if ros == 2 else 2)
    # Clouds are read as they are known, whatever the log says about them.
    types = before if find_codec(channel) and name in before else layouts.types_of(channel.schema)
    schema, checksum = layouts.definition_of(known if name in known else types, name, ros)
    out = _channel(channel, encoding, schema, checksum)
    source = layouts.Layouts(types).struct(name)
    target = layouts.Layouts(known).struct(name) if name in known else source
    change, lost = (layouts.as_is, []) if source == target else layouts.change_between(source, target)
    return Translator(out, partial(_convert, ros, source, target, change), tuple(lost))


def _channel(channel: Channel, encoding: str, schema: Schema, checksum: str) -> Channel:
    latched = declares_latched(channel)
    if encoding == ROS1:
        metadata = {"md5sum": checksum, "topic": channel.topic, "type": schema.name}
        metadata |= {"latching": "1"} if latched else {}
    else:
        metadata = {"offered_qos_profiles": _LATCHED_QOS if latched else "", "topic_type_hash": checksum}
    return replace(channel, message_encoding=encoding, schema=schema, metadata=tuple(sorted(metadata.items())))


def _with_checksum(channel: Channel, encoding: str) -> Channel:
    """Return a channel with the checksum of its definition, which logs without it would lack."""
    name = "md5sum" if encoding == ROS1 else "topic_type_hash"
    if channel.schema is None or dict(channel.metadata).get(name):
        return channel
    try:
        types = layouts.types_of(channel.schema)
        _, checksum = layouts.definition_of(types, full_name(channel.schema.name), version_of(encoding))
    except TranslationError:
        return channel
    return replace(channel, metadata=tuple(sorted({**dict(channel.metadata), name: checksum}.items())))


def _convert(ros: Ros, source: Struct, target: Struct, change: Callable[[Any], Any], data: Buffer) -> bytes:
    """Return a message of the other version of ROS, in one layout, as a message of this version in another one."""
    try:
        read = layouts.ItemReader(data, 1 if ros == 2 else 2)
        values = source.read(read)
    except CloudError as error:
        raise TranslationError(str(error)) from error
    if read.left > (3 if read.ros == 2 else 0):  # writers of CDR may pad a message
        raise TranslationError(f"the message has {read.left} bytes more than its definition")
    write = Writer(ros)
    target.write(write, change(values))
    return write.message()


def _cloud_translator(channel: Channel, encoding: str) -> Translator:
    codec, ros = find_codec(channel), version_of(encoding)
    if codec is None:
        raise TranslationError(f"its messages are encoded as {channel.message_encoding}")
    schema, checksum = layouts.definition_of(layouts.known_types(ros), POINT_CLOUD, ros)
    target, lost = CODECS[schema.name, encoding], list[str]()

    def encode(data: Buffer) -> bytes:
        try:
            cloud = codec.decode(data)
            lost[:] = ["the pose, which was applied to the points,"] if cloud.is_moved else lost
            return target.encode(replace(cloud.posed(), extra=None))
        except (CloudError, FieldError) as error:
            raise TranslationError(str(error)) from error

    return Translator(_channel(channel, encoding, schema, checksum), encode, lost)
