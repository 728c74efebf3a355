"""Packets of a sensor in a recording: samples from which its decoder is made, their order, and the clouds of them.

Each packet is used once, in the order in which the sensor sent them, however the network delivered them.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Ints, Mask
from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import CloudError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import CODECS
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.sensors.packets import PacketDecoder, PacketFamily, PacketFrame, Packets
from seaclutter_cli.text import count

MAX_SAMPLES, MAX_CALIBRATIONS = 64, 32
_MOST_PACKETS, _MOST_BYTES = 2048, 4 * 2**20
"""Earlier packets that are kept: at least those of 50 ms."""
_LATEST_NS = 100_000_000
_LEAST_HELD = 64
_LEAST_SPACING = 0.75
"""Share of the usual distance between places that packets have which were only delivered in another order."""


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
        sample = Packets(np.array([time_ns for time_ns, _ in pairs], np.int64), payloads)
        return sample, np.stack(others) if others else None


class PacketOrder:
    """Order of the packets for a decoder; counts those that were ``repeated``, ``moved``, or too ``late`` to be used.

    Repeated ones equal in all bytes one that was received up to 100 ms before. Packets wait for late ones only after
    there were some: as long as they arrive in order, they are passed on at once. Packets are not late if the clock was
    set back, or a recording is played again: their places would then lie between those of others.
    """

    def __init__(self, decoder: PacketDecoder) -> None:
        self.repeated = self.moved = self.late = 0
        self._decoder = decoder
        self._passed: list[tuple[Packets, Ints]] = []
        self._waiting: list[tuple[Packets, Ints]] = []
        self._held = 0

    def add(self, packets: Packets) -> Iterator[Packets]:
        """Yield the packets whose order is known; those without a place, such as device information, at once."""
        places = self._decoder.places(packets)
        if not (has_place := places >= 0).all():
            yield packets[~has_place]
            packets, places = packets[has_place], places[has_place]
        if not len(packets):
            return
        if any(one.payloads.shape[1] != packets.payloads.shape[1] for one, _ in (*self._passed, *self._waiting)):
            yield from self.finish()
            self._passed = []
        before = self._passed[-1][1][-1:] if self._passed else places[:0]
        if not self._held and (self._steps(np.append(before, places)) > 0).all():
            yield from self._pass(packets, places)
        else:
            yield from self._sort(packets, places)

    def finish(self) -> Iterator[Packets]:
        """Yield the packets that wait."""
        for packets, places in self._waiting:
            yield from self._pass(packets, places)
        self._waiting = []

    def _pass(self, packets: Packets, places: Ints) -> Iterator[Packets]:
        """Yield packets and remember them instead of the first ones."""
        if len(packets):
            self._passed.append((packets, places))
            spare = sum(len(part) for _, part in self._passed) - _most(packets)
            while spare >= len(self._passed[0][1]):
                spare -= len(self._passed.pop(0)[1])
            yield packets

    def _steps(self, places: Ints) -> Ints:
        """Return the steps between places, shape (P - 1,), across the end of their range."""
        half = self._decoder.places_end // 2
        return np.asarray((np.diff(places) + half) % self._decoder.places_end - half)

    def _sort(self, packets: Packets, places: Ints) -> Iterator[Packets]:
        """Yield those of the waiting and the next packets that no later one can precede, in order."""
        passed, waiting = (sum(len(part) for _, part in parts) for parts in (self._passed, self._waiting))
        parts = [*self._passed, *self._waiting, (packets, places)]
        packets, places = Packets.joined([one for one, _ in parts]), np.concatenate([one for _, one in parts])
        times, usual = self._unwrapped(places)
        rows = np.flatnonzero(~_repeats(times, packets))
        self.repeated += len(packets) - len(rows)
        order = _order(times[rows], usual * _LEAST_SPACING)
        earlier = np.empty_like(order)
        earlier[order] = order - np.arange(len(order))
        place = np.arange(len(order)) - earlier
        is_new, is_late = rows >= passed + waiting, (rows >= passed) & (place < place[:passed].max(initial=-1))
        self.moved += int(((earlier > 0) & is_new & ~is_late).sum())
        self.late += int(is_late.sum())
        if earlier.any():
            self._held = min(max(self._held, _LEAST_HELD, 2 * int(earlier.max())), _most(packets))
        left = rows[order[((rows >= passed) & ~is_late)[order]]]
        ready, waits = np.split(left, [max(len(left) - self._held, 0)])
        self._waiting = [(packets[waits], places[waits])]
        yield from self._pass(packets[ready], places[ready])

    def _unwrapped(self, places: Ints) -> tuple[Ints, float]:
        """Return places without wraps and jumps beyond all of these packets, and the usual distance of two."""
        distances = np.diff(np.unique(places))
        usual = float(np.median(distances)) if len(distances) else 1.0
        steps = self._steps(places)
        steps = np.where(np.abs(steps) > len(places) * usual, round(usual), steps)
        return np.cumsum(np.append(0, steps)), usual


def _most(packets: Packets) -> int:
    """Return the number of packets with which later ones are compared."""
    size = int(packets.payloads.shape[1])
    return max(min(_MOST_PACKETS, _MOST_BYTES // max(size, 1)), _LEAST_HELD)


def _repeats(places: Ints, packets: Packets) -> Mask:
    """Return which packets, shape (P,), equal an earlier one that was received not long before."""
    _, group, sizes = np.unique(places, return_inverse=True, return_counts=True)
    again, seen = np.zeros(len(places), np.bool_), dict[bytes, int]()
    for row in np.flatnonzero(sizes[group] > 1).tolist():
        payload, time_ns = packets.payloads[row].tobytes(), int(packets.times_ns[row])
        again[row] = payload in seen and abs(time_ns - seen[payload]) <= _LATEST_NS
        if not again[row]:
            seen[payload] = time_ns
    return again


def _order(places: Ints, least: float) -> NDArray[np.intp]:
    """Return the order of packets, shape (P,), by their places; as they are where two would lie too close together."""
    order = np.argsort(places, kind="stable")
    is_end = np.maximum.accumulate(places)[:-1] <= np.minimum.accumulate(places[::-1])[-2::-1]
    group = np.cumsum(np.append(False, is_end))
    close = (np.diff(places[order]) < least) & ~is_end
    as_they_are = np.isin(group, group[1:][close])
    order[as_they_are] = np.flatnonzero(as_they_are)
    return order


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
