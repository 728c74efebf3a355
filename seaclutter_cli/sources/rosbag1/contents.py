"""Content of a ROS 1 bag, intact or damaged: its chunks and channels, found in one pass without unpacking a chunk."""

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from struct import Struct

from seaclutter_cli.limits import above_in_file, limits
from seaclutter_cli.records import Buffer, Channel, Damage, Schema
from seaclutter_cli.sources.rosbag1.records import MAGIC, NANO, BagRecord, Op, parse_fields, read_record, walk
from seaclutter_cli.sources.shared.chunked import MAX_AHEAD_BYTES, Chunk
from seaclutter_cli.sources.shared.log_file import Bytes
from seaclutter_cli.sources.shared.unpacking import DECOMPRESSION_ERRORS, readable, unpacked_frame
from seaclutter_cli.text import count

_COUNT, _ENTRY = Struct("<II"), Struct("<II4x")
_MAX_RATIO = 256
_RUN_BYTES = 4 * 2**20
ANY_TIME = (0, 2**63)


@dataclass(frozen=True, slots=True)
class ChunkIndex:
    """Times of the first and last message of a chunk, and the number of messages per connection."""

    start_ns: int
    end_ns: int
    counts: Counter[int]


def read_index(view: Bytes[Buffer], at: int) -> ChunkIndex | None:
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
    if not counts:
        return None
    return ChunkIndex(first[0] * NANO + first[1], last[0] * NANO + last[1], counts)


def unpack(packed: memoryview, chunk: BagRecord, *, ends_bag: bool, bag_bytes: int) -> tuple[memoryview, str | None]:
    """Return the readable content of a chunk's data, and a description of its damage; None if it is intact.

    The limit of a chunk depends on the size of the bag; ``ends_bag`` if the bag ends where the chunk ends.
    """
    size, limit = chunk.number(b"size"), limits().chunk_bytes_of(bag_bytes)
    most = min(limit, max(size, MAX_AHEAD_BYTES))
    compression = chunk.fields[b"compression"]
    if compression == b"none":
        content, whole = packed[:size] if chunk.repaired else packed, True
    elif compression in (b"bz2", b"lz4"):
        unpacked, whole = _decompress(compression.decode(), packed, size, most)
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


def _decompress(compression: str, packed: memoryview, size: int, most: int) -> tuple[Buffer, bool]:
    """Return the data that can be decompressed, and whether it is complete."""
    with suppress(*DECOMPRESSION_ERRORS):
        # One byte more than expected reveals the end; limited by the packed size because it is allocated.
        expected = min(size, _MAX_RATIO * len(packed), most)
        content, whole = unpacked_frame(compression, packed, expected)
        if whole:
            return content, True
    return readable(compression, packed, most)


def channel_of(view: Bytes[Buffer], record: BagRecord) -> Channel:
    """Return the channel that a connection record describes."""
    entries = parse_fields(bytes(view[record.data : record.end])) or {}
    definition = entries.pop(b"message_definition", b"")
    text = {name.decode("utf-8", "replace"): value.decode("utf-8", "replace") for name, value in entries.items()}
    schema = Schema(text["type"], "ros1msg", definition) if "type" in text else None
    topic = record.fields[b"topic"].decode("utf-8", "replace")
    return Channel(record.number(b"conn"), topic, "ros1", schema, tuple(sorted(text.items())))


class BagContents:
    """Chunks, channels and counts of a bag.

    Messages outside chunks, which remain of a chunk with a destroyed header, are combined into runs that are read like
    a chunk. Chunks have their offsets as keys; ``untimed`` ones must be unpacked for times and counts. ``first_use``
    has the offset of a chunk with messages of each connection, ``counts`` the messages per connection without those of
    untimed chunks, and ``indexed`` their number in the index at the end of the bag, unless it is missing or incomplete.
    """

    def __init__(self, view: Bytes[Buffer]) -> None:
        self.header: BagRecord | None = None
        self.compression: bytes | None = None
        self.channels: dict[int, Channel] = {}
        self.chunks: dict[int, Chunk] = {}
        self.untimed: dict[int, Chunk] = {}
        self.first_use: dict[int, int] = {}
        self.counts: Counter[int] = Counter()
        self.indexed: int | None = None
        self._view = view
        self._gaps: list[tuple[int, int]] = []
        self._seen: Counter[Op] = Counter()
        self._infos: dict[int, int] = {}
        self._runs: list[tuple[int, int]] = []
        for record in walk(view, len(MAGIC), self._gaps):
            self._seen[record.op] += 1
            match record.op:
                case Op.MESSAGE:
                    self._take_message(record)
                case Op.BAG_HEADER:
                    self.header = self.header or record
                case Op.CHUNK:
                    self._take_chunk(record)
                case Op.CHUNK_INFO:
                    self._take_info(record)
                case Op.CONNECTION:
                    self.channels.setdefault(record.number(b"conn"), channel_of(view, record))
        self._close_runs()
        if self.header is not None and self._infos and not self._index_incomplete(self.header):
            self.indexed = sum(self._infos.values())

    def _take_chunk(self, record: BagRecord) -> None:
        self.compression = self.compression or record.fields[b"compression"]
        unpacked = min(record.number(b"size"), limits().chunk_bytes_of(len(self._view)))
        chunk = Chunk(record.start, record.end - record.start, *ANY_TIME, unpacked=unpacked)
        index = None if record.repaired else read_index(self._view, record.end)
        if index is None:
            self.untimed[record.start] = chunk
        else:
            self._add_chunk(chunk, index)

    def _add_chunk(self, chunk: Chunk, index: ChunkIndex) -> None:
        start_ns, end_ns, counts = index.start_ns, index.end_ns, index.counts
        self.chunks[chunk.offset] = replace(chunk, start_ns=start_ns, end_ns=end_ns, messages=counts.total())
        self.counts += counts
        for connection in counts:
            self.first_use.setdefault(connection, chunk.offset)

    def _take_info(self, record: BagRecord) -> None:
        """Add or check the times of a chunk, and count its messages in case it is lost."""
        offset = record.number(b"chunk_pos")
        start_ns, end_ns = record.time_ns(b"start_time"), record.time_ns(b"end_time")
        entries = self._view[record.data : record.end]
        counts: Counter[int] = Counter()
        for connection, messages in _COUNT.iter_unpack(entries[: len(entries) // _COUNT.size * _COUNT.size]):
            counts[connection] += messages
        self._infos[offset] = counts.total()
        if offset in self.untimed and counts:
            self._add_chunk(self.untimed.pop(offset), ChunkIndex(start_ns, end_ns, counts))
        chunk = self.chunks.get(offset)
        if chunk is not None and (chunk.start_ns, chunk.end_ns) != (start_ns, end_ns):
            # Its index and its chunk info contradict each other.
            self.untimed[offset] = Chunk(offset, chunk.size, *ANY_TIME, unpacked=chunk.unpacked)
            del self.chunks[offset]
            if index := read_index(self._view, offset + chunk.size):
                self.counts -= index.counts

    def _take_message(self, record: BagRecord) -> None:
        """Append a message outside chunks to the run before it, or start a run."""
        start, end = self._runs.pop() if self._runs else (record.start, record.start)
        if end != record.start or end - start > _RUN_BYTES:
            self._runs.append((start, end))
            start = record.start
        self._runs.append((start, record.end))

    def _close_runs(self) -> None:
        """Keep the messages outside chunks; in a compressed bag, treat them as part of damaged data."""
        if self.compression in {None, b"none"}:
            self.untimed |= {start: Chunk(start, end - start, *ANY_TIME) for start, end in self._runs}
        else:
            self._gaps += self._runs
            self._runs = []

    def damage(self, path: Path) -> list[Damage]:
        """Return the damage that is visible without unpacking chunks."""
        found = [self._gap(path, *gap) for gap in _joined(self._gaps)]
        size = len(self._view)
        if self.header is None:
            return found or [Damage(path, len(MAGIC), "the bag is truncated before its first record")]
        index_pos = self.header.number(b"index_pos")
        if index_pos == 0:
            found.append(Damage(path, None, "the recorder did not close the bag; it is read without its index"))
        elif self._index_incomplete(self.header):
            problem = "the index at the end of the bag is incomplete; the bag is read without it"
            if index_pos > size:
                missing = count(index_pos - size, "byte")
                problem = f"the bag is truncated by at least {missing}; it is read without its index"
            found.append(Damage(path, min(index_pos, size), problem))
        return found

    def _index_incomplete(self, header: BagRecord) -> bool:
        connections, infos = self._seen[Op.CONNECTION], self._seen[Op.CHUNK_INFO]
        return connections < header.number(b"conn_count") or infos < header.number(b"chunk_count")

    def _gap(self, path: Path, start: int, end: int) -> Damage:
        lost = 0 if self._runs else sum(count for offset, count in self._infos.items() if start <= offset < end)
        if start == end:
            problem = "a record of wrong length"
        elif end == len(self._view):
            problem = "damaged or truncated; nothing readable follows"
        else:
            problem = f"damaged; reading resumes at byte {end}"
        return Damage(path, start, problem, end - start, lost or None)


def _joined(gaps: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return gaps in order, with adjacent ones merged."""
    joined: list[tuple[int, int]] = []
    for start, end in sorted(gaps):
        touches = joined and joined[-1][1] == start
        joined.append((joined.pop()[0] if touches else start, end))
    return joined
