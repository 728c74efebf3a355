"""Files of skops: zip archives of arrays, and a schema that says what they are."""

import io
import re
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

_SCHEMA = "schema.json"
_ADDRESS = re.compile(r'("__id__": |"file": ")(\d+)')
_MAX_UNPACKED_BYTES = 64 * 2**20
_MAX_RATIO = 50
"""Files may unpack to the larger of this size and this multiple of their own; trees shrink to a fifth by packing."""


def check_size(data: bytes) -> None:
    """Raise `ValueError` if a file would unpack to more than the size of any model."""
    with ZipFile(io.BytesIO(data)) as archive:
        unpacked = sum(member.file_size for member in archive.infolist())
    if unpacked > max(_MAX_UNPACKED_BYTES, _MAX_RATIO * len(data)):
        raise ValueError(f"{len(data):,} bytes that unpack to {unpacked:,}")


def reproducible(data: bytes) -> bytes:
    """Return a file whose bytes depend on its content only.

    skops names arrays and objects by their addresses in memory and writes the time; the spare bytes between the columns
    of an array of records are whatever the memory held.
    """
    numbers: dict[str, int] = {}

    def by_number(found: re.Match[str]) -> str:
        return f"{found[1]}{numbers.setdefault(found[2], len(numbers) + 1)}"

    packed = io.BytesIO()
    with ZipFile(io.BytesIO(data)) as source, ZipFile(packed, "w") as target:
        schema = _ADDRESS.sub(by_number, source.read(_SCHEMA).decode())
        for name in source.namelist():
            if name == _SCHEMA:
                _write(target, name, schema.encode())
            else:
                stem, _, suffix = name.partition(".")
                _write(target, f"{numbers[stem]}.{suffix}", _without_spare_bytes(source.read(name)))
    return packed.getvalue()


def _without_spare_bytes(array_file: bytes) -> bytes:
    array = np.load(io.BytesIO(array_file), allow_pickle=False)
    if not array.dtype.names:
        return array_file
    clean = np.zeros(array.shape, array.dtype)
    for name in array.dtype.names:
        clean[name] = array[name]
    written = io.BytesIO()
    np.save(written, clean, allow_pickle=False)
    return written.getvalue()


def _write(archive: ZipFile, name: str, data: bytes) -> None:
    member = ZipInfo(name)  # of the year 1980
    member.create_system = 3  # Unix, also on Windows
    member.external_attr = 0o600 << 16
    archive.writestr(member, data, ZIP_DEFLATED, 6)
