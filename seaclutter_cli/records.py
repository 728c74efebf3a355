"""Records of a log, independent of its format: channels, messages, attachments, metadata.

Times are integer nanoseconds. Data of type ``Buffer`` are views where possible: a message of an MCAP file refers to
its decompressed chunk.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from seaclutter_cli.text import count, printable

Buffer = bytes | memoryview
_PIECE = 2**20


class Bytes(Protocol):
    """Data that is read by slices without a step: a file, bytes or a memoryview."""

    def __len__(self) -> int: ...

    def __getitem__(self, part: slice, /) -> Buffer: ...


class FilePart:
    """A part of a file that is read piece by piece, so that its size does not matter."""

    def __init__(self, file: Bytes, start: int, stop: int) -> None:
        self._file, self._start, self._stop = file, start, stop

    def __len__(self) -> int:
        return self._stop - self._start

    def __bytes__(self) -> bytes:
        return b"".join(self.pieces())

    def pieces(self) -> Iterator[Buffer]:
        """Yield the data in order."""
        for at in range(self._start, self._stop, _PIECE):
            yield self._file[at : min(at + _PIECE, self._stop)]

    def crc32(self) -> int:
        """Return the checksum of the data."""
        crc = 0
        for piece in self.pieces():
            crc = zlib.crc32(piece, crc)
        return crc


@dataclass(frozen=True, slots=True)
class Schema:
    """A message definition, as MCAP stores it."""

    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic as filled by one publisher; ``id`` is unique within the log."""

    id: int
    topic: str
    message_encoding: str
    schema: Schema | None
    metadata: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Message:
    """One message of a log, not decoded."""

    channel: Channel
    log_time_ns: int
    publish_time_ns: int
    sequence: int
    data: Buffer


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file stored inside a log."""

    log_time_ns: int
    create_time_ns: int
    name: str
    media_type: str
    data: Buffer | FilePart

    def pieces(self) -> Iterator[Buffer]:
        """Yield the data in order."""
        return self.data.pieces() if isinstance(self.data, FilePart) else iter([self.data])


@dataclass(frozen=True, slots=True)
class Metadata:
    """Named key-value pairs stored inside a log."""

    name: str
    entries: dict[str, str]


Record = Message | Attachment | Metadata


@dataclass
class SensorFacts:
    """Facts about a sensor and its packets, if there are any, updated while they are decoded.

    ``details`` are firmware, return mode, intensity mode and similar facts, for display. Packets are lost according to
    gaps in the sequence, and bad if they cannot be decoded. ``from_packets`` is whether they identify the sensor, not
    the metadata of the log.
    """

    model: str
    details: dict[str, str] = field(default_factory=dict)
    lost_packets: int = 0
    bad_packets: int = 0
    warnings: list[str] = field(default_factory=list)
    from_packets: bool = True


@dataclass(frozen=True, slots=True)
class Damage:
    """An unusable part of the input: its position, the problem, and how much was left out."""

    path: Path
    offset: int | None
    problem: str
    lost_bytes: int = 0
    lost_messages: int | None = None

    def __str__(self) -> str:
        position = f"{self.path}" if self.offset is None else f"{self.path}: byte {self.offset}"
        amounts = []
        if self.lost_messages is not None:
            amounts.append(count(self.lost_messages, "message"))
        if self.lost_bytes:
            amounts.append(count(self.lost_bytes, "byte"))
        return printable(f"{position}: {self.problem}{'; left out: ' * bool(amounts)}{', '.join(amounts)}")


class StampClock:
    """Stamps of the clouds of one sensor; those that stand still go on with the log."""

    def __init__(self) -> None:
        self._last = 0, 0

    def next(self, stamp_ns: int, log_ns: int) -> tuple[int, str]:
        """Return the time of the next cloud, and what is wrong with its stamp, if anything."""
        before_ns, since_ns = self._last
        if stamp_ns == before_ns:
            text = "has frames with the stamp of the one before; times between them are those of the log"
            return max(before_ns + log_ns - since_ns, before_ns), text
        self._last = stamp_ns, log_ns
        text = "has frames with an earlier stamp than the one before; times and velocities around them may be wrong"
        return stamp_ns, text if stamp_ns < before_ns else ""
