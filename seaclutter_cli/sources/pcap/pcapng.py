"""PCAPNG captures: blocks of several kinds, in sections of either byte order."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sources.pcap import PCAPNG_MAGIC
from seaclutter_cli.sources.pcap.records import BATCH, MAX_PACKET, RecordReader, Records
from seaclutter_cli.sources.shared.log_file import LogFile, unpack

_SECTION, _INTERFACE, _OLD_PACKET, _SIMPLE_PACKET, _PACKET = 0x0A0D0D0A, 1, 2, 3, 6
_OTHER_KINDS = frozenset((*range(4, 12), 0xBAD, 0x40000BAD))
"""Blocks without packets: names, statistics, decryption secrets, custom ones."""
_LOCAL_KINDS = 0x80000000
_KINDS = (_SECTION, _INTERFACE, _OLD_PACKET, _SIMPLE_PACKET, _PACKET)
_ORDER = {bytes.fromhex("1a2b3c4d"): ">", bytes.fromhex("4d3c2b1a"): "<"}
_RESOLUTION, _TIME_OFFSET = 9, 14
_MIN_BLOCK, _MAX_BLOCK = 12, 2**24
_LATEST_NS = 2**62
_WINDOW = 2**20
_RUN, _SINGLY = 4, 64

Row = tuple[int, int, int]


@dataclass(frozen=True)
class Interface:
    """An interface on which packets were captured; its clock has ``ticks`` per second."""

    link: int
    snap: int
    ticks: int = 10**6
    offset_s: int = 0

    def time_ns(self, ticks: int) -> int:
        """Return a time stamp in nanoseconds of Unix time."""
        return max(min(ticks * 10**9 // self.ticks + self.offset_s * 10**9, _LATEST_NS), -_LATEST_NS)

    def times_ns(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return time stamps, shape (N,), in nanoseconds of Unix time."""
        whole, rest = divmod(10**9, self.ticks)
        if rest or int(ticks.max()) > _LATEST_NS // 2 // whole or int(ticks.min()) < 0:
            return np.array([self.time_ns(tick & (2**64 - 1)) for tick in ticks.tolist()], np.int64)
        return ticks * whole + self.offset_s * 10**9


class PcapngReader(RecordReader):
    """Reader of a PCAPNG capture."""

    def __init__(self, file: LogFile, path: Path) -> None:
        super().__init__(file, path)
        self._interfaces: list[Interface] = []
        self._time_ns = 0
        self._use_order("<")

    def _use_order(self, order: str) -> None:
        self._order = order
        self._block, self._length = struct.Struct(order + "II"), struct.Struct(order + "I")
        self._packet, self._old_packet = struct.Struct(order + "IIIII"), struct.Struct(order + "HHIIII")

    def batches(self) -> Iterator[Records]:
        """Yield all records in order, in batches."""
        parts: list[NDArray[np.int64]] = []
        link, offset, left, singly = -1, 0, BATCH, 0
        while offset < self._size:
            kind, length = self._read_block(offset)
            if not length:
                offset = self._skip_damage(offset)
                continue
            found = self._read_packet(kind, offset, length)
            if found is None:
                offset += length
                continue
            if parts and (found[0] != link or not left):
                yield Records(link, *np.concatenate(parts).T.copy())
                parts, left = [], BATCH
            link, row = found
            rows = np.array([row], np.int64)
            # Blocks of equal length are read all at once; where the lengths change, one by one.
            if kind == _PACKET and not singly:
                rows = self._run(offset, length, row, left)
                singly = 0 if len(rows) >= _RUN else _SINGLY
            else:
                singly = max(singly - 1, 0)
            parts.append(rows)
            left -= len(rows)
            offset += length * len(rows)
        if parts:
            yield Records(link, *np.concatenate(parts).T.copy())

    def _run(self, offset: int, length: int, row: Row, limit: int) -> NDArray[np.int64]:
        """Return the rows of packets of equal length and interface from a block on; ``row`` is the first row."""
        word = np.dtype(self._order + "u4")
        count = min(limit, (self._size - offset) // length, max(_WINDOW // length, 1))
        block = self._file[offset : offset + count * length]
        words = np.ndarray((count, 6), word, block, strides=(length, 4)).astype(np.int64)
        ends = np.ndarray((count,), word, block, length - 4, (length,))
        alike = (words[:, [0, 1, 2, 5]] == words[0, [0, 1, 2, 5]]).all(axis=1) & (ends == length)
        count = count if alike.all() else int(np.argmin(alike))
        ticks = words[:count, 3] << 32 | words[:count, 4]
        rows = np.empty((count, 3), np.int64)
        rows[:, 0], rows[:, 1] = row[0] + np.arange(count) * length, row[1]
        rows[:, 2] = self._interfaces[int(words[0, 2])].times_ns(ticks)
        self._time_ns = int(rows[-1, 2])
        return rows

    def _read_block(self, offset: int) -> tuple[int, int]:
        """Return kind and length of the block at an offset; a length of 0 if it is not a valid block."""
        data = self._file
        if offset + _MIN_BLOCK > self._size:
            return 0, 0
        if data[offset : offset + 4] == PCAPNG_MAGIC:
            order = _ORDER.get(bytes(data[offset + 8 : offset + 12]))
            if order is None:
                return 0, 0
            self._use_order(order)
        kind, length = unpack(self._block, data, offset)
        if not _MIN_BLOCK <= length <= _MAX_BLOCK or length % 4 or offset + length > self._size:
            return 0, 0
        if unpack(self._length, data, offset + length - 4)[0] != length:
            return 0, 0
        return int(kind), int(length)

    def _read_packet(self, kind: int, offset: int, length: int) -> tuple[int, Row] | None:
        """Return link type and row of a block; None if it contains no valid packet."""
        data, body, number = self._file, offset + 8, 0
        room = length - _MIN_BLOCK
        if kind == _PACKET and room >= 20:
            number, high, low, captured, _ = unpack(self._packet, data, body)
        elif kind == _OLD_PACKET and room >= 20:
            number, _, high, low, captured, _ = unpack(self._old_packet, data, body)
        elif kind == _SIMPLE_PACKET and room >= 4 and self._interfaces:
            captured, high, low = unpack(self._length, data, body)[0], None, 0
            captured = min(captured, self._interfaces[0].snap or captured, room - 4)
        else:
            if kind == _SECTION:
                self._interfaces = []
            elif kind == _INTERFACE and room >= 8:
                self._interfaces.append(self._read_interface(body, room))
            elif kind < _LOCAL_KINDS and kind not in _OTHER_KINDS:
                self._note(offset, "a block of an unknown kind", length)
            return None
        start = body + (4 if kind == _SIMPLE_PACKET else 20)
        if number >= len(self._interfaces) or captured > min(MAX_PACKET, offset + length - 4 - start):
            self._note(offset, "this packet does not fit its block or interface", length)
            return None
        interface = self._interfaces[number]
        if high is not None:
            self._time_ns = interface.time_ns(high << 32 | low)
        return interface.link, (start, captured, self._time_ns)

    def _read_interface(self, body: int, room: int) -> Interface:
        data = self._file[body : body + room]
        link, _, snap = struct.unpack_from(self._order + "HHI", data)
        ticks, offset_s, at = 10**6, 0, 8
        while at + 4 <= room:
            code, size = struct.unpack_from(self._order + "HH", data, at)
            value = data[at + 4 : at + 4 + size]
            if code == _RESOLUTION and len(value) == 1:
                ticks = 2 ** (value[0] & 0x7F) if value[0] & 0x80 else 10 ** value[0]
            elif code == _TIME_OFFSET and len(value) == 8:
                (offset_s,) = struct.unpack(self._order + "q", value)
            at += 4 + (size + 3) // 4 * 4
            if code == 0:
                break
        offset_s = offset_s if abs(offset_s) < _LATEST_NS // 2 // 10**9 else 0
        return Interface(link, snap, ticks, offset_s)

    def _skip_damage(self, offset: int) -> int:
        found = self._find(offset)
        problem = "the capture ends within a block" if found == self._size else "no packet can be read here"
        self._note(offset, problem, found - offset)
        return found

    def _find(self, offset: int) -> int:
        """Return the next offset after ``offset`` where a block begins; the file size without one."""
        word = np.dtype(self._order + "u4")
        for start in range(offset + 1, self._size - _MIN_BLOCK + 1, _WINDOW):
            count = min(_WINDOW, self._size - _MIN_BLOCK + 1 - start)
            block = self._file[start : start + count + _MIN_BLOCK]
            kinds, lengths = (np.ndarray((count,), word, block, 4 * n, (1,)) for n in range(2))
            is_block = np.isin(kinds, _KINDS) & (lengths >= _MIN_BLOCK) & (lengths <= _MAX_BLOCK) | (kinds == _SECTION)
            for candidate in (np.flatnonzero(is_block) + start).tolist():
                if self._read_block(candidate)[1]:
                    return int(candidate)
        return self._size
