"""Layouts and times of Hesai packets."""

from collections.abc import Mapping
from itertools import chain, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.packets import unix_seconds

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
_NONE: list[Any] = []
_STATUS = [("status", "u1", 8)]
_TAIL: list[Any] = [("rpm", "<u2"), ("microseconds", "<u4"), ("mode", "u1"), ("factory", "u1"), ("utc", "u1", 6)]
_LATE_TAIL = [_TAIL[at] for at in (2, 0, 4, 1, 3)]
_SEQUENCE, _CHECKSUM, _TAIL_CHECKSUM = [("sequence", "<u4")], [("checksum", "<u4")], [("tail_checksum", "<u4")]
_SIGNATURE = [("signature", "u1", 32)]


def _blocks(
    blocks: int, lasers: int, unit_bytes: int, mark: list[Any] | None = None, fine: list[Any] | None = None
) -> list[Any]:
    """Return the field of the blocks of a packet; ``fine`` is a field after the azimuth."""
    names, formats = ["distance", "intensity"], ["<u2", "u1"]
    unit: Any = {"names": names, "formats": formats, "offsets": [0, 2], "itemsize": unit_bytes}
    fields = [*(mark or []), ("azimuth", "<u2"), *(fine or []), ("units", np.dtype(unit), lasers)]
    return [("blocks", np.dtype(fields), blocks)]


def _layouts(*parts: list[Any] | tuple[list[Any], ...]) -> Layouts:
    """Return the layouts of packets of some parts; of a tuple, a packet has one of its alternatives."""
    choices = [part if isinstance(part, tuple) else (part,) for part in parts]
    layouts = [np.dtype(list(chain.from_iterable(packet))) for packet in product(*choices)]
    return {layout.itemsize: layout for layout in layouts}


PANDAR40 = _layouts(_blocks(10, 40, 3, _MARK), _STATUS, _TAIL, (_SEQUENCE, _NONE))
PANDAR64 = _layouts(
    [*_MARK, *_HEADER[4:6], ("reserved", "u1"), ("unit_mm", "u1"), ("spare", "u1", 2)],
    _blocks(6, 64, 3),
    _STATUS,
    _TAIL,
    (_SEQUENCE, _NONE),
)
PANDARQT = _layouts(_HEADER, _blocks(4, 64, 4), [("status", "u1", 10)], _TAIL, _SEQUENCE)
MIRRORS = _layouts(
    _HEADER,
    _blocks(2, 128, 4, fine=[("fine", "u1")]),
    _CHECKSUM,
    [("status", "u1", 18)],
    _TAIL,
    (_SEQUENCE, _NONE),
    _TAIL_CHECKSUM,
    (_SIGNATURE, _NONE),
)
"""Packets of protocol 4.3: with and without sequence number and signature."""
FLAGGED = _layouts(
    _HEADER,
    tuple(_blocks(2, 128, unit_bytes) for unit_bytes in (3, 4, 5, 6)),
    _CHECKSUM,
    ([("safety", "u1", 17)], _NONE),
    [("status", "u1", 5), ("mode_flag", "u1"), ("more_status", "u1", 3), ("azimuth_state", "<u2"), ("operation", "u1")],
    _LATE_TAIL,
    (_SEQUENCE, _NONE),
    ([("inertial", "u1", 22)], _NONE),
    _TAIL_CHECKSUM,
    (_SIGNATURE, _NONE),
)
"""Packets of protocols 1.4 and 3.2, which have parts that flags announce and that their lengths determine.

These are up to three bytes after distance and intensity, functional safety, sequence number, inertial measurements and
signature.
"""


def xt_layouts(blocks: int, lasers: int) -> Layouts:
    """Return the layout of a PandarXT."""
    return _layouts(_HEADER, _blocks(blocks, lasers, 4), [("status", "u1", 10)], _LATE_TAIL, _SEQUENCE)


def utc_ns(packets: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the time of each packet, shape (P,), in nanoseconds of Unix time.

    Notes
    -----
    The six bytes are year, month, day, hour, minute and second; years below 70 count from 2000, others from 1900. A
    first byte of 0 means that the last four are seconds of Unix time, big-endian.
    """
    utc = packets["utc"].astype(np.int64)
    civil = unix_seconds(utc[:, 0] + np.where(utc[:, 0] < 70, 2000, 1900), *utc[:, 1:].T)
    counted = utc[:, 2:] @ np.array([1 << 24, 1 << 16, 1 << 8, 1])
    seconds = np.where(utc[:, 0] == 0, counted, civil)
    return np.asarray(seconds * 1_000_000_000 + packets["microseconds"].astype(np.int64) * 1000)
