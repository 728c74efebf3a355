"""Records of ROS 1 bags (format 2.0), in a file or in a chunk: parsing them, and finding the next one after damage.

A record is a header of ``name=value`` fields and data, each preceded by its length. No length is trusted: where a
record does not end at another one, the next is searched for.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from enum import IntEnum
from struct import Struct
from typing import NamedTuple

from seaclutter_cli.records import Bytes
from seaclutter_cli.sources.shared.log_file import unpack

MAGIC = b"#ROSBAG V2.0\n"
U32 = Struct("<I")
STAMP = Struct("<II")

_MAX_HEADER = 4096
_MAX_NAME = 32
_FIRST_WINDOW, _WINDOW = 64 * 2**10, 16 * 2**20
NANO = 1_000_000_000


class Op(IntEnum):
    """Kinds of records."""

    MESSAGE = 2
    BAG_HEADER = 3
    INDEX = 4
    CHUNK = 5
    CHUNK_INFO = 6
    CONNECTION = 7


BETWEEN_CHUNKS = frozenset({Op.INDEX, Op.CHUNK, Op.CHUNK_INFO})
"""Records that never occur in a chunk."""

# Fields that a record must have, with their sizes; None for text.
_REQUIRED: Mapping[bytes, tuple[Op, Mapping[bytes, int | None]]] = {
    b"\x02": (Op.MESSAGE, {b"conn": 4, b"time": 8}),
    b"\x03": (Op.BAG_HEADER, {b"index_pos": 8, b"conn_count": 4, b"chunk_count": 4}),
    b"\x04": (Op.INDEX, {b"conn": 4, b"count": 4}),
    b"\x05": (Op.CHUNK, {b"compression": None, b"size": 4}),
    b"\x06": (Op.CHUNK_INFO, {b"chunk_pos": 8, b"start_time": 8, b"end_time": 8, b"count": 4}),
    b"\x07": (Op.CONNECTION, {b"conn": 4, b"topic": None}),
}
_FIELDS = {name for _, fields in _REQUIRED.values() for name in fields} | {b"op", b"ver", b"encryptor"}
# The first field name of a header; the lengths of header and field, 8 bytes in total, precede it.
_NAME = re.compile(rb"(?:" + b"|".join(sorted(_FIELDS)) + rb")=")

# Message headers in the two field orders that recorders write: a shortcut for most records.
_SHORTCUTS = (
    (Struct("<21s4s9s8sI"), b"&\0\0\0\x04\0\0\0op=\x02\t\0\0\0conn=", b"\r\0\0\0time="),
    (Struct("<13s4s17s8sI"), b"&\0\0\0\t\0\0\0conn=", b"\x04\0\0\0op=\x02\r\0\0\0time="),
)


class BagRecord(NamedTuple):
    """A record: kind, fields, and the offsets of its start, its data and its end."""

    op: Op
    fields: dict[bytes, bytes]
    start: int
    data: int
    end: int
    repaired: bool = False
    """Whether the end differs from the one that the record states."""

    def number(self, name: bytes) -> int:
        """Return the number in a field of 4 or 8 bytes."""
        return int.from_bytes(self.fields[name], "little")

    def time_ns(self, name: bytes = b"time") -> int:
        """Return the time in a field, in nanoseconds."""
        seconds, nanoseconds = STAMP.unpack(self.fields[name])
        return int(seconds * NANO + nanoseconds)


def parse_fields(header: bytes) -> dict[bytes, bytes] | None:
    r"""Return the fields of a header; None if it is not valid."""
    fields = {}
    at = 0
    while at < len(header):
        if at + 4 > len(header):
            return None
        (size,) = U32.unpack_from(header, at)
        name, equals, value = header[at + 4 : at + 4 + size].partition(b"=")
        at += 4 + size
        if not equals or at > len(header):
            return None
        fields[name] = value
    return fields


def read_record(view: Bytes, at: int) -> BagRecord | None:
    """Return the record at an offset; None if there is no record. Its end may be beyond the view."""
    head = view[at : at + 46]
    if len(head) == 46 and head[0] == 38:
        for header, start, middle in _SHORTCUTS:
            found_start, connection, found_middle, time, length = header.unpack(head)
            if found_start == start and found_middle == middle:
                return BagRecord(Op.MESSAGE, {b"conn": connection, b"time": time}, at, at + 46, at + 46 + length)
    return _read_any_record(view, at)


def _read_any_record(view: Bytes, at: int) -> BagRecord | None:
    if at + 8 > len(view):
        return None
    (size,) = unpack(U32, view, at)
    data = at + 8 + size
    if size > _MAX_HEADER or data > len(view):
        return None
    fields = parse_fields(bytes(view[at + 4 : data - 4])) or {}
    op, required = _REQUIRED.get(fields.get(b"op", b""), (None, {}))
    if op is None or any(
        name not in fields or (length is not None and len(fields[name]) != length) for name, length in required.items()
    ):
        return None
    return BagRecord(op, fields, at, data, data + unpack(U32, view, data - 4)[0])


def find_record(view: Bytes, at: int, ops: Collection[Op] = frozenset(Op)) -> int:
    """Return the offset of the first record of some kinds at or after an offset; the view's length without one."""
    at, window = at + 8, _FIRST_WINDOW
    while at < len(view):
        for match in _NAME.finditer(view[at : at + window + _MAX_NAME]):
            record = read_record(view, at + match.start() - 8)
            if record is not None and record.op in ops:
                return record.start
        at, window = at + window, min(2 * window, _WINDOW)
    return len(view)


def walk(view: Bytes, at: int, gaps: list[tuple[int, int]]) -> Iterator[BagRecord]:
    """Yield the records of a file, or of a chunk, from an offset on, one after another.

    The gaps receive start and end of every part that is skipped; empty ones mark records of wrong length, which end
    where the next one begins. Chunks end only at records that cannot occur in a chunk, or with the view.
    """
    record = read_record(view, at)
    while at < len(view):
        if record is not None:
            following = read_record(view, record.end)
            if following is None and record.end != len(view):
                record = _repair(view, record)
                following = None if record is None else read_record(view, record.end)
        if record is None:
            resumed = find_record(view, at + 1)
            gaps.append((at, resumed))
            at, record = resumed, read_record(view, resumed)
            continue
        if record.repaired and record.op != Op.CHUNK:
            gaps.append((record.start, record.start))
        yield record
        at, record = record.end, following


def _repair(view: Bytes, record: BagRecord) -> BagRecord | None:
    """Return a record that ends at the start of the next one if it overlaps it; None if it is incomplete."""
    if record.op == Op.CHUNK:
        resumed = find_record(view, record.data, BETWEEN_CHUNKS)
        return record._replace(end=resumed, repaired=True) if resumed < record.end else record
    resumed = find_record(view, record.data)
    if resumed < record.end and resumed < len(view):
        return record._replace(end=resumed, repaired=True)
    return record if record.end < len(view) else None
