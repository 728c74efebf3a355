"""Decompression within limits: no more is unpacked than asked for, whatever the compressed data declare."""

import bz2
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import lz4.frame
import zstandard

from seaclutter_cli.errors import InputError
from seaclutter_cli.limits import above, limits
from seaclutter_cli.paths import open_regular
from seaclutter_cli.records import Buffer, Damage

DECOMPRESSION_ERRORS = (zstandard.ZstdError, RuntimeError, ValueError, EOFError, OSError)
"""Errors that decompression raises on damaged data."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of compressed data; no CDR message starts with them."""
_MAX_RATIO = 256
_TERABYTE = 10**12
_PIECE = 2**20
_PACKED_PIECE = 4096
_PACKED_FILE_PIECE = 2048
"""Bytes of a file that are unpacked at a time: each of them may become 32 KiB."""
_INCREMENTAL: Mapping[str, Callable[[], Any]] = {"lz4": lz4.frame.LZ4FrameDecompressor, "bz2": bz2.BZ2Decompressor}


def unpacked(compression: str, packed: Buffer, size: int) -> Buffer:
    """Return data compressed by ``zstd``, ``lz4``, ``bz2`` or not, at most one byte more than the expected ``size``."""
    if compression == "":
        return packed
    if compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
            return stream.read(size + 1)
    return bytes(_INCREMENTAL[compression]().decompress(packed, max_length=size + 1))


def readable(compression: str, packed: Buffer, most: int) -> tuple[Buffer, bool]:
    """Return at most ``most`` bytes before the first error, and whether these are all; unknown, so False, for zstd."""
    if compression == "":
        return packed[:most], len(packed) <= most
    content = bytearray()
    with suppress(*DECOMPRESSION_ERRORS):
        for piece, is_last in _pieces(compression, packed):
            content += piece
            if is_last or len(content) > most:
                return memoryview(content)[:most], is_last and len(content) <= most
    return memoryview(content), False


def _pieces(compression: str, packed: Buffer) -> Iterator[tuple[bytes, bool]]:
    if compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
            while piece := stream.read(2**16):
                yield piece, False
        return
    decompressor = _INCREMENTAL[compression]()
    for at in range(0, len(packed), _PACKED_PIECE):
        yield decompressor.decompress(packed[at : at + _PACKED_PIECE], max_length=_PIECE), decompressor.eof
        while not (decompressor.needs_input or decompressor.eof):
            yield decompressor.decompress(b"", max_length=_PIECE), decompressor.eof


def unpack_message(data: Buffer, most: int) -> Buffer | None:
    """Return a message, unpacked if it is compressed; None if it is damaged or has more than ``most`` bytes."""
    if data[:4] != ZSTD_MAGIC:
        return data if len(data) <= most else None
    with suppress(zstandard.ZstdError):
        if zstandard.frame_content_size(data) <= most:
            limit = min(most, 2**20 + _MAX_RATIO * len(data))
            return zstandard.ZstdDecompressor().decompress(data, max_output_size=limit)
    return None


def is_large(data: object, most: int) -> bool:
    """Return whether the data of a message, or the size that represents them, exceed ``most`` bytes if unpacked."""
    size = data if isinstance(data, int) else 0
    if isinstance(data, bytes) and data[:4] == ZSTD_MAGIC:
        with suppress(zstandard.ZstdError):
            size = zstandard.frame_content_size(data)
    return most < size < _TERABYTE  # still larger sizes are damage


@contextmanager
def unpacked_file(path: Path, damage: list[Damage]) -> Iterator[Path]:
    """Provide a file itself, or a temporary copy of what can be read of a ``.zstd`` file; `InputError` if that is none.

    Its damage is added to ``damage``.
    """
    if path.suffix.lower() != ".zstd":
        yield path
        return
    with TemporaryDirectory(prefix="seaclutter-") as folder:
        target = Path(folder, path.stem)
        try:
            with open_regular(path) as packed, target.open("wb") as unpacked:
                problem = _copy_unpacked(packed, unpacked, path.stat().st_size)
                if not unpacked.tell():
                    raise InputError(f"{path}: {problem or 'the compressed file is empty'}")
        except OSError as error:
            raise InputError(f"{path}: cannot be unpacked: {error.strerror}") from error
        damage += [] if problem is None else [Damage(path, None, problem)]
        yield target


def _copy_unpacked(packed: BinaryIO, unpacked: BinaryIO, packed_bytes: int) -> str | None:
    """Unpack the readable part, and return a description of the damage; None if the file is intact."""
    frame = None
    most, written = limits().file_bytes(packed_bytes), 0
    try:
        while piece := packed.read(_PACKED_FILE_PIECE):
            while piece:
                if frame is None or frame.eof:
                    frame = zstandard.ZstdDecompressor().decompressobj()
                content = frame.decompress(piece)
                written += len(content)
                if written > most:
                    limit = "file_gib" if most == limits().file_gib * 2**30 else "file_ratio"
                    return f"the compressed file has {above('more bytes', limit)}; the rest is left out"
                unpacked.write(content)
                piece = frame.unused_data if frame.eof else b""
    except zstandard.ZstdError as error:
        return f"the compressed file is damaged ({error})"
    return None if frame is not None and frame.eof else "the compressed file is truncated"
