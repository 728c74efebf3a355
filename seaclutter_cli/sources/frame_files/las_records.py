"""Unchanged variable length records of LAS files; laspy rewrites those it knows, not always correctly."""

from typing import Any, BinaryIO

from seaclutter_cli.errors import CloudError

_HEADER_BYTES_AT, _VLRS_AT, _EVLRS_AT = 94, 100, 235
_LASZIP = ("laszip encoded", 22204)


def read_records(laspy: Any, file: BinaryIO) -> tuple[list[Any], list[Any]]:
    """Return the variable length records of a file, and the extended ones after its points, as ``laspy.VLR``.

    The sizes in the file must have been checked. The record that describes the compression is left out.
    """
    version = _number(file, 24, 1), _number(file, 25, 1)
    vlrs = _read(laspy, file, _number(file, _HEADER_BYTES_AT, 2), _number(file, _VLRS_AT, 4), 2)
    evlrs: list[Any] = []
    if version >= (1, 4):
        evlrs = _read(laspy, file, _number(file, _EVLRS_AT, 8), _number(file, _EVLRS_AT + 8, 4), 8)
    return [vlr for vlr in vlrs if (vlr.user_id, vlr.record_id) != _LASZIP], evlrs


def _read(laspy: Any, file: BinaryIO, at: int, count: int, width: int) -> list[Any]:
    """Return ``count`` records from an offset on; their length field has ``width`` bytes."""
    out = []
    for _ in range(count):
        user, number, length = _text(file, at + 2, 16), _number(file, at + 18, 2), _number(file, at + 20, width)
        described = _text(file, at + 20 + width, 32)
        at += 52 + width
        out.append(laspy.VLR(user.decode("ascii"), number, described, _bytes(file, at, length)))
        at += length
    return out


def _bytes(file: BinaryIO, at: int, count: int) -> bytes:
    file.seek(at)
    data = file.read(count)
    if len(data) < count:
        raise CloudError("the file is truncated")
    return data


def _number(file: BinaryIO, at: int, count: int) -> int:
    return int.from_bytes(_bytes(file, at, count), "little")


def _text(file: BinaryIO, at: int, count: int) -> bytes:
    return _bytes(file, at, count).split(b"\0")[0]
