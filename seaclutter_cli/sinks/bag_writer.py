"""Writer for ROS 1 bags (format 2.0) that compresses chunks in other threads.

The writer of the ``rosbags`` library compresses in the calling thread, and its LZ4 frames have options that the tools
of ROS 1 refuse. The output bytes do not depend on the number of threads.
"""

import struct
from typing import BinaryIO

import lz4.frame

from seaclutter_cli.errors import OutputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages.metadata import METADATA_TOPIC, STRING, to_message
from seaclutter_cli.records import Buffer, Channel, Schema
from seaclutter_cli.sinks.log_output import Chunk, ChunkedWriter, LogFiles

_MAGIC = b"#ROSBAG V2.0\n"
_HEADER_BYTES = 4096
"""Size of the header with padding, without their sizes. ROS 1 writes it anew when it appends or reindexes."""
_MESSAGE, _BAG_HEADER, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = range(2, 8)
_U32, _PAIR = struct.Struct("<I"), struct.Struct("<II")
_NANO = 10**9
_STRING_MD5 = "992ce8a1687cec8c8bd883ec73ca41d1"
_LZ4 = {"block_linked": False, "content_checksum": True, "store_size": False}
"""Options that ROS 1 requires."""


class BagOutput(LogFiles):
    """ROS 1 bags."""

    encoding = "ros1"

    @staticmethod
    def start(stream: BinaryIO, source: Source, compression: str | None) -> "BagWriter":
        """Return the writer of a bag."""
        if compression is None:
            compression = "" if source.compression == "" else "lz4"
        return BagWriter(stream, compression=compression)


class BagWriter(ChunkedWriter):
    """Writer for one ROS 1 bag, whose header is written again at the end; ``compression`` is ``lz4`` or empty."""

    chunk_size = 768 * 2**10
    """As in the recorder of ROS 1."""

    def __init__(self, stream: BinaryIO, *, compression: str) -> None:
        super().__init__(stream)
        self._compression = compression
        self._connections: dict[int, bytes] = {}
        self._numbers: dict[int, int] = {}
        self._undeclared: set[int] = set()
        self._infos = bytearray()
        self._chunks = 0
        self.write_bytes(_MAGIC, self._header(0))

    def add_channel(self, channel: Channel) -> None:
        """Declare a channel, before its first message.

        Connections are numbered from 0: tools of ROS 1 that append to a bag give the next one their number.
        """
        assert channel.schema is not None  # noqa: S101 - translated channels have one
        topic = channel.topic or "/"  # readers refuse an empty name
        known = {"md5sum": "*", "type": channel.schema.name, **dict(channel.metadata), "topic": topic}
        fields = {name: value.encode() for name, value in known.items()}
        definition = channel.schema.data.decode("utf-8", "replace") or "\n"  # readers refuse other bytes
        data = _fields(**{**fields, "message_definition": definition.encode()})
        number = self._numbers.setdefault(channel.id, len(self._numbers))
        head = _fields(op=bytes((_CONNECTION,)), conn=_U32.pack(number), topic=topic.encode())
        self._connections[channel.id] = head + data
        self.channels[channel.id] = channel
        self._undeclared.add(channel.id)

    def put(self, channel: int, times_ns: tuple[int, int], sequence: int, data: Buffer) -> None:  # noqa: ARG002
        """Write a message of a declared channel; `OutputError` if its time does not fit into a bag."""
        if channel in self._undeclared:
            self._chunk.data += self._connections[channel]
            self._undeclared.remove(channel)
        number = self._numbers[channel]
        if not 0 <= times_ns[0] // _NANO < 2**32:
            where = f"message {self.counts[channel]} on {self.channels[channel].topic}"
            raise OutputError(f"{where}: a ROS 1 bag cannot contain its log time, {times_ns[0]} ns; write MCAP instead")
        head = _fields(op=bytes((_MESSAGE,)), conn=_U32.pack(number), time=_time(times_ns[0]))
        self.add(number, times_ns[0], head, _U32.pack(len(data)), data)

    def finish(self) -> None:
        """Write the metadata records as a message, pending chunks, the index, and the header."""
        if self.metadata:
            number = max(self._connections, default=0) + 1
            schema = Schema(STRING, "ros1msg", b"string data\n")
            header = (("latching", "1"), ("md5sum", _STRING_MD5))
            self.add_channel(Channel(number, METADATA_TOPIC, "ros1", schema, header))
            self.put(number, (self.end_ns, 0), 0, to_message(self.metadata))
        self.finish_chunks()
        index = self._offset
        self.write_bytes(*self._connections.values(), self._infos)
        self._stream.seek(len(_MAGIC))
        self.write_bytes(self._header(index))

    def _header(self, index: int) -> bytes:
        head = _fields(
            op=bytes((_BAG_HEADER,)),
            index_pos=struct.pack("<Q", index),
            conn_count=_U32.pack(len(self._connections)),
            chunk_count=_U32.pack(self._chunks),
        )
        padding = _HEADER_BYTES - (len(head) - _U32.size)
        return head + _U32.pack(padding) + b" " * padding

    def compress(self, chunk: Chunk) -> Buffer | bytearray:
        """Return the compressed data of a chunk."""
        return lz4.frame.compress(chunk.data, **_LZ4) if self._compression else chunk.data

    def write_chunk(self, chunk: Chunk, data: Buffer | bytearray) -> None:
        """Write a chunk and its index, and keep the record about it for the end."""
        counts = {conn: len(entries) // 2 for conn, entries in chunk.index.items()}
        self._infos += _fields(
            op=bytes((_CHUNK_INFO,)),
            ver=_U32.pack(1),
            chunk_pos=struct.pack("<Q", self._offset),
            start_time=_time(chunk.start_ns),
            end_time=_time(chunk.end_ns),
            count=_U32.pack(len(counts)),
        )
        self._infos += _sized(b"".join(_PAIR.pack(*pair) for pair in counts.items()))
        self._chunks += 1
        name = self._compression or "none"
        head = _fields(op=bytes((_CHUNK,)), compression=name.encode(), size=_U32.pack(len(chunk.data)))
        self.write_bytes(head, _U32.pack(len(data)), data)
        for conn, entries in chunk.index.items():
            ids = {"conn": _U32.pack(conn), "count": _U32.pack(counts[conn])}
            pairs = zip(entries[::2], entries[1::2], strict=True)
            index = b"".join(_time(time_ns) + _U32.pack(offset) for time_ns, offset in pairs)
            self.write_bytes(_fields(op=bytes((_INDEX,)), ver=_U32.pack(1), **ids), _sized(index))


def _fields(**fields: bytes) -> bytes:
    """Return the fields of a header, preceded by their size."""
    return _sized(b"".join(_sized(name.encode() + b"=" + value) for name, value in fields.items()))


def _sized(data: Buffer | bytearray) -> bytes:
    return _U32.pack(len(data)) + data


def _time(time_ns: int) -> bytes:
    return _PAIR.pack(*divmod(time_ns, _NANO))
