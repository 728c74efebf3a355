"""Packets of a sensor in the order in which it sent them, each once, however the network delivered them."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Ints, Mask
from seaclutter_cli.sensors.packets import PacketDecoder, Packets

_MOST_PACKETS, _MOST_BYTES = 2048, 4 * 2**20
"""Earlier packets that are kept: at least those of 50 ms."""
_LATEST_NS = 100_000_000
_LEAST_HELD = 64
_LEAST_SPACING = 0.75
"""Share of the usual distance between places that packets have which were only delivered in another order."""

_Places = Ints


class PacketOrder:
    """Order of the packets for a decoder; counts those that were ``repeated``, ``moved``, or too ``late`` to be used.

    Repeated ones equal in all bytes one that was received up to 100 ms before. Packets wait for late ones only after
    there were some: as long as they arrive in order, they are passed on at once. Packets are not late if the clock was
    set back, or a recording is played again: their places would then lie between those of others.
    """

    def __init__(self, decoder: PacketDecoder) -> None:
        self.repeated = self.moved = self.late = 0
        self._decoder = decoder
        self._passed: list[tuple[Packets, _Places]] = []
        self._waiting: list[tuple[Packets, _Places]] = []
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

    def _pass(self, packets: Packets, places: _Places) -> Iterator[Packets]:
        """Yield packets and remember them instead of the first ones."""
        if len(packets):
            self._passed.append((packets, places))
            spare = sum(len(part) for _, part in self._passed) - _most(packets)
            while spare >= len(self._passed[0][1]):
                spare -= len(self._passed.pop(0)[1])
            yield packets

    def _steps(self, places: _Places) -> _Places:
        """Return the steps between places, shape (P - 1,), across the end of their range."""
        half = self._decoder.places_end // 2
        return np.asarray((np.diff(places) + half) % self._decoder.places_end - half)

    def _sort(self, packets: Packets, places: _Places) -> Iterator[Packets]:
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

    def _unwrapped(self, places: _Places) -> tuple[_Places, float]:
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


def _repeats(places: _Places, packets: Packets) -> Mask:
    """Return which packets, shape (P,), equal an earlier one that was received not long before."""
    _, group, sizes = np.unique(places, return_inverse=True, return_counts=True)
    again, seen = np.zeros(len(places), np.bool_), dict[bytes, int]()
    for row in np.flatnonzero(sizes[group] > 1).tolist():
        payload, time_ns = packets.payloads[row].tobytes(), int(packets.times_ns[row])
        again[row] = payload in seen and abs(time_ns - seen[payload]) <= _LATEST_NS
        if not again[row]:
            seen[payload] = time_ns
    return again


def _order(places: _Places, least: float) -> NDArray[np.intp]:
    """Return the order of packets, shape (P,), by their places; as they are where two would lie too close together."""
    order = np.argsort(places, kind="stable")
    is_end = np.maximum.accumulate(places)[:-1] <= np.minimum.accumulate(places[::-1])[-2::-1]
    group = np.cumsum(np.append(False, is_end))
    close = (np.diff(places[order]) < least) & ~is_end
    as_they_are = np.isin(group, group[1:][close])
    order[as_they_are] = np.flatnonzero(as_they_are)
    return order
