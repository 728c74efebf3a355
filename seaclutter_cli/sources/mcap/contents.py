"""Content of an MCAP file, found in one pass over its records without unpacking a chunk."""

import struct
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from mcap import records as mcap_records
from mcap.opcode import Opcode

from seaclutter_cli.limits import CHANNEL_BYTES, above, limits
from seaclutter_cli.records import Attachment, Buffer, Bytes, Channel, FilePart, Metadata, Schema
from seaclutter_cli.sources.mcap.records import (
    MAGIC,
    MESSAGE,
    RECORD,
    BrokenRecordError,
    ChunkHeader,
    Gap,
    Span,
    is_other,
    name_of,
    parse,
    walk,
)
from seaclutter_cli.sources.shared import log_file
from seaclutter_cli.sources.shared.chunked import Chunk
from seaclutter_cli.sources.shared.log_file import LogFile

_LOOSE_BYTES = 4 * 2**20
_INDEX, _TIMES = struct.Struct("<HI"), struct.Struct("<QQ")
_END_OPS = (
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
    Opcode.SUMMARY_OFFSET,
    Opcode.FOOTER,
)


def index_counts(view: Bytes, at: int) -> Counter[int]:
    """Return the number of messages per channel of a chunk that ends at an offset, from its message indexes."""
    counts = Counter[int]()
    while at + RECORD.size <= len(view):
        op, size = log_file.unpack(RECORD, view, at)
        start = at + RECORD.size
        at = start + size
        if op != Opcode.MESSAGE_INDEX or at > len(view) or size < 6:
            break
        channel, size = log_file.unpack(_INDEX, view, start)
        counts[channel] += size // 16
    return counts


@dataclass(frozen=True, slots=True)
class McapChunk(Chunk):
    """A chunk record, or a run of messages outside chunks (``header`` is None); ``suspect`` if times may be wrong."""

    header: ChunkHeader | None
    suspect: bool = False


class Trust(IntEnum):
    """Levels of trust in a declaration, in ascending order."""

    BROKEN = 0
    """The declaration is among records that include damaged ones."""
    UNCHECKED = 1
    CHECKED = 2
    """The declaration is in a chunk, or in the summary, with a correct checksum."""


class Declarations:
    """Schemas and channels of a file, declared in any order; of contradictory ones, the first most trusted applies."""

    def __init__(self, report: Gap) -> None:
        self._report = report
        self._schemas: dict[int, tuple[Trust, mcap_records.Schema]] = {}
        self._records: dict[int, tuple[Trust, mcap_records.Channel]] = {}
        self._channels: dict[int, Channel] = {}
        self._offsets: dict[int, int] = {}
        self._contradicted: set[tuple[int, int]] = set()
        self._room = limits().message_bytes

    def add(self, op: int, content: Buffer, offset: int, trust: Trust) -> None:
        """Add a schema or channel; other records are ignored."""
        if op not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        number = int.from_bytes(content[:2], "little")
        known: dict[int, tuple[Trust, Any]] = self._schemas if op == Opcode.SCHEMA else self._records
        if number not in known:
            self._room -= len(content) + CHANNEL_BYTES
            if self._room < 0:
                self._report(offset, f"{name_of(op)}s of {above('more bytes', 'message_mib')}", len(content))
                return
        try:
            kind = mcap_records.Schema if op == Opcode.SCHEMA else mcap_records.Channel
            record = parse(kind.read, content)
        except BrokenRecordError as error:
            self._report(offset, f"damaged {name_of(op)} ({error})", len(content))
            return
        before, other = known.setdefault(record.id, (trust, record))
        if trust > before:
            known[record.id] = trust, record
        self._channels = {}
        if op == Opcode.CHANNEL:
            self._offsets.setdefault(number, offset)
        if other != record and (op, number) not in self._contradicted:
            self._contradicted.add((op, number))
            self._report(offset, f"{name_of(op)} {number} is declared again, with different content", 0)

    def get(self, number: int) -> Channel | None:
        """Return a channel by its number; None if it is not declared."""
        if number not in self._channels and number in self._records:
            _, record = self._records[number]
            _, schema = self._schemas.get(record.schema_id, (None, None))
            known = Schema(schema.name, schema.encoding, schema.data) if schema else None
            metadata = tuple(record.metadata.items())
            self._channels[number] = Channel(number, record.topic, record.message_encoding, known, metadata)
        return self._channels.get(number)

    def all(self) -> list[Channel]:
        """Return the channels in the order of their numbers."""
        return [channel for number in sorted(self._records) if (channel := self.get(number))]

    def incomplete(self, numbers: Iterable[int]) -> set[int]:
        """Return the channel numbers that are not declared, or whose schema is not."""
        return {number for number in numbers if number not in self._records or self._lacks_schema(number)}

    def report_missing_schemas(self) -> None:
        """Report channels whose schema is not declared."""
        for number, (_, record) in self._records.items():
            if self._lacks_schema(number):
                problem = f"topic {record.topic} has schema {record.schema_id}, which is not declared"
                self._report(self._offsets[number], problem, 0)

    def _lacks_schema(self, number: int) -> bool:
        schema = self._records[number][1].schema_id
        return schema != 0 and schema not in self._schemas


class McapContents:
    """Content of a file, found in one pass over its records.

    The declarations receive the schemas and channels outside chunks, but not those in the ``tail``, records after the
    last data: the summary. ``first`` has the index of the first chunk with messages of each channel.
    """

    def __init__(self, file: LogFile, declarations: Declarations, report: Gap) -> None:
        self.profile = ""
        self.chunks: list[McapChunk] = []
        self.counts: Counter[int] = Counter()
        self.first: dict[int, int] = {}
        self.extras: list[Attachment | Metadata] = []
        self.tail: list[Span] = []
        self.end = len(MAGIC)
        self._file = file
        self._declarations = declarations
        self._report = report
        self._follows_chunk = self._follows_odd = False
        self._run()

    def _run(self) -> None:
        start = len(MAGIC) if self._file[: len(MAGIC)] == MAGIC else 0
        for span in walk(self._file, self._gap, start):
            self.end = span.end
            self._take(span)
            is_closed = span.op == Opcode.FOOTER and bool(self.chunks or self.extras)
            if is_closed and self._file[span.end : span.end + 2 * len(MAGIC)] == 2 * MAGIC:
                self._gap(span.end, "", len(self._file) - span.end)  # another file
                break

    def declare(self, spans: Sequence[Span], trust: Trust) -> None:
        """Add the schemas and channels among records of the file."""
        for span in spans:
            self._declarations.add(span.op, self._file[span.start : span.end], span.offset, trust)

    def _take(self, span: Span) -> None:
        is_out_of_place = span.op == Opcode.MESSAGE and (self._follows_chunk or self._follows_odd)
        if is_out_of_place and is_other(self._file, span):
            self._report(span.offset, "damaged opcode of a record that is not needed", 0)
            return
        if span.op in _END_OPS:
            self.tail.append(span)
            return
        self.declare(self.tail, Trust.UNCHECKED)
        self.tail.clear()
        if span.op == Opcode.MESSAGE_INDEX:
            self._message_index(span)
            return
        self._follows_chunk, self._follows_odd = span.op == Opcode.CHUNK, span.op == Opcode.DATA_END
        if span.op == Opcode.CHUNK:
            self._chunk(span)
        elif span.op == Opcode.MESSAGE:
            self._loose_message(span)
        else:
            self._extra(span)

    def _chunk(self, span: Span) -> None:
        try:
            header = ChunkHeader.read(self._file, span)
        except BrokenRecordError as error:
            self._report(span.offset, f"damaged chunk ({error})", span.end - span.offset)
            self._follows_chunk = False
            return
        size, unpacked = span.end - span.offset, min(header.size, limits().bytes_of("chunk", len(self._file)))
        self.chunks.append(McapChunk(span.offset, size, header.start_ns, header.end_ns, header, unpacked=unpacked))

    def _extra(self, span: Span) -> None:
        """Add a record that describes the file as a whole, or an attachment."""
        start, end = span.start, span.end
        try:
            if span.op == Opcode.HEADER or span.offset == len(MAGIC):
                self.profile = parse(mcap_records.Header.read, self._file[start:end]).profile
            elif span.op == Opcode.METADATA:
                record = parse(mcap_records.Metadata.read, self._file[start:end])
                self.extras.append(Metadata(record.name, dict(record.metadata)))
            elif span.op == Opcode.ATTACHMENT:
                self.extras.append(self._attachment(span))
        except BrokenRecordError as error:
            self._report(span.offset, f"damaged {name_of(span.op)} ({error})", end - start)

    def _attachment(self, span: Span) -> Attachment:
        """Return an attachment without reading its data into memory."""
        file = self._file
        stated = int.from_bytes(file[span.end - 4 : span.end], "little")
        if stated not in (0, FilePart(file, span.start, span.end - 4).crc32()):
            raise BrokenRecordError("its checksum is wrong")
        log_time, create_time = log_file.unpack(_TIMES, file, span.start)
        at = span.start + _TIMES.size
        strings: list[str] = []
        for _ in range(2):
            size = int.from_bytes(file[at : at + 4], "little")
            strings.append(bytes(file[at + 4 : at + 4 + size]).decode("utf-8", "replace"))
            at += 4 + size
        size = int.from_bytes(file[at : at + 8], "little")
        data = FilePart(file, at + 8, min(at + 8 + size, span.end))
        return Attachment(log_time, create_time, strings[0], strings[1], data)

    def _message_index(self, span: Span) -> None:
        """Count the messages of a channel in the previous chunk, and compare their times with the chunk's."""
        content = self._file[span.start : span.end]
        channel, size = (int.from_bytes(content[part], "little") for part in (slice(2), slice(2, 6)))
        if self._follows_chunk and size >= 16:
            chunk = self.chunks[-1]
            # The index must contain valid times of messages in the chunk.
            is_valid = not size % 16 and size <= len(content) - 6
            if is_valid:
                times_ns = np.frombuffer(content, "<u8", size // 8, 6)[::2]
                is_valid = chunk.start_ns <= int(times_ns.min()) and int(times_ns.max()) <= chunk.end_ns
            suspect = chunk.suspect or not is_valid
            self.chunks[-1] = replace(chunk, messages=chunk.messages + size // 16, suspect=suspect)
            self._count(channel, size // 16)

    def _gap(self, offset: int, problem: str, lost_bytes: int) -> None:
        """Report damaged bytes; the chunk of an index after them is unknown."""
        is_behind = self.tail and self.tail[-1].op == Opcode.FOOTER and lost_bytes > len(MAGIC)
        if is_behind and self._file[offset : offset + len(MAGIC)] == MAGIC:
            problem, offset, lost_bytes = "bytes after the end of the recording", offset + 8, lost_bytes - len(MAGIC)
        self._report(offset, problem, lost_bytes)
        if self._follows_chunk:
            self.chunks[-1] = replace(self.chunks[-1], suspect=True)
        if lost_bytes:
            self._follows_chunk, self._follows_odd = False, True

    def _loose_message(self, span: Span) -> None:
        """Add a message outside chunks to the run before it, or begin a run."""
        channel, _, log_time, _ = log_file.unpack(MESSAGE, self._file, span.start)
        last = self.chunks[-1] if self.chunks else None
        if last and last.header is None and last.offset + last.size == span.offset and last.size < _LOOSE_BYTES:
            start_ns, end_ns, size = min(last.start_ns, log_time), max(last.end_ns, log_time), span.end - last.offset
            run = replace(last, size=size, start_ns=start_ns, end_ns=end_ns, messages=last.messages + 1)
            self.chunks[-1] = run
        else:
            self.chunks.append(McapChunk(span.offset, span.end - span.offset, log_time, log_time, None, messages=1))
        self._count(channel, 1)

    def _count(self, channel: int, messages: int) -> None:
        self.counts[channel] += messages
        self.first.setdefault(channel, len(self.chunks) - 1)
