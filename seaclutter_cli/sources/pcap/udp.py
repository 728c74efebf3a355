"""UDP datagrams in the records of a capture."""

import ipaddress
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Callable, Hashable, Iterator
from struct import Struct
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.packets import Packets
from seaclutter_cli.sources.pcap.records import RecordReader, Records
from seaclutter_cli.sources.shared.log_file import LogFile

_HEAD = 128
_COOKED_2, _RAW, _LOOPBACK = 276, (12, 14, 101, 228, 229), (0, 108)
_KIND_AT = {1: 12, 113: 14, _COOKED_2: 0}
"""Offset of the kind of content by link type: Ethernet, and the cooked captures of Linux."""
_VLAN = (b"\x81\x00", b"\x88\xa8", b"\x91\x00")
_VERSIONS = {b"\x08\x00": 4, b"\x86\xdd": 6}
_MAX_TAGS = 4
_UDP, _HEADER = 17, Struct(">IHxx")
_MAX_OTHERS, _MAX_HEADERS = 10_000, 64
_MAX_OPEN, _MAX_DONE, _MAX_BYTES = 64, 128, 2**17

Flow = tuple[bytes, int]
"""Address of the sender, and its port and that of the receiver as one number."""

Kind = tuple[Flow, int]
"""Flow and length of a payload."""

_Payloads = NDArray[np.uint8]

K = TypeVar("K", bound=Hashable)


def ends(flow: Flow) -> tuple[str, int, int]:
    """Return the address of the sender, its port, and the port of the receiver."""
    return str(ipaddress.ip_address(flow[0])), flow[1] >> 16, flow[1] & 0xFFFF


class _Header(NamedTuple):
    """Header of a datagram: its payload in the record, and bytes that vary between datagrams of a flow."""

    flow: Flow
    start: int
    size: int
    varying: list[int]


class _Fragments:
    """Reassembly of up to 64 IPv4 datagrams; a new one replaces the oldest. ``lost`` counts the discarded ones.

    Fragments of the last 128 complete ones are known, since each may be received again.
    """

    def __init__(self) -> None:
        self._open: OrderedDict[bytes, dict[int, bytes]] = OrderedDict()
        self._done: OrderedDict[bytes, dict[int, bytes]] = OrderedDict()
        self.lost = 0

    def add(self, key: bytes, offset: int, more: bool, piece: bytes) -> bytes | None:
        """Return the datagram that a fragment at an offset in bytes completes; None if it is incomplete."""
        if self._done.get(key, {}).get(offset) == piece:
            return None
        self._done.pop(key, None)
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
            self._done[key] = self._open.pop(key)
            if len(self._done) > _MAX_DONE:
                self._done.popitem(last=False)
            return data
        if sum(map(len, pieces.values())) > _MAX_BYTES:
            self._discard(key)
        return None

    def finish(self) -> None:
        """Count the incomplete datagrams as lost."""
        self.lost += len(self._open)
        self._open.clear()

    def _discard(self, key: bytes) -> None:
        del self._open[key]
        self.lost += 1


class Udp:
    """Parser of the datagrams in a capture.

    ``cut`` counts the datagrams that the capture truncates by flow, ``other`` records without a datagram; ``unread``
    has offset and length of some of these, to compare with those of sensors. ``shapes`` are the length of a record, and
    the offset of the payload in it, by the length of the payload.
    """

    def __init__(self, file: LogFile) -> None:
        self._file = file
        self.fragments = _Fragments()
        self.cut = Counter[Flow]()
        self.other = 0
        self.unread: list[tuple[int, int]] = []
        self.shapes: dict[int, tuple[int, int]] = {}

    def packets(self, reader: RecordReader, key: Callable[[Kind], K | None]) -> Iterator[tuple[K, Packets]]:
        """Yield the datagrams of kinds with a key, those of equal keys and lengths together, for some records each."""
        for records in reader.batches():
            groups: dict[tuple[K, int], list[tuple[NDArray[np.int64], _Payloads]]] = defaultdict(list)
            for flow, rows, payloads in self._datagrams(records):
                if (group := key((flow, payloads.shape[1]))) is not None:
                    groups[group, payloads.shape[1]].append((rows, payloads))
            for (group, _), parts in groups.items():
                rows, payloads = parts[0]
                if len(parts) > 1:
                    order = np.argsort(np.concatenate([one for one, _ in parts]))
                    rows, payloads = (np.concatenate(one)[order] for one in zip(*parts, strict=True))
                yield group, Packets(records.times_ns[rows], payloads)

    def _datagrams(self, records: Records) -> Iterator[tuple[Flow, NDArray[np.int64], _Payloads]]:
        """Yield flow, rows, shape (D,), and payloads, shape (D, L), of datagrams in records with equal headers."""
        heads, headers = self._heads(records), 0
        left = np.arange(len(heads))
        while len(left):
            row, alike = int(left[0]), np.arange(len(left)) == 0
            found = self._datagram(records, row, heads[row].tobytes())
            if isinstance(found, _Header):
                headers += 1
                if headers < _MAX_HEADERS:
                    differs = heads[left, : found.start] != heads[row, : found.start]
                    differs[:, found.varying] = False
                    alike = ~differs.any(axis=1) & (records.lengths[left] >= found.start + found.size)
                rows = left[alike]
                yield found.flow, rows, _gather(self._file, records.offsets[rows] + found.start, found.size)
            elif found is not None:
                yield found[0], left[:1], np.frombuffer(found[1], np.uint8)[None]
            left = left[~alike]

    def _heads(self, records: Records) -> NDArray[np.uint8]:
        """Return the first bytes of each record, shape (R, 128), padded with zeros after its end."""
        heads = _gather(self._file, records.offsets, _HEAD)
        short = np.flatnonzero(records.lengths < _HEAD)
        heads[short] *= np.arange(_HEAD) < records.lengths[short, None]
        return heads

    def _datagram(self, records: Records, row: int, head: bytes) -> _Header | tuple[Flow, bytes] | None:
        """Return the header of the datagram in a record, or flow and payload of one that its fragment completes."""
        offset, length = int(records.offsets[row]), int(records.lengths[row])
        at, version = _network(records.link, head)
        begin, sender, varying = -1, b"", list[int]()
        if version == 4 and head[at + 9] == _UDP and head[at] & 0x0F >= 5:
            begin, sender = at + (head[at] & 0x0F) * 4, head[at + 12 : at + 16]
            varying = [at + 4, at + 5, at + 10, at + 11]  # identification and checksum
        elif version == 6 and head[at + 6] == _UDP:
            begin, sender = at + 40, head[at + 8 : at + 24]
        if begin < 0:
            self.other += 1
            if len(self.unread) < _MAX_OTHERS:
                self.unread.append((offset, length))
            return None
        if version == 4 and (head[at + 6] & 0x3F or head[at + 7]):
            data = self._join(offset, length, head, at)
            ports, size = _HEADER.unpack_from(data.ljust(_HEADER.size, b"\0"))
            return ((sender, ports), data[_HEADER.size : size]) if _HEADER.size <= size <= len(data) else None
        ports, size = _HEADER.unpack_from(head, begin)
        flow, start = (sender, ports), begin + _HEADER.size
        if size < _HEADER.size or start > length:
            return None
        if begin + size > length:
            if flow in self.cut or len(self.cut) < _MAX_OTHERS:
                self.cut[flow] += 1
            return None
        self.shapes.setdefault(size - _HEADER.size, (length, start))
        return _Header(flow, start, size - _HEADER.size, [*varying, start - 2, start - 1])

    def _join(self, offset: int, length: int, head: bytes, at: int) -> bytes:
        """Return the datagram that a fragment completes; empty if it is still incomplete."""
        begin, end = at + (head[at] & 0x0F) * 4, at + int.from_bytes(head[at + 2 : at + 4], "big")
        if not begin < end <= length:
            return b""  # truncated: its datagram remains incomplete, and is counted as lost
        position = int.from_bytes(head[at + 6 : at + 8], "big")
        key = head[at + 12 : at + 20] + head[at + 4 : at + 6]
        piece = bytes(self._file[offset + begin : offset + end])
        return self.fragments.add(key, (position & 0x1FFF) * 8, bool(position & 0x2000), piece) or b""


def _gather(file: LogFile, offsets: NDArray[np.int64], size: int) -> _Payloads:
    """Return bytes of a file from some offsets on, shape (R, size); those after its end are zeros."""
    start, stop = int(offsets.min()), int(offsets.max()) + size
    block = file[start:stop] if stop <= len(file) else bytes(file[start:stop]).ljust(stop - start, b"\0")
    return np.ndarray((stop - start - size + 1, size), np.uint8, block, strides=(1, 1))[offsets - start]


def _network(link: int, head: bytes) -> tuple[int, int]:
    """Return the offset of the IP header in a record, and its version; 0 without a header."""
    if link in _RAW or link in _LOOPBACK:
        at = 0 if link in _RAW else 4
        version = head[at] >> 4
        return at, version if version in (4, 6) else 0
    if link not in _KIND_AT:
        return 0, 0
    at = _KIND_AT[link]
    kind = head[at : at + 2]
    at += 20 if link == _COOKED_2 else 2
    for _ in range(_MAX_TAGS):
        if kind not in _VLAN:
            break
        kind = head[at + 2 : at + 4]
        at += 4
    version = head[at] >> 4
    return at, version if _VERSIONS.get(kind) == version else 0
