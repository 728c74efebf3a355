"""ROS 1 bags (format 2.0): intact, unindexed, truncated or damaged."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from seaclutter_cli.errors import InputError
from seaclutter_cli.limits import CHANNEL_BYTES, above, limits
from seaclutter_cli.messages.metadata import from_message, is_carrier
from seaclutter_cli.records import Channel, Message, Metadata, Record
from seaclutter_cli.sources.rosbag1.contents import ANY_TIME, BagContents, channel_of, read_index, unpack
from seaclutter_cli.sources.rosbag1.records import MAGIC, Op, read_record, walk
from seaclutter_cli.sources.shared.chunked import Chunk, ChunkedSource
from seaclutter_cli.text import count

_COMPRESSIONS = {b"lz4": "lz4", b"bz2": "zstd", b"none": ""}

Content = tuple[memoryview, int, str | None]


class BagSource(ChunkedSource[Chunk, Content]):
    """A ROS 1 bag, or the ``.bag.active`` file that a crashed recorder leaves.

    Messages are views of their chunk, or of the file if it is not compressed. `InputError` if the file is not a bag of
    format 2.0, or is encrypted.
    """

    format = "ROS 1 bag"
    profile = "ros1"

    def _open(self) -> None:
        self.name = self._path.name.removesuffix(".active").removesuffix(".bag")
        self._declared_bytes = 0
        start = bytes(self._file[: len(MAGIC)])
        if start != MAGIC:
            raise InputError(f"{self._path}: {_describe(start)}")
        found = BagContents(self._file)
        if found.header is not None and found.header.fields.get(b"encryptor"):
            raise InputError(f"{self._path}: the bag is encrypted; decrypt it first (rosbag decrypt)")
        self.compression = _COMPRESSIONS.get(found.compression) if found.compression else None
        self.damage += found.damage(self._path)
        self._channels = found.channels
        self._counts = found.counts
        self._listed = found.indexed
        self._chunks = list(found.chunks.values())
        self._unpack_untimed(found)
        self.metadata = self._read_metadata()

    def _read_metadata(self) -> Sequence[Metadata]:
        """Return the records that this program writes to a bag as a message, whose channels are then hidden."""
        self._hidden: set[int] = set()
        carriers = {number for number, channel in self._channels.items() if is_carrier(channel)}
        found = [from_message(message.data) for message in self.latest(carriers, ANY_TIME[1])] if carriers else []
        if not all(found):
            return ()
        self._hidden = carriers
        return [record for records in found for record in records]

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels known before reading, including those without messages."""
        return [channel for number, channel in self._channels.items() if number not in self._hidden]

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id."""
        return {channel: self._counts[channel] for channel in self._channels if channel not in self._hidden}

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield metadata, then the messages in log time order; can be called again.

        Chunks outside ``[start_ns, end_ns)`` are left out.
        """
        yield from self.metadata
        read = 0
        messages, is_all = self._in_time_order(start_ns, end_ns)
        for message in messages:
            read += 1
            if message.channel.id not in self._hidden:
                yield message
        known = sum(damage.lost_messages or 0 for damage in self.damage)
        if is_all and self._listed is not None and self._listed > read + known:
            problem = f"the index lists {count(self._listed, 'message')}, but {read:,} can be read"
            self._report(None, problem, 0, self._listed - read - known)

    def _indexed(self, chunk: Chunk) -> Counter[int] | None:
        index = read_index(self._file, chunk.offset + chunk.size)
        return index.counts if index else None

    def _unpack_untimed(self, found: BagContents) -> None:
        """Unpack the chunks where unknown channels first occur, and those with unknown times."""
        for connection, offset in found.first_use.items():
            if connection not in self._channels and offset in found.chunks:
                self._read(found.chunks[offset])
        for chunk in found.untimed.values():
            messages = self._read(chunk)
            if messages:
                times, size = [message.log_time_ns for message in messages], len(messages)
                self._chunks.append(replace(chunk, start_ns=min(times), end_ns=max(times), messages=size))
                self._counts.update(message.channel.id for message in messages)

    def _messages(self, chunk: Chunk, unpacked: Callable[[], Content]) -> list[Message]:
        content, size, problem = unpacked()
        gaps: list[tuple[int, int]] = []
        messages, unknown = self._parse(content, gaps)
        most = limits().chunk_messages
        if len(messages) > most:
            del messages[most:]
            problem = f"a chunk of {above('more messages', 'chunk_messages')}"
        elif problem is None and gaps:
            problem = "damaged records in this chunk"
        elif problem is None and unknown:
            problem = "messages of an unknown connection"
        if problem is not None:
            indexed = self._indexed(chunk)
            lost_bytes = max(size - len(content), 0) + sum(stop - start for start, stop in gaps)
            lost = indexed.total() - len(messages) if indexed is not None else unknown
            self._report(chunk.offset, problem, lost_bytes, lost if lost > 0 else None)
        elif any(not chunk.start_ns <= message.log_time_ns <= chunk.end_ns for message in messages):
            self._report(chunk.offset, "messages of this chunk are outside the times in its index", 0, None)
        return messages

    def _unpack(self, chunk: Chunk) -> Content:
        """Return the records of a chunk, their expected size, and a description of their damage, if any."""
        end = chunk.offset + chunk.size
        record = read_record(self._file, chunk.offset)
        if record is None or record.op != Op.CHUNK or record.data > end:
            start, op = chunk.offset, None
        else:
            start, op = record.data, record
        if end - start > limits().chunk_bytes:
            return memoryview(b""), end - start, f"a chunk of {above(count(end - start, 'byte'), 'chunk_mib')}"
        data = self._file[start:end]
        if op is None:
            return data, chunk.size, None
        whole = op._replace(end=end, repaired=op.end != end)
        content, problem = unpack(data, whole, ends_bag=end == len(self._file), bag_bytes=len(self._file))
        return content, op.number(b"size"), problem

    def _parse(self, content: memoryview, gaps: list[tuple[int, int]]) -> tuple[list[Message], int]:
        """Return the messages of a chunk, at most one above the limit, and the number of unknown messages."""
        messages: list[Message] = []
        most = limits().chunk_messages
        unknown = 0
        for record in walk(content, 0, gaps):
            if record.op == Op.MESSAGE:
                channel = self._channels.get(record.number(b"conn"))
                if channel is None:
                    unknown += 1
                    continue
                time_ns = record.time_ns()
                messages.append(Message(channel, time_ns, time_ns, 0, content[record.data : record.end]))
                if len(messages) > most:
                    break
            elif record.op == Op.CONNECTION and record.number(b"conn") not in self._channels:
                self._declared_bytes += record.end - record.data + CHANNEL_BYTES
                if self._declared_bytes > limits().message_bytes:
                    gaps.append((record.start, record.end))
                else:
                    self._channels[record.number(b"conn")] = channel_of(content, record)
        return messages, unknown


def _describe(start: bytes) -> str:
    if MAGIC.startswith(start):
        return "the bag is truncated in its first line"
    if start.startswith(b"#ROSBAG V"):
        version = start[9:].partition(b"\n")[0].strip().decode("utf-8", "replace")
        return f"bag version {version} is not supported; convert the bag to 2.0 first (rosbag reindex)"
    return "not a ROS 1 bag"
