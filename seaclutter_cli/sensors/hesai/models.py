"""Supported Hesai sensors: packet layouts, angles and firing times."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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

_XT_UNIT = np.dtype([("distance", "<u2"), ("intensity", "u1"), ("confidence", "u1")])
_XT_BLOCK = np.dtype([("azimuth", "<u2"), ("units", _XT_UNIT, 32)])
_XT_PACKET = np.dtype(
    [
        ("start", "u1", 2),
        ("version", "u1", 2),
        ("reserved", "u1", 2),
        ("lasers", "u1"),
        ("blocks_number", "u1"),
        ("first_return", "u1"),
        ("unit_mm", "u1"),
        ("returns", "u1"),
        ("flags", "u1"),
        ("blocks", _XT_BLOCK, 8),
        ("status", "u1", 10),
        ("mode", "u1"),
        ("rpm", "<u2"),
        ("utc", "u1", 6),
        ("microseconds", "<u4"),
        ("factory", "u1"),
        ("sequence", "<u4"),
    ]
)
_P40_UNIT = np.dtype([("distance", "<u2"), ("intensity", "u1")])
_P40_BLOCK = np.dtype([("start", "u1", 2), ("azimuth", "<u2"), ("units", _P40_UNIT, 40)])
_P40_FIELDS: list[Any] = [
    ("blocks", _P40_BLOCK, 10),
    ("status", "u1", 8),
    ("rpm", "<u2"),
    ("microseconds", "<u4"),
    ("mode", "u1"),
    ("factory", "u1"),
    ("utc", "u1", 6),
]

# Microseconds between the end of a block and the firing of each channel.
_P40_FIRING = """
    42.22 28.47 16.04 3.62 45.49 31.74 47.46 54.67 20.62 33.71 40.91 8.19 20.62 27.16 50.73 8.19 14.74 36.98 45.49 52.70
    23.89 31.74 38.95 11.47 18.65 25.19 48.76 6.23 12.77 35.01 21.92 9.50 43.52 29.77 17.35 4.92 42.22 28.47 16.04 3.62
"""
_P40_ELEVATION = """
    15 11 8 5 3 2 1.67 1.33 1 0.67 0.33 0 -0.33 -0.67 -1 -1.33 -1.66 -2 -2.33 -2.67
    -3 -3.33 -3.67 -4 -4.33 -4.67 -5 -5.33 -5.67 -6 -7 -8 -9 -10 -11 -12 -13 -14 -19 -25
"""
_P40_AZIMUTH = [-1.042] * 6 + [3.125, -5.208, -1.042] * 8 + [-1.042] * 10


@dataclass(frozen=True)
class HesaiModel:
    """A Hesai sensor with C channels. Each block in a packet contains one firing or one return.

    Parameters
    ----------
    name : str
        Name as in `SENSORS`.
    packets : tuple of dtype
        Packet layouts, distinguished by length.
    block_ns, last_block_ns : int
        Time between two firings of all channels, and from the packet's time to its last firing, in nanoseconds.
    channel_ns : ndarray, shape (C,)
        Firing time of each channel relative to its block, in nanoseconds.
    elevation_deg, azimuth_deg : ndarray, shape (C,)
        Nominal angles; azimuths are offsets from the azimuth of the block.
    matches : callable
        Returns which packets, shape (P,), come from this sensor.
    """

    name: str
    packets: tuple[np.dtype[Any], ...]
    block_ns: int
    last_block_ns: int
    channel_ns: NDArray[np.int64]
    elevation_deg: NDArray[np.float64]
    azimuth_deg: NDArray[np.float64]
    matches: Callable[[NDArray[np.void]], NDArray[np.bool_]]

    def layout(self, length: int) -> np.dtype[Any] | None:
        """Return the layout of packets of ``length`` bytes; None if no packet of the sensor has this length."""
        return next((packet for packet in self.packets if packet.itemsize == length), None)

    def unit_m(self, packets: NDArray[np.void]) -> NDArray[np.float64]:
        """Return the distance unit of each packet, shape (P,), in metres."""
        if "unit_mm" in (packets.dtype.names or ()):
            return np.asarray(packets["unit_mm"] / 1000.0)
        return np.full(len(packets), 0.004)


def _is_xt32(packets: NDArray[np.void]) -> NDArray[np.bool_]:
    numbers = (packets["lasers"] == 32) & (packets["blocks_number"] == 8) & (packets["unit_mm"] > 0)
    return np.asarray((packets["start"] == (0xEE, 0xFF)).all(axis=1) & (packets["version"][:, 0] == 6) & numbers)


def _is_p40(packets: NDArray[np.void]) -> NDArray[np.bool_]:
    return np.asarray((packets["blocks"]["start"] == (0xFF, 0xEE)).all(axis=(1, 2)))


def _numbers(text: str) -> NDArray[np.float64]:
    return np.array(text.split(), np.float64)


MODELS = (
    HesaiModel(
        name="PandarXT-32",
        packets=(_XT_PACKET,),
        block_ns=50_000,
        last_block_ns=5_632,
        channel_ns=368 + 1512 * np.arange(32, dtype=np.int64),
        elevation_deg=np.linspace(15, -16, 32),
        azimuth_deg=np.zeros(32),
        matches=_is_xt32,
    ),
    HesaiModel(
        name="Pandar40P",
        packets=(np.dtype(_P40_FIELDS), np.dtype([*_P40_FIELDS, ("sequence", "<u4")])),
        block_ns=55_560,
        last_block_ns=-28_580,
        channel_ns=-np.rint(1000 * _numbers(_P40_FIRING)).astype(np.int64),
        elevation_deg=_numbers(_P40_ELEVATION),
        azimuth_deg=np.array(_P40_AZIMUTH),
        matches=_is_p40,
    ),
)
"""Supported sensors. Times and angles are from their user manuals."""


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
