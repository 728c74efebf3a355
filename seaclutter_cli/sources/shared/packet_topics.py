"""Point clouds from packet topics: packets that lidar drivers publish before they are decoded."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from seaclutter_cli.errors import CloudError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages.definitions import points_channel
from seaclutter_cli.records import Buffer, Channel, Message, Record, SensorFacts
from seaclutter_cli.sensors.packets import DecoderOptions, PacketFamily, PacketFrame
from seaclutter_cli.sources.shared import SourceWrapper
from seaclutter_cli.sources.shared.packet_messages import has_single_packets, packet_type, read_packets, runs
from seaclutter_cli.sources.shared.packet_probe import Decodable, make_candidates, probe
from seaclutter_cli.sources.shared.packet_streams import CloudStream

_MAX_IDS = 65_535
_DECODED_AT_ONCE, _DECODED_WITHIN_NS = 64, 50_000_000


@dataclass
class _Stream:
    """State of reading a packet topic: its clouds, the messages that wait to be decoded, and the times of the last."""

    clouds: CloudStream
    is_single: bool
    times: tuple[int, int] = (0, 0)
    frame_id: str | None = None
    waiting: list[Message] = field(default_factory=list)
    scans: int = 0


class PacketTopics(SourceWrapper):
    """A log with additional point clouds for its packet topics, as the sensor's driver would publish them.

    Every message is kept. A cloud follows the message that completes it, and has its times; messages with one packet
    are decoded 64 at once, or those of 50 ms. Topics that cannot be decoded are kept without clouds, with a warning.
    """

    def __init__(self, inner: Source, families: Mapping[str, PacketFamily], options: DecoderOptions) -> None:
        super().__init__(inner)
        self._options = options
        self.facts: dict[str, SensorFacts] = dict(inner.facts)
        self._topics: dict[int, tuple[Channel, Decodable]] = {}
        topics = {channel.topic for channel in inner.channels}
        # Topics whose clouds were recorded too, as in the output of `filter`, are not decoded.
        undecoded = [channel for channel in inner.channels if _points_topic(channel) not in topics]
        self._probe([channel for channel in undecoded if inner.counts.get(channel.id) != 0], families.values())

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels of the log and of the clouds."""
        return [*self._inner.channels, *(clouds for clouds, _ in self._topics.values())]

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id; each scan counts as one frame, and frames of single packets are not known."""
        counts = dict(self._inner.counts)
        for channel in self._inner.channels:
            if channel.id in counts and channel.id in self._topics and not has_single_packets(channel):
                counts[self._topics[channel.id][0].id] = counts[channel.id]
        return counts

    def _probe(self, undecoded: Sequence[Channel], families: Collection[PacketFamily]) -> None:
        """Determine from the first packets of each topic whether it can be decoded."""
        candidates = make_candidates(undecoded, families, self._options)
        probe(self._inner.records, candidates)
        for candidate in candidates:
            packets, found = candidate.channel, candidate.found
            if found:
                taken = {channel.id for channel in self.channels}
                free = next(id_ for id_ in range(_MAX_IDS, 0, -1) if id_ not in taken)
                clouds = points_channel(replace(packets, id=free, topic=_points_topic(packets), metadata=()))
                self._topics[packets.id] = clouds, found
                self.facts[clouds.topic] = found.facts
                self.warn(*(f"{clouds.topic}: {text}" for text in found.facts.warnings))
        self.warn(*(candidate.problems[0] for candidate in candidates if candidate.problems))

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:  # noqa: ARG002
        """Yield the records of the log before ``end_ns``, and the clouds between them; can be called again."""
        streams: dict[int, _Stream] = {}
        latest_ns = 0
        for record in self._inner.records():
            if not isinstance(record, Message):
                yield record
                continue
            time_ns = record.log_time_ns
            if end_ns is not None and time_ns >= end_ns:
                return
            yield record
            latest_ns = max(latest_ns, time_ns)
            if record.channel.id in self._topics and (stream := self._take(record, streams)):
                yield from self._add(stream)
        for stream in streams.values():
            stream.times = max(latest_ns, stream.times[0]), stream.times[1]
            yield from self._add(stream)
            yield from _messages(stream, stream.clouds.decoder.finish())
            stream.clouds.conclude(Path(self.name), "where the recording begins, pauses or ends")

    def _take(self, message: Message, streams: dict[int, _Stream]) -> _Stream | None:
        """Take the packets of a message; return the stream if its packets are to be decoded now."""
        stream = streams.get(message.channel.id)
        if stream is None:
            channel, found = self._topics[message.channel.id]
            clouds = CloudStream(self, channel, found.make(), found.packet_bytes)
            stream = streams[message.channel.id] = _Stream(clouds, has_single_packets(message.channel))
            self.facts[channel.topic] = clouds.decoder.facts
        stream.times = (message.log_time_ns, message.publish_time_ns)
        stream.waiting.append(message)
        waited_ns = message.log_time_ns - stream.waiting[0].log_time_ns
        waits = stream.is_single and len(stream.waiting) < _DECODED_AT_ONCE and waited_ns < _DECODED_WITHIN_NS
        return None if waits else stream

    def _add(self, stream: _Stream) -> Iterator[Message]:
        """Yield the clouds that the waiting messages complete."""
        messages, stream.waiting = stream.waiting, []
        times_ns, payloads = list[int](), list[Buffer]()
        for number, message in enumerate(messages, stream.scans):
            try:
                read = read_packets(message)
            except CloudError as error:
                problem = f"scan {number} of {message.channel.topic} cannot be read ({error})"
                self._note(problem, len(message.data))
                continue
            times_ns += read.times_ns
            payloads += read.payloads
            stream.frame_id = stream.frame_id if read.frame_id is None else read.frame_id
        stream.scans += len(messages)
        for packets in runs(times_ns, payloads):
            yield from _messages(stream, stream.clouds.decoder.add(packets))


def _messages(stream: _Stream, frames: Iterator[PacketFrame]) -> Iterator[Message]:
    """Yield the messages of frames, with the times of the last message of packets."""
    found = (stream.clouds.message(frame, stream.times, stream.frame_id) for frame in frames)
    return (message for message in found if message)


def _points_topic(packets: Channel) -> str:
    """Return the topic of the clouds of a packet topic, as the sensor's driver names it."""
    of_ouster = (packet_type(packets) or "").endswith("/PacketMsg")
    topic = re.sub("lidar_packets$", "packets", packets.topic) if of_ouster else packets.topic
    front = topic.removesuffix("packets")
    return f"{front}points" if front != topic else f"{topic}/points"
