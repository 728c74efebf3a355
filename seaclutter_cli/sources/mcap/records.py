"""The records of an MCAP file, found by walking from one to the next, past whatever is damaged.

The index at the end is not needed for this, so a file that lost it, or has one that lies, reads like any other.
"""

import re
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from io import BytesIO
from typing import NamedTuple, Self, TypeVar
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
COMPRESSIONS = ("zstd", "lz4", "")

_CANDIDATE = re.compile(rb"[\x01-\x0f](?=[\s\S]{5}\x00\x00\x00)")
_WINDOW = 16 * 2**20
_MOST_GROWTH = 256
_MOST_UNPACKED = 2 * 2**30
_PIECE = 2**16
_DECOMPRESSION_ERRORS = (zstandard.ZstdError, RuntimeError, MemoryError, ValueError, EOFError)

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
"""What each record consists of: bytes of fixed size, and parts that begin with their own size."""
_LARGE = (Opcode.CHUNK, Opcode.ATTACHMENT)
_MENDED = (*_LARGE, Opcode.MESSAGE_INDEX, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
"""Records that are known by their sizes though their opcode is broken; the former, though it is one of another kind."""
_INSIDE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_PRIVATE = 0x80
_ENDLESS = 2**70

R = TypeVar("R")


Gap = Callable[[int, str, int], object]
"""Takes place, kind and size in bytes of what is leapt over."""


class BrokenRecordError(Exception):
    """A record's content cannot be what its opcode says."""


class Span(NamedTuple):
    """A record: its opcode, where it begins, where its content begins and ends.

    ``sure`` if the sizes inside the content agree with the record's own. The end of such a record may lie behind the
    end of the file: it is cut off.
    """

    op: int
    offset: int
    start: int
    end: int
    sure: bool


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
    def read(cls, data: Buffer, span: Span) -> Self:
        """Read the head of a chunk that `walk` has found; `BrokenRecordError` if its parts cannot be told apart."""
        name_start = span.start + CHUNK.size + _SHORT.size
        if name_start > len(data):
            raise BrokenRecordError("it is cut off")
        start_ns, end_ns, size, crc = CHUNK.unpack_from(data, span.start)
        name_end = name_start + _SHORT.unpack_from(data, name_start - _SHORT.size)[0]
        name = bytes(data[name_start : min(name_end, name_start + 64)]).decode("utf-8", "replace")
        data_start = name_end + _LONG.size
        if data_start > span.end:
            raise BrokenRecordError("its sizes do not fit together")
        return cls(start_ns, end_ns, size, crc, name, data_start, span.end)


def walk(data: Buffer, report: Gap, at: int = 0, touched: Callable[[int], object] = lambda _: None) -> Iterator[Span]:
    """Yield the records from a place on, leaping over what is broken.

    Parameters
    ----------
    data : bytes or memoryview
        A file, or the unpacked records of a chunk.
    report : callable
        Is told of what is leapt over.
    at : int, optional
        Where the first record begins.
    touched : callable, optional
        Is told how many bytes were looked at in search of a record.
    """
    walker = _Walker(data, report, touched)
    while not walker.is_end(at):
        span = walker.record(at)
        if span is None or not walker.is_plausible(span):
            span = walker.mend(at, span)
        elif span.op != data[at]:
            report(at, f"broken opcode of this {name_of(span.op)}", 0)
        if span is None:
            following = walker.anchor(at + 1, len(data))
            cut = following == len(data)
            report(at, "no record can be read from here on" if cut else "broken bytes between records", following - at)
            at = following
        elif span.end > len(data) and span.op != Opcode.CHUNK:
            report(at, f"the file ends inside this {name_of(span.op)}", len(data) - at)
            return
        else:
            yield span
            at = span.end


class _Walker:
    """Finds records where some may be broken."""

    def __init__(self, data: Buffer, report: Gap, touched: Callable[[int], object]) -> None:
        self._data = data
        self._report = report
        self._touched = touched
        self.record = lru_cache(4)(partial(_record, data))

    def is_end(self, at: int) -> bool:
        """Tell whether the records end here."""
        rest = len(self._data) - at
        return rest <= 0 or (rest == len(MAGIC) and self._data[at:] == MAGIC)

    def joins(self, at: int, depth: int = 2) -> bool:
        """Tell whether what ends here is followed by the end, by a sure record, or by several that may be some."""
        data = self._data
        if at >= len(data) or data[at : at + len(MAGIC)] == MAGIC:
            return at <= len(data)
        span = self.record(at)
        if span is None or span.sure or depth == 1:
            return span is not None
        return self.joins(span.end, depth - 1)

    def is_plausible(self, span: Span) -> bool:
        """Tell whether a record joins what follows, and does not seem to hold others where there should be none."""
        if not span.sure and span.op != Opcode.MESSAGE:
            known = span.op < _PRIVATE
            if self.anchor(span.start, span.end, outside=known) < span.end:
                return False
        return self.joins(span.end)

    def mend(self, at: int, span: Span | None) -> Span | None:
        """Return a record that is not plausible as it should have been written; None if it is broken.

        Either it is broken or what follows it; the former, if another record begins before it ends.
        """
        data, op = self._data, self._data[at]
        start = at + RECORD.size
        if op in _LARGE and not (span and span.sure):
            end = _extent(data, op, start)
            if end < len(data) and self.joins(end) and self.anchor(at + 1, end, outside=True) == end:
                self._report(at, f"broken size of this {name_of(op)}", 0)
                return Span(op, at, start, end, True)
        if span is None:
            return None
        end = self.anchor(at + 1, min(span.end, len(data)), outside=span.op == Opcode.CHUNK)
        if end == min(span.end, len(data)):
            return span
        if span.op != Opcode.CHUNK:
            return None
        cut = span._replace(end=end, sure=False)
        if _is_sound_chunk(data, span) and not _is_sound_chunk(data, cut):
            return span
        self._report(at, "bytes are missing inside this chunk", 0)
        return cut

    def anchor(self, start: int, stop: int, *, outside: bool = False) -> int:
        """Return the first place where a record begins that joins what follows; if ``outside``, one of no chunk."""
        for at in range(start, stop, _WINDOW):
            end = min(at + _WINDOW, stop)
            self._touched(end - at)
            for match in _CANDIDATE.finditer(self._data, at, min(end + RECORD.size, len(self._data))):
                span = self.record(match.start())
                if span is None or match.start() >= end or (outside and span.op in _INSIDE):
                    continue
                if span.op != match[0][0] or not (span.sure or span.op == Opcode.MESSAGE):
                    continue
                whole = span.end <= len(self._data) and self.joins(span.end)
                if whole or (span.sure and span.op == Opcode.CHUNK):
                    return match.start()
        return stop


def _record(data: Buffer, at: int) -> Span | None:
    """Return the record at a place, if there can be one."""
    if len(data) - at < RECORD.size:
        return None
    op, size = RECORD.unpack_from(data, at)
    start = at + RECORD.size
    end = start + size
    extent = _extent(data, op, start)
    known = op in _LAYOUTS and op != Opcode.MESSAGE
    if known and extent == end:
        return Span(op, at, start, end, True)
    for kind in _LARGE if op == Opcode.MESSAGE or op >= _PRIVATE else _MENDED:
        if _extent(data, kind, start, filled=True) == end:
            return Span(kind, at, start, end, True)
    if not (op in _LAYOUTS or op >= _PRIVATE) or end > len(data) or (extent > end and op != Opcode.CHUNK):
        return None
    # Later versions of the format may add to a record; private records may hold anything.
    return None if known and end - extent > _MOST_GROWTH else Span(op, at, start, end, False)


def _is_sound_chunk(data: Buffer, span: Span) -> bool:
    """Tell whether a chunk holds what it should."""
    try:
        head = ChunkHead.read(data, span)
        unpack(head, memoryview(data)[head.data_start : head.data_end])
    except BrokenRecordError:
        return False
    return head.crc != 0 or head.compression != ""


def _extent(data: Buffer, op: int, at: int, *, filled: bool = False) -> int:
    """Return where the content of a record ends by the sizes inside it; endless if it runs out of the data.

    What must be ``filled`` is endless too if it is empty, as zeros always seem to be.
    """
    inside = 0
    for part in _LAYOUTS.get(op, ()):
        if isinstance(part, int):
            at += part
        elif at + part.size <= len(data):
            size = part.unpack_from(data, at)[0]
            inside = size if part is _LONG else inside + size
            at += part.size + size
        else:
            return _ENDLESS
    return at if inside or not filled else _ENDLESS


def is_other(data: Buffer, span: Span) -> bool:
    """Tell whether a record fits to the byte what another kind of record consists of."""
    kinds = (op for op, parts in _LAYOUTS.items() if op != span.op and not all(isinstance(part, int) for part in parts))
    return any(_extent(data, op, span.start) == span.end for op in kinds)


def name_of(op: int) -> str:
    """Return what people call a record.

    Examples
    --------
    >>> name_of(7), name_of(200)
    ('message index', 'record of kind 200')
    """
    return Opcode(op).name.lower().replace("_", " ") if op in _LAYOUTS else f"record of kind {op}"


def split(records: Buffer, report: Gap, *, trusted: bool) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of the records of an unpacked chunk; ``trusted`` ones are not looked into."""
    at = 0
    while trusted and at + RECORD.size <= len(records):
        op, size = RECORD.unpack_from(records, at)
        start = at + RECORD.size
        if start + size > len(records):
            break
        at = start + size
        yield op, start, at
    for span in walk(records, report, at):
        yield span.op, span.start, span.end


def parse(read: Callable[[ReadDataStream], R], content: Buffer) -> R:
    """Read one of the ``mcap`` library's records; `BrokenRecordError` if the content is none."""
    try:
        return read(ReadDataStream(BytesIO(content)))
    except (McapError, struct.error, ValueError, OverflowError) as error:
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
    except _DECOMPRESSION_ERRORS as error:
        raise BrokenRecordError(f"cannot be decompressed ({error})") from error
    if len(records) != head.size:
        raise BrokenRecordError(f"does not hold the {head.size} bytes that it should")
    if head.crc and crc32(records) != head.crc:
        raise BrokenRecordError("fails its checksum")
    return records


def _decompress(head: ChunkHead, packed: memoryview) -> Buffer:
    """Return the records, but no more than one byte above what the chunk says, whatever the compressor says."""
    if head.compression == "":
        return packed
    if head.compression not in COMPRESSIONS:
        raise ValueError(f"compression {head.compression[:8]!r} is not known")
    if head.size > _MOST_UNPACKED:
        raise ValueError(f"it would take {head.size} bytes")
    if head.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
            return stream.read(head.size + 1)
    return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=head.size + 1))


def salvage(head: ChunkHead, packed: memoryview) -> Buffer:
    """Return the records at the beginning of a chunk that is cut off or broken, as far as they can be decompressed."""
    if head.compression == "":
        return packed
    records = bytearray()
    with suppress(*_DECOMPRESSION_ERRORS):
        for piece in _pieces(head, packed):
            records += piece
            if len(records) >= min(head.size, _MOST_UNPACKED):
                break
    return bytes(records)


def _pieces(head: ChunkHead, packed: memoryview) -> Iterator[bytes]:
    if head.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
            while piece := stream.read(_PIECE):
                yield piece
    elif head.compression == "lz4":
        decompressor = lz4.frame.LZ4FrameDecompressor()
        yield decompressor.decompress(packed, max_length=_PIECE)
        while not (decompressor.eof or decompressor.needs_input):
            yield decompressor.decompress(b"", max_length=_PIECE)
