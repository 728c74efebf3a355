"""UDP datagrams in the records of a capture, parsed in batches."""

import ipaddress
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.packets import Packets
from seaclutter_cli.sources.pcap.records import RecordReader, Records
from seaclutter_cli.sources.shared.log_file import Bytes, LogFile

_HEAD = 128
_ETHERNET, _COOKED, _COOKED_2, _RAW = 1, 113, 276, (12, 14, 101, 228, 229)
_LOOPBACK = (0, 108)
_VLAN = (0x8100, 0x88A8, 0x9100)
_MAX_TAGS = 4
_IPV4, _IPV6, _UDP = 0x0800, 0x86DD, 17
_MAX_ADDRESSES = 2**15
_MAX_OTHERS = 10_000
_MAX_OPEN, _MAX_BYTES = 64, 2**17


_Key = tuple[int, int, int]


@dataclass(frozen=True)
class Datagrams:
    """D UDP datagrams in order; all arrays but ``cut`` have the shape (D,).

    Flows are sender and ports as one number, see `Udp.ends`; times are in nanoseconds of Unix time. Offsets and lengths
    are those of payloads in ``data``: the file, or datagrams that were sent in fragments. ``cut`` are the flows of the
    datagrams that the capture truncates.
    """

    data: Bytes[bytes | memoryview]
    flows: NDArray[np.int64]
    times_ns: NDArray[np.int64]
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]
    cut: NDArray[np.int64]

    def packets(self, rows: NDArray[np.int64]) -> Packets:
        """Return datagrams of equal length."""
        return Packets(self.times_ns[rows], _gather(self.data, self.offsets[rows], int(self.lengths[rows[0]])))


def _gather(data: Bytes[bytes | memoryview], offsets: NDArray[np.int64], length: int) -> NDArray[np.uint8]:
    """Return the bytes at offsets, shape (P, length)."""
    start, stop = int(offsets.min()), int(offsets.max()) + length
    block = data[start:stop]
    return np.ndarray((stop - start - length + 1, length), np.uint8, block, strides=(1, 1))[offsets - start]


@dataclass
class _UnreadRecords:
    """Offset and length of records without a datagram, some with damaged headers, to compare with those of sensors.

    ``shapes`` are the length of a record and the offset of the payload in it, by the length of the payload.
    """

    shapes: dict[int, tuple[int, int]] = field(default_factory=dict)
    others: list[tuple[int, int]] = field(default_factory=list)

    def add(
        self, records: Records, used: NDArray[np.int64], rows: NDArray[np.int64], payloads: NDArray[np.int64]
    ) -> None:
        """Add records, given those with a datagram or a part of one, and those with a complete datagram.

        ``payloads``, shape (2, D), are the offset in the record, and the length, of the payloads of the latter.
        """
        _, firsts = np.unique(payloads[1], return_index=True)
        for first in firsts.tolist():
            start, length = payloads[:, first].tolist()
            self.shapes.setdefault(length, (int(records.lengths[rows[first]]), start))
        if len(used) < len(records.offsets) and len(self.others) < _MAX_OTHERS:
            other = np.setdiff1d(np.arange(len(records.offsets)), used)
            self.others += zip(records.offsets[other].tolist(), records.lengths[other].tolist(), strict=True)
            del self.others[_MAX_OTHERS:]

    def count(self, file: LogFile, length: int, recognises: Callable[[NDArray[np.uint8]], bool]) -> int:
        """Return the number of records without a datagram that have length and payload of a sensor's records."""
        size, start = self.shapes[length]
        found = (file[offset + start : offset + start + length] for offset, other in self.others if other == size)
        return sum(recognises(np.frombuffer(payload, np.uint8)) for payload in found)


class _Fragments:
    """Reassembly of up to 64 IPv4 datagrams; a new one replaces the oldest. ``lost`` counts the discarded ones."""

    def __init__(self) -> None:
        self._open: OrderedDict[_Key, dict[int, bytes]] = OrderedDict()
        self.lost = 0

    def add(self, key: _Key, offset: int, more: bool, piece: bytes) -> bytes | None:
        """Return the datagram that a fragment completes; None if it is still incomplete.

        The key is sender, receiver and identification, the offset that of the fragment in the datagram in bytes.
        """
        if self._open.get(key, {}).get(offset, piece) != piece:
            self._discard(key)  # the identification is reused
        if key not in self._open and len(self._open) >= _MAX_OPEN:
            self._discard(next(iter(self._open)))
        pieces = self._open.setdefault(key, {})
        pieces[offset] = piece
        if not more:
            pieces[offset + len(piece)] = b""  # marks the end
        data = b""
        while found := pieces.get(len(data)):
            data += found
        if len(data) in pieces:
            del self._open[key]
            return data
        if sum(map(len, pieces.values())) > _MAX_BYTES:
            self._discard(key)
        return None

    def finish(self) -> None:
        """Count the incomplete datagrams as lost."""
        self.lost += len(self._open)
        self._open.clear()

    def _discard(self, key: _Key) -> None:
        del self._open[key]
        self.lost += 1


class Udp:
    """Parser of the datagrams in a capture; ``other`` counts records without a datagram, ``unread`` has some."""

    def __init__(self, file: LogFile) -> None:
        self._file = file
        self._addresses: dict[bytes, int] = {}
        self._names: list[bytes] = []
        self.fragments = _Fragments()
        self.other = 0
        self.unread = _UnreadRecords()

    def ends(self, flow: int) -> tuple[str, int, int]:
        """Return the address of the sender, its port, and the port of the receiver."""
        return str(ipaddress.ip_address(self._names[flow >> 32])), flow >> 16 & 0xFFFF, flow & 0xFFFF

    def datagrams(self, reader: RecordReader) -> Iterator[Datagrams]:
        """Yield the datagrams in a capture in batches; those that were sent in fragments are batches of their own."""
        for records in reader.batches():
            heads = self._heads(records)
            (rows, udp, sources), fragments = self._parse(records, heads)
            self.other += len(records.offsets) - len(rows) - len(fragments)
            ports = _word(heads, rows, udp) << 16 | _word(heads, rows, udp + 2)
            lengths = _word(heads, rows, udp + 4) - 8
            flows, start, size = sources << 32 | ports, udp + 8, records.lengths[rows]
            good = (lengths >= 0) & (start <= size)
            whole = good & (start + lengths <= size)
            payloads = np.stack((start, lengths))[:, whole]
            self.unread.add(records, np.concatenate((rows, fragments)), rows[whole], payloads)
            times_ns, offsets = records.times_ns[rows[whole]], records.offsets[rows[whole]] + start[whole]
            yield Datagrams(self._file, flows[whole], times_ns, offsets, lengths[whole], flows[good & ~whole])
            if len(fragments):
                yield self._joined(records, heads, fragments)

    def _heads(self, records: Records) -> NDArray[np.uint8]:
        """Return the first bytes of each record, shape (R, 128), padded with zeros after its end."""
        offsets = records.offsets
        heads = np.zeros((len(offsets), _HEAD), np.uint8)
        inside = offsets + _HEAD <= len(self._file)
        if inside.any():
            heads[inside] = _gather(self._file, offsets[inside], _HEAD)
        for row in np.flatnonzero(~inside).tolist():
            rest = self._file[int(offsets[row]) : len(self._file)]
            heads[row, : len(rest)] = np.frombuffer(rest, np.uint8)
        short = np.flatnonzero(records.lengths < _HEAD)
        if len(short):
            heads[short] *= np.arange(_HEAD) < records.lengths[short, None]
        return heads

    def _parse(self, records: Records, heads: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return rows, offsets of UDP headers and numbers of senders, shape (3, D), and the rows of fragments."""
        network, version = _network(records.link, heads)
        found: list[NDArray[np.int64]] = []
        fragments = np.empty(0, np.int64)
        for kind, protocol_at, sender_at, size in ((4, 9, 12, 4), (6, 6, 8, 16)):
            rows = np.flatnonzero(version == kind)
            rows = rows[heads[rows, network[rows] + protocol_at] == _UDP]
            at = network[rows]
            sources = self._numbers(heads[rows[:, None], at[:, None] + sender_at + np.arange(size)])
            header = np.full(len(rows), 40)
            usable = sources >= 0
            if kind == 4:
                header = (heads[rows, at] & 0x0F).astype(np.int64) * 4
                usable &= header >= 20
                in_parts = (_word(heads, rows, at + 6) & 0x3FFF) != 0
                fragments, usable = rows[in_parts & usable], usable & ~in_parts
            found.append(np.stack((rows, at + header, sources))[:, usable])
        columns = np.concatenate(found, axis=1)
        return columns[:, np.argsort(columns[0], kind="stable")], fragments

    def _numbers(self, addresses: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Return numbers, shape (R,), of addresses, shape (R, 4) or (R, 16); -1 for new ones beyond the limit."""
        different, inverse = np.unique(addresses, axis=0, return_inverse=True)
        numbers = [self._number(address.tobytes()) for address in different]
        return np.array(numbers, np.int64)[inverse.ravel()]

    def _number(self, address: bytes) -> int:
        number = self._addresses.get(address)
        if number is None:
            if len(self._names) >= _MAX_ADDRESSES:
                return -1
            number = self._addresses[address] = len(self._names)
            self._names.append(address)
        return number

    def _joined(self, records: Records, heads: NDArray[np.uint8], fragments: NDArray[np.int64]) -> Datagrams:
        """Return the datagrams that fragments complete."""
        network, _ = _network(records.link, heads[fragments])
        found: list[tuple[int, int, int, int]] = []
        joined, end = [], 0
        for row, at in zip(fragments.tolist(), network.tolist(), strict=True):
            data = self._join(records, heads[row].tobytes(), row, at)
            length = int.from_bytes(data[4:6], "big") - 8 if data else -1
            if 0 <= length <= len(data) - 8:
                source = self._number(heads[row, at + 12 : at + 16].tobytes())
                flow = source << 32 | int.from_bytes(data[:4], "big")
                found.append((flow, int(records.times_ns[row]), end + 8, length))
                joined.append(data)
                end += len(data)
        flows, times_ns, offsets, lengths = np.array(found, np.int64).reshape(-1, 4).T
        return Datagrams(b"".join(joined), flows, times_ns, offsets, lengths, np.empty(0, np.int64))

    def _join(self, records: Records, head: bytes, row: int, at: int) -> bytes:
        """Return the datagram that a fragment completes; empty if it is still incomplete."""
        header = (head[at] & 0x0F) * 4
        begin = int(records.offsets[row]) + at + header
        size = int.from_bytes(head[at + 2 : at + 4], "big") - header
        left = int(records.lengths[row]) - at - header
        if size <= 0 or size > left:
            return b""  # truncated: its datagram remains incomplete, and is counted as lost
        position = int.from_bytes(head[at + 6 : at + 8], "big")
        pair = int.from_bytes(head[at + 12 : at + 16], "big"), int.from_bytes(head[at + 16 : at + 20], "big")
        key = (*pair, int.from_bytes(head[at + 4 : at + 6], "big"))
        piece = bytes(self._file[begin : begin + size])
        return self.fragments.add(key, (position & 0x1FFF) * 8, bool(position & 0x2000), piece) or b""


def _network(link: int, heads: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the offset of the IP header in each record, shape (R,), and its version; 0 without a header."""
    count = len(heads)
    if link in _RAW or link in _LOOPBACK:
        at = np.full(count, 0 if link in _RAW else 4)
        version = heads[np.arange(count), at] >> 4
        return at, np.where((version == 4) | (version == 6), version, 0).astype(np.int64)
    if link not in (_ETHERNET, _COOKED, _COOKED_2):
        return np.zeros(count, np.int64), np.zeros(count, np.int64)
    kind_at = np.full(count, {_ETHERNET: 12, _COOKED: 14, _COOKED_2: 0}[link])
    rows = np.arange(count)
    kind = _word(heads, rows, kind_at)
    at = kind_at + (20 if link == _COOKED_2 else 2)
    for _ in range(_MAX_TAGS):
        tagged = np.isin(kind, _VLAN)
        if not tagged.any():
            break
        kind = np.where(tagged, _word(heads, rows, at + 2), kind)
        at = at + 4 * tagged
    version = (heads[rows, at] >> 4).astype(np.int64)
    valid = ((kind == _IPV4) & (version == 4)) | ((kind == _IPV6) & (version == 6))
    return at, np.where(valid, version, 0)


def _word(heads: NDArray[np.uint8], rows: NDArray[np.int64], at: NDArray[np.int64]) -> NDArray[np.int64]:
    return heads[rows, at].astype(np.int64) << 8 | heads[rows, at + 1]
