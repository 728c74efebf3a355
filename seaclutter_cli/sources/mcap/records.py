"""Records of an MCAP file, found one after another, with damaged data skipped.

The index at the end is not needed for this. A file with a missing or wrong index is read like any other.
"""

import re
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from io import BytesIO
from typing import NamedTuple, Self, TypeVar
from zlib import crc32

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from seaclutter_cli.limits import above_in_file, limits
from seaclutter_cli.records import Buffer, Bytes
from seaclutter_cli.sources.shared import log_file
from seaclutter_cli.sources.shared.unpacking import DECOMPRESSION_ERRORS, readable, unpacked
from seaclutter_cli.text import count

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
CHUNK = struct.Struct("<QQQI")
MESSAGE = struct.Struct("<HIQQ")
COMPRESSIONS = ("zstd", "lz4", "")

_CANDIDATE = re.compile(rb"[\x01-\x0f](?=[\s\S]{5}\x00\x00\x00)")
_SMALL_CANDIDATE = re.compile(rb"[\x01-\x0f](?=[\s\S]{4}\x00\x00\x00\x00)")
"""Beginnings of records in a file of any size, and in one of less than 4 GiB: coordinates look like the former."""
_FIRST_WINDOW, _WINDOW = 64 * 2**10, 16 * 2**20
_MAX_GROWTH = 256
_LARGEST_CHUNK = 2**32

_SHORT, _LONG = struct.Struct("<I"), struct.Struct("<Q")
_LAYOUTS: dict[int, tuple[int | struct.Struct, ...]] = {
    Opcode.HEADER: (_SHORT, _SHORT),
    Opcode.FOOTER: (20,),
    Opcode.SCHEMA: (2, _SHORT, _SHORT, _SHORT),
    Opcode.CHANNEL: (4, _SHORT, _SHORT, _SHORT),
    Opcode.MESSAGE: (22,),
    Opcode.CHUNK: (28, _SHORT, _LONG),
    Opcode.MESSAGE_INDEX: (2, _SHORT),
    Opcode.CHUNK_INDEX: (32, _SHORT, 8, _SHORT, 16),
    Opcode.ATTACHMENT: (16, _SHORT, _SHORT, _LONG, 4),
    Opcode.ATTACHMENT_INDEX: (40, _SHORT, _SHORT),
    Opcode.STATISTICS: (42, _SHORT),
    Opcode.METADATA: (_SHORT, _SHORT),
    Opcode.METADATA_INDEX: (16, _SHORT),
    Opcode.SUMMARY_OFFSET: (17,),
    Opcode.DATA_END: (4,),
}
"""Layout of each record: numbers of bytes of fixed size, and parts that begin with their own size."""
_LARGE = (Opcode.CHUNK, Opcode.ATTACHMENT)
_REPAIRABLE = (*_LARGE, Opcode.MESSAGE_INDEX, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
"""Records that are known by their sizes if the opcode is damaged; only `_LARGE` if it reads as message or private."""
_INSIDE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_PRIVATE = 0x80
_ENDLESS = 2**70

R = TypeVar("R")

Gap = Callable[[int, str, int], object]
"""Receives offset, kind and size in bytes of skipped data."""


class BrokenRecordError(Exception):
    """The content of a record does not match its opcode."""


class Span(NamedTuple):
    """A record and its content, which may end after the file; ``consistent`` if the sizes inside fit its size."""

    op: int
    offset: int
    start: int
    end: int
    consistent: bool


@dataclass(frozen=True, slots=True)
class ChunkHeader:
    """Header of a chunk, and the location of its compressed records in the file."""

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    data_start: int
    data_end: int

    @classmethod
    def read(cls, data: Bytes, span: Span) -> Self:
        """Return the header of a chunk found by `walk`; `BrokenRecordError` if its sizes are inconsistent."""
        name_start = span.start + CHUNK.size + _SHORT.size
        if name_start > len(data):
            raise BrokenRecordError("it is truncated")
        start_ns, end_ns, size, crc = log_file.unpack(CHUNK, data, span.start)
        name_end = name_start + log_file.unpack(_SHORT, data, name_start - _SHORT.size)[0]
        name = bytes(data[name_start : min(name_end, name_start + 64)]).decode("utf-8", "replace")
        data_start = name_end + _LONG.size
        if data_start > span.end:
            raise BrokenRecordError("its sizes are inconsistent")
        return cls(start_ns, end_ns, size, crc, name, data_start, span.end)


def walk(data: Bytes, report: Gap, at: int = 0) -> Iterator[Span]:
    """Yield the records of a file, or of an unpacked chunk, from an offset on; skipped damaged data is reported."""
    walker = _Walker(data, report)
    while not walker.is_end(at):
        span = walker.record(at)
        if span is None or not walker.is_plausible(span):
            span = walker.repair(at, span)
        elif span.op != data[at : at + 1][0]:
            report(at, f"damaged opcode of this {name_of(span.op)}", 0)
        if span is None:
            following = walker.next_record(at + 1, len(data))
            cut = following == len(data)
            report(at, "no readable record follows" if cut else "damaged bytes between records", following - at)
            at = following
        elif span.end > len(data) and span.op != Opcode.CHUNK:
            report(at, f"the file ends inside this {name_of(span.op)}", len(data) - at)
            return
        else:
            yield span
            at = span.end


class _Walker:
    """Search for records in data that may be damaged."""

    def __init__(self, data: Bytes, report: Gap) -> None:
        self._data = data
        self._report = report
        self.record = lru_cache(4)(partial(_record, data))

    def is_end(self, at: int) -> bool:
        """Return whether the records end at an offset."""
        rest = len(self._data) - at
        return rest <= 0 or (rest == len(MAGIC) and self._data[at : at + rest] == MAGIC)

    def is_boundary(self, at: int, depth: int = 2) -> bool:
        """Return whether the data ends at an offset, or a consistent record or ``depth`` possible records follow."""
        data = self._data
        if at >= len(data) or data[at : at + len(MAGIC)] == MAGIC:
            return at <= len(data)
        span = self.record(at)
        if span is None or span.consistent or depth == 1:
            return span is not None
        return self.is_boundary(span.end, depth - 1)

    def is_plausible(self, span: Span) -> bool:
        """Return whether a record ends at a boundary, and does not seem to contain unexpected records."""
        if not span.consistent and span.op != Opcode.MESSAGE:
            known = span.op < _PRIVATE
            if self.next_record(span.start, span.end, outside=known) < span.end:
                return False
        return self.is_boundary(span.end)

    def repair(self, at: int, span: Span | None) -> Span | None:
        """Return the repaired version of an implausible record; None if the record is damaged.

        Either the record or the data after it is damaged. It is the record if another one begins before its end.
        """
        data, op = self._data, self._data[at : at + 1][0]
        start = at + RECORD.size
        if op in _LARGE and not (span and span.consistent):
            end = _extent(data, op, start)
            if end < len(data) and self.is_boundary(end) and self.next_record(at + 1, end, outside=True) == end:
                self._report(at, f"damaged size of this {name_of(op)}", 0)
                return Span(op, at, start, end, True)
        if span is None:
            return None
        end = self.next_record(at + 1, min(span.end, len(data)), outside=span.op == Opcode.CHUNK)
        if end == min(span.end, len(data)):
            return span
        if span.op != Opcode.CHUNK:
            return None
        cut = span._replace(end=end, consistent=False)
        if _is_valid_chunk(data, span) and not _is_valid_chunk(data, cut):
            return span
        self._report(at, "bytes are missing inside this chunk", 0)
        return cut

    def next_record(self, start: int, stop: int, *, outside: bool = False) -> int:
        """Return the offset of the next record that ends at a boundary; with ``outside``, of a kind outside chunks."""
        at, window = start, _FIRST_WINDOW
        pattern = _CANDIDATE if len(self._data) > _LARGEST_CHUNK else _SMALL_CANDIDATE
        while at < stop:
            end = min(at + window, stop)
            searched = self._data[at : min(end + RECORD.size, len(self._data))]
            for match in pattern.finditer(searched):
                found = at + match.start()
                op, size = RECORD.unpack_from(searched, match.start())
                if size > (_LARGEST_CHUNK if op == Opcode.CHUNK else len(self._data) - found):
                    continue  # most candidates in damaged points: a check that costs little
                span = self.record(found)
                if span is None or found >= end or (outside and span.op in _INSIDE):
                    continue
                if span.op != match[0][0] or not (span.consistent or span.op == Opcode.MESSAGE):
                    continue
                whole = span.end <= len(self._data) and self.is_boundary(span.end)
                if whole or (span.consistent and span.op == Opcode.CHUNK):
                    return found
            at, window = end, min(2 * window, _WINDOW)
        return stop


def _record(data: Bytes, at: int) -> Span | None:
    """Return the record at an offset; None if no record can be there."""
    if len(data) - at < RECORD.size:
        return None
    op, size = log_file.unpack(RECORD, data, at)
    start = at + RECORD.size
    end = start + size
    extent = _extent(data, op, start)
    known = op in _LAYOUTS and op != Opcode.MESSAGE
    if known and extent == end:
        return Span(op, at, start, end, True)
    for kind in _LARGE if op == Opcode.MESSAGE or op >= _PRIVATE else _REPAIRABLE:
        if _extent(data, kind, start, filled=True) == end:
            return Span(kind, at, start, end, True)
    if not (op in _LAYOUTS or op >= _PRIVATE) or end > len(data) or (extent > end and op != Opcode.CHUNK):
        return None
    # Later versions of the format may extend a record; private records may contain anything.
    return None if known and end - extent > _MAX_GROWTH else Span(op, at, start, end, False)


def _is_valid_chunk(data: Bytes, span: Span) -> bool:
    """Return whether a chunk can be unpacked, and is compressed or has a checksum."""
    try:
        header = ChunkHeader.read(data, span)
        unpack(header, data)
    except BrokenRecordError:
        return False
    return header.crc != 0 or header.compression != ""


def _extent(data: Bytes, op: int, at: int, *, filled: bool = False) -> int:
    """Return where content ends by the sizes inside it; `_ENDLESS` beyond the data and, if ``filled``, for zeros."""
    inside = 0
    for part in _LAYOUTS.get(op, ()):
        if isinstance(part, int):
            at += part
        elif at + part.size <= len(data):
            size = log_file.unpack(part, data, at)[0]
            inside = size if part is _LONG else inside + size
            at += part.size + size
        else:
            return _ENDLESS
    return at if inside or not filled else _ENDLESS


def is_other(data: Bytes, span: Span) -> bool:
    """Return whether a record exactly matches the layout of another kind of record."""
    kinds = (op for op, parts in _LAYOUTS.items() if op != span.op and not all(isinstance(part, int) for part in parts))
    return any(_extent(data, op, span.start) == span.end for op in kinds)


def name_of(op: int) -> str:
    """Return the name of a kind of record, for messages."""
    return Opcode(op).name.lower().replace("_", " ") if op in _LAYOUTS else f"record of kind {op}"


def split(records: Buffer, report: Gap, *, trusted: bool) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of each record in an unpacked chunk; ``trusted`` records are not checked."""
    at, trusted = 0, trusted or _is_chain(records)
    while trusted and at + RECORD.size <= len(records):
        op, size = RECORD.unpack_from(records, at)
        start = at + RECORD.size
        if start + size > len(records):
            break
        at = start + size
        yield op, start, at
    for span in walk(records, report, at):
        yield span.op, span.start, span.end


def _is_chain(records: Buffer) -> bool:
    """Return whether sizes lead from record to record to the end of a chunk; a tenth of the cost of `walk`."""
    at = 0
    while at + RECORD.size <= len(records):
        op, size = RECORD.unpack_from(records, at)
        start = at + RECORD.size
        at = start + size
        if op == Opcode.MESSAGE:
            continue
        if op not in _INSIDE or _extent(records, op, start) != at:
            return False
    return at == len(records)


def parse(read: Callable[[ReadDataStream], R], content: Buffer) -> R:
    """Return a record of the ``mcap`` library; `BrokenRecordError` if the content is not valid."""
    try:
        return read(ReadDataStream(BytesIO(content)))
    except (McapError, struct.error, ValueError, OverflowError) as error:
        raise BrokenRecordError(str(error)) from error


def parse_all(
    data: Bytes, spans: Iterable[Span], op: Opcode, read: Callable[[ReadDataStream], R], report: Gap
) -> list[R]:
    """Return the records of a kind among others; damaged ones are reported."""
    found = []
    for span in spans:
        if span.op == op:
            try:
                found.append(parse(read, data[span.start : span.end]))
            except BrokenRecordError as error:
                report(span.offset, f"damaged {name_of(op)} ({error})", span.end - span.start)
    return found


def unpack(header: ChunkHeader, data: Bytes) -> Buffer:
    """Return the records of a chunk; `BrokenRecordError` if they are damaged, or exceed the limit of a chunk."""
    size = max(header.size, header.data_end - header.data_start)
    if size > limits().bytes_of("chunk", len(data)):
        raise BrokenRecordError(f"has {above_in_file(count(size, 'byte'), 'chunk', len(data))}")
    if header.compression not in COMPRESSIONS:
        raise BrokenRecordError(f"cannot be decompressed (unknown compression {header.compression[:8]!r})")
    packed = data[header.data_start : header.data_end]
    try:
        records = unpacked(header.compression, packed, header.size)
    except DECOMPRESSION_ERRORS as error:
        raise BrokenRecordError(f"cannot be decompressed ({error})") from error
    if len(records) != header.size:
        raise BrokenRecordError(f"does not have the declared size of {count(header.size, 'byte')}")
    if header.crc and crc32(records) != header.crc:
        raise BrokenRecordError("fails its checksum")
    return records


def salvage(header: ChunkHeader, data: Bytes) -> Buffer:
    """Return the records at the beginning of a truncated or damaged chunk, as far as they can be decompressed."""
    most = limits().bytes_of("chunk", len(data))
    packed = data[header.data_start : min(header.data_end, header.data_start + most, len(data))]
    if header.compression not in COMPRESSIONS:
        return b""
    return readable(header.compression, packed, min(header.size, most))[0]
