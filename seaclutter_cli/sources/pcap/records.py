"""Records of captures, PCAP and PCAPNG: location of each packet in the file, and capture time."""

import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Damage
from seaclutter_cli.sources.pcap import PCAP_MAGICS, PCAPNG_MAGIC
from seaclutter_cli.sources.shared.log_file import LogFile, unpack

_Row = tuple[int, int, int]

_BATCH = 1024
_MAX_PACKET = 262144
"""Maximum bytes of a captured packet: libpcap's own limit."""
_DAY_S = 86400

_HEADER_BYTES, _RECORD_BYTES = 24, 16
_WINDOW = 2**20
_RUN, _SINGLY = 16, 128

_SECTION, _INTERFACE, _OLD_PACKET, _SIMPLE_PACKET, _PACKET = 0x0A0D0D0A, 1, 2, 3, 6
_OTHER_KINDS = frozenset((*range(4, 12), 0xBAD, 0x40000BAD))
"""Blocks without packets: names, statistics, decryption secrets, custom ones."""
_LOCAL_KINDS = 0x80000000
_KINDS = (_SECTION, _INTERFACE, _OLD_PACKET, _SIMPLE_PACKET, _PACKET)
_ORDER = {bytes.fromhex("1a2b3c4d"): ">", bytes.fromhex("4d3c2b1a"): "<"}
_RESOLUTION, _TIME_OFFSET = 9, 14
_MIN_BLOCK, _MAX_BLOCK = 12, 2**24
_LATEST_NS = 2**62
_BLOCK_RUN, _BLOCK_SINGLY = 4, 64


@dataclass(frozen=True)
class Records:
    """R records of one link type: offset and captured length of each packet in the file, and its capture time.

    All arrays have the shape (R,); times are in nanoseconds of Unix time.
    """

    link: int
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]
    times_ns: NDArray[np.int64]


class RecordReader(ABC):
    """Reader for one pass over a capture."""

    def __init__(self, file: LogFile, path: Path) -> None:
        self._file, self._path, self._size = file, path, len(file)
        self.damage: list[Damage] = []

    @abstractmethod
    def batches(self) -> Iterator[Records]:
        """Yield all records in order, in batches."""

    def _note(self, offset: int, problem: str, size: int) -> None:
        self.damage.append(Damage(self._path, offset, problem, size))


class PcapReader(RecordReader):
    """Reader of a classic capture; `InputError` if the file is shorter than the header."""

    def __init__(self, file: LogFile, path: Path) -> None:
        if len(file) < _HEADER_BYTES:
            raise InputError(f"{path}: the capture ends within its header")
        super().__init__(file, path)
        order, self._tick_ns = PCAP_MAGICS[bytes(file[:4])]
        self._word = np.dtype(order + "u4")
        self._record = struct.Struct(order + "IIII")
        # The upper bits describe checksums.
        self._link = int(struct.unpack(order + "I", file[20:24])[0]) & 0xFFFF
        self._time_ns: int | None = None

    def batches(self) -> Iterator[Records]:
        """Yield all records in order, in batches."""
        offset = _HEADER_BYTES
        while offset < self._size:
            rows, after = self._walk(offset)
            if len(rows):
                self._time_ns = int(rows[-1, 2])
                yield Records(self._link, *rows.T.copy())
            offset = after
            if len(rows) < _BATCH and offset < self._size:
                offset = self._skip_damage(offset)

    def _walk(self, offset: int) -> tuple[NDArray[np.int64], int]:
        """Return the rows of at most one batch, up to the first invalid record, and the offset after them."""
        parts: list[NDArray[np.int64]] = []
        left, many = _BATCH, True
        while left and offset + _RECORD_BYTES <= self._size:
            # Records of equal length are read all at once; where the lengths change, one by one.
            rows, offset = self._run(offset, left) if many else self._step(offset, min(left, _SINGLY))
            if not len(rows):
                break
            many = not many or len(rows) >= _RUN
            parts.append(rows)
            left -= len(rows)
        return np.concatenate(parts) if parts else np.empty((0, 3), np.int64), offset

    def _step(self, offset: int, limit: int) -> tuple[NDArray[np.int64], int]:
        """Return the rows of records from an offset on, read one by one, and the offset after them."""
        data, layout, size, ticks = self._file, self._record, self._size, 10**9 // self._tick_ns
        rows: list[tuple[int, int, int]] = []
        while len(rows) < limit and offset + _RECORD_BYTES <= size:
            seconds, fraction, length, original = unpack(layout, data, offset)
            end = offset + _RECORD_BYTES + length
            if end > size or length > _MAX_PACKET or fraction >= ticks or not original:
                break
            rows.append((offset + _RECORD_BYTES, length, seconds * 10**9 + fraction * self._tick_ns))
            offset = end
        return np.array(rows, np.int64).reshape(-1, 3), offset

    def _run(self, offset: int, limit: int) -> tuple[NDArray[np.int64], int]:
        """Return the rows of records of equal length from an offset on, and the offset after them."""
        length = int(unpack(self._record, self._file, offset)[2])
        size = _RECORD_BYTES + length
        count = min(limit, (self._size - offset) // size, max(_WINDOW // size, 1))
        if length > _MAX_PACKET or not count:
            return np.empty((0, 3), np.int64), offset
        block = self._file[offset : offset + count * size]
        words = np.ndarray((count, 4), self._word, block, strides=(size, 4)).astype(np.int64)
        bad = np.flatnonzero((words[:, 2] != length) | (words[:, 1] >= 10**9 // self._tick_ns) | (words[:, 3] == 0))
        words = words[: bad[0]] if len(bad) else words
        rows = np.empty((len(words), 3), np.int64)
        rows[:, 0] = offset + _RECORD_BYTES + np.arange(len(words)) * size
        rows[:, 1], rows[:, 2] = length, words[:, 0] * 10**9 + words[:, 1] * self._tick_ns
        return rows, offset + len(words) * size

    def _skip_damage(self, offset: int) -> int:
        """Return the offset of the next valid record; report the damage before it, or a truncated last record."""
        found = self._find(offset)
        cut = found == self._size and self._is_truncated(offset)
        problem = "the capture ends within a packet" if cut else "no packet can be read here"
        self._note(offset, problem, found - offset)
        return found

    def _is_truncated(self, offset: int) -> bool:
        if offset + _RECORD_BYTES > self._size:
            return True
        _, fraction, length, original = unpack(self._record, self._file, offset)
        return bool(length <= _MAX_PACKET and fraction < 10**9 // self._tick_ns and original > 0)

    def _find(self, offset: int) -> int:
        """Return the next offset where two plausible records begin, or one that ends the file; or the file size."""
        for start in range(offset + 1, self._size - _RECORD_BYTES + 1, _WINDOW):
            count = min(_WINDOW, self._size - _RECORD_BYTES + 1 - start)
            block = self._file[start : start + count + _RECORD_BYTES]
            words = (np.ndarray((count,), self._word, block, 4 * n, (1,)) for n in range(4))
            seconds, fraction, length, original = words
            likely = (fraction < 10**9 // self._tick_ns) & (length <= _MAX_PACKET) & (length <= original) & (length > 0)
            if self._time_ns is not None:
                likely &= np.abs(seconds.astype(np.int64) - self._time_ns // 10**9) <= _DAY_S
            for candidate in (np.flatnonzero(likely) + start).tolist():
                if self._is_followed(candidate):
                    return int(candidate)
        return self._size

    def _is_followed(self, offset: int) -> bool:
        seconds, _, length, _ = unpack(self._record, self._file, offset)
        end = int(offset + _RECORD_BYTES + length)
        if end + _RECORD_BYTES > self._size:
            return end == self._size
        after, fraction, length, original = unpack(self._record, self._file, end)
        likely = fraction < 10**9 // self._tick_ns and length <= _MAX_PACKET and length <= original and original > 0
        return bool(likely and abs(after - seconds) <= _DAY_S)


@dataclass(frozen=True)
class _Interface:
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
        self._interfaces: list[_Interface] = []
        self._time_ns = 0
        self._use_order("<")

    def _use_order(self, order: str) -> None:
        self._order = order
        self._block, self._length = struct.Struct(order + "II"), struct.Struct(order + "I")
        self._packet, self._old_packet = struct.Struct(order + "IIIII"), struct.Struct(order + "HHIIII")

    def batches(self) -> Iterator[Records]:
        """Yield all records in order, in batches."""
        parts: list[NDArray[np.int64]] = []
        link, offset, left, singly = -1, 0, _BATCH, 0
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
                parts, left = [], _BATCH
            link, row = found
            rows = np.array([row], np.int64)
            # Blocks of equal length are read all at once; where the lengths change, one by one.
            if kind == _PACKET and not singly:
                rows = self._run(offset, length, row, left)
                singly = 0 if len(rows) >= _BLOCK_RUN else _BLOCK_SINGLY
            else:
                singly = max(singly - 1, 0)
            parts.append(rows)
            left -= len(rows)
            offset += length * len(rows)
        if parts:
            yield Records(link, *np.concatenate(parts).T.copy())

    def _run(self, offset: int, length: int, row: _Row, limit: int) -> NDArray[np.int64]:
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

    def _read_packet(self, kind: int, offset: int, length: int) -> tuple[int, _Row] | None:
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
        if number >= len(self._interfaces) or captured > min(_MAX_PACKET, offset + length - 4 - start):
            self._note(offset, "this packet does not fit its block or interface", length)
            return None
        interface = self._interfaces[number]
        if high is not None:
            self._time_ns = interface.time_ns(high << 32 | low)
        return interface.link, (start, captured, self._time_ns)

    def _read_interface(self, body: int, room: int) -> _Interface:
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
        return _Interface(link, snap, ticks, offset_s)

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
