"""Writer for MCAP files that compresses chunks in other threads.

The writer of the ``mcap`` library compresses in the calling thread, which takes longer than the rest of a filter run.
The output bytes do not depend on the number of threads.
"""

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from threading import local
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap import records as mcap_records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from seaclutter_cli import __version__
from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Attachment, Buffer, Channel, Metadata, Schema
from seaclutter_cli.sinks.log_output import Chunk, ChunkedWriter, LogFiles, LogWriter

_MAGIC = b"\x89MCAP0\r\n"
_MESSAGE = struct.Struct("<BQHIQQ")
_thread = local()


def _zstd(data: bytearray) -> bytes:
    if not hasattr(_thread, "zstd"):
        _thread.zstd = zstandard.ZstdCompressor()
    try:
        return bytes(_thread.zstd.compress(data))
    except zstandard.ZstdError as error:  # nothing else can fail
        raise MemoryError(str(error)) from error


COMPRESSIONS: dict[str, Callable[[bytearray], Buffer | bytearray]] = {
    "zstd": _zstd,
    "lz4": lz4.frame.compress,
    "": lambda data: data,
}


class McapOutput(LogFiles):
    """MCAP files, which keep everything."""

    @staticmethod
    def start(stream: BinaryIO, source: Source, compression: str | None) -> LogWriter:
        """Return the writer of a file."""
        return McapWriter(stream, profile=source.profile, compression=mcap_compression(source, compression))


def mcap_compression(source: Source, given: str | None) -> str:
    """Return the compression of an MCAP file: the one that was asked for, that of the input, or zstd."""
    return given if given is not None else "zstd" if source.compression is None else source.compression


class McapWriter(ChunkedWriter):
    """Writer for one MCAP file, which is written sequentially; the compression is a key of `COMPRESSIONS`."""

    chunk_size = 1 << 20
    """As in other writers."""

    def __init__(self, stream: BinaryIO, *, profile: str, compression: str = "zstd") -> None:
        super().__init__(stream)
        self._compression = compression
        self._schemas: dict[Schema, int] = {}
        self._summary = {opcode: bytearray() for opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS)}
        self._kept: Counter[Opcode] = Counter()
        self.write_bytes(_MAGIC)
        self.write_bytes(_serialise(mcap_records.Header(profile=profile, library=f"seaclutter {__version__}")))

    def add_channel(self, channel: Channel) -> None:
        """Declare a channel under its own id, before its first message."""
        self.drain()  # so that the place of the record does not depend on the number of threads
        schema = channel.schema
        if schema is not None and schema not in self._schemas:
            self._schemas[schema] = number = len(self._schemas) + 1
            record = mcap_records.Schema(id=number, name=schema.name, encoding=schema.encoding, data=schema.data)
            self.write_bytes(self._keep(Opcode.SCHEMA, record))
        self.channels[channel.id] = channel
        declared = mcap_records.Channel(
            id=channel.id,
            topic=channel.topic,
            message_encoding=channel.message_encoding,
            metadata=dict(channel.metadata),
            schema_id=self._schemas[schema] if schema else 0,
        )
        self.write_bytes(self._keep(Opcode.CHANNEL, declared))

    @property
    def lost(self) -> Sequence[str]:
        """Nothing."""
        return ()

    def put(self, channel: int, times_ns: tuple[int, int], sequence: int, data: Buffer) -> None:
        """Write a message of a declared channel with its log time and its publish time."""
        size = len(data) + _MESSAGE.size - 9
        self.add(channel, times_ns[0], _MESSAGE.pack(Opcode.MESSAGE, size, channel, sequence, *times_ns), data)

    def attach(self, attachment: Attachment) -> None:
        """Write an attachment without copying its data."""
        self.drain()
        head = struct.pack("<QQ", attachment.log_time_ns, attachment.create_time_ns)
        head += _prefixed(attachment.name) + _prefixed(attachment.media_type)
        head += struct.pack("<Q", len(attachment.data))
        crc = zlib.crc32(head)
        offset, size = self._offset, len(head) + len(attachment.data) + 4
        self.write_bytes(struct.pack("<BQ", Opcode.ATTACHMENT, size), head)
        for piece in attachment.pieces():
            crc = zlib.crc32(piece, crc)
            self.write_bytes(piece)
        self.write_bytes(struct.pack("<I", crc))
        entry = mcap_records.AttachmentIndex(
            offset=offset,
            length=self._offset - offset,
            log_time=attachment.log_time_ns,
            create_time=attachment.create_time_ns,
            data_size=len(attachment.data),
            name=attachment.name,
            media_type=attachment.media_type,
        )
        self._keep(Opcode.ATTACHMENT_INDEX, entry)

    def add_metadata(self, metadata: Metadata) -> None:
        """Write a metadata record."""
        super().add_metadata(metadata)
        self.drain()
        offset = self._offset
        self.write_bytes(_serialise(mcap_records.Metadata(name=metadata.name, metadata=metadata.entries)))
        entry = mcap_records.MetadataIndex(offset=offset, length=self._offset - offset, name=metadata.name)
        self._keep(Opcode.METADATA_INDEX, entry)

    def finish(self) -> None:
        """Write pending chunks, the summary and the footer."""
        self.finish_chunks()
        self.write_bytes(_serialise(mcap_records.DataEnd(data_section_crc=0)))
        self._write_summary()
        self.write_bytes(_MAGIC)

    def compress(self, chunk: Chunk) -> Buffer | bytearray:
        """Return the compressed data of a chunk; set its checksum."""
        chunk.crc = zlib.crc32(chunk.data)
        return COMPRESSIONS[self._compression](chunk.data)

    def write_chunk(self, chunk: Chunk, data: Buffer | bytearray) -> None:
        """Write a chunk and its message indexes, and keep the index of the chunk for the end."""
        offset = self._offset
        head = struct.pack("<QQQI", chunk.start_ns, chunk.end_ns, len(chunk.data), chunk.crc)
        head += _prefixed(self._compression) + struct.pack("<Q", len(data))
        self.write_bytes(struct.pack("<BQ", Opcode.CHUNK, len(head) + len(data)), head, data)
        length = self._offset - offset
        index_offsets: dict[int, int] = {}
        for channel, entries in chunk.index.items():
            index_offsets[channel] = self._offset
            array = struct.pack(f"<{len(entries)}Q", *entries)
            self.write_bytes(struct.pack("<BQHI", Opcode.MESSAGE_INDEX, len(array) + 6, channel, len(array)), array)
        entry = mcap_records.ChunkIndex(
            chunk_length=length,
            chunk_start_offset=offset,
            compression=self._compression,
            compressed_size=len(data),
            message_end_time=chunk.end_ns,
            message_index_length=self._offset - offset - length,
            message_index_offsets=index_offsets,
            message_start_time=chunk.start_ns,
            uncompressed_size=len(chunk.data),
        )
        self._keep(Opcode.CHUNK_INDEX, entry)

    def _keep(self, opcode: Opcode, record: mcap_records.McapRecord) -> bytes:
        """Store a record for the summary, serialised to save memory, and return its bytes."""
        data = _serialise(record)
        self._summary.setdefault(opcode, bytearray()).extend(data)
        self._kept[opcode] += 1
        return data

    def _write_summary(self) -> None:
        """Write schemas, channels, statistics and indexes, the offsets of these groups, and the footer."""
        self._keep(Opcode.STATISTICS, self._statistics())
        start, crc, offsets = self._offset, 0, []
        for opcode, data in self._summary.items():
            if data:
                offsets.append((opcode, self._offset, len(data)))
                crc = zlib.crc32(data, crc)
                self.write_bytes(data)
        offset_start = self._offset
        groups = _serialise(*(mcap_records.SummaryOffset(*offset) for offset in offsets))
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start)
        crc = zlib.crc32(footer, zlib.crc32(groups, crc))
        self.write_bytes(groups, footer, struct.pack("<I", crc))

    def _statistics(self) -> mcap_records.Statistics:
        return mcap_records.Statistics(
            attachment_count=self._kept[Opcode.ATTACHMENT_INDEX],
            channel_count=len(self.channels),
            channel_message_counts=dict(self.counts),
            chunk_count=self._kept[Opcode.CHUNK_INDEX],
            message_count=self.messages,
            message_end_time=self.end_ns,
            message_start_time=self.start_ns if self.messages else 0,
            metadata_count=self._kept[Opcode.METADATA_INDEX],
            schema_count=len(self._schemas),
        )


def _serialise(*records: mcap_records.McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _prefixed(text: str) -> bytes:
    raw = text.encode()
    return struct.pack("<I", len(raw)) + raw
