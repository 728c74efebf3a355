"""Chunks of ROS 1 bags, intact or damaged: their content, and the index after them."""

import bz2
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from struct import Struct
from typing import Any

import lz4.frame

from seaclutter_cli.sources.rosbag1.records import NANO, BagRecord, Op, read_record
from seaclutter_cli.text import count

MAX_CHUNK_BYTES = 2**30
"""Maximum bytes of an unpacked chunk; the rest is left out."""

_PIECE = 4096
_MAX_RATIO = 256
_ENTRY = Struct("<II4x")
_DECOMPRESSORS: Mapping[bytes, Callable[[], Any]] = {
    b"bz2": bz2.BZ2Decompressor,
    b"lz4": lz4.frame.LZ4FrameDecompressor,
}


@dataclass(frozen=True, slots=True)
class ChunkIndex:
    """Times of the first and last message of a chunk, and the number of messages per connection."""

    start_ns: int
    end_ns: int
    counts: Counter[int]


def read_index(view: memoryview, at: int) -> ChunkIndex | None:
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


def unpack(view: memoryview, chunk: BagRecord) -> tuple[memoryview, str | None]:
    """Return the readable content of a chunk, and a description of its damage; None if it is intact."""
    packed = view[chunk.data : chunk.end]
    size = chunk.number(b"size")
    compression = chunk.fields[b"compression"]
    if compression == b"none":
        content, whole = packed[:size] if chunk.repaired else packed, True
    elif compression in _DECOMPRESSORS:
        unpacked, whole = _decompress(_DECOMPRESSORS[compression], packed, size)
        content = memoryview(unpacked)
    else:
        return memoryview(b""), f"a chunk with the unknown compression {compression.decode('utf-8', 'replace')!r}"
    if not whole or len(content) != size:
        if chunk.repaired and chunk.end == len(view):
            return content, "the bag ends inside a chunk"
        return content, f"a damaged chunk: {len(content):,} of {count(size, 'byte')} can be read"
    return content, "a record of wrong length, or damage after it" if chunk.repaired else None


def _decompress(make: Callable[[], Any], packed: memoryview, size: int) -> tuple[bytes | bytearray, bool]:
    """Return the data that can be decompressed, and whether it is complete."""
    with suppress(OSError, RuntimeError, EOFError):
        decompressor = make()
        # One byte more than expected, which reveals the end; limited by the packed size because it is allocated.
        content: bytes = decompressor.decompress(packed, min(size, _MAX_RATIO * len(packed), MAX_CHUNK_BYTES) + 1)
        if decompressor.eof:
            return content, True
    return _salvage(make(), packed)


def _salvage(decompressor: Any, packed: memoryview) -> tuple[bytearray, bool]:
    """Return the data before the first error, decompressed piece by piece, and whether it is complete."""
    content = bytearray()
    with suppress(OSError, RuntimeError, EOFError):
        for at in range(0, len(packed), _PIECE):
            content += decompressor.decompress(packed[at : at + _PIECE], _PIECE * _MAX_RATIO)
            while not (decompressor.needs_input or decompressor.eof or len(content) > MAX_CHUNK_BYTES):
                content += decompressor.decompress(b"", _PIECE * _MAX_RATIO)
            if decompressor.eof or len(content) > MAX_CHUNK_BYTES:
                break
    return content, decompressor.eof
