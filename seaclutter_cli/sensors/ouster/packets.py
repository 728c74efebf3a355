"""Packets of Ouster sensors: layouts and validity."""

from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.packets import view_packets

_MAX_COLUMNS = 4096


@dataclass(frozen=True)
class Profile:
    """Layout of the pixels in a column; each return has a range, in the bits of a mask, and an intensity."""

    pixel: np.dtype[Any]
    ranges: tuple[str, ...]
    intensities: tuple[str, ...]
    range_mask: int
    range_unit_mm: int = 1
    has_signal: bool = True


def _pixel(size: int, **fields: tuple[str, int]) -> np.dtype[Any]:
    formats, offsets = zip(*fields.values(), strict=True)
    return np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": size})


_SINGLE = _pixel(12, range=("<u4", 0), signal=("<u2", 6))
PROFILES = {
    "LEGACY": Profile(_SINGLE, ("range",), ("signal",), 0xFFFFF),
    "RNG19_RFL8_SIG16_NIR16": Profile(_SINGLE, ("range",), ("signal",), 0x7FFFF),
    "RNG19_RFL8_SIG16_NIR16_DUAL": Profile(
        _pixel(16, range=("<u4", 0), range2=("<u4", 4), signal=("<u2", 8), signal2=("<u2", 10)),
        ("range", "range2"),
        ("signal", "signal2"),
        0x7FFFF,
    ),
    "RNG15_RFL8_NIR8": Profile(
        _pixel(4, range=("<u2", 0), reflectivity=("u1", 2)),
        ("range",),
        ("reflectivity",),
        0x7FFF,
        range_unit_mm=8,
        has_signal=False,
    ),
}
"""Profiles by name."""


@cache
def packet_layout(profile: str, rows: int, columns: int) -> np.dtype[Any]:
    """Return the layout of packets with the given numbers of columns and rows."""
    pixels = ("pixels", PROFILES[profile].pixel, rows)
    if profile == "LEGACY":
        head = [("time_ns", "<u8"), ("id", "<u2"), ("frame", "<u2"), ("encoder", "<u4")]
        column = np.dtype([*head, pixels, ("status", "<u4")])
        return np.dtype([("columns", column, columns)])
    column = np.dtype([("time_ns", "<u8"), ("id", "<u2"), ("status", "<u2"), pixels])
    top: list[Any] = [("type", "<u2"), ("frame", "<u2"), ("alerts", "u1", 3), ("serial", "u1", 5), ("state", "u1", 20)]
    return np.dtype([*top, ("columns", column, columns), ("footer", "u1", 32)])


def frame_ids(packets: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the frame id of each packet, shape (P,), a 16-bit counter that wraps around."""
    numbers = packets["frame"] if "frame" in (packets.dtype.names or ()) else packets["columns"]["frame"][:, 0]
    return np.asarray(numbers, np.int64)


def valid_columns(packets: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return which columns of packets, shape (P, C), contain measurements."""
    status = packets["columns"]["status"]
    return np.asarray(status == 0xFFFFFFFF if status.dtype.itemsize == 4 else status & 1 == 1)


def first_columns(packets: NDArray[np.void]) -> NDArray[np.int64]:
    """Return the id of the first column of each packet, shape (P,), according to its first valid column."""
    at = valid_columns(packets).argmax(axis=1)
    return np.asarray(packets["columns"]["id"][np.arange(len(packets)), at].astype(np.int64) - at)


def valid_packets(packets: NDArray[np.void], columns: int) -> NDArray[np.bool_]:
    """Return which packets, shape (P,), are valid: consecutive ids among all columns, measured within one second."""
    ids = packets["columns"]["id"].astype(np.int64)
    count = ids.shape[1]
    valid = valid_columns(packets)
    valid |= ~valid.any(axis=1, keepdims=True)
    first = (ids - np.arange(count))[np.arange(len(ids)), valid.argmax(axis=1)]
    intact = (((ids - np.arange(count)) == first[:, None]) | ~valid).all(axis=1)
    intact &= (first >= 0) & (first % count == 0) & (first + count <= columns)
    times_ns = packets["columns"]["time_ns"]
    start_ns = times_ns[np.arange(len(ids)), valid.argmax(axis=1), None]
    intact &= ((times_ns - start_ns <= 1_000_000_000) | ~valid).all(axis=1) & (start_ns[:, 0] < 1 << 62)
    if "type" in (packets.dtype.names or ()):
        intact &= packets["type"] == 1
    return np.asarray(intact)


def serial_number(packet: NDArray[np.void]) -> str | None:
    """Return the serial number in a packet, a scalar of `packet_layout`; None if it contains none."""
    if "serial" not in (packet.dtype.names or ()):
        return None
    return str(int.from_bytes(packet["serial"].tobytes(), "little"))


def is_data_packet(payload: NDArray[np.uint8]) -> bool:
    """Return whether a payload, shape (L,), is a data packet of any sensor and profile."""
    for shape in product(PROFILES, (128, 64, 32, 16), (16, 8, 4)):
        layout = packet_layout(*shape)
        if layout.itemsize == len(payload):
            packet = view_packets(payload[None], layout)
            if valid_packets(packet, _MAX_COLUMNS)[0] and valid_columns(packet).any():
                return True
    return False
