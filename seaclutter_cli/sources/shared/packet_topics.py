"""Point clouds from packet topics: packets that lidar drivers publish before they are decoded."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from os.path import commonprefix
from pathlib import Path

from seaclutter_cli.errors import CloudError, InputError, MissingExtraError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages.definitions import points_channel
from seaclutter_cli.records import Buffer, Channel, Message, Record, SensorFacts
from seaclutter_cli.sensors.catalog import ADVICE, name_unsupported
from seaclutter_cli.sensors.families import PACKET_FAMILIES
from seaclutter_cli.sensors.packets import DecoderOptions, PacketDecoder, PacketFamily, Packets
from seaclutter_cli.sources.shared import SourceWrapper
from seaclutter_cli.sources.shared.packet_messages import (
    DRIVER_MESSAGES,
    has_single_packets,
    packet_type,
    read_packets,
    read_recorded,
    ros2_type,
    runs,
)
from seaclutter_cli.sources.shared.packet_streams import MAX_SAMPLES, CloudStream, Samples

_MAX_IDS = 65_535
_DECODED_AT_ONCE, _DECODED_WITHIN_NS = 64, 50_000_000
_MAX_TRIES = 10
_IMU_BYTES = 48
"""Length of Ouster's IMU packets, which the driver publishes in messages of the same type."""


@dataclass
class _Candidate:
    """A packet topic, families that may have sent it, the topic with its calibration, and, once known, its decoder."""

    channel: Channel
    families: Sequence[PacketFamily]
    options: DecoderOptions
    companion: Channel | None
    make: Callable[[], PacketDecoder] | None = None
    packet_bytes: int = 0
    problems: list[str] = field(default_factory=list)
    is_done: bool = False
    _family: PacketFamily | None = None
    _samples: Samples = field(default_factory=Samples)

    def add(self, message: Message) -> None:
        """Add a message of the topic or of its companion."""
        if self.companion and message.channel.id == self.companion.id:
            self._add_calibration(message)
        elif message.channel.id == self.channel.id:
            try:
                self._add_packets(read_packets(message).packets)
            except CloudError as error:
                self._fail(str(error))

    def finish(self) -> None:
        """Try whether the packets so far suffice for a decoder."""
        if self._samples.data:
            length = Counter(len(payload) for _, payload in self._samples.data).most_common(1)[0][0]
            sample, info = self._samples.packets(length)
            self.options = replace(self.options, info=info)
            self._try(sample)
        elif self._samples.calibrations:
            self._note("only device information, no data packets")

    def _add_packets(self, found: Sequence[Packets]) -> None:
        if (longest := max(found, key=len, default=None)) is None:
            raise CloudError("the scan contains no packets")
        self._family = self._family or self._recognise(longest)
        if self._family is None:
            self.is_done = True
        elif self._gathers:
            self._gather(found, self._family)
        else:
            self._try(longest)

    def _recognise(self, packets: Packets) -> PacketFamily | None:
        """Return the family that sent packets, of which the only one is taken as it is; None for IMU packets."""
        if len(self.families) == 1 and not has_single_packets(self.channel):
            return self.families[0]
        found = (one for one in self.families if any(map(one.recognises, packets.payloads[:MAX_SAMPLES])))
        family, size = next(found, None), packets.payloads.shape[1]
        if family is None and size != _IMU_BYTES:
            if name := name_unsupported(packets.payloads[0]):
                raise CloudError(f"packets of a {name} are not supported; {ADVICE}")
            titles = ", ".join(family.title for family in self.families)
            raise CloudError(f"packets of {size:,} bytes are not from a supported sensor ({titles})")
        return family

    def _add_calibration(self, message: Message) -> None:
        try:
            if packet_type(message.channel):
                family = self._family or next(one for one in self.families if one.calibrates)
                self._gather(read_packets(message).packets, family)
                return
            if self.options.recorded is None:
                self.options = replace(self.options, recorded=read_recorded(message))
        except CloudError as error:
            self._note(f"{message.channel.topic}: {error}")
        if self._is_ready:
            self.finish()

    def _gather(self, found: Iterable[Packets], family: PacketFamily) -> None:
        samples, new = self._samples, False
        for packets in found:
            before = len(samples.data)
            samples.add(packets, family)
            new |= bool(family.is_calibration(packets.payloads).any()) or before < len(samples.data) == MAX_SAMPLES
        if new and self._is_ready:
            self.finish()

    @property
    def _gathers(self) -> bool:
        """Whether a decoder needs more than the packets of one message."""
        return has_single_packets(self.channel) or self._calibrates or bool(self.companion)

    @property
    def _calibrates(self) -> bool:
        return self._family is not None and self._family.calibrates

    @property
    def _is_ready(self) -> bool:
        waits = self.companion is not None and self.options.recorded is None and self.options.calibration is None
        waits = not self._samples.calibrations if self._calibrates else waits
        return len(self._samples.data) >= MAX_SAMPLES and not waits

    def _try(self, sample: Packets) -> None:
        if self._family is None:
            return
        make = partial(self._family.decoder, sample, self.options)
        try:
            make()
        except MissingExtraError as error:
            self.is_done = True
            self._note(str(error))
        except InputError as error:
            self._fail(str(error))
            self.is_done |= self._gathers and not self._calibrates
        else:
            self.make, self.packet_bytes = make, sample.payloads.shape[1]
            self.is_done, self.problems = True, []

    def _fail(self, problem: str) -> None:
        self._note(problem)
        self.is_done = len(self.problems) >= _MAX_TRIES and not self._samples.data

    def _note(self, problem: str) -> None:
        self.problems.append(f"{self.channel.topic} is not decoded: {problem}")


def _candidates(channels: Collection[Channel], options: DecoderOptions) -> list[_Candidate]:
    """Return a candidate for each channel of packets; topics with only calibrations are left out."""
    found = []
    for channel in channels:
        if kind := DRIVER_MESSAGES.get(packet_type(channel) or ""):
            families = [PACKET_FAMILIES[name] for name in kind.families]
            typename, word = kind.companion or ("", "")
            beside = [one for one in channels if ros2_type(one) == typename and word in one.topic.lower()]
            # Of several, the one whose name begins most alike.
            nearest = max(beside, key=lambda one: len(commonprefix((one.topic, channel.topic))), default=None)  # noqa: RUF071
            found.append(_Candidate(channel, families, options, nearest))
    companions = {candidate.companion.id for candidate in found if candidate.companion}
    return [candidate for candidate in found if candidate.channel.id not in companions]


@dataclass
class _Stream(CloudStream):
    """State of reading a packet topic: its clouds, and the messages that wait to be decoded."""

    waiting: list[Message] = field(default_factory=list)
    scans: int = 0


class PacketTopics(SourceWrapper):
    """A log with additional point clouds for its packet topics, as the sensor's driver would publish them.

    Every message is kept. A cloud follows the message that completes it, and has its times; messages with one packet
    are decoded 64 at once, or those of 50 ms. Topics that cannot be decoded are kept without clouds, with a warning.
    """

    def __init__(self, inner: Source, options: DecoderOptions) -> None:
        super().__init__(inner)
        self.facts: dict[str, SensorFacts] = dict(inner.facts)
        self._topics: dict[int, tuple[Channel, Callable[[], PacketDecoder], int]] = {}
        topics = {channel.topic for channel in inner.channels}
        # Topics whose clouds were recorded too, as in the output of `filter`, are not decoded.
        undecoded = [channel for channel in inner.channels if _points_topic(channel) not in topics]
        undecoded = [channel for channel in undecoded if inner.counts.get(channel.id) != 0]
        self._find_decodable(_candidates(undecoded, options))

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels of the log and of the clouds."""
        return [*self._inner.channels, *(clouds for clouds, *_ in self._topics.values())]

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id; each scan counts as one frame, and frames of single packets are not known."""
        counts = dict(self._inner.counts)
        for channel in self._inner.channels:
            if channel.id in counts and channel.id in self._topics and not has_single_packets(channel):
                counts[self._topics[channel.id][0].id] = counts[channel.id]
        return counts

    def _find_decodable(self, candidates: Sequence[_Candidate]) -> None:
        """Determine from the first packets of each topic whether it can be decoded."""
        left = candidates
        for record in self._inner.records() if left else ():
            if isinstance(record, Message):
                for candidate in left:
                    candidate.add(record)
            left = [candidate for candidate in left if not candidate.is_done]
            if not left:
                break
        for candidate in left:
            candidate.finish()
        for candidate in candidates:
            if candidate.make:
                taken = {channel.id for channel in self.channels}
                free = next(id_ for id_ in range(_MAX_IDS, 0, -1) if id_ not in taken)
                topic = _points_topic(candidate.channel)
                clouds = points_channel(replace(candidate.channel, id=free, topic=topic, metadata=()))
                self._topics[candidate.channel.id] = clouds, candidate.make, candidate.packet_bytes
                self.facts[topic] = candidate.make().facts
                self.warn(*(f"{topic}: {text}" for text in self.facts[topic].warnings))
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
            log_ns, publish_ns = stream.times_ns or (0, 0)
            stream.times_ns = max(latest_ns, log_ns), publish_ns
            yield from self._add(stream)
            yield from stream.messages(stream.finish())
            stream.conclude(Path(self.name), "where the recording begins, pauses or ends")

    def _take(self, message: Message, streams: dict[int, _Stream]) -> _Stream | None:
        """Take the packets of a message; return the stream if its packets are to be decoded now."""
        if (stream := streams.get(message.channel.id)) is None:
            channel, make, packet_bytes = self._topics[message.channel.id]
            stream = streams[message.channel.id] = _Stream(self, channel, make(), packet_bytes)
            self.facts[channel.topic] = stream.decoder.facts
        stream.times_ns = (message.log_time_ns, message.publish_time_ns)
        stream.waiting.append(message)
        waited_ns = message.log_time_ns - stream.waiting[0].log_time_ns
        waits = len(stream.waiting) < _DECODED_AT_ONCE and waited_ns < _DECODED_WITHIN_NS
        return None if waits and has_single_packets(message.channel) else stream

    def _add(self, stream: _Stream) -> Iterator[Message]:
        """Yield the clouds that the waiting messages complete."""
        messages, stream.waiting = stream.waiting, []
        times_ns, payloads = list[int](), list[Buffer]()
        for number, message in enumerate(messages, stream.scans):
            try:
                read = read_packets(message)
            except CloudError as error:
                self.report(f"scan {number} of {message.channel.topic} cannot be read ({error})", len(message.data), 1)
                continue
            times_ns += read.times_ns
            payloads += read.payloads
            stream.frame_id = stream.frame_id if read.frame_id is None else read.frame_id
        stream.scans += len(messages)
        for packets in runs(times_ns, payloads):
            yield from stream.messages(stream.add(packets))


def _points_topic(packets: Channel) -> str:
    """Return the topic of the clouds of a packet topic, as the sensor's driver names it."""
    of_ouster = (packet_type(packets) or "").endswith("/PacketMsg")
    topic = re.sub("lidar_packets$", "packets", packets.topic) if of_ouster else packets.topic
    front = topic.removesuffix("packets")
    return f"{front}points" if front != topic else f"{topic}/points"
