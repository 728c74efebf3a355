"""COPC: LAZ files whose chunks are the nodes of an octree, so that a part of the area can be read alone.

laspy's reader trusts the offsets in a file, and decompresses in this process; `laz` says why neither is safe.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError
from seaclutter_cli.sources.frame_files.las import CHUNK_POINTS, open_las
from seaclutter_cli.sources.frame_files.laz import LazBackend
from seaclutter_cli.sources.frame_files.reading import reading

_INFO = struct.Struct("<5dQQ")
_ENTRY = np.dtype([("level", "<i4"), ("key", "<i4", 3), ("offset", "<u8"), ("bytes", "<i4"), ("points", "<i4")])
_PAGE = -1
_DEEPEST = 30
_USER = "copc"


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


def is_copc(header: Any) -> bool:
    """Return whether a header has the record of a COPC file."""
    return _info(header) is not None


def _info(header: Any) -> bytes | None:
    found = [one.record_data for one in header.vlrs if (one.user_id, one.record_id) == (_USER, 1)]
    return bytes(found[0]) if found and len(found[0]) >= _INFO.size else None


def read_index(path: Path, header: Any) -> CopcIndex:
    """Return the index of a COPC file, given its header with unchanged records; `CloudError` if it does not fit."""
    info = _info(header)
    if info is None:
        raise CloudError("not a COPC file")
    *center, half, _, offset, size = _INFO.unpack_from(info)
    entries = _entries(path, offset, size)
    entries = entries[entries["points"] > 0]
    entries = entries[np.argsort(entries["offset"], kind="stable")]
    chunks = np.stack([entries[name].astype(np.int64) for name in ("offset", "bytes", "points")], axis=1)
    _check(chunks, header, path.stat().st_size)
    level = entries["level"]
    if not np.isfinite(center).all() or not half > 0 or (level < 0).any() or (level > _DEEPEST).any():
        raise CloudError("the COPC index has an impossible octree")
    width = (2 * half / 2.0**level)[:, None]
    low = np.array(center[:2]) - half + entries["key"][:, :2] * width
    return CopcIndex(low, low + width, chunks)


def _entries(path: Path, offset: int, size: int) -> NDArray[Any]:
    """Return the entries of all pages of the index."""
    found, known = [np.empty(0, _ENTRY)], set()
    total, pages = path.stat().st_size, [(offset, size)]
    with path.open("rb") as file:
        while pages:
            offset, size = pages.pop()
            if offset in known or size < 0 or offset + size > total:
                raise CloudError("the COPC index has an impossible page")
            known.add(offset)
            file.seek(offset)
            page = np.frombuffer(file.read(size // _ENTRY.itemsize * _ENTRY.itemsize), _ENTRY)
            found.append(page[page["points"] != _PAGE])
            below = page[page["points"] == _PAGE]
            pages += zip(below["offset"].tolist(), below["bytes"].tolist(), strict=True)
    return np.concatenate(found)


def _check(chunks: NDArray[np.int64], header: Any, total: int) -> None:
    ends = chunks[:, 0] + chunks[:, 1]
    if (chunks < 0).any() or (ends > total).any() or (ends[:-1] > chunks[1:, 0]).any():
        raise CloudError("the COPC index has impossible chunks")
    if chunks[:, 2].sum() != header.point_count:
        raise CloudError(f"the COPC index has {chunks[:, 2].sum():,} points, but the header {header.point_count:,}")


def read_chunks(path: Path, chunks: list[tuple[int, int, int]]) -> Iterator[Any]:
    """Yield the points of chunks in parts, as laspy point records; `CloudError` if they cannot be decompressed."""
    import laspy  # an extra

    with reading("COPC"), open_las(path) as reader, LazBackend(path) as laz:
        header = reader.header
        points = laz.read_chunks(header, chunks)
        left = sum(number for *_, number in chunks)
        while left:
            number = min(left, CHUNK_POINTS)
            packed = laspy.PackedPointRecord.from_buffer(points.read_n_points(number), header.point_format)
            yield laspy.ScaleAwarePointRecord(packed.array, header.point_format, header.scales, header.offsets)
            left -= number
