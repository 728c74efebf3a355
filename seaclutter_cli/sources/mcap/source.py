"""MCAP files: indexed or not, chunked or not, every compression, intact or damaged."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import MappingProxyType

from mcap import records as mcap_records
from mcap.opcode import Opcode

from seaclutter_cli.documents import DocumentError, load_json
from seaclutter_cli.errors import InputError
from seaclutter_cli.limits import above, limits
from seaclutter_cli.records import Attachment, Buffer, Channel, FilePart, Message, Metadata, Record, SensorFacts
from seaclutter_cli.sensors.catalog import SENSORS
from seaclutter_cli.sources.mcap.contents import Declarations, McapChunk, McapContents, Trust, index_counts
from seaclutter_cli.sources.mcap.records import (
    COMPRESSIONS,
    MAGIC,
    MESSAGE,
    BrokenRecordError,
    parse,
    parse_all,
    salvage,
    split,
    unpack,
    walk,
)
from seaclutter_cli.sources.shared.chunked import ChunkedSource
from seaclutter_cli.sources.shared.unpacking import ZSTD_MAGIC, unpack_message
from seaclutter_cli.text import count

_SMALL = 4 * 2**20
_MAX_SALVAGED = 20_000


class McapSource(ChunkedSource[McapChunk, Buffer]):
    """An MCAP file; `InputError` if it is something else, or contains no readable record."""

    format = "MCAP"

    def _open(self) -> None:
        self.name = Path(self._path.name.removesuffix(".zstd")).stem
        self._declared = Declarations(self._report)
        if self._file[: len(MAGIC)] != MAGIC:
            if not self._path.name.lower().endswith((".mcap", ".mcap.zstd")):
                raise InputError(f"{self._path}: not an MCAP file")
            self._report(0, "the file does not begin with the MCAP magic bytes", 0)
        self._found = found = McapContents(self._file, self._declared, self._report)
        self.profile = found.profile
        self._chunks, self._tail, self._counts, self._first = found.chunks, found.tail, found.counts, found.first
        self.metadata = [record for record in found.extras if isinstance(record, Metadata)]
        self.facts = _simulated_facts(self.metadata)
        if not (found.chunks or found.extras or found.tail or self._declared.all()):
            raise InputError(f"{self._path}: no readable record in this MCAP file")
        used = (chunk.header.compression for chunk in self._chunks if chunk.header)
        self.compression = next((name for name in used if name in COMPRESSIONS), None)
        trust, has_valid_offset = self._trust_in_tail(found.end)
        found.declare(self._tail, trust)
        self._declares_channels = trust == Trust.CHECKED and any(span.op == Opcode.CHANNEL for span in self._tail)
        self._statistics: mcap_records.Statistics | None = None
        if has_valid_offset:
            self._check_chunk_index()
        if self._is_closed and trust > Trust.BROKEN:
            stated = parse_all(self._file, self._tail, Opcode.STATISTICS, mcap_records.Statistics.read, self._report)
            self._statistics = next(iter(stated), None)
        self._inspect_chunks()
        self._declared.report_missing_schemas()

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels in numerical order."""
        return self._declared.all()

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel number, from the statistics or, without them, from the message indexes."""
        return dict(self._statistics.channel_message_counts if self._statistics else self._counts)

    def _extras(self) -> Iterator[Record]:
        for extra in self._found.extras:
            if isinstance(extra, Attachment) and len(extra.data) <= _SMALL:  # so that it outlives the source
                yield replace(extra, data=bytes(extra.data))
            else:
                yield extra

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield metadata and attachments, then the messages of chunks with times in ``[start_ns, end_ns)``."""
        broken = 0
        for record in super().records(start_ns, end_ns):
            if (plain := self._plain(record) if isinstance(record, Message) else record) is not None:
                yield plain
            else:
                broken += 1
        if broken:
            self.report("damaged compressed messages", 0, broken, path=self._path)

    def _indexed(self, chunk: McapChunk) -> Counter[int] | None:
        counts = index_counts(self._file, chunk.offset + chunk.size)
        return counts if chunk.header is not None and 0 < chunk.messages == counts.total() else None

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels."""
        return list(filter(None, map(self._plain, super().latest(channels, before_ns))))

    def _plain(self, message: Message) -> Message | None:
        """Return a message, unpacked if rosbag2 compressed it, as only its folder says; None if it is damaged."""
        if message.data[:4] != ZSTD_MAGIC or message.channel.message_encoding != "cdr":
            return message
        data = unpack_message(message.data, limits().bytes_of("message", len(self._file)))
        return None if data is None else replace(message, data=data)

    @property
    def _is_closed(self) -> bool:
        return bool(self._tail) and self._tail[-1].op == Opcode.FOOTER

    def _trust_in_tail(self, end: int) -> tuple[Trust, bool]:
        """Return the trust in the summary, and whether its stated offset is valid; report damage."""
        if not self._is_closed:
            self._report(len(self._file), "the recording was not closed: the file has no footer", 0)
            return Trust.UNCHECKED, False
        if self._file[end : end + len(MAGIC)] != MAGIC:
            self._report(end, "the file does not end with the MCAP magic bytes", 0)
        first, last = self._tail[0], self._tail[-1]
        footer = parse(mcap_records.Footer.read, self._file[last.start : last.end])
        has_valid_offset = footer.summary_start == (0 if len(self._tail) == 1 else first.offset)
        # The checksum covers the summary and the footer up to the checksum itself.
        if footer.summary_crc == FilePart(self._file, first.offset, last.end - 4).crc32():
            trust = Trust.CHECKED
        else:
            trust = Trust.UNCHECKED if has_valid_offset and not footer.summary_crc else Trust.BROKEN
        if not has_valid_offset or trust == Trust.BROKEN:
            self._report(first.offset, "the index at the end is damaged; the log is read without it", 0)
        return trust, has_valid_offset and trust > Trust.BROKEN

    def _check_chunk_index(self) -> None:
        """Compare the chunk index with the chunks; mark chunks that it describes differently as suspect."""
        entries = parse_all(self._file, self._tail, Opcode.CHUNK_INDEX, mcap_records.ChunkIndex.read, self._report)
        if not entries:
            return
        indexed = {(entry.chunk_start_offset, entry.message_start_time, entry.message_end_time) for entry in entries}
        known = {chunk.offset for chunk in self._chunks}
        wrong = [
            number
            for number, chunk in enumerate(self._chunks)
            if chunk.header and (chunk.offset, chunk.start_ns, chunk.end_ns) not in indexed
        ]
        for number in wrong:
            self._chunks[number] = replace(self._chunks[number], suspect=True)
        if wrong:
            chunks = f"{len(wrong)} of {count(len(known), 'chunk')}"
            problem = f"the index at the end does not fit {chunks}; the log is read without it"
            self._report(self._chunks[wrong[0]].offset, problem, 0)
        absent = sum(entry.chunk_start_offset not in known for entry in entries)
        if absent and not wrong and not self.damage:
            offset = next(span.offset for span in self._tail if span.op == Opcode.CHUNK_INDEX)
            problem = f"the index at the end lists {count(absent, 'chunk')} that the file does not contain"
            self._report(offset, problem, 0)

    def _check_number(self, found: int) -> None:
        if self._statistics is None:
            return
        offset = next(span.offset for span in self._tail if span.op == Opcode.STATISTICS)
        expected = self._statistics.message_count
        missing = expected - found - sum(item.lost_messages or 0 for item in self.damage)
        extras = self._statistics.attachment_count + self._statistics.metadata_count
        if missing > 0:
            self._report(offset, f"the file lacks {missing:,} of {count(expected, 'message')}", 0, missing)
        elif found > expected:
            surplus = count(found - expected, "message")
            self._report(offset, f"the file contains {surplus} more than its statistics state", 0)
        elif extras > len(self._found.extras) and not self.damage:
            problem = f"the file lacks {extras - len(self._found.extras)} of {extras} attachments and metadata records"
            self._report(offset, problem, 0)

    def _inspect_chunks(self) -> None:
        """Load chunks that declare channels, unless the summary does, and chunks with unknown times or counts."""
        wanted = self._declared.incomplete(self._first) if self._declares_channels else self._first
        for number in sorted({self._first[channel] for channel in wanted}):
            self._read(replace(self._chunks[number], suspect=True))
        for number, chunk in enumerate(self._chunks):
            if chunk.suspect or not (chunk.messages or self._declares_channels):
                self._inspect(number)
        for chunk in self._chunks:
            if not self._declared.incomplete(self._first):
                return
            self._read(replace(chunk, suspect=True))

    def _inspect(self, number: int) -> None:
        """Determine the times and the number of messages of a chunk from its content."""
        chunk = replace(self._chunks[number], suspect=True)
        messages = self._read(chunk)
        if not chunk.messages:
            self._counts.update(message.channel.id for message in messages)
        times_ns = [message.log_time_ns for message in messages] or [chunk.start_ns, chunk.end_ns]
        start_ns, end_ns = min(times_ns), max(times_ns)
        if not chunk.start_ns <= start_ns <= end_ns <= chunk.end_ns:
            self._report(chunk.offset, "messages of this chunk are outside the times that it states", 0)
        count = max(chunk.messages, len(messages))
        self._chunks[number] = replace(chunk, start_ns=start_ns, end_ns=end_ns, messages=count, suspect=False)

    def _messages(self, chunk: McapChunk, unpacked: Callable[[], Buffer]) -> list[Message]:
        try:
            return self._loaded(chunk, unpacked())
        except BrokenRecordError as error:
            self._report(chunk.offset, f"the chunk {error}", chunk.size, chunk.messages or None)
            if chunk.header is not None and not self._declares_channels:
                # Without a summary, the rest of the log depends on the channels of this chunk.
                records = memoryview(salvage(chunk.header, self._file))
                for op, _, start, end, _ in islice(walk(records, lambda *_: None), _MAX_SALVAGED):
                    self._declared.add(op, records[start:end], chunk.offset, Trust.BROKEN)
        return []

    def _loaded(self, chunk: McapChunk, records: Buffer) -> list[Message]:
        gaps: list[int] = []
        undeclared = Counter[int]()
        most = limits().chunk_messages
        messages = list(islice(self._each_message(chunk, records, gaps, undeclared), most + 1))
        if len(messages) > most:
            lost = max(chunk.messages - most, 0)
            self._report(chunk.offset, f"the chunk has {above('more messages', 'chunk_messages')}", 0, lost or None)
            return messages[:most]
        lost = max(chunk.messages - len(messages) - undeclared.total(), 0)
        if self._is_cut(chunk):
            missing = max(chunk.header.size - len(records), 0) if chunk.header else 0
            self._report(chunk.offset, "the file ends inside this chunk", missing + sum(gaps))
        elif gaps or (lost and not self._is_verified(chunk)):
            self._report(chunk.offset, "damaged records in this chunk", sum(gaps), lost or None)
        elif lost and not chunk.suspect:
            problem = f"the index of this chunk lists {count(lost, 'message')} that it does not contain"
            self._report(chunk.offset, problem, 0)
        if not chunk.suspect:  # all channels and times are known
            for number, lost in undeclared.items():
                self._report(chunk.offset, f"messages of channel {number}, which is not declared", 0, lost)
            if not all(chunk.start_ns <= message.log_time_ns <= chunk.end_ns for message in messages):
                self._report(chunk.offset, "messages of this chunk are outside the times that it states", 0)
        return messages

    def _unpack(self, chunk: McapChunk) -> Buffer:
        if chunk.header is not None:
            return salvage(chunk.header, self._file) if self._is_cut(chunk) else unpack(chunk.header, self._file)
        if chunk.size > limits().chunk_bytes:
            raise BrokenRecordError(f"has {above(count(chunk.size, 'byte'), 'chunk_mib')}")
        return self._file[chunk.offset : chunk.offset + chunk.size]

    def _is_cut(self, chunk: McapChunk) -> bool:
        return chunk.offset + chunk.size > len(self._file)

    def _is_verified(self, chunk: McapChunk) -> bool:
        return chunk.header is not None and chunk.header.crc != 0 and not self._is_cut(chunk)

    def _each_message(
        self, chunk: McapChunk, unpacked: Buffer, gaps: list[int], undeclared: Counter[int]
    ) -> Iterator[Message]:
        """Yield the messages among unpacked records, and add the channels."""
        view = memoryview(unpacked)
        verified = self._is_verified(chunk)
        trust = Trust.CHECKED if verified else Trust.UNCHECKED
        records = split(view, lambda _, __, size: gaps.append(size), trusted=verified or chunk.header is None)
        for op, start, end in records:
            if op == Opcode.MESSAGE and end - start >= MESSAGE.size:
                number, sequence, log_time, publish_time = MESSAGE.unpack_from(view, start)
                if (channel := self._declared.get(number)) is None:
                    undeclared[number] += 1
                else:
                    yield Message(channel, log_time, publish_time, sequence, view[start + MESSAGE.size : end])
            else:
                self._declared.add(op, view[start:end], chunk.offset, trust)


def _simulated_facts(records: Sequence[Metadata]) -> Mapping[str, SensorFacts]:
    """Return the lidar that a log by `simulate` names in its metadata record ``scene``; empty for other logs."""
    for record in records:
        if record.name == "scene":
            with suppress(DocumentError, KeyError, TypeError):
                model = load_json(record.entries["scene"])["recording"]["lidar"]
                if isinstance(model, str) and model in SENSORS:
                    return {"/points": SensorFacts(model, {"origin": "simulated"}, from_packets=False)}
    return MappingProxyType({})
