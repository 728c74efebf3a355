"""Layouts and times of Hesai packets."""

from collections.abc import Mapping
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

Layouts = Mapping[int, np.dtype[Any]]
"""Layouts of packets by their length in bytes."""

RETURN_MODES = {
    0x33: "first",
    0x34: "second",
    0x37: "strongest",
    0x38: "last",
    0x39: "last, strongest",
    0x3A: "first, second",
    0x3B: "last, first",
    0x3C: "first, strongest",
    0x3E: "strongest, second strongest",
}
"""Returns by the mode code in a packet, in the order of the blocks that contain them."""

DUAL_MODES = [mode for mode, names in RETURN_MODES.items() if "," in names]
"""Codes of modes with two returns."""

_MARK: list[Any] = [("start", "u1", 2)]
_HEADER: list[Any] = [
    *_MARK,
    ("version", "u1", 2),
    ("status_version", "u1"),
    ("reserved", "u1"),
    ("lasers", "u1"),
    ("blocks_number", "u1"),
    ("first_return", "u1"),
    ("unit_mm", "u1"),
    ("returns", "u1"),
    ("flags", "u1"),
]
_MODE: list[Any] = [("mode", "u1")]
_RPM: list[Any] = [("rpm", "<u2")]
_UTC: list[Any] = [("utc", "u1", 6)]
_MICROSECONDS: list[Any] = [("microseconds", "<u4")]
_FACTORY: list[Any] = [("factory", "u1")]
_SEQUENCE: list[Any] = [("sequence", "<u4")]
_TAIL = [("status", "u1", 8), *_RPM, *_MICROSECONDS, *_MODE, *_FACTORY, *_UTC]


def _blocks(
    blocks: int, lasers: int, unit_bytes: int, mark: list[Any] | None = None, fine: list[Any] | None = None
) -> list[Any]:
    """Return the field of the blocks of a packet; ``fine`` is a field after the azimuth."""
    unit: Any = {
        "names": ["distance", "intensity"],
        "formats": ["<u2", "u1"],
        "offsets": [0, 2],
        "itemsize": unit_bytes,
    }
    fields = [*(mark or []), ("azimuth", "<u2"), *(fine or []), ("units", np.dtype(unit), lasers)]
    return [("blocks", np.dtype(fields), blocks)]


def _by_length(*packets: list[Any]) -> Layouts:
    layouts = [np.dtype(fields) for fields in packets]
    return {layout.itemsize: layout for layout in layouts}


@cache
def pandar40_layouts() -> Layouts:
    """Return the layouts of a Pandar40P: with and without sequence number."""
    fields = [*_blocks(10, 40, 3, _MARK), *_TAIL]
    return _by_length(fields, [*fields, *_SEQUENCE])


@cache
def pandar64_layouts() -> Layouts:
    """Return the layouts of a Pandar64: with and without sequence number."""
    header = [*_MARK, *_HEADER[4:6], ("reserved", "u1"), ("unit_mm", "u1"), ("spare", "u1", 2)]
    fields = [*header, *_blocks(6, 64, 3), *_TAIL]
    return _by_length(fields, [*fields, *_SEQUENCE])


@cache
def pandarqt_layouts() -> Layouts:
    """Return the layout of a PandarQT."""
    tail = [("status", "u1", 10), *_TAIL[1:]]
    return _by_length([*_HEADER, *_blocks(4, 64, 4), *tail, *_SEQUENCE])


@cache
def xt_layouts(blocks: int, lasers: int) -> Layouts:
    """Return the layout of a PandarXT."""
    tail = [("status", "u1", 10), *_MODE, *_RPM, *_UTC, *_MICROSECONDS, *_FACTORY]
    return _by_length([*_HEADER, *_blocks(blocks, lasers, 4), *tail, *_SEQUENCE])


@cache
def mirror_layouts() -> Layouts:
    """Return the layouts of protocol 4.3: with and without sequence number and signature."""
    body = [*_HEADER, *_blocks(2, 128, 4, fine=[("fine", "u1")]), ("checksum", "<u4"), ("status", "u1", 18)]
    fields = [*body, *_TAIL[1:]]
    parts = product(([], _SEQUENCE), ([], [("signature", "u1", 32)]))
    return _by_length(*([*fields, *sequence, ("tail_checksum", "<u4"), *signature] for sequence, signature in parts))


@cache
def flagged_layouts(blocks: int, lasers: int) -> Layouts:
    """Return the layouts of protocols 1.4 and 3.2, whose packets have parts that flags announce.

    Lengths determine which parts there are: up to three bytes after distance and intensity, functional safety, sequence
    number, inertial measurements and signature.
    """
    tail = [
        ("status", "u1", 5),
        ("mode_flag", "u1"),
        ("more_status", "u1", 3),
        ("azimuth_state", "<u2"),
        ("operation", "u1"),
        *(_MODE + _RPM + _UTC + _MICROSECONDS + _FACTORY),
    ]
    parts: list[list[Any]] = [[("safety", "u1", 17)], _SEQUENCE, [("inertial", "u1", 22)], [("signature", "u1", 32)]]
    packets = []
    for unit_bytes, *present in product((3, 4, 5, 6), *([True, False] for _ in parts)):
        safety, sequence, inertial, signature = (
            part if is_there else [] for part, is_there in zip(parts, present, strict=True)
        )
        begin = [*_HEADER, *_blocks(blocks, lasers, unit_bytes), ("checksum", "<u4"), *safety, *tail]
        packets.append([*begin, *sequence, *inertial, ("tail_checksum", "<u4"), *signature])
    return _by_length(*packets)


def utc_ns(packets: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the time of each packet, shape (P,), in nanoseconds of Unix time.

    Notes
    -----
    The six bytes are year, month, day, hour, minute and second; years below 70 count from 2000, others from 1900. A
    first byte of 0 means that the last four are seconds of Unix time, big-endian.
    """
    utc = packets["utc"].astype(np.int64)
    year = utc[:, 0] + np.where(utc[:, 0] < 70, 2000, 1900)
    months = ((year - 1970) * 12 + utc[:, 1] - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]").astype(np.int64) + utc[:, 2] - 1
    civil = days * 86_400 + utc[:, 3] * 3600 + utc[:, 4] * 60 + utc[:, 5]
    counted = utc[:, 2:] @ np.array([1 << 24, 1 << 16, 1 << 8, 1])
    seconds = np.where(utc[:, 0] == 0, counted, civil)
    return np.asarray(seconds * 1_000_000_000 + packets["microseconds"].astype(np.int64) * 1000)
