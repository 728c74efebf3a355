"""The two ways in which rosbag2 compresses besides its storage: message by message, and whole files."""

from pathlib import Path
from typing import BinaryIO

import zstandard

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Buffer, Damage

MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of compressed data; no CDR message begins so."""

MAX_MESSAGE_BYTES = 2**30
"""Bytes that a message may unpack to."""

_MAX_RATIO = 256
_PIECE = 4096


def unpack_message(data: Buffer) -> Buffer | None:
    """Return a message unpacked if it is compressed, else as it is; None if it is damaged or impossibly large."""
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
    """Unpack a ``.zstd`` file into a folder as far as it is whole.

    Returns
    -------
    tuple of Path and Damage
        The unpacked file, and what is wrong with the packed one; None if nothing is.

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
    """Unpack as much as is whole, and return what is wrong with the rest."""
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
    return None if frame is not None and frame.eof else "the compressed file is cut off"
