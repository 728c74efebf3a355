"""A small MCAP file with the first frames of a large one that is far away, and what its summary says about the rest."""

import struct
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from zlib import crc32

from mcap import records as mcap_records
from mcap.opcode import Opcode

from seaclutter_cli.messages import find_codec
from seaclutter_cli.sources.mcap.contents import Declarations, Trust
from seaclutter_cli.sources.mcap.records import MAGIC, RECORD, BrokenRecordError, Span, parse_all, walk

_FOOTER = struct.Struct("<QQI")
_END = RECORD.size + _FOOTER.size + len(MAGIC)
_HEAD_BYTES = 4096
_MAX_SUMMARY_BYTES = 64 * 2**20
_MAX_CHUNK_BYTES = 64 * 2**20
_CHUNKS = 3

ReadRange = Callable[[int, int], bytes]
"""Returns the bytes between two offsets of a file."""


@dataclass(frozen=True)
class Excerpt:
    """An MCAP file with the first chunks of each topic with clouds, and what the summary of the whole log says.

    ``messages`` are those of the whole log by channel id; start and end are its first and last log time.
    """

    data: bytes
    messages: dict[int, int]
    start_ns: int
    end_ns: int


def excerpt(read: ReadRange, size: int) -> Excerpt | None:
    """Return an excerpt of an MCAP file of a size; None if its summary cannot be used, or it has no clouds."""
    with suppress(BrokenRecordError, struct.error):
        return _excerpt(read, size)
    return None


def _excerpt(read: ReadRange, size: int) -> Excerpt | None:
    head, end = read(0, min(_HEAD_BYTES, size)), read(max(size - _END, 0), size)
    first = next(walk(head, _broken, len(MAGIC)), None) if head.startswith(MAGIC) else None
    if first is None or first.op != Opcode.HEADER or first.end > len(head) or not end.endswith(MAGIC):
        return None
    op, length = RECORD.unpack_from(end)
    start, _, crc = _FOOTER.unpack_from(end, RECORD.size)
    if (op, length) != (Opcode.FOOTER, _FOOTER.size) or not 0 < size - _END - start <= _MAX_SUMMARY_BYTES:
        return None
    summary = read(start, size - _END)
    if crc not in (0, crc32(end[: _END - len(MAGIC) - 4], crc32(summary))):
        return None
    spans = list(walk(summary, _broken))
    statistics = parse_all(summary, spans, Opcode.STATISTICS, mcap_records.Statistics.read, _broken)
    chunks = _first_chunks(summary, spans)
    if not (statistics and chunks):
        return None
    pieces = [read(one.chunk_start_offset, one.chunk_start_offset + _length(one)) for one in chunks]
    declared = [summary[one.offset : one.end] for one in spans if one.op in (Opcode.SCHEMA, Opcode.CHANNEL)]
    data = _file(head[: first.end], pieces, b"".join(declared))
    found = statistics[0]
    return Excerpt(data, dict(found.channel_message_counts), found.message_start_time, found.message_end_time)


def _broken(_: int, problem: str, *__: object) -> None:
    raise BrokenRecordError(problem)


def _first_chunks(summary: bytes, spans: Sequence[Span]) -> list[mcap_records.ChunkIndex]:
    """Return the index of the first chunks with each topic that has clouds, in the order of the file."""
    declarations = Declarations(_broken)
    for span in spans:
        declarations.add(span.op, summary[span.start : span.end], span.offset, Trust.CHECKED)
    indexed = parse_all(summary, spans, Opcode.CHUNK_INDEX, mcap_records.ChunkIndex.read, _broken)
    indexed.sort(key=lambda one: one.message_start_time)
    chosen: dict[int, mcap_records.ChunkIndex] = {}
    for channel in filter(find_codec, declarations.all()):
        with_channel = (one for one in indexed if channel.id in one.message_index_offsets)
        chosen |= {one.chunk_start_offset: one for one, _ in zip(with_channel, range(_CHUNKS), strict=False)}
    taken, left = [], _MAX_CHUNK_BYTES
    for offset in sorted(chosen):
        left -= _length(chosen[offset])
        if left >= 0:
            taken.append(chosen[offset])
    return taken


def _length(chunk: mcap_records.ChunkIndex) -> int:
    """Return the bytes of a chunk and of the message indexes after it."""
    return chunk.chunk_length + chunk.message_index_length


def _file(head: bytes, chunks: Iterable[bytes], declared: bytes) -> bytes:
    data = b"".join((head, *chunks, RECORD.pack(Opcode.DATA_END, 4), bytes(4)))
    footer = RECORD.pack(Opcode.FOOTER, _FOOTER.size) + struct.pack("<QQ", len(data), 0)
    return data + declared + footer + struct.pack("<I", crc32(footer, crc32(declared))) + MAGIC
