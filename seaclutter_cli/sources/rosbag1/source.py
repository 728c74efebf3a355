"""ROS 1 bags (format 2.0): intact, unindexed, truncated or damaged."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain
from struct import Struct

from seaclutter_cli.errors import InputError
from seaclutter_cli.limits import CHANNEL_BYTES, above, above_in_file, limits
from seaclutter_cli.messages.metadata import from_text, is_carrier
from seaclutter_cli.records import Bytes, Channel, Message, Schema
from seaclutter_cli.sources.rosbag1.records import MAGIC, NANO, BagRecord, Op, parse_fields, read_record, walk
from seaclutter_cli.sources.shared.chunked import MAX_AHEAD_BYTES, Chunk, ChunkedSource
from seaclutter_cli.sources.shared.unpacking import readable
from seaclutter_cli.text import count

_COMPRESSIONS = {b"lz4": "lz4", b"bz2": "zstd", b"none": ""}
_COUNT, _ENTRY = Struct("<II"), Struct("<II4x")
_RUN_BYTES = 4 * 2**20
_ANY_TIME = (0, 2**63)

Content = tuple[memoryview, int, str | None]
"""Records of a chunk, their expected size, and a description of their damage, if any."""

Index = tuple[int, int, Counter[int]]
"""Times of the first and last message of a chunk, and the number of messages per connection."""


class BagSource(ChunkedSource[Chunk, Content]):
    """A ROS 1 bag, or the ``.bag.active`` file that a crashed recorder leaves.

    Messages are views of their chunk, or of the file if it is not compressed. Those outside chunks, which remain of a
    chunk with a destroyed header, are combined into runs that are read like a chunk. `InputError` if the file is not a
    bag of format 2.0, or is encrypted.
    """

    format = "ROS 1 bag"
    profile = "ros1"

    def _open(self) -> None:
        self.name = self._path.name.removesuffix(".active").removesuffix(".bag")
        self._declared_bytes = 0
        start = bytes(self._file[: len(MAGIC)])
        if start != MAGIC:
            raise InputError(f"{self._path}: {_describe(start)}")
        self._header: BagRecord | None = None
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._found: list[tuple[Chunk, Index | None]] = []
        """Chunks and what their own index says, None if it is missing or damaged."""
        self._infos: dict[int, Index] = {}
        """What the end of the bag says about the chunks at some offsets."""
        self._seen: Counter[Op] = Counter()
        self._look_at_records()
        if self._header is not None and self._header.fields.get(b"encryptor"):
            raise InputError(f"{self._path}: the bag is encrypted; decrypt it first (rosbag decrypt)")
        self._place_chunks()
        self._read_metadata()

    def _look_at_records(self) -> None:
        """Find channels, chunks and damage in one pass without unpacking a chunk."""
        compression: bytes | None = None
        gaps: list[tuple[int, int]] = []
        runs: list[tuple[int, int]] = []
        for record in walk(self._file, len(MAGIC), gaps):
            self._seen[record.op] += 1
            match record.op:
                case Op.MESSAGE:
                    start, end = runs[-1] if runs else (0, 0)
                    if end == record.start and end - start <= _RUN_BYTES:
                        runs[-1] = (start, record.end)
                    else:
                        runs.append((record.start, record.end))
                case Op.BAG_HEADER:
                    self._header = self._header or record
                case Op.CHUNK:
                    compression = compression or record.fields[b"compression"]
                    self._take_chunk(record)
                case Op.CHUNK_INFO:
                    self._take_info(record)
                case Op.CONNECTION:
                    self._channels.setdefault(record.number(b"conn"), _channel_of(self._file, record))
        self.compression = _COMPRESSIONS.get(compression) if compression else None
        if compression in {None, b"none"}:
            self._found += [(Chunk(start, end - start, *_ANY_TIME), None) for start, end in runs]
        else:  # what looks like messages are parts of damaged data
            gaps, runs = gaps + runs, []
        self._report_gaps(gaps, counted=bool(runs))
        self._check_index()

    def _report_gaps(self, gaps: list[tuple[int, int]], *, counted: bool) -> None:
        """Report skipped parts, with the messages of lost chunks unless they are ``counted`` among those outside."""
        for start, end in _joined(gaps):
            lost = 0 if counted else sum(info[2].total() for at, info in self._infos.items() if start <= at < end)
            problem = f"damaged; reading resumes at byte {end}"
            if start == end:
                problem = "a record of wrong length"
            elif end == len(self._file):
                problem = "damaged or truncated; nothing readable follows"
            self._report(start, problem, end - start, lost or None)

    def _check_index(self) -> None:
        """Report a missing or incomplete index at the end; ``_listed`` is the number of messages in a complete one."""
        self._listed: int | None = None
        if self._header is None:
            if not self.damage:
                self._report(len(MAGIC), "the bag is truncated before its first record", 0)
            return
        missing = self._header.number(b"index_pos") - len(self._file)
        if missing == -len(self._file):
            self._report(None, "the recorder did not close the bag; it is read without its index", 0)
        expected = self._header.number(b"conn_count"), self._header.number(b"chunk_count")
        if self._seen[Op.CONNECTION] >= expected[0] and self._seen[Op.CHUNK_INFO] >= expected[1]:
            self._listed = sum(counts.total() for *_, counts in self._infos.values()) if self._infos else None
        elif missing > -len(self._file):
            problem = "the index at the end of the bag is incomplete; the bag is read without it"
            if missing > 0:
                problem = f"the bag is truncated by at least {count(missing, 'byte')}; it is read without its index"
            self._report(len(self._file) + min(missing, 0), problem, 0)

    def _take_chunk(self, record: BagRecord) -> None:
        unpacked = min(record.number(b"size"), limits().bytes_of("chunk", len(self._file)))
        chunk = Chunk(record.start, record.end - record.start, *_ANY_TIME, unpacked=unpacked)
        self._found.append((chunk, None if record.repaired else read_index(self._file, record.end)))

    def _take_info(self, record: BagRecord) -> None:
        entries = self._file[record.data : record.end]
        counts: Counter[int] = Counter()
        for connection, messages in _COUNT.iter_unpack(entries[: len(entries) // _COUNT.size * _COUNT.size]):
            counts[connection] += messages
        times_ns = record.time_ns(b"start_time"), record.time_ns(b"end_time")
        self._infos[record.number(b"chunk_pos")] = (*times_ns, counts)

    def _place_chunks(self) -> None:
        """Give chunks the times of their index, or of their messages if they have none, or two that differ."""
        first: dict[int, Chunk] = {}
        untimed = []
        for chunk, own in self._found:
            info = self._infos.get(chunk.offset)
            index = own or (info if info and info[2] else None)
            if index is None or (info and info[:2] != index[:2]):
                untimed.append(chunk)
                continue
            start_ns, end_ns, counts = index
            self._chunks.append(replace(chunk, start_ns=start_ns, end_ns=end_ns, messages=counts.total()))
            self._counts += counts
            first = dict.fromkeys(counts, self._chunks[-1]) | first
        for connection, chunk in first.items():
            if connection not in self._channels:
                self._read(chunk)
        for chunk in untimed:
            if messages := self._read(chunk):
                times, size = [message.log_time_ns for message in messages], len(messages)
                self._chunks.append(replace(chunk, start_ns=min(times), end_ns=max(times), messages=size))
                self._counts.update(message.channel.id for message in messages)

    def _read_metadata(self) -> None:
        """Take the records that this program writes to a bag as a message, whose channels are then hidden."""
        carriers = {number for number, channel in self._channels.items() if is_carrier(channel)}
        messages = self.latest(carriers, _ANY_TIME[1]) if carriers else []
        found = [from_text(bytes(message.data[4:])) for message in messages]
        if found and all(found):
            self._hidden = carriers
            self.metadata = [record for records in found for record in records]

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels known before reading, including those without messages."""
        return [channel for number, channel in self._channels.items() if number not in self._hidden]

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id."""
        return {channel: self._counts[channel] for channel in self._channels if channel not in self._hidden}

    def _check_number(self, found: int) -> None:
        known = sum(damage.lost_messages or 0 for damage in self.damage)
        if self._listed is not None and self._listed > found + known:
            problem = f"the index lists {count(self._listed, 'message')}, but {found:,} can be read"
            self._report(None, problem, 0, self._listed - found - known)

    def _indexed(self, chunk: Chunk) -> Counter[int] | None:
        index = read_index(self._file, chunk.offset + chunk.size)
        return index[2] if index else None

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
        end = chunk.offset + chunk.size
        record = read_record(self._file, chunk.offset)
        is_chunk = record is not None and record.op == Op.CHUNK and record.data <= end
        start = record.data if record and is_chunk else chunk.offset
        if end - start > limits().chunk_bytes:
            return memoryview(b""), end - start, f"a chunk of {above(count(end - start, 'byte'), 'chunk_mib')}"
        data = self._file[start:end]
        if record is None or not is_chunk:
            return data, chunk.size, None
        whole = record._replace(end=end, repaired=record.end != end)
        content, problem = _unpacked(data, whole, ends_bag=end == len(self._file), bag_bytes=len(self._file))
        return content, record.number(b"size"), problem

    def _parse(self, content: memoryview, gaps: list[tuple[int, int]]) -> tuple[list[Message], int]:
        """Return the messages of a chunk, at most one above the limit, and the number of unknown messages."""
        messages: list[Message] = []
        most = limits().chunk_messages
        unknown = 0
        for record in walk(content, 0, gaps):
            if record.op == Op.MESSAGE:
                if (channel := self._channels.get(record.number(b"conn"))) is None:
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
                    self._channels[record.number(b"conn")] = _channel_of(content, record)
        return messages, unknown


def _describe(start: bytes) -> str:
    if MAGIC.startswith(start):
        return "the bag is truncated in its first line"
    if start.startswith(b"#ROSBAG V"):
        version = start[9:].partition(b"\n")[0].strip().decode("utf-8", "replace")
        return f"bag version {version} is not supported; convert the bag to 2.0 first (rosbag reindex)"
    return "not a ROS 1 bag"


def read_index(view: Bytes, at: int) -> Index | None:
    """Return the index from the index records at an offset; None if they are missing or damaged."""
    counts: Counter[int] = Counter()
    first, last = (2**32, 0), (0, 0)
    while (record := read_record(view, at)) is not None and record.op == Op.INDEX:
        entries = view[record.data : record.end]
        count = record.number(b"count")
        if len(entries) != 12 * count:
            return None
        if count:
            first = min(chain([first], _ENTRY.iter_unpack(entries)))
            last = max(chain([last], _ENTRY.iter_unpack(entries)))
            counts[record.number(b"conn")] += count
        at = record.end
    return (first[0] * NANO + first[1], last[0] * NANO + last[1], counts) if counts else None


def _unpacked(packed: memoryview, chunk: BagRecord, *, ends_bag: bool, bag_bytes: int) -> tuple[memoryview, str | None]:
    """Return the readable content of a chunk's data, and a description of its damage; None if it is intact."""
    size, limit = chunk.number(b"size"), limits().bytes_of("chunk", bag_bytes)
    most = min(limit, max(size, MAX_AHEAD_BYTES))
    compression = chunk.fields[b"compression"]
    if compression == b"none":
        content, whole = packed[:size] if chunk.repaired else packed, True
    elif compression in (b"bz2", b"lz4"):
        unpacked, whole = readable(compression.decode(), packed, most)
        content = memoryview(unpacked)
    else:
        return memoryview(b""), f"a chunk with the unknown compression {compression.decode('utf-8', 'replace')!r}"
    if len(content) > limit or (len(content) == limit and not whole):
        large = above_in_file(count(max(size, len(content)), "byte"), "chunk", bag_bytes)
        return memoryview(b""), f"a chunk of {large}"
    if not whole or len(content) != size:
        if chunk.repaired and ends_bag:
            return content, "the bag ends inside a chunk"
        return content, f"a damaged chunk: {len(content):,} of {count(size, 'byte')} can be read"
    return content, "a record of wrong length, or damage after it" if chunk.repaired else None


def _channel_of(view: Bytes, record: BagRecord) -> Channel:
    entries = parse_fields(bytes(view[record.data : record.end])) or {}
    definition = entries.pop(b"message_definition", b"")
    text = {name.decode("utf-8", "replace"): value.decode("utf-8", "replace") for name, value in entries.items()}
    schema = Schema(text["type"], "ros1msg", definition) if "type" in text else None
    topic = record.fields[b"topic"].decode("utf-8", "replace")
    return Channel(record.number(b"conn"), topic, "ros1", schema, tuple(sorted(text.items())))


def _joined(gaps: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return gaps in order, with adjacent ones merged."""
    joined: list[tuple[int, int]] = []
    for start, end in sorted(gaps):
        touches = joined and joined[-1][1] == start
        joined.append((joined.pop()[0] if touches else start, end))
    return joined
