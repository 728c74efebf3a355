"""The two ways in which rosbag2 compresses besides its storage: message by message, and whole files."""

from pathlib import Path

import zstandard

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Buffer, Damage

MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of compressed data; no CDR message begins so."""

MAX_MESSAGE_BYTES = 2**30
"""Bytes that a message may unpack to."""

_MAX_RATIO = 256


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
    problem = None
    try:
        with path.open("rb") as packed, target.open("wb") as unpacked:
            size = zstandard.frame_content_size(packed.read(18))
            packed.seek(0)
            try:
                zstandard.ZstdDecompressor().copy_stream(packed, unpacked)
            except zstandard.ZstdError as error:
                problem = f"the compressed file is damaged ({error})"
            written = unpacked.tell()
    except zstandard.ZstdError:
        raise InputError(f"{path}: not a zstd file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be unpacked: {error.strerror}") from error
    if problem is None and written < size:
        problem = "the compressed file is cut off"
    if problem is None:
        return target, None
    return target, Damage(path, None, problem, max(size - written, 0))
