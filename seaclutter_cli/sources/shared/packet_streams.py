"""Packets of a sensor in a recording: samples from which its decoder is made, and the clouds that it decodes."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import CODECS
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.sensors.order import PacketOrder
from seaclutter_cli.sensors.packets import PacketDecoder, PacketFamily, PacketFrame, Packets
from seaclutter_cli.text import count

MAX_SAMPLES, MAX_CALIBRATIONS = 64, 32


@dataclass
class Samples:
    """Times and payloads of some data packets, and of some calibration packets."""

    data: list[tuple[int, bytes]] = field(default_factory=list)
    calibrations: list[tuple[int, bytes]] = field(default_factory=list)

    def add(self, packets: Packets, family: PacketFamily) -> None:
        """Add packets of a family, of which only those of a self-calibrating one are checked."""
        calibrates = family.is_calibration(packets.payloads)
        is_data = ~calibrates
        if family.calibrates:
            is_data[:MAX_SAMPLES] &= [family.recognises(payload) for payload in packets.payloads[:MAX_SAMPLES]]
        for into, chosen, most in (
            (self.data, is_data, MAX_SAMPLES),
            (self.calibrations, calibrates, MAX_CALIBRATIONS),
        ):
            rows = np.flatnonzero(chosen)[: most - len(into)]
            payloads = map(np.ndarray.tobytes, packets.payloads[rows])
            into.extend(zip(packets.times_ns[rows].tolist(), payloads, strict=True))

    def packets(self, length: int) -> tuple[Packets, NDArray[np.uint8] | None]:
        """Return the packets of a length, calibrations first, and the calibrations of another length, shape (I, M)."""
        pairs = [pair for pair in (*self.calibrations, *self.data) if len(pair[1]) == length]
        payloads = np.frombuffer(b"".join(payload for _, payload in pairs), np.uint8).reshape(len(pairs), length)
        others = [np.frombuffer(payload, np.uint8) for _, payload in self.calibrations if len(payload) != length]
        return Packets(np.array([time_ns for time_ns, _ in pairs], np.int64), payloads), np.stack(
            others
        ) if others else None


@dataclass
class CloudStream:
    """The clouds of a sensor in a source, as messages of a channel, and what its decoder says about its packets."""

    source: Source
    channel: Channel
    decoder: PacketDecoder
    packet_bytes: int
    times_ns: tuple[int, int] | None = None
    """Log time and publish time of the next messages; None for their stamps."""
    frame_id: str | None = None
    frames: int = 0
    partial: int = 0

    def __post_init__(self) -> None:
        self._order = PacketOrder(self.decoder)

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that the next packets complete."""
        for part in self._order.add(packets):
            yield from self.decoder.add(part)

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the frames of the remaining packets."""
        for part in self._order.finish():
            yield from self.decoder.add(part)
        yield from self.decoder.finish()

    def messages(self, frames: Iterable[PacketFrame]) -> Iterator[Message]:
        """Yield the messages of frames; those that cannot be written are damage."""
        channel = self.channel
        codec = CODECS[channel.schema.name if channel.schema else "", channel.message_encoding]
        for number, frame in enumerate(frames, self.frames):
            self.frames += 1
            self.partial += frame.partial
            cloud = replace(from_array(frame.points, stamp_ns=frame.stamp_ns), extra=number)
            if self.frame_id is not None:
                cloud = replace(cloud, frame_id=self.frame_id)
            try:
                data = codec.encode(cloud)
            except CloudError as error:
                problem = f"frame {number} of {channel.topic} cannot be written ({error})"
                self.source.report(problem, len(cloud.data), 1)
            else:
                yield Message(channel, *(self.times_ns or (frame.stamp_ns, frame.stamp_ns)), number, data)

    def conclude(self, path: Path, where: str, cut: int = 0) -> None:
        """Report, at the end, what was counted, also ``cut`` packets; ``where`` says where revolutions are partial."""
        topic, facts, order = self.channel.topic, self.decoder.facts, self._order
        if self.partial:
            facts.details["partial revolutions"] = f"{self.partial}, {where}"
        self.source.warn(*(f"{topic}: {text}" for text in facts.warnings))
        for number, problem in (
            (facts.lost_packets, "missing, counted from gaps"),
            (order.repeated, "received again, left out"),
            (order.moved, "received late, put in order"),
            (order.late, "received too late, left out"),
        ):
            if number:
                self.source.warn(f"{topic}: {count(number, 'packet')} {problem}")
        for number, problem in ((facts.bad_packets, "that cannot be decoded"), (cut, "truncated by the capture")):
            if number:
                text = f"{topic}: {count(number, 'packet')} {problem}"
                self.source.report(text, number * self.packet_bytes, path=path)
