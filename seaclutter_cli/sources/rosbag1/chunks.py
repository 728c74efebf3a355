"""Chunks of ROS 1 bags, intact or damaged: their content, and the index after them."""

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from struct import Struct

from seaclutter_cli.limits import above_in_file, limits
from seaclutter_cli.records import Buffer
from seaclutter_cli.sources.rosbag1.records import NANO, BagRecord, Op, read_record
from seaclutter_cli.sources.shared.chunked import MAX_AHEAD_BYTES
from seaclutter_cli.sources.shared.log_file import Bytes
from seaclutter_cli.sources.shared.unpacking import DECOMPRESSION_ERRORS, readable, unpacked_frame
from seaclutter_cli.text import count

_MAX_RATIO = 256
_ENTRY = Struct("<II4x")


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
    """Return the readable content of a chunk, and a description of its damage; None if it is intact.

    Parameters
    ----------
    packed : memoryview
        Data of the chunk.
    chunk : BagRecord
        Its record.
    ends_bag : bool
        Whether the bag ends where the chunk ends.
    bag_bytes : int
        Size of the bag, on which the limit of a chunk depends.
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
        return memoryview(
            b""
        ), f"a chunk of {above_in_file(count(max(size, len(content)), 'byte'), 'chunk', bag_bytes)}"
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
