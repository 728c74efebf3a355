"""The records of an MCAP file, found by walking from one to the next, past whatever is damaged.

The index at the end is not needed for this, so a file that lost it, or has one that lies, reads like any other.
"""

import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from mmap import mmap
from typing import Self, TypeVar
from zlib import crc32

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from seaclutter_cli.records import Buffer

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
CHUNK = struct.Struct("<QQQI")
MESSAGE = struct.Struct("<HIQQ")

_CANDIDATE = re.compile(rb"[\x01-\x0f][\s\S]{5}\x00\x00\x00")
_FIXED: dict[int, int] = {Opcode.FOOTER: 20, Opcode.DATA_END: 4}
_LEAST: dict[int, int] = {
    Opcode.HEADER: 8,
    Opcode.SCHEMA: 14,
    Opcode.CHANNEL: 16,
    Opcode.MESSAGE: 22,
    Opcode.ATTACHMENT: 36,
}

R = TypeVar("R")

Report = Callable[[int, str, int], object]
"""Takes the place, the kind and the size in bytes of a damage."""


class BrokenRecordError(Exception):
    """A record's content cannot be what its opcode says."""


@dataclass(frozen=True, slots=True)
class Span:
    """A record in the file: its opcode, where it begins, where its content begins and ends.

    The end lies behind the end of the file for a chunk that is cut off.
    """

    op: int
    offset: int
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """What a chunk says of itself, and where its compressed records lie in the file."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    data_start: int
    data_end: int

    @classmethod
    def read(cls, data: mmap, span: Span) -> Self:
        """Read the head of a chunk; `BrokenRecordError` if its sizes do not fit together."""
        try:
            start_ns, end_ns, size, crc = CHUNK.unpack_from(data, span.start)
            (name_size,) = struct.unpack_from("<I", data, span.start + CHUNK.size)
            name_start = span.start + CHUNK.size + 4
            name = data[name_start : name_start + min(name_size, 64)].decode()
            (data_size,) = struct.unpack_from("<Q", data, name_start + name_size)
        except (struct.error, UnicodeDecodeError):
            raise BrokenRecordError from None
        data_start = name_start + name_size + 8
        if data_start + data_size != span.end:
            raise BrokenRecordError
        return cls(start_ns, end_ns, size, crc, name, data_start, span.end)


def walk(data: mmap, report: Report) -> Iterator[Span]:
    """Yield the records of a file from behind its first magic bytes, leaping over what is broken."""
    at, end = len(MAGIC), len(data)
    while at < end and (end - at != len(MAGIC) or data[at:] != MAGIC):
        span = _span(data, at)
        if span is not None:
            yield span
            at = span.end
            continue
        following = _resynchronise(data, at + 1)
        if following is None:
            report(at, "the file ends inside a record", end - at)
            return
        report(at, "broken bytes between records", following - at)
        at = following


def _span(data: mmap, at: int) -> Span | None:
    """Return the record at a place, if there can be one."""
    if len(data) - at < RECORD.size:
        return None
    op, size = RECORD.unpack_from(data, at)
    span = Span(op, at, at + RECORD.size, at + RECORD.size + size)
    # Both sizes of a chunk agree: rather the file is cut than the chunk broken.
    return span if _plausible(data, span) and (span.end <= len(data) or op == Opcode.CHUNK) else None


def _plausible(data: mmap, span: Span) -> bool:
    size = span.end - span.start
    if span.op == 0 or size != _FIXED.get(span.op, size) or size < _LEAST.get(span.op, 0):
        return False
    if span.op == Opcode.CHUNK:
        try:
            ChunkHead.read(data, span)
        except BrokenRecordError:
            return False
    if span.op == Opcode.MESSAGE_INDEX and span.end <= len(data):
        return size >= 6 and struct.unpack_from("<I", data, span.start + 2)[0] == size - 6
    return True


def _resynchronise(data: mmap, at: int) -> int | None:
    """Return the next place where a record begins that another one, or the end, follows."""
    while match := _CANDIDATE.search(data, at):
        at = match.start()
        span = _span(data, at)
        if span and (span.end >= len(data) or data[span.end : span.end + 9] == MAGIC or _span(data, span.end)):
            return at
        at += 1
    return None


def parse(read: Callable[[ReadDataStream], R], content: Buffer) -> R:
    """Read one of the ``mcap`` library's records; `BrokenRecordError` if the content is none."""
    try:
        return read(ReadDataStream(BytesIO(content)))
    except (McapError, struct.error, UnicodeDecodeError, ValueError) as error:
        raise BrokenRecordError(str(error)) from error


def unpack(head: ChunkHead, packed: memoryview) -> Buffer:
    """Return the records of a chunk.

    Raises
    ------
    BrokenRecordError
        If they cannot be decompressed, or are not those that were written.
    """
    try:
        records = _decompress(head, packed)
    except (zstandard.ZstdError, RuntimeError, MemoryError, ValueError) as error:
        raise BrokenRecordError(f"cannot be decompressed ({error})") from error
    if len(records) != head.size:
        raise BrokenRecordError(f"holds {len(records)} bytes instead of {head.size}")
    if head.crc and crc32(records) != head.crc:
        raise BrokenRecordError("fails its checksum")
    return records


def _decompress(head: ChunkHead, packed: memoryview) -> Buffer:
    # A size that the compressor and the chunk do not agree on could ask for any amount of memory.
    if head.compression == "":
        return packed
    if head.compression == "zstd":
        size = zstandard.frame_content_size(packed)
        if size == -1:
            return zstandard.ZstdDecompressor().decompressobj().decompress(packed)
        if size != head.size:
            raise ValueError("its size is wrong")
        return zstandard.ZstdDecompressor().decompress(packed)
    if head.compression == "lz4":
        if lz4.frame.get_frame_info(packed)["content_size"] not in (0, head.size):
            raise ValueError("its size is wrong")
        return bytes(lz4.frame.decompress(packed))
    raise ValueError(f"compression {head.compression!r} is not known")


def unpack_cut(head: ChunkHead, packed: memoryview) -> Buffer:
    """Return the records at the beginning of a chunk that is cut off, as far as they can be decompressed."""
    try:
        if head.compression == "zstd":
            return zstandard.ZstdDecompressor().decompressobj().decompress(packed)
        if head.compression == "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed))
    except (zstandard.ZstdError, RuntimeError, MemoryError, ValueError):
        return b""
    return packed if head.compression == "" else b""
