"""MCAP files: indexed or not, chunked or not, every compression, whole or damaged."""

import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path

from mcap import records as mcap_records
from mcap.opcode import Opcode

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Attachment, Buffer, Channel, Damage, Message, Metadata, Record, Schema
from seaclutter_cli.sources.chunked import Chunk, in_time_order
from seaclutter_cli.sources.mapped import MappedFile
from seaclutter_cli.sources.mcap_file import (
    MAGIC,
    MESSAGE,
    RECORD,
    BrokenRecordError,
    ChunkHead,
    Span,
    parse,
    unpack,
    unpack_cut,
    walk,
)

_LOOSE_BYTES = 4 * 2**20


@dataclass(frozen=True, slots=True)
class _McapChunk(Chunk):
    """A chunk record, or a run of messages that stand outside chunks (``head`` is None)."""

    head: ChunkHead | None
    messages: int = 0


class McapSource:
    """An MCAP file as a `Source`.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        If the file is no MCAP, or nothing in it can be read.
    """

    format = "MCAP"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.name = path.stem
        self.damage: list[Damage] = []
        self.profile = ""
        self._file = MappedFile(path)
        self._data = self._file.data
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[_McapChunk] = []
        self._counts: Counter[int] = Counter()
        self._first: dict[int, int] = {}
        self._extras: list[Attachment | Metadata] = []
        try:
            self._scan()
        except BaseException:
            self.close()
            raise
        heads = [chunk.head for chunk in self._chunks if chunk.head]
        self.compression = heads[0].compression if heads else None

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels in the order of their ids."""
        return [self._channels[number] for number in sorted(self._channels)]

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id, from the index that follows each chunk."""
        return dict(self._counts)

    def records(self) -> Iterator[Record]:
        """Yield metadata and attachments, then the messages in the order of their log time."""
        yield from self._extras
        yield from in_time_order(self._chunks, self._load)

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def _scan(self) -> None:
        if self._data[: len(MAGIC)] != MAGIC:
            if self.path.suffix.lower() != ".mcap":
                raise InputError(f"{self.path}: not an MCAP file")
            self._report(0, "the file does not begin as an MCAP file should", 0)
        summary: list[Span] | None = None
        for span in walk(self._data, self._report):
            self._file.touched()
            if summary is not None:
                summary.append(span)
            elif span.op == Opcode.DATA_END:
                summary = []
            else:
                self._data_record(span)
        if not (self._chunks or self._extras or self._channels or summary):
            raise InputError(f"{self.path}: nothing in this MCAP file can be read")
        if summary is None or not self._read_summary(summary):
            self._discover_channels()

    def _data_record(self, span: Span) -> None:
        content = self._content(span)
        try:
            if span.op == Opcode.CHUNK:
                head = ChunkHead.read(self._data, span)
                size = span.end - span.offset
                self._chunks.append(_McapChunk(span.offset, size, head.start_ns, head.end_ns, head))
            elif span.op == Opcode.MESSAGE_INDEX and self._chunks:
                self._count(int.from_bytes(content[:2], "little"), (len(content) - 6) // 16)
            elif span.op == Opcode.MESSAGE:
                self._loose_message(span)
            elif span.op == Opcode.HEADER:
                self.profile = parse(mcap_records.Header.read, content).profile
            elif span.op in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._declare(span.op, content)
            elif span.op == Opcode.METADATA:
                record = parse(mcap_records.Metadata.read, content)
                self._extras.append(Metadata(record.name, dict(record.metadata)))
            elif span.op == Opcode.ATTACHMENT:
                self._extras.append(_attachment(content))
        except BrokenRecordError as error:
            self._report(span.offset, f"broken {_name(span.op)}{f' ({error})' if str(error) else ''}", len(content))

    def _loose_message(self, span: Span) -> None:
        """Add a message outside chunks to the run before it, or begin a run."""
        channel, _, log_time, _ = MESSAGE.unpack_from(self._data, span.start)
        last = self._chunks[-1] if self._chunks else None
        if last and last.head is None and last.offset + last.size == span.offset and last.size < _LOOSE_BYTES:
            self._chunks[-1] = replace(
                last,
                size=span.end - last.offset,
                start_ns=min(last.start_ns, log_time),
                end_ns=max(last.end_ns, log_time),
            )
        else:
            self._chunks.append(_McapChunk(span.offset, span.end - span.offset, log_time, log_time, None))
        self._count(channel, 1)

    def _count(self, channel: int, messages: int) -> None:
        """Note that the last chunk holds messages of a channel."""
        self._chunks[-1] = replace(self._chunks[-1], messages=self._chunks[-1].messages + messages)
        self._counts[channel] += messages
        self._first.setdefault(channel, len(self._chunks) - 1)

    def _declare(self, op: int, content: Buffer) -> None:
        """Take note of a schema or channel."""
        if op == Opcode.SCHEMA:
            schema = parse(mcap_records.Schema.read, content)
            self._schemas[schema.id] = Schema(schema.name, schema.encoding, schema.data)
            return
        channel = parse(mcap_records.Channel.read, content)
        if channel.schema_id and channel.schema_id not in self._schemas:
            raise BrokenRecordError(f"topic {channel.topic} has schema {channel.schema_id}, which is nowhere")
        metadata = tuple(channel.metadata.items())
        schema = self._schemas.get(channel.schema_id)
        self._channels[channel.id] = Channel(channel.id, channel.topic, channel.message_encoding, schema, metadata)

    def _read_summary(self, spans: Sequence[Span]) -> bool:
        """Read schemas and channels from the summary and check the rest of it; return whether it was of use."""
        if not spans or spans[-1].op != Opcode.FOOTER:
            self._report(len(self._data), "the recording was not closed: the file has no footer", 0)
            return False
        if len(self._data) - spans[-1].end != len(MAGIC):
            self._report(spans[-1].end, "the file does not end as an MCAP file should", len(self._data) - spans[-1].end)
        footer = parse(mcap_records.Footer.read, self._content(spans[-1]))
        if not footer.summary_start:
            return False
        # The checksum covers all from the summary's beginning up to itself.
        covered = self._file.view[footer.summary_start : spans[-1].end - 4]
        if footer.summary_start != spans[0].offset or (
            footer.summary_crc and zlib.crc32(covered) != footer.summary_crc
        ):
            self._report(spans[0].offset, "the index at the end is broken; the log was read without it", 0)
            return False
        for span in spans:
            if span.op in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._declare(span.op, self._content(span))
        self._check_index([span for span in spans if span.op == Opcode.CHUNK_INDEX])
        self._check_statistics([span for span in spans if span.op == Opcode.STATISTICS])
        return any(span.op == Opcode.CHANNEL for span in spans)

    def _check_index(self, spans: Sequence[Span]) -> None:
        entries = [parse(mcap_records.ChunkIndex.read, self._content(span)) for span in spans]
        indexed = {(entry.chunk_start_offset, entry.message_start_time, entry.message_end_time) for entry in entries}
        for chunk in self._chunks:
            if chunk.head and entries and (chunk.offset, chunk.start_ns, chunk.end_ns) not in indexed:
                self._report(
                    chunk.offset, "the index at the end does not fit this chunk; the log was read without it", 0
                )
        if len(entries) > sum(chunk.head is not None for chunk in self._chunks) and not self.damage:
            self._report(spans[0].offset, "the index at the end names chunks that are not there", 0)

    def _check_statistics(self, spans: Sequence[Span]) -> None:
        if not spans or not all(chunk.messages for chunk in self._chunks):
            return
        expected = parse(mcap_records.Statistics.read, self._content(spans[0])).message_count
        missing = expected - self._counts.total()
        if missing > 0:
            self._report(spans[0].offset, f"{missing} of {expected} messages are nowhere in the file", 0, missing)
        elif missing:
            self._report(spans[0].offset, f"the file holds {-missing} messages more than its statistics say", 0)

    def _discover_channels(self) -> None:
        """Look for channels inside the chunks: where their first message is, then wherever they may be."""
        for chunk in [self._chunks[number] for number in self._first.values()]:
            self._load(chunk)
        for chunk in self._chunks:
            if not chunk.messages or not self._counts.keys() <= self._channels.keys():
                self._load(chunk)

    def _load(self, chunk: _McapChunk) -> list[Message]:
        try:
            return sorted(self._messages(chunk, self._unpack(chunk)), key=attrgetter("log_time_ns"))
        except BrokenRecordError as error:
            self._report(chunk.offset, f"the chunk {error}", chunk.size, chunk.messages or None)
            return []

    def _unpack(self, chunk: _McapChunk) -> Buffer:
        data, head = self._file.view, chunk.head
        self._file.touched(chunk.size)
        if head is None:
            return data[chunk.offset : chunk.offset + chunk.size]
        packed = data[head.data_start : head.data_end]
        if head.data_end <= len(data):
            return unpack(head, packed)
        records = unpack_cut(head, packed)
        self._report(chunk.offset, "the file ends inside this chunk, its end is missing", head.data_end - len(data))
        return records

    def _messages(self, chunk: _McapChunk, records: Buffer) -> Iterator[Message]:
        """Yield the messages of unpacked records; declare the channels among them."""
        view, at, strangers = memoryview(records), 0, Counter[int]()
        while at + RECORD.size <= len(view):
            op, size = RECORD.unpack_from(view, at)
            start, at = at + RECORD.size, at + RECORD.size + size
            if at > len(view):
                break
            if op == Opcode.MESSAGE and size >= MESSAGE.size:
                number, sequence, log_time, publish_time = MESSAGE.unpack_from(view, start)
                channel = self._channels.get(number)
                if channel is None:
                    strangers[number] += 1
                else:
                    yield Message(channel, log_time, publish_time, sequence, view[start + MESSAGE.size : at])
            elif op in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._declare(op, view[start:at])
        if at != len(view) and not (chunk.head and chunk.head.data_end > len(self._data)):
            self._report(chunk.offset, "the chunk's last records are broken", max(len(view) - at, 0))
        for number, count in strangers.items():
            self._report(chunk.offset, f"messages of channel {number}, which is declared nowhere", 0, count)

    def _content(self, span: Span) -> memoryview:
        return self._file.view[span.start : span.end]

    def _report(self, offset: int, what: str, lost_bytes: int, lost_messages: int | None = None) -> None:
        damage = Damage(self.path, offset, what, lost_bytes, lost_messages)
        if damage not in self.damage:  # a chunk may be read more than once
            self.damage.append(damage)


def _attachment(content: memoryview) -> Attachment:
    """Read an attachment without copying its data."""
    if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little") != 0:
        raise BrokenRecordError("its checksum is wrong")
    at = 16
    strings: list[str] = []
    for _ in range(2):
        size = int.from_bytes(content[at : at + 4], "little")
        strings.append(bytes(content[at + 4 : at + 4 + size]).decode("utf-8", "replace"))
        at += 4 + size
    size = int.from_bytes(content[at : at + 8], "little")
    if at + 8 + size != len(content) - 4:
        raise BrokenRecordError("its sizes do not fit together")
    log_time, create_time = (int.from_bytes(content[i : i + 8], "little") for i in (0, 8))
    return Attachment(log_time, create_time, strings[0], strings[1], content[at + 8 : at + 8 + size])


def _name(op: int) -> str:
    return Opcode(op).name.lower().replace("_", " ")
