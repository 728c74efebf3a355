"""UDP datagrams in the records of a capture."""

import ipaddress
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Callable, Hashable, Iterator
from itertools import islice
from struct import Struct
from typing import TypeVar

import numpy as np

from seaclutter_cli.records import Buffer
from seaclutter_cli.sensors.packets import Packets
from seaclutter_cli.sources.pcap.records import RecordReader
from seaclutter_cli.sources.shared.log_file import LogFile

_BATCH = 1024
_HEAD = 128
_COOKED_2, _RAW, _LOOPBACK = 276, (12, 14, 101, 228, 229), (0, 108)
_KIND_AT = {1: 12, 113: 14, _COOKED_2: 0}
"""Offset of the kind of content by link type: Ethernet, and the cooked captures of Linux."""
_VLAN = (b"\x81\x00", b"\x88\xa8", b"\x91\x00")
_VERSIONS = {b"\x08\x00": 4, b"\x86\xdd": 6}
_MAX_TAGS = 4
_UDP, _HEADER = 17, Struct(">IHxx")
_MAX_OTHERS = 10_000
_MAX_OPEN, _MAX_BYTES = 64, 2**17

Flow = tuple[bytes, int]
"""Address of the sender, and its port and that of the receiver as one number."""

Kind = tuple[Flow, int]
"""Flow and length of a payload."""

K = TypeVar("K", bound=Hashable)


def ends(flow: Flow) -> tuple[str, int, int]:
    """Return the address of the sender, its port, and the port of the receiver."""
    return str(ipaddress.ip_address(flow[0])), flow[1] >> 16, flow[1] & 0xFFFF


class _Fragments:
    """Reassembly of up to 64 IPv4 datagrams; a new one replaces the oldest. ``lost`` counts the discarded ones."""

    def __init__(self) -> None:
        self._open: OrderedDict[bytes, dict[int, bytes]] = OrderedDict()
        self.lost = 0

    def add(self, key: bytes, offset: int, more: bool, piece: bytes) -> bytes | None:
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
        records = reader.records()
        while batch := list(islice(records, _BATCH)):
            groups: dict[tuple[K, int], tuple[list[int], list[Buffer]]] = defaultdict(lambda: ([], []))
            for link, offset, length, time_ns in batch:
                flow, payload = self._datagram(link, offset, length) or (None, b"")
                if flow is not None and (group := key((flow, len(payload)))) is not None:
                    times_ns, payloads = groups[group, len(payload)]
                    times_ns.append(time_ns)
                    payloads.append(payload)
            for (group, size), (times_ns, payloads) in groups.items():
                data = np.frombuffer(b"".join(payloads), np.uint8).reshape(len(payloads), size)
                yield group, Packets(np.array(times_ns, np.int64), data)

    def _datagram(self, link: int, offset: int, length: int) -> tuple[Flow, Buffer] | None:
        """Return flow and payload of the datagram that a record contains or completes; None if there is none."""
        data: Buffer = self._file[offset : offset + length]
        head = bytes(data[:_HEAD]).ljust(_HEAD, b"\0")
        at, version = _network(link, head)
        begin, sender = -1, b""
        if version == 4 and head[at + 9] == _UDP and head[at] & 0x0F >= 5:
            begin, sender = at + (head[at] & 0x0F) * 4, head[at + 12 : at + 16]
        elif version == 6 and head[at + 6] == _UDP:
            begin, sender = at + 40, head[at + 8 : at + 24]
        if begin < 0:
            self.other += 1
            if len(self.unread) < _MAX_OTHERS:
                self.unread.append((offset, length))
            return None
        is_part = version == 4 and (head[at + 6] & 0x3F or head[at + 7])
        if is_part:
            data, begin = self._join(data, head, at, begin), 0
        start = begin + _HEADER.size
        if start > len(data):
            return None
        ports, size = _HEADER.unpack_from(data, begin)
        flow, end = (sender, ports), begin + size
        if end > len(data):
            self.cut[flow] += not is_part
            return None
        if not is_part and end >= start:
            self.shapes.setdefault(end - start, (length, start))
        return (flow, data[start:end]) if end >= start else None

    def _join(self, data: Buffer, head: bytes, at: int, begin: int) -> bytes:
        """Return the datagram that a fragment completes; empty if it is still incomplete."""
        end = at + int.from_bytes(head[at + 2 : at + 4], "big")
        if not begin < end <= len(data):
            return b""  # truncated: its datagram remains incomplete, and is counted as lost
        position = int.from_bytes(head[at + 6 : at + 8], "big")
        key = head[at + 12 : at + 20] + head[at + 4 : at + 6]
        piece = bytes(data[begin:end])
        return self.fragments.add(key, (position & 0x1FFF) * 8, bool(position & 0x2000), piece) or b""


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
