"""Decompression within limits: no more is unpacked than asked for, whatever the compressed data declare."""

import bz2
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any

import lz4.frame
import zstandard

from seaclutter_cli.records import Buffer

DECOMPRESSION_ERRORS = (zstandard.ZstdError, RuntimeError, ValueError, EOFError, OSError)
"""Errors that decompression raises on damaged data."""

_PIECE = 2**20
_PACKED_PIECE = 4096
_INCREMENTAL: Mapping[str, Callable[[], Any]] = {
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "bz2": bz2.BZ2Decompressor,
}


def unpacked(compression: str, packed: Buffer, size: int) -> Buffer:
    """Return decompressed data, at most one byte more than ``size``.

    Parameters
    ----------
    compression : str
        ``zstd``, ``lz4``, ``bz2``, or empty for none.
    packed : bytes or memoryview
        Compressed data. Frames of zstd may follow one another.
    size : int
        Expected number of bytes.
    """
    if compression == "":
        return packed
    if compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
            return stream.read(size + 1)
    return unpacked_frame(compression, packed, size)[0]


def unpacked_frame(compression: str, packed: Buffer, size: int) -> tuple[bytes, bool]:
    """Return what `unpacked` returns for ``lz4`` or ``bz2``, and whether it is complete."""
    decompressor = _INCREMENTAL[compression]()
    return bytes(decompressor.decompress(packed, max_length=size + 1)), decompressor.eof


def readable(compression: str, packed: Buffer, most: int) -> tuple[Buffer, bool]:
    """Return the data before the first error, at most ``most`` bytes.

    The second value is whether these are all data; it is unknown, and False, for zstd.
    """
    if compression == "":
        return packed[:most], len(packed) <= most
    content = bytearray()
    with suppress(*DECOMPRESSION_ERRORS):
        for piece, is_last in _zstd_pieces(packed) if compression == "zstd" else _pieces(compression, packed):
            content += piece
            if is_last or len(content) > most:
                return memoryview(content)[:most], is_last and len(content) <= most
    return memoryview(content), False


def _zstd_pieces(packed: Buffer) -> Iterator[tuple[bytes, bool]]:
    with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
        while piece := stream.read(2**16):
            yield piece, False


def _pieces(compression: str, packed: Buffer) -> Iterator[tuple[bytes, bool]]:
    decompressor = _INCREMENTAL[compression]()
    for at in range(0, len(packed), _PACKED_PIECE):
        yield decompressor.decompress(packed[at : at + _PACKED_PIECE], max_length=_PIECE), decompressor.eof
        while not (decompressor.needs_input or decompressor.eof):
            yield decompressor.decompress(b"", max_length=_PIECE), decompressor.eof
