"""COPC files for tests: an octree with two levels by default, and a page of the index for each node below the root."""

import io
import struct

import numpy as np
import pytest


def write_copc(path, source, groups_of=None):
    """Write the points of a LAS or LAZ file with a point format from 6 on as a COPC file; return its path.

    ``groups_of`` takes the tile, the low corner of the octree and half of its width, and returns the indices of the
    points of each node by its key (level, x, y, z), the root first.
    """
    laspy, lazrs = pytest.importorskip("laspy"), pytest.importorskip("lazrs")
    tile = laspy.read(source)
    size = tile.point_format.size
    vlr = lazrs.LazVlr.new_for_compression(tile.point_format.id, tile.point_format.num_extra_bytes, True)
    records = [("laszip encoded", 22204, bytes(vlr.record_data()))]
    records += [(one.user_id, one.record_id, one.record_data_bytes()) for one in tile.vlrs if one.user_id != "copc"]
    start = 375 + 54 + 160 + sum(54 + len(data) for *_, data in records)
    low, center, half = _cube(tile)
    packed = tile.points.array.view(np.uint8).reshape(-1, size)
    groups = (groups_of or _groups)(tile, low, half)
    out = io.BytesIO(bytes(start))
    out.seek(start)
    compressor = lazrs.LasZipCompressor(out, vlr)
    compressor.reserve_offset_to_chunk_table()
    entries = {}
    for key, own in groups.items():
        at = out.tell()
        compressor.compress_many(packed[own].tobytes())
        compressor.finish_current_chunk()
        entries[key] = [*key, at, out.tell() - at, len(own)]
    compressor.done()
    end = out.seek(0, io.SEEK_END)
    pages = {key: struct.pack("<4iQii", *entry) for key, entry in entries.items()}
    (_, top), *below = pages.items()
    page_at = end + 60
    for number, (key, page) in enumerate(below):
        top += struct.pack("<4iQii", *key, page_at + number * len(page), len(page), -1)
    leaves = b"".join(page for _, page in below)
    root_at = page_at + len(leaves)
    info = struct.pack("<5dQQ2d", *center, half, half / 64, root_at, len(top), 0, 1).ljust(160, b"\0")
    data = bytearray(out.getvalue())
    data[:start] = (
        _head(source, tile, start, end, len(records) + 1)
        + _record("copc", 1, info)
        + b"".join(_record(*record) for record in records)
    )
    data += struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(leaves) + len(top), b"index") + leaves + top
    path.write_bytes(data)
    return path


def _cube(tile):
    low = np.array(tile.header.mins)
    half = float(np.max(np.array(tile.header.maxs) - low)) / 2 + 0.01
    return low, low + half, half


def _groups(tile, low, half):
    """Return every eighth point as the root, and the others by octant."""
    place = np.stack([np.asarray(tile[axis]) for axis in "xyz"], axis=1)
    octant = np.minimum((place - low) // half, 1).astype(int)
    is_root = np.arange(len(place)) % 8 == 0
    groups = {(0, 0, 0, 0): np.flatnonzero(is_root)}
    for key in np.unique(octant, axis=0).tolist():
        groups[1, *key] = np.flatnonzero(~is_root & (octant == key).all(axis=1))
    return groups


def _head(source, tile, start, end, records):
    head = bytearray(source.read_bytes()[:375])
    struct.pack_into("<HII", head, 94, 375, start, records)
    head[104] = tile.point_format.id | 0x80
    struct.pack_into("<QI", head, 235, end, 1)
    return bytes(head)


def _record(user, number, data):
    return struct.pack("<H16sHH32s", 0, user.encode(), number, len(data), b"") + data
