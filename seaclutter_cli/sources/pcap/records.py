"""Records of captures: location of each packet in the file, and capture time."""

import struct
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Damage
from seaclutter_cli.sources.pcap import PCAP_MAGICS
from seaclutter_cli.sources.shared.log_file import LogFile, unpack

BATCH = 1024
MAX_PACKET = 262144
"""Maximum bytes of a captured packet: libpcap's own limit."""
_DAY_S = 86400

_HEADER_BYTES, _RECORD_BYTES = 24, 16
_WINDOW = 2**20
_RUN, _SINGLY = 16, 128


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
            if len(rows) < BATCH and offset < self._size:
                offset = self._skip_damage(offset)

    def _walk(self, offset: int) -> tuple[NDArray[np.int64], int]:
        """Return the rows of at most one batch, up to the first invalid record, and the offset after them."""
        parts: list[NDArray[np.int64]] = []
        left, many = BATCH, True
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
            if end > size or length > MAX_PACKET or fraction >= ticks or not original:
                break
            rows.append((offset + _RECORD_BYTES, length, seconds * 10**9 + fraction * self._tick_ns))
            offset = end
        return np.array(rows, np.int64).reshape(-1, 3), offset

    def _run(self, offset: int, limit: int) -> tuple[NDArray[np.int64], int]:
        """Return the rows of records of equal length from an offset on, and the offset after them."""
        length = int(unpack(self._record, self._file, offset)[2])
        size = _RECORD_BYTES + length
        count = min(limit, (self._size - offset) // size, max(_WINDOW // size, 1))
        if length > MAX_PACKET or not count:
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
        return bool(length <= MAX_PACKET and fraction < 10**9 // self._tick_ns and original > 0)

    def _find(self, offset: int) -> int:
        """Return the next offset where two plausible records begin, or one that ends the file; or the file size."""
        for start in range(offset + 1, self._size - _RECORD_BYTES + 1, _WINDOW):
            count = min(_WINDOW, self._size - _RECORD_BYTES + 1 - start)
            for candidate in self._candidates(start, count):
                if self._is_followed(candidate):
                    return candidate
        return self._size

    def _candidates(self, start: int, count: int) -> list[int]:
        block = self._file[start : start + count + _RECORD_BYTES]
        words = (np.ndarray((count,), self._word, block, 4 * n, (1,)) for n in range(4))
        seconds, fraction, length, original = words
        likely = (fraction < 10**9 // self._tick_ns) & (length <= MAX_PACKET) & (length <= original) & (length > 0)
        if self._time_ns is not None:
            likely &= np.abs(seconds.astype(np.int64) - self._time_ns // 10**9) <= _DAY_S
        return (np.flatnonzero(likely) + start).tolist()

    def _is_followed(self, offset: int) -> bool:
        seconds, _, length, _ = unpack(self._record, self._file, offset)
        end = int(offset + _RECORD_BYTES + length)
        if end + _RECORD_BYTES > self._size:
            return end == self._size
        after, fraction, length, original = unpack(self._record, self._file, end)
        likely = fraction < 10**9 // self._tick_ns and length <= MAX_PACKET and length <= original and original > 0
        return bool(likely and abs(after - seconds) <= _DAY_S)
