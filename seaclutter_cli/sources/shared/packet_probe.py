"""Search of a log for packet topics that can be decoded, and for what their decoders need.

A companion is a topic beside a packet topic that contains the calibration of the same sensor.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from os.path import commonprefix
from typing import Any

import numpy as np

from seaclutter_cli.errors import CloudError, InputError, MissingExtraError
from seaclutter_cli.records import Channel, Message, Record, SensorFacts
from seaclutter_cli.sensors.catalog import ADVICE, name_unsupported
from seaclutter_cli.sensors.packets import (
    DecoderOptions,
    PacketDecoder,
    PacketFamily,
    Packets,
    SelfCalibrating,
)
from seaclutter_cli.sources.shared.packet_messages import (
    has_single_packets,
    packet_type,
    read_packets,
    ros2_type,
)
from seaclutter_cli.sources.shared.packet_streams import MAX_SAMPLES, Samples, sample_of

_MAX_TRIES = 10
_IMU_BYTES = (48,)
"""Lengths of Ouster's IMU packets, which the driver publishes in messages of the same type."""


_COMPANIONS = {
    "rslidar_msgs/msg/rslidarScan": ("rslidar_msgs/msg/rslidarPacket", ""),
    "rslidar_msg/msg/RslidarScan": ("rslidar_msg/msg/RslidarPacket", "difop"),
    "ouster_ros/msg/PacketMsg": ("std_msgs/msg/String", "metadata"),
    "ouster_sensor_msgs/msg/PacketMsg": ("std_msgs/msg/String", "metadata"),
    "hesai_ros_driver/msg/UdpFrame": ("std_msgs/msg/UInt8MultiArray", "correction"),
}
"""ROS 2 message type of companions and a word in their topics, by the message type of packets."""


def _find_companion(packets: Channel, channels: Iterable[Channel]) -> Channel | None:
    """Return the topic with the calibration of a packet topic: of several, the one whose name begins most alike."""
    typename, word = _COMPANIONS.get(ros2_type(packets) or "", ("", ""))
    found = [channel for channel in channels if ros2_type(channel) == typename and word in channel.topic.lower()]
    return max(found, key=lambda one: len(commonprefix((one.topic, packets.topic))), default=None)  # noqa: RUF071


def _read_recorded(message: Message) -> bytes:
    """Return the file in a ``std_msgs/String`` or ``std_msgs/UInt8MultiArray``; `CloudError` if it is damaged."""
    from rosbags.typesys import Stores, get_typestore

    store, typename = get_typestore(Stores.ROS1_NOETIC), ros2_type(message.channel) or ""
    read = store.deserialize_ros1 if message.channel.message_encoding == "ros1" else store.deserialize_cdr
    try:
        data: Any = read(bytes(message.data), typename).data  # type: ignore[attr-defined]
    except Exception as error:  # the library does not wrap errors of damaged messages
        raise CloudError(f"the message is not a valid {typename}: {error}") from error
    return data.encode(errors="surrogateescape") if isinstance(data, str) else bytes(data.tobytes())


def find_families(channel: Channel, families: Iterable[PacketFamily]) -> list[PacketFamily]:
    """Return the families whose packets the messages of a channel may contain."""
    typename = packet_type(channel)
    return [family for family in families if typename and typename in family.scan_types]


@dataclass(frozen=True)
class Decodable:
    """What is known about packets that can be decoded: how to make decoders, facts, and the length of packets."""

    make: Callable[[], PacketDecoder]
    facts: SensorFacts
    packet_bytes: int


@dataclass
class Candidate:
    """A packet topic of which it is not yet known whether it can be decoded, and the families that may have sent it."""

    channel: Channel
    families: Sequence[PacketFamily]
    options: DecoderOptions
    companion: Channel | None
    found: Decodable | None = None
    problems: list[str] = field(default_factory=list)
    is_done: bool = False
    _family: PacketFamily | None = None
    _samples: Samples = field(default_factory=Samples)

    def add(self, message: Message) -> None:
        """Add a message of the topic."""
        try:
            packets = read_packets(message).packets
        except CloudError as error:
            self._fail(str(error))
            return
        longest = max(packets, key=len, default=None)
        if longest is None:
            self._fail("the scan contains no packets")
            return
        self._family = self._family or self._recognise(longest)
        if self._family is None:
            if longest.payloads.shape[1] in _IMU_BYTES:
                self.is_done = True
            else:
                titles = ", ".join(family.title for family in self.families)
                problem = f"packets of {longest.payloads.shape[1]:,} bytes are not from a supported sensor ({titles})"
                if name := name_unsupported(longest.payloads[0]):
                    problem = f"packets of a {name} are not supported; {ADVICE}"
                self._fail(problem)
        elif self._gathers:
            self._gather(packets)
        else:
            self._try(longest)

    def add_calibration(self, message: Message) -> None:
        """Add a message of the companion topic."""
        try:
            if packet_type(message.channel):
                self._gather(read_packets(message).packets)
                return
            if self.options.recorded is None:
                self.options = replace(self.options, recorded=_read_recorded(message))
        except CloudError as error:
            self._note(f"{message.channel.topic}: {error}")
        if self._is_ready:
            self.finish()

    def finish(self) -> None:
        """Try whether the packets so far suffice for a decoder."""
        data, calibrations = self._samples.data, self._samples.calibrations
        if data:
            length = Counter(len(payload) for _, payload in data).most_common(1)[0][0]
            sample, info = sample_of(calibrations, data, length)
            self.options = replace(self.options, info=info)
            self._try(sample)
        elif calibrations:
            self._note("only device information, no data packets")

    def _try(self, sample: Packets) -> None:
        if self._family is None:
            return
        make = partial(self._family.decoder, sample, self.options)
        try:
            self.found = Decodable(make, make().facts, sample.payloads.shape[1])
        except MissingExtraError as error:
            self.is_done = True
            self._note(str(error))
        except InputError as error:
            self._fail(str(error))
            self.is_done |= self._gathers and not isinstance(self._family, SelfCalibrating)
        else:
            self.is_done, self.problems = True, []

    @property
    def _gathers(self) -> bool:
        """Whether a decoder needs more than the packets of one message."""
        return has_single_packets(self.channel) or isinstance(self._family, SelfCalibrating) or bool(self.companion)

    @property
    def _is_ready(self) -> bool:
        if isinstance(self._family, SelfCalibrating):
            return len(self._samples.data) >= MAX_SAMPLES and bool(self._samples.calibrations)
        waits = self.companion is not None and self.options.recorded is None and self.options.calibration is None
        return len(self._samples.data) >= MAX_SAMPLES and not waits

    def _recognise(self, packets: Packets) -> PacketFamily | None:
        """Return the family that sent packets; the only one is taken as it is."""
        if len(self.families) == 1 and not has_single_packets(self.channel):
            return self.families[0]
        return next((f for f in self.families if any(map(f.recognises, packets.payloads[:MAX_SAMPLES]))), None)

    def _gather(self, found: Iterable[Packets]) -> None:
        own, new = self._samples, False
        for packets in found:
            calibrates = np.zeros(len(packets), np.bool_)
            for family in [self._family] if self._family else self.families:
                if isinstance(family, SelfCalibrating):
                    calibrates = family.is_calibration(packets.payloads)
            before = len(own.data)
            own.add(packets, calibrates)
            new |= bool(calibrates.any()) or before < len(own.data) == MAX_SAMPLES
        if new and self._is_ready:
            self.finish()

    def _fail(self, problem: str) -> None:
        self._note(problem)
        self.is_done = len(self.problems) >= _MAX_TRIES and not self._samples.data

    def _note(self, problem: str) -> None:
        self.problems.append(f"{self.channel.topic} is not decoded: {problem}")


def probe(records: Callable[[], Iterable[Record]], candidates: Iterable[Candidate]) -> None:
    """Read a log until it is known which of some topics can be decoded."""
    left = list(candidates)
    for message in (record for record in (records() if left else ()) if isinstance(record, Message)):
        for candidate in left:
            if message.channel.id == candidate.channel.id:
                candidate.add(message)
            elif candidate.companion and message.channel.id == candidate.companion.id:
                candidate.add_calibration(message)
        left = [candidate for candidate in left if not candidate.is_done]
        if not left:
            break
    for candidate in left:
        candidate.finish()


def make_candidates(
    channels: Collection[Channel], families: Iterable[PacketFamily], options: DecoderOptions
) -> list[Candidate]:
    """Return a candidate for each channel of packets; topics with only calibrations are left out."""
    known, found = list(families), []
    for channel in channels:
        if of_channel := find_families(channel, known):
            companion = _find_companion(channel, channels)
            found.append(Candidate(channel, of_channel, options, companion))
    companions = {candidate.companion.id for candidate in found if candidate.companion}
    return [candidate for candidate in found if candidate.channel.id not in companions]
