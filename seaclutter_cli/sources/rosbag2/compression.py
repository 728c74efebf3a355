"""The compression modes of rosbag2 outside its storage format: single messages and whole files."""

from pathlib import Path
from typing import BinaryIO

import zstandard

from seaclutter_cli.errors import InputError
from seaclutter_cli.limits import above, limits
from seaclutter_cli.records import Buffer, Damage

MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of compressed data; no CDR message starts with them."""

_MAX_RATIO = 256
_TERABYTE = 10**12
_PIECE = 2048
"""Bytes that are unpacked at a time: each of them may become 32 KiB."""


def unpack_message(data: Buffer, most: int) -> Buffer | None:
    """Return a message, unpacked if it is compressed; None if it is damaged or has more than ``most`` bytes."""
    if data[:4] != MAGIC:
        return data if len(data) <= most else None
    try:
        size = zstandard.frame_content_size(data)
        if size > most:
            return None
        limit = min(most, 2**20 + _MAX_RATIO * len(data))
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=limit)
    except zstandard.ZstdError:
        return None


def is_large(data: object, most: int) -> bool:
    """Return whether the data of a message, or the size that represents them, exceed ``most`` bytes if unpacked."""
    if isinstance(data, int):
        return data > most
    try:
        # Still larger sizes are damage.
        return isinstance(data, bytes) and data[:4] == MAGIC and most < zstandard.frame_content_size(data) < _TERABYTE
    except zstandard.ZstdError:
        return False


def unpack_file(path: Path, folder: Path) -> tuple[Path, Damage | None]:
    """Unpack the readable part of a ``.zstd`` file into a folder.

    Returns
    -------
    tuple of Path and Damage
        The unpacked file, and the damage of the packed one; None if it is intact.

    Raises
    ------
    InputError
        If it cannot be read, or the unpacked file does not fit on the disk.
    """
    target = folder / path.stem
    try:
        with path.open("rb") as packed, target.open("wb") as unpacked:
            problem = _copy_unpacked(packed, unpacked, path.stat().st_size)
    except OSError as error:
        raise InputError(f"{path}: cannot be unpacked: {error.strerror}") from error
    return target, None if problem is None else Damage(path, None, problem)


def _copy_unpacked(packed: BinaryIO, unpacked: BinaryIO, packed_bytes: int) -> str | None:
    """Unpack the readable part, and return a description of the damage; None if the file is intact."""
    frame = None
    most, written = limits().file_bytes(packed_bytes), 0
    try:
        while piece := packed.read(_PIECE):
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
