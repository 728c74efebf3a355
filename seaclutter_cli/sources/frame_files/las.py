"""LAS and LAZ, the file formats of surveying, and COPC: LAZ files whose chunks are the nodes of an octree.

laspy and lazrs trust the sizes in a file: one wrong bit can cost hours or gigabytes. The sizes are therefore checked
here first. Of a COPC file, a part of the area can be read alone; laspy's reader would decompress it in this process.
"""

import logging
import os
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud, from_array, structured
from seaclutter_cli.errors import CloudError, MissingExtraError, requiring
from seaclutter_cli.limits import above, limits
from seaclutter_cli.paths import open_regular
from seaclutter_cli.sources.frame_files.laz import LazBackend
from seaclutter_cli.sources.frame_files.reading import check_size, reading
from seaclutter_cli.text import count

CHUNK_POINTS = 500_000
"""Number of points that are decompressed at a time."""

_HEAD_BYTES = 104
_LEGACY_COUNT_AT = 107
_USER_AT, _USER_BYTES = 2, 16
_VERSION_AT, _HEADER_BYTES_AT, _VLRS_AT, _EVLRS_AT = 24, 94, 100, 235
_VLR_BYTES = 54
_LASZIP = ("laszip encoded", 22204)
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # Point14, RGB14, RGBNIR14, WavePacket14
_BYTE14 = 14
_LASZIP_ITEMS_AT = 34
_POINT_WISE = b"\x01\x00"
"""Compressor of old LASzip files: all points are one chunk, without a table."""
_COPC_INFO = struct.Struct("<5dQQ")
_COPC_ENTRY = np.dtype([("level", "<i4"), ("key", "<i4", 3), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")])
_COPC_PAGE = -1
_DEEPEST = 30
_OF_NAN = np.iinfo(np.int32).min
_COPC = ("copc", 1)
# laspy logs errors before it raises them; without a handler, the log would reach standard error.
logging.getLogger("laspy").addHandler(logging.NullHandler())


def read_las(path: Path) -> Cloud:
    """Return the points of a LAS or LAZ file: scaled x, y, z as float64, all other dimensions unchanged.

    Points that a writer made of NaN have NaN again.

    `CloudError` if the file is not a LAS file, or does not contain the number of points in its header;
    `MissingExtraError` if laspy, or its LAZ backend, is not installed.
    """
    with open_las(path) as reader:
        empty = _laspy().ScaleAwarePointRecord.zeros(0, header=reader.header)
        return from_array(np.concatenate([_structured(part) for part in (empty, *parts_of(reader))]))


def parts_of(reader: Any) -> Iterator[Any]:
    """Yield the points of an open file in parts; `CloudError` if they are not as many as its header declares."""
    found, declared = 0, reader.header.point_count
    for part in reader.chunk_iterator(CHUNK_POINTS):
        found += len(part)
        yield part
    if found != declared:
        raise CloudError(f"{count(found, 'point')} found, but the header declares {declared:,}")


@contextmanager
def open_las(path: Path) -> Iterator[Any]:
    """Open a LAS or LAZ file as a ``laspy.LasReader`` after checking its sizes; call it inside `reading`."""
    laspy = _laspy()
    with open_regular(path) as file, LazBackend(path) as laz:
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        head = file.read(_HEAD_BYTES)
        if len(head) < _HEAD_BYTES or not head.startswith(b"LASF"):
            raise CloudError("no LAS header")
        check_size(_unpack(file, _VLRS_AT, "<I")[0] * _VLR_BYTES, size)
        others = _ids_to_replace(file, *_unpack(file, _HEADER_BYTES_AT, "<H"), *_unpack(file, _VLRS_AT, "<I"))
        file.seek(0)
        source = _Patched(file, others) if others else file
        with laspy.open(source, read_evlrs=False, laz_backend=laz, closefd=False) as reader:
            if not reader.header.point_count:  # some writers of LAS 1.4 fill in the number of earlier versions only
                reader.header.point_count = _unpack(file, _LEGACY_COUNT_AT, "<I")[0]
                file.seek(reader.header.offset_to_point_data)
            count = reader.header.point_count
            if count and not reader.header.are_points_compressed:
                check_size(reader.header.offset_to_point_data + count * reader.header.point_format.size, size)
                _check_count(reader.header, file, size)
            elif count:
                if not laz.is_available():
                    raise MissingExtraError("LAZ", "las")
                _check_compressed(reader.header, file, size)
            yield reader


class _Patched:
    """File some of whose bytes, by their offset, are others."""

    def __init__(self, file: BinaryIO, others: Mapping[int, bytes]) -> None:
        self._file, self._others = file, others

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def read(self, size: int) -> bytes:
        at = self._file.tell()
        data = bytearray(self._file.read(size))
        for start, other in self._others.items():
            low, high = max(start, at), min(start + len(other), at + len(data))
            if low < high:
                data[low - at : high - at] = other[low - start : high - start]
        return bytes(data)


def _ids_to_replace(file: BinaryIO, at: int, number: int) -> dict[int, bytes]:
    """Return ASCII for the user ids of records that are not UTF-8, which laspy requires, by their offset."""
    found = {}
    for _ in range(number):
        user, size = _unpack(file, at + _USER_AT, f"<{_USER_BYTES}s2xH")
        if _ascii(user.split(b"\0")[0]).encode() != user.split(b"\0")[0]:
            found[at + _USER_AT] = _ascii(user.split(b"\0")[0]).encode().ljust(_USER_BYTES, b"\0")
        at += _VLR_BYTES + size
    return found


def _ascii(text: bytes) -> str:
    return text.decode("ascii", "replace").replace("\ufffd", "?")


def _laspy() -> Any:
    with requiring("LAS/LAZ", "las"):
        import laspy  # an extra
    return laspy


def with_records(header: Any, path: Path) -> Any:
    """Return a header of `open_las` with unchanged records: laspy rewrites some of them, at times wrongly."""
    laspy = _laspy()
    with open_regular(path) as file:
        (at,), (number,) = _unpack(file, _HEADER_BYTES_AT, "<H"), _unpack(file, _VLRS_AT, "<I")
        vlrs, evlrs = _records(file, at, number, "H"), list[Any]()
        if _unpack(file, _VERSION_AT, "<BB") >= (1, 4):
            at, number = _unpack(file, _EVLRS_AT, "<QI")
            evlrs = _records(file, at, number, "Q")
    header.vlrs[:] = [vlr for vlr in vlrs if (vlr.user_id, vlr.record_id) != _LASZIP]  # the setter would rewrite some
    header.evlrs = laspy.vlrs.vlrlist.VLRList(evlrs)
    return header


def _records(file: BinaryIO, at: int, number: int, length: str) -> list[Any]:
    """Return variable length records from an offset on as ``laspy.VLR``; ``length`` is the type of their size."""
    layout, found, size = f"<2x16sH{length}32s", [], os.fstat(file.fileno()).st_size
    for _ in range(number):
        user, kind, content, described = _unpack(file, at, layout)
        at += struct.calcsize(layout)
        check_size(at + content, size)
        (data,) = _unpack(file, at, f"<{content}s")
        at += content
        user, described = user.split(b"\0")[0], described.split(b"\0")[0]
        found.append(_laspy().VLR(_ascii(user), kind, described, data))
    return found


def _check_count(header: Any, file: BinaryIO, size: int) -> None:
    """Check that no points follow those that the header declares; files may end in zeros."""
    end, at = header.offset_to_point_data + header.point_count * header.point_format.size, file.tell()
    records = [header.start_of_first_evlr] * (header.number_of_evlrs > 0)
    waveforms = getattr(header, "start_of_waveform_data_packet_record", 0)
    more = (min(one for one in (size, *records, waveforms) if one >= end) - end) // header.point_format.size
    if more:
        file.seek(end)
        if any(file.read(header.point_format.size)):
            raise CloudError(
                f"the header declares {count(header.point_count, 'point')}, but {more:,} more follow; correct it, as "
                "with lasinfo -repair_counters"
            )
        file.seek(at)


def _check_compressed(header: Any, file: BinaryIO, size: int) -> None:
    """Check the size of a point and, unless all points are one chunk, the chunk table and the layers of every chunk."""
    start, point_size = header.offset_to_point_data, header.point_format.size
    if header.point_count * point_size > limits().file_bytes(size):
        raise CloudError(f"the points have {above(count(header.point_count * point_size, 'byte'), 'file_ratio')}")
    if not (described := header.vlrs.get("LasZipVlr")):
        raise CloudError("the record that describes the compression is missing")
    record = described[0].record_data
    items = list(struct.iter_unpack("<HHH", record[_LASZIP_ITEMS_AT:]))
    widths = sum(width for _, width, _ in items)
    if widths != point_size:
        raise CloudError(f"compressed points have {widths} bytes, but the header declares {point_size}")
    if record[:2] != _POINT_WISE:
        table = _find_chunk_table(file, start, size)
        _, chunks = _unpack(file, table, "<II")
        if chunks > min(size, header.point_count):
            raise CloudError(f"the chunk table declares {count(chunks, 'chunk')}, more than points or bytes")
        layers = sum(width if kind == _BYTE14 else _LAYERS.get(kind, 0) for kind, width, _ in items)
        if layers:
            # One uncompressed point, the sizes of the layers, the layers.
            at = start + 8
            while at < table:
                _, *sizes = _unpack(file, at + point_size, f"<{layers + 1}I")
                at += point_size + 4 * (layers + 1) + sum(sizes)
            if at > table:
                raise CloudError("the sizes of the compressed layers do not fit the chunk table")
    file.seek(start)


def _find_chunk_table(file: BinaryIO, start: int, size: int) -> int:
    (table,) = _unpack(file, start, "<q")
    if table <= start:  # written to a stream without seek: the offset is at the end of the file
        (table,) = _unpack(file, size - 8, "<q")
    if not start < table <= size - 8:
        raise CloudError("the chunk table is missing; the file is truncated")
    return int(table)


def _unpack(file: BinaryIO, at: int, layout: str) -> tuple[Any, ...]:
    file.seek(at)
    data = file.read(struct.calcsize(layout))
    if len(data) < struct.calcsize(layout):
        raise CloudError("the file is truncated")
    return struct.unpack(layout, data)


def _structured(part: Any) -> NDArray[Any]:
    names = [name for name in part.point_format.dimension_names if name not in ("X", "Y", "Z")]
    points = structured({name: np.asarray(part[name]) for name in ("x", "y", "z", *names)})
    # NumPy makes this integer of NaN, and so do writers.
    nowhere = np.all([np.asarray(part[axis]) == _OF_NAN for axis in "XYZ"], axis=0)
    for axis in "xyz":
        points[axis][nowhere] = np.nan
    return points


@dataclass(frozen=True)
class CopcIndex:
    """Where the points of a COPC file are: a row for each of N chunks, in the order of the file.

    ``low`` and ``high``, shape (N, 2), are the corners of a chunk's area in the unit of the file; ``chunks``, shape
    (N, 3), its offset, size in bytes, and number of points.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    chunks: NDArray[np.int64]

    def within(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> list[tuple[int, int, int]]:
        """Return the chunks that may have points in a rectangle in the unit of the file."""
        near = ((self.low <= high) & (self.high >= low)).all(axis=1)
        return [(offset, size, points) for offset, size, points in self.chunks[near].tolist()]


def read_index(path: Path, header: Any) -> CopcIndex | None:
    """Return the index of a file, given its header with unchanged records; `CloudError` if it does not fit.

    None if it is not a COPC file.
    """
    found = [one.record_data for one in header.vlrs if (one.user_id, one.record_id) == _COPC]
    if path.suffix.lower() != ".laz" or not found or len(found[0]) < _COPC_INFO.size:
        return None
    *center, half, _, offset, size = _COPC_INFO.unpack_from(found[0])
    entries = _copc_entries(path, offset, size)
    entries = entries[entries["points"] > 0]
    entries = entries[np.argsort(entries["offset"], kind="stable")]
    chunks = np.stack([entries[name].astype(np.int64) for name in ("offset", "bytes", "points")], axis=1)
    ends, total = chunks[:, 0] + chunks[:, 1], path.stat().st_size
    if (chunks < 0).any() or (ends > total).any() or (ends[:-1] > chunks[1:, 0]).any():
        raise CloudError("the COPC index has impossible chunks")
    if chunks[:, 2].sum() != header.point_count:
        raise CloudError(f"the COPC index has {chunks[:, 2].sum():,} points, but the header {header.point_count:,}")
    level = entries["level"]
    if not np.isfinite(center).all() or not half > 0 or (level < 0).any() or (level > _DEEPEST).any():
        raise CloudError("the COPC index has an impossible octree")
    width = (2 * half / 2.0**level)[:, None]
    low = np.array(center[:2]) - half + entries["key"][:, :2] * width
    return CopcIndex(low, low + width, chunks)


def _copc_entries(path: Path, offset: int, size: int) -> NDArray[Any]:
    found, known = [np.empty(0, _COPC_ENTRY)], set()
    total, pages = path.stat().st_size, [(offset, size)]
    with open_regular(path) as file:
        while pages:
            offset, size = pages.pop()
            if offset in known or size < 0 or offset + size > total:
                raise CloudError("the COPC index has an impossible page")
            known.add(offset)
            file.seek(offset)
            page = np.frombuffer(file.read(size // _COPC_ENTRY.itemsize * _COPC_ENTRY.itemsize), _COPC_ENTRY)
            found.append(page[page["points"] != _COPC_PAGE])
            below = page[page["points"] == _COPC_PAGE]
            pages += zip(below["offset"].tolist(), below["bytes"].tolist(), strict=True)
    return np.concatenate(found)


def read_chunks(path: Path, chunks: list[tuple[int, int, int]]) -> Iterator[Any]:
    """Yield the points of chunks in parts, as laspy point records; `CloudError` if they cannot be decompressed."""
    laspy = _laspy()
    with reading("COPC"), open_las(path) as reader, LazBackend(path) as laz:
        header = reader.header
        left = sum(number for *_, number in chunks)
        points = laz.start(header, chunks, left)
        while left:
            number = min(left, CHUNK_POINTS)
            packed = laspy.PackedPointRecord.from_buffer(points.read_n_points(number), header.point_format)
            yield laspy.ScaleAwarePointRecord(packed.array, header.point_format, header.scales, header.offsets)
            left -= number
