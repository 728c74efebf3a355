"""The compression modes of rosbag2 outside its storage format: single messages and whole files."""

from pathlib import Path
from typing import BinaryIO

import zstandard

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Buffer, Damage

MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of compressed data; no CDR message starts with them."""

MAX_MESSAGE_BYTES = 2**30
"""Maximum bytes of an unpacked message."""

_MAX_RATIO = 256
_PIECE = 4096


def unpack_message(data: Buffer) -> Buffer | None:
    """Return a message, unpacked if it is compressed; None if it is damaged or too large."""
    if data[:4] != MAGIC:
        return data
    try:
        size = zstandard.frame_content_size(data)
        if size > MAX_MESSAGE_BYTES:
            return None
        limit = min(MAX_MESSAGE_BYTES, 2**20 + _MAX_RATIO * len(data))
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=limit)
    except zstandard.ZstdError:
        return None


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
            problem = _copy_unpacked(packed, unpacked)
    except OSError as error:
        raise InputError(f"{path}: cannot be unpacked: {error.strerror}") from error
    return target, None if problem is None else Damage(path, None, problem)


def _copy_unpacked(packed: BinaryIO, unpacked: BinaryIO) -> str | None:
    """Unpack the readable part, and return a description of the damage; None if the file is intact."""
    frame = None
    try:
        while piece := packed.read(_PIECE):
            while piece:
                if frame is None or frame.eof:
                    frame = zstandard.ZstdDecompressor().decompressobj()
                unpacked.write(frame.decompress(piece))
                piece = frame.unused_data if frame.eof else b""
    except zstandard.ZstdError as error:
        return f"the compressed file is damaged ({error})"
    return None if frame is not None and frame.eof else "the compressed file is truncated"
