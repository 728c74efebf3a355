"""Records of captures, PCAP and PCAPNG: location of each packet in the file, and capture time."""

import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Damage
from seaclutter_cli.sources.pcap import PCAP_MAGICS, PCAPNG_MAGIC
from seaclutter_cli.sources.shared.log_file import LogFile, unpack

_Row = tuple[int, int, int]
_Words = NDArray[np.int64]

_BATCH = 1024
_MAX_PACKET = 262144
"""Maximum bytes of a captured packet: libpcap's own limit."""
_DAY_S = 86400
_WINDOW = 2**20
_RUN, _SINGLY = 4, 64
_HEADER_BYTES, _RECORD_BYTES = 24, 16

_SECTION, _INTERFACE, _OLD_PACKET, _SIMPLE_PACKET, _PACKET = 0x0A0D0D0A, 1, 2, 3, 6
_OTHER_KINDS = frozenset((*range(4, 12), 0xBAD, 0x40000BAD))
"""Blocks without packets: names, statistics, decryption secrets, custom ones."""
_LOCAL_KINDS = 0x80000000
_KINDS = (_SECTION, _INTERFACE, _OLD_PACKET, _SIMPLE_PACKET, _PACKET)
_ORDER = {bytes.fromhex("1a2b3c4d"): ">", bytes.fromhex("4d3c2b1a"): "<"}
_RESOLUTION, _TIME_OFFSET = 9, 14
_MIN_BLOCK, _MAX_BLOCK = 12, 2**24
_LATEST_NS = 2**62


@dataclass(frozen=True)
class Records:
    """Offsets, captured lengths, and times (ns of Unix time) of R packets of a link type; arrays of shape (R,)."""

    link: int
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]
    times_ns: NDArray[np.int64]


class RecordReader(ABC):
    """Reader for one pass over a capture, whose entries follow one another: records, or blocks of any kind."""

    _kind: str
    _first = 0
    _least: int
    """Bytes of the shortest entry."""
    _columns: int
    """Number of 32-bit words at the beginning of a record that say whether it continues a run."""

    def __init__(self, file: LogFile, path: Path) -> None:
        self._file, self._path, self._size = file, path, len(file)
        self._order = "<"
        self.damage: list[Damage] = []

    def batches(self) -> Iterator[Records]:
        """Yield all records in order, in batches of at most some megabytes of the file."""
        parts: list[NDArray[np.int64]] = []
        link, offset, begin, left, singly = -1, self._first, 0, _BATCH, 0
        while offset < self._size:
            length, found = self._entry(offset)
            if not length:
                offset = self._skip_damage(offset)
                continue
            if found is None:
                offset += length
                continue
            if parts and (found[0] != link or not left or offset - begin > _WINDOW):
                yield Records(link, *np.concatenate(parts).T.copy())
                parts, left = [], _BATCH
            begin = begin if parts else offset
            link, row = found
            # Records of equal length are read all at once; where the lengths change, one by one.
            rows = np.array([row], np.int64) if singly else self._run(offset, length, row, left)
            singly = singly - 1 if singly else _SINGLY * (len(rows) < _RUN)
            parts.append(rows)
            left -= len(rows)
            offset += length * len(rows)
        if parts:
            yield Records(link, *np.concatenate(parts).T.copy())

    def _run(self, offset: int, length: int, row: _Row, limit: int) -> NDArray[np.int64]:
        """Return the rows of records that only differ in time and content from the one at an offset; ``row`` is its."""
        count = min(limit, (self._size - offset) // length, max(_WINDOW // length, 1))
        block = self._file[offset : offset + count * length]
        if length < 4 * self._columns:
            return np.array([row], np.int64)
        words = self._words(block, count, self._columns, length).astype(np.int64)
        alike = self._alike(words, self._words(block[length - 4 :], count, 1, length)[:, 0])
        count = max(count if alike.all() else int(np.argmin(alike)), 1)
        rows = np.empty((count, 3), np.int64)
        rows[:, 0], rows[:, 1], rows[0, 2] = row[0] + np.arange(count) * length, row[1], row[2]
        if count > 1:
            rows[:, 2] = self._times_ns(words[:count])
        return rows

    def _skip_damage(self, offset: int) -> int:
        """Return the offset of the next valid entry, and report the damage before it; the file size without one."""
        found = next(self._candidates(offset + 1), self._size)
        ends = f"the capture ends within a {self._kind}"
        self._note(offset, ends if found == self._size else "no packet can be read here", found - offset)
        return found

    def _candidates(self, start: int) -> Iterator[int]:
        """Yield the offsets where an entry begins that is followed by another one, or by the end of the file."""
        for at in range(start, self._size - self._least + 1, _WINDOW):
            count = min(_WINDOW, self._size - self._least + 1 - at)
            block = self._file[at : at + count + self._least]
            likely = self._is_likely(self._words(block, count, self._least // 4, 1))
            yield from (found for found in (np.flatnonzero(likely) + at).tolist() if self._is_followed(found))

    def _words(self, block: memoryview, count: int, columns: int, step: int) -> NDArray[np.uint32]:
        """Return words of 32 bits, shape (count, columns), of each entry in a block."""
        return np.ndarray((count, columns), np.dtype(self._order + "u4"), block, strides=(step, 4))

    def _note(self, offset: int, problem: str, size: int) -> None:
        self.damage.append(Damage(self._path, offset, problem, size))

    @abstractmethod
    def _entry(self, offset: int) -> tuple[int, tuple[int, _Row] | None]:
        """Return the length of the entry at an offset, 0 if it is invalid, and link type and row of a record."""

    @abstractmethod
    def _alike(self, words: _Words, ends: NDArray[np.uint32]) -> NDArray[np.bool_]:
        """Return which records continue a run, given their first words and the last."""

    @abstractmethod
    def _times_ns(self, words: _Words) -> NDArray[np.int64]:
        """Return the times of a run of records, and remember the last."""

    @abstractmethod
    def _is_likely(self, words: NDArray[np.uint32]) -> NDArray[np.bool_]:
        """Return where a valid entry may begin, to be checked by `_is_followed`."""

    @abstractmethod
    def _is_followed(self, offset: int) -> bool: ...


class PcapReader(RecordReader):
    """Reader of a classic capture; `InputError` if the file is shorter than the header."""

    _kind, _first, _least, _columns = "packet", _HEADER_BYTES, _RECORD_BYTES, 4

    def __init__(self, file: LogFile, path: Path) -> None:
        if len(file) < _HEADER_BYTES:
            raise InputError(f"{path}: the capture ends within its header")
        super().__init__(file, path)
        self._order, self._tick_ns = PCAP_MAGICS[bytes(file[:4])]
        self._record = struct.Struct(self._order + "IIII")
        # The upper bits describe checksums.
        self._link = int(struct.unpack(self._order + "I", file[20:24])[0]) & 0xFFFF
        self._seconds: int | None = None

    def _entry(self, offset: int) -> tuple[int, tuple[int, _Row] | None]:
        if offset + _RECORD_BYTES > self._size:
            return 0, None
        seconds, *sizes = unpack(self._record, self._file, offset)
        end = offset + _RECORD_BYTES + sizes[1]
        if end > self._size or not self._is_valid(*sizes):
            return 0, None
        self._seconds = seconds
        row = (offset + _RECORD_BYTES, sizes[1], seconds * 10**9 + sizes[0] * self._tick_ns)
        return end - offset, (self._link, row)

    def _is_valid(self, fraction: Any, length: Any, original: Any) -> Any:
        return (fraction < 10**9 // self._tick_ns) & (length <= _MAX_PACKET) & (original > 0)

    def _alike(self, words: _Words, ends: NDArray[np.uint32]) -> NDArray[np.bool_]:
        del ends
        alike: NDArray[np.bool_] = self._is_valid(*words.T[1:]) & (words[:, 2] == words[0, 2])
        return alike

    def _times_ns(self, words: _Words) -> NDArray[np.int64]:
        self._seconds = int(words[-1, 0])
        return words[:, 0] * 10**9 + words[:, 1] * self._tick_ns

    def _is_likely(self, words: NDArray[np.uint32]) -> NDArray[np.bool_]:
        seconds, fraction, length, original = words.T
        likely: NDArray[np.bool_] = self._is_valid(fraction, length, original) & (length <= original) & (length > 0)
        if self._seconds is not None:
            likely &= np.abs(seconds.astype(np.int64) - self._seconds) <= _DAY_S
        return likely

    def _is_followed(self, offset: int) -> bool:
        seconds, _, length, _ = unpack(self._record, self._file, offset)
        end = int(offset + _RECORD_BYTES + length)
        if end + _RECORD_BYTES > self._size:
            return end == self._size
        after, *sizes = unpack(self._record, self._file, end)
        return bool(self._is_valid(*sizes) and sizes[1] <= sizes[2] and abs(after - seconds) <= _DAY_S)


@dataclass(frozen=True)
class _Interface:
    """An interface on which packets were captured; its clock has ``ticks`` per second."""

    link: int
    snap: int
    ticks: int = 10**6
    offset_s: int = 0

    def time_ns(self, ticks: int) -> int:
        return max(min(ticks * 10**9 // self.ticks + self.offset_s * 10**9, _LATEST_NS), -_LATEST_NS)

    def times_ns(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        whole, rest = divmod(10**9, self.ticks)
        if rest or int(ticks.max()) > _LATEST_NS // 2 // whole or int(ticks.min()) < 0:
            return np.array([self.time_ns(tick & (2**64 - 1)) for tick in ticks.tolist()], np.int64)
        return ticks * whole + self.offset_s * 10**9


class PcapngReader(RecordReader):
    """Reader of a PCAPNG capture; each section has its own byte order and interfaces."""

    _kind, _least, _columns = "block", _MIN_BLOCK, 6

    def __init__(self, file: LogFile, path: Path) -> None:
        super().__init__(file, path)
        self._interfaces: list[_Interface] = []
        self._time_ns = 0

    def _unpack(self, layout: str, at: int) -> tuple[Any, ...]:
        return unpack(struct.Struct(self._order + layout), self._file, at)

    def _entry(self, offset: int) -> tuple[int, tuple[int, _Row] | None]:
        kind, length = self._block(offset)
        return length, self._packet(kind, offset, length) if length else None

    def _block(self, offset: int) -> tuple[int, int]:
        """Return kind and length of the block at an offset; a length of 0 if it is not a valid block."""
        if offset + _MIN_BLOCK > self._size:
            return 0, 0
        if self._file[offset : offset + 4] == PCAPNG_MAGIC:
            if (order := _ORDER.get(bytes(self._file[offset + 8 : offset + 12]))) is None:
                return 0, 0
            self._order = order
        kind, length = self._unpack("II", offset)
        if not _MIN_BLOCK <= length <= _MAX_BLOCK or length % 4 or offset + length > self._size:
            return 0, 0
        return (kind, length) if self._unpack("I", offset + length - 4)[0] == length else (0, 0)

    def _packet(self, kind: int, offset: int, length: int) -> tuple[int, _Row] | None:
        """Return link type and row of a block; None if it contains no valid packet."""
        body, number = offset + 8, 0
        room = length - _MIN_BLOCK
        if kind in (_PACKET, _OLD_PACKET) and room >= 20:
            layout = "IIIII" if kind == _PACKET else "H2xIIII"
            number, high, low, captured, _ = self._unpack(layout, body)
        elif kind == _SIMPLE_PACKET and room >= 4 and self._interfaces:
            captured, high, low = self._unpack("I", body)[0], None, 0
            captured = min(captured, self._interfaces[0].snap or captured, room - 4)
        else:
            if kind == _SECTION:
                self._interfaces = []
            elif kind == _INTERFACE and room >= 8:
                self._interfaces.append(self._interface(body, room))
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

    def _interface(self, body: int, room: int) -> _Interface:
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

    def _alike(self, words: _Words, ends: NDArray[np.uint32]) -> NDArray[np.bool_]:
        same = (words[:, [0, 1, 2, 5]] == words[0, [0, 1, 2, 5]]).all(axis=1)
        return np.asarray(same & (ends == words[0, 1]) & (words[:, 0] == _PACKET))

    def _times_ns(self, words: _Words) -> NDArray[np.int64]:
        times_ns = self._interfaces[int(words[0, 2])].times_ns(words[:, 3] << 32 | words[:, 4])
        self._time_ns = int(times_ns[-1])
        return times_ns

    def _is_likely(self, words: NDArray[np.uint32]) -> NDArray[np.bool_]:
        kinds, lengths = words.T[:2]
        sized = (lengths >= _MIN_BLOCK) & (lengths <= _MAX_BLOCK)
        return np.asarray(np.isin(kinds, _KINDS) & sized | (kinds == _SECTION))

    def _is_followed(self, offset: int) -> bool:
        return self._block(offset)[1] > 0
