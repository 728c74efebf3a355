"""Point clouds from packet topics: packets that lidar drivers publish before they are decoded."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import CloudError, InputError, MissingExtraError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Buffer, Channel, Damage, Message, Metadata, Record, Schema
from seaclutter_cli.sensors.packets import DecoderOptions, PacketDecoder, PacketFamily, PacketFrame, Packets
from seaclutter_cli.text import count

_NANO = 1_000_000_000
_MAX_IDS = 65_535
_MAX_TRIES = 10
_MAX_SLACK = 8

_PACKET_BYTES: Mapping[str, tuple[int, bool]] = {
    "velodyne_msgs/msg/VelodyneScan": (1206, False),
    "pandar_msgs/msg/PandarScan": (1500, True),
}
"""Bytes of a packet in a scan message, and whether its length follows it."""


def wrap_packets(
    source: Source, options: DecoderOptions | None = None, families: Mapping[str, PacketFamily] | None = None
) -> Source:
    """Return a source with point clouds for its packet topics; a source without them is returned unchanged.

    Parameters
    ----------
    source : Source
        A log. The first messages of its packet topics are read.
    options : DecoderOptions, optional
        Settings that packets do not contain.
    families : mapping of str to PacketFamily, optional
        Sensors that can be decoded; all if not given.
    """
    if not any(map(_scan_type, source.channels)):
        return source
    if families is None:
        from seaclutter_cli.sensors.families import PACKET_FAMILIES

        families = PACKET_FAMILIES
    if not any(_find_family(channel, families.values()) for channel in source.channels):
        return source
    try:
        return PacketTopics(source, families, options or DecoderOptions())
    except BaseException:
        source.close()
        raise


def _scan_type(channel: Channel) -> str | None:
    """Return the ROS 2 type of a channel's messages; None if they are not scans of a known layout."""
    if channel.schema is None or channel.message_encoding not in ("cdr", "ros1"):
        return None
    package, _, name = channel.schema.name.partition("/")
    typename = f"{package}/msg/{name.removeprefix('msg/')}"
    return typename if typename in _PACKET_BYTES else None


def _find_family(channel: Channel, families: Iterable[PacketFamily]) -> PacketFamily | None:
    typename = _scan_type(channel)
    return next((family for family in families if typename and typename in family.scan_types), None)


@dataclass(frozen=True)
class _Topic:
    """A packet topic: the channel of its clouds, and the family and sample that its decoders need."""

    clouds: Channel
    family: PacketFamily
    sample: Packets


@dataclass
class _Stream:
    """State of reading a packet topic."""

    topic: _Topic
    decoder: PacketDecoder
    last: Message
    frame_id: str = ""
    scans: int = 0
    frames: int = 0
    partial: int = 0


class PacketTopics:
    """A log with additional point clouds for its packet topics, as the sensor's driver would publish them.

    Every message is kept. The cloud of a frame follows the scan message that completes it, and has the times of this
    message; frames that are incomplete at the end of the log come last. Topics that cannot be decoded are kept without
    clouds, with a warning.

    Parameters
    ----------
    inner : Source
        The log.
    families : mapping of str to PacketFamily
        Sensors that can be decoded.
    options : DecoderOptions
        Settings that packets do not contain.

    Attributes
    ----------
    facts : dict of str to SensorFacts
        Facts about the sensor of each cloud topic; filled while the records are read.
    """

    def __init__(self, inner: Source, families: Mapping[str, PacketFamily], options: DecoderOptions) -> None:
        """Read the first scan of every packet topic."""
        self._inner, self._options = inner, options
        self.name, self.format = inner.name, inner.format
        self.profile, self.compression = inner.profile, inner.compression
        self.damage, self.warnings = inner.damage, list(inner.warnings)
        self.facts = dict(inner.facts)
        self._topics: dict[int, _Topic] = {}
        topics = {channel.topic for channel in inner.channels}
        # Topics whose clouds were recorded too, as in the output of `filter`, are not decoded.
        undecoded = [channel for channel in inner.channels if _points_topic(channel.topic) not in topics]
        waiting = {c.id: f for c in undecoded if (f := _find_family(c, families.values()))}
        self._probe({number: family for number, family in waiting.items() if inner.counts.get(number) != 0})

    @property
    def metadata(self) -> Sequence[Metadata]:
        """Metadata records of the log."""
        return self._inner.metadata

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels of the log and of the clouds."""
        return [*self._inner.channels, *(topic.clouds for topic in self._topics.values())]

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id; each scan counts as one frame."""
        counts = dict(self._inner.counts)
        counts |= {topic.clouds.id: counts[number] for number, topic in self._topics.items() if number in counts}
        return counts

    def close(self) -> None:
        """Close the log."""
        self._inner.close()

    def _probe(self, waiting: dict[int, PacketFamily]) -> None:
        """Determine from the first scans of each topic whether it can be decoded."""
        problems: dict[int, list[str]] = {number: [] for number in waiting}
        for record in self._inner.records() if waiting else ():
            if isinstance(record, Message) and record.channel.id in waiting:
                number = record.channel.id
                try:
                    self._accept(record, waiting[number])
                    problems[number] = []
                    del waiting[number]
                except MissingExtraError as error:
                    problems[number] = [f"{record.channel.topic} is not decoded: {error}"]
                    del waiting[number]
                except InputError as error:
                    problems[number].append(f"{record.channel.topic} is not decoded: {error}")
                    if len(problems[number]) == _MAX_TRIES:
                        del waiting[number]
            if not waiting:
                break
        self._warn(*(texts[0] for texts in problems.values() if texts))

    def _accept(self, message: Message, family: PacketFamily) -> None:
        """Add the clouds of a topic; `InputError` or `MissingExtraError` if it cannot be decoded."""
        sample = _sample(message)
        facts = family.decoder(sample, self._options).facts
        topic = _Topic(self._cloud_channel(message.channel), family, sample)
        self._topics[message.channel.id] = topic
        self.facts[topic.clouds.topic] = facts
        self._warn(*(f"{topic.clouds.topic}: {text}" for text in facts.warnings))

    def _warn(self, *texts: str) -> None:
        self.warnings += [text for text in texts if text not in self.warnings]

    def _cloud_channel(self, packets: Channel) -> Channel:
        """Return the channel of a packet topic's clouds."""
        channels = self.channels
        taken = {channel.id for channel in channels}
        number = next(id_ for id_ in range(_MAX_IDS, 0, -1) if id_ not in taken)
        ros1 = packets.message_encoding == "ros1"
        schema = _ros1_schema() if ros1 else ros2_schema("sensor_msgs/msg/PointCloud2")
        topic = _points_topic(packets.topic)
        return Channel(number, topic, packets.message_encoding, schema)

    def skipped(self, start_ns: int) -> Mapping[int, int]:  # noqa: ARG002 - the interface of all sources
        """Return an empty mapping: nothing is left out because clouds are numbered by decoding all packets."""
        return {}

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message of the log."""
        return self._inner.span_ns

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels of the log."""
        return self._inner.latest(channels, before_ns)

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:  # noqa: ARG002
        """Yield the records of the log before ``end_ns``, and the clouds between them; can be called again."""
        streams: dict[int, _Stream] = {}
        latest_ns = 0
        for record in self._inner.records():
            if isinstance(record, Message) and end_ns is not None and record.log_time_ns >= end_ns:
                return
            yield record
            if not isinstance(record, Message):
                continue
            latest_ns = max(latest_ns, record.log_time_ns)
            if topic := self._topics.get(record.channel.id):
                yield from self._decode(record, topic, streams)
        for stream in streams.values():
            last = replace(stream.last, log_time_ns=max(latest_ns, stream.last.log_time_ns))
            yield from self._messages(stream, last, stream.decoder.finish())
            self._conclude(stream)

    def _decode(self, message: Message, topic: _Topic, streams: dict[int, _Stream]) -> Iterator[Message]:
        """Yield the clouds that a scan completes."""
        stream = streams.get(message.channel.id)
        if stream is None:
            stream = _Stream(topic, topic.family.decoder(topic.sample, self._options), message)
            streams[message.channel.id] = stream
            self.facts[topic.clouds.topic] = stream.decoder.facts
        stream.last, stream.scans = replace(message, data=b""), stream.scans + 1
        try:
            scan = _Scan.read(message)
        except CloudError as error:
            problem = f"scan {stream.scans - 1} of {message.channel.topic} cannot be read ({error})"
            self._note(problem, len(message.data), 1)
            return
        stream.frame_id = scan.frame_id
        for packets in scan.packets:
            yield from self._messages(stream, message, stream.decoder.add(packets))

    def _messages(self, stream: _Stream, message: Message, frames: Iterator[PacketFrame]) -> Iterator[Message]:
        """Yield the messages of frames, with the times of a scan message."""
        channel = stream.topic.clouds
        codec = CODECS[channel.schema.name if channel.schema else "", channel.message_encoding]
        for frame in frames:
            cloud = from_array(frame.points, stamp_ns=frame.stamp_ns, frame_id=stream.frame_id, height=frame.height)
            number, stream.frames = stream.frames, stream.frames + 1
            stream.partial += frame.partial
            try:
                data = codec.encode(replace(cloud, extra=number))
            except CloudError as error:
                self._note(f"frame {number} of {channel.topic} cannot be written ({error})", len(cloud.data), 1)
                continue
            yield Message(channel, message.log_time_ns, message.publish_time_ns, number, data)

    def _conclude(self, stream: _Stream) -> None:
        """Report the facts and losses of a topic at its end."""
        topic, facts = stream.topic.clouds.topic, stream.decoder.facts
        if stream.partial:
            facts.details["partial revolutions"] = f"{stream.partial}, where the recording begins, pauses or ends"
        self._warn(*(f"{topic}: {text}" for text in facts.warnings))
        if facts.lost_packets:
            self._warn(f"{topic}: {count(facts.lost_packets, 'packet')} missing, counted from gaps")
        if facts.bad_packets:
            size = stream.topic.sample.payloads.shape[1]
            problem = f"{topic}: {count(facts.bad_packets, 'packet')} that cannot be decoded"
            self._note(problem, facts.bad_packets * size, None)

    def _note(self, problem: str, lost_bytes: int, lost_messages: int | None) -> None:
        damage = Damage(Path(self.name), None, problem, lost_bytes, lost_messages)
        if damage not in self.damage:
            self.damage.append(damage)


def _sample(message: Message) -> Packets:
    """Return the longest run of packets of equal length in a scan; `CloudError` if it has no packets."""
    runs = _Scan.read(message).packets
    if not runs:
        raise CloudError("the scan contains no packets")
    return max(runs, key=len)


def _points_topic(packets: str) -> str:
    """Return the topic of the clouds of a packet topic.

    Examples
    --------
    >>> _points_topic("/front/velodyne_packets"), _points_topic("/lidar/scan")
    ('/front/velodyne_points', '/lidar/scan/points')
    """
    front = packets.removesuffix("packets")
    return f"{front}points" if front != packets else f"{packets}/points"


@cache
def _ros1_schema() -> Schema:
    from rosbags.typesys import Stores, get_typestore

    definition, _ = get_typestore(Stores.ROS1_NOETIC).generate_msgdef("sensor_msgs/msg/PointCloud2", ros_version=1)
    return Schema("sensor_msgs/PointCloud2", "ros1msg", definition.encode())


@dataclass(frozen=True)
class _Scan:
    """A scan message: its coordinate frame and its packets, in runs of equal length."""

    frame_id: str
    packets: list[Packets]

    @classmethod
    def read(cls, message: Message) -> "_Scan":
        """Return the scan in a message; `CloudError` if it is truncated or has another layout."""
        payload_bytes, sized = _PACKET_BYTES[_scan_type(message.channel) or ""]
        order, start, align = _encapsulation(message.channel, message.data)
        frame_id, at = _header(message.data, order, start, ros1=message.channel.message_encoding == "ros1")
        number = _number(message.data, at, order)
        fields = [("sec", order + "u4"), ("nanosec", order + "u4"), ("data", "u1", (payload_bytes,))]
        packet = np.dtype([*fields, ("size", order + "u4")] if sized else fields)
        step = packet.itemsize + -packet.itemsize % align
        needed, found = (number - 1) * step + packet.itemsize if number else 0, len(message.data) - at - 4
        if not 0 <= found - needed <= _MAX_SLACK:
            declared = f"{count(number, 'packet')} of {count(needed, 'byte')} in all"
            raise CloudError(f"the message declares {declared}, but contains {found:,}")
        packets = np.ndarray((number,), packet, message.data, at + 4, (step,))
        return cls(frame_id, list(_runs(packets, message.log_time_ns, sized=sized)))


def _encapsulation(channel: Channel, data: Buffer) -> tuple[str, int, int]:
    """Return byte order, start and alignment of a message's fields."""
    if channel.message_encoding == "ros1":
        return "<", 0, 1
    if len(data) < 4 or data[0] != 0 or data[1] > 1:
        raise CloudError("the message does not start with a plain CDR header")
    return "<" if data[1] else ">", 4, 4


def _header(data: Buffer, order: str, start: int, *, ros1: bool) -> tuple[str, int]:
    """Return the frame id in a message's header, and the offset after the header."""
    at = start + (12 if ros1 else 8)
    size = _number(data, at, order)
    if size > len(data) - at - 4:
        left = len(data) - at - 4
        raise CloudError(f"the message declares a frame id of {count(size, 'byte')}, but contains only {left:,} more")
    end = at + 4 + size
    name = bytes(data[at + 4 : end]).decode(errors="surrogateescape").removesuffix("" if ros1 else "\0")
    return name, end if ros1 else end + -(end - start) % 4


def _number(data: Buffer, at: int, order: str) -> int:
    if at + 4 > len(data):
        raise CloudError(f"the message is truncated at byte {len(data)}")
    return int.from_bytes(data[at : at + 4], "little" if order == "<" else "big")


def _runs(packets: NDArray[np.void], log_time_ns: int, *, sized: bool) -> Iterator[Packets]:
    """Yield packets in order, in runs of equal length; packets without a time get the log time."""
    times_ns = packets["sec"].astype(np.int64) * _NANO + packets["nanosec"]
    times_ns[times_ns == 0] = min(log_time_ns, np.iinfo(np.int64).max)
    most = packets["data"].shape[1]
    sizes = np.minimum(packets["size"], most) if sized else np.full(len(packets), most)
    for part in np.split(np.arange(len(packets)), np.flatnonzero(np.diff(sizes.astype(np.int64))) + 1):
        if len(part):
            yield Packets(times_ns[part], packets["data"][part, : int(sizes[part[0]])].copy())
