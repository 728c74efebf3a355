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
_XT_FIELDS: list[Any] = [
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
_XT_PACKET = np.dtype(_XT_FIELDS)
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

_P64_BLOCK = np.dtype([("azimuth", "<u2"), ("units", _P40_UNIT, 64)])
_P64_FIELDS: list[Any] = [
    ("start", "u1", 2),
    ("lasers", "u1"),
    ("blocks_number", "u1"),
    ("returns", "u1"),
    ("unit_mm", "u1"),
    ("reserved", "u1", 2),
    ("blocks", _P64_BLOCK, 6),
    *_P40_FIELDS[1:],
]
_QT_BLOCK = np.dtype([("azimuth", "<u2"), ("units", _XT_UNIT, 64)])
_QT_PACKET = np.dtype(
    [
        *_XT_FIELDS[:9],
        ("blocks", _QT_BLOCK, 4),
        ("status", "u1", 10),
        ("rpm", "<u2"),
        ("microseconds", "<u4"),
        ("mode", "u1"),
        ("factory", "u1"),
        ("utc", "u1", 6),
        ("sequence", "<u4"),
    ]
)

# Microseconds between the end of a block and the firing of each channel.
_P40_FIRING = """
    42.22 28.47 16.04 3.62 45.49 31.74 47.46 54.67 20.62 33.71 40.91 8.19 20.62 27.16 50.73 8.19 14.74 36.98 45.49 52.70
    23.89 31.74 38.95 11.47 18.65 25.19 48.76 6.23 12.77 35.01 21.92 9.50 43.52 29.77 17.35 4.92 42.22 28.47 16.04 3.62
"""
_P40_ELEVATION = """
    15 11 8 5 3 2 1.67 1.33 1 0.67 0.33 0 -0.33 -0.67 -1 -1.33 -1.66 -2 -2.33 -2.67
    -3 -3.33 -3.67 -4 -4.33 -4.67 -5 -5.33 -5.67 -6 -7 -8 -9 -10 -11 -12 -13 -14 -19 -25
"""
_P64_FIRING = """
    23.18 21.876 20.572 19.268 17.964 16.66 11.444 46.796 7.532 36.956 50.732 54.668 40.892 44.828 31.052 34.988
    48.764 52.7 38.924 42.86 29.084 33.02 46.796 25.148 36.956 50.732 27.116 40.892 44.828 31.052 34.988 48.764
    25.148 38.924 42.86 29.084 33.02 52.7 6.228 54.668 15.356 27.116 10.14 23.18 4.924 21.876 14.052 17.964
    8.836 19.268 3.62 20.572 12.748 16.66 7.532 11.444 6.228 15.356 10.14 4.924 3.62 14.052 8.836 12.748
"""
_P64_ELEVATION = """
    14.708 10.858 7.885 4.883 2.866 1.854 1.686 1.514 1.348 1.177 1.01 0.839 0.672 0.501 0.334 0.163
    -0.005 -0.174 -0.343 -0.511 -0.682 -0.849 -1.019 -1.187 -1.358 -1.525 -1.696 -1.862 -2.034 -2.202 -2.372 -2.539
    -2.71 -2.874 -3.047 -3.214 -3.384 -3.549 -3.722 -3.886 -4.058 -4.224 -4.395 -4.559 -4.732 -4.894 -5.066 -5.231
    -5.403 -5.565 -5.739 -5.9 -6.072 -6.235 -7.237 -8.233 -9.234 -10.059 -11.206 -12.18 -13.148 -14.104 -19.063 -25.071
"""
_P64_AZIMUTH = [-1.042] * 6 + [1.042, 3.125, 5.208, -5.208, -3.125, -1.042] * 8 + [-1.042] * 10

# Microseconds from the beginning of a block to the firing of each channel.
_QT_FIRING = """
    2.31 4.37 6.43 8.49 10.54 12.6 14.66 16.71 19.16 21.22 23.28 25.34 27.39 29.45 31.5 33.56
    36.61 38.67 40.73 42.78 44.84 46.9 48.95 51.01 53.45 55.52 57.58 59.63 61.69 63.74 65.8 67.86
    70.9 72.97 75.02 77.08 79.14 81.19 83.25 85.3 87.75 89.82 91.87 93.93 95.98 98.04 100.1 102.15
    105.2 107.26 109.32 111.38 113.43 115.49 117.54 119.6 122.05 124.11 126.17 128.22 130.28 132.34 134.39 136.45
"""
_QT_ELEVATION = """
    -52.121 -49.785 -47.577 -45.477 -43.465 -41.528 -39.653 -37.831 -36.055 -34.32 -32.619 -30.95 -29.308 -27.69 -26.094
    -24.517 -22.964 -21.42 -19.889 -18.372 -16.865 -15.368 -13.88 -12.399 -10.925 -9.457 -7.994 -6.535 -5.079 -3.626
    -2.175 -0.725 0.725 2.175 3.626 5.079 6.534 7.993 9.456 10.923 12.397 13.877 15.365 16.861 18.368 19.885
    21.415 22.959 24.524 26.101 27.697 29.315 30.957 32.627 34.328 36.064 37.84 39.662 41.537 43.475 45.487 47.587
    49.795 52.133
"""
_QT_AZIMUTH = """
    8.736 8.314 7.964 7.669 7.417 7.198 7.007 6.838 6.688 6.554 6.434 6.326 6.228 6.14 6.059 5.987
    -5.27 -5.216 -5.167 -5.123 -5.083 -5.047 -5.016 -4.988 -4.963 -4.942 -4.924 -4.91 -4.898 -4.889 -4.884 -4.881
    5.493 5.496 5.502 5.512 5.525 5.541 5.561 5.584 5.611 5.642 5.676 5.716 5.759 5.808 5.862 5.921
    -5.33 -5.396 -5.469 -5.55 -5.64 -5.74 -5.85 -5.974 -6.113 -6.269 -6.447 -6.651 -6.887 -7.163 -7.493 -7.892
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
    first_block_ns : int, optional
        Time from the packet's time to its first firing, which is then the reference instead of the last one.
    is_experimental : bool, optional
        Whether neither real packets nor another decoder were available to check the decoder.
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
    first_block_ns: int | None = None
    is_experimental: bool = False

    def firings_ns(self, firings: int) -> NDArray[np.int64]:
        """Return the times of the firings in a packet relative to the packet's time, shape (firings,)."""
        times = self.block_ns * np.arange(firings, dtype=np.int64)
        return times + (self.last_block_ns - times[-1] if self.first_block_ns is None else self.first_block_ns)

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


def _is_p64(packets: NDArray[np.void]) -> NDArray[np.bool_]:
    numbers = (packets["lasers"] == 64) & (packets["blocks_number"] == 6) & (packets["unit_mm"] > 0)
    return np.asarray((packets["start"] == (0xEE, 0xFF)).all(axis=1) & numbers)


def _is_qt(packets: NDArray[np.void]) -> NDArray[np.bool_]:
    numbers = (packets["lasers"] == 64) & (packets["blocks_number"] == 4) & (packets["unit_mm"] > 0)
    return np.asarray(
        (packets["start"] == (0xEE, 0xFF)).all(axis=1) & (packets["version"] == (3, 1)).all(axis=1) & numbers
    )


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
    HesaiModel(
        name="Pandar64",
        packets=(np.dtype(_P64_FIELDS), np.dtype([*_P64_FIELDS, ("sequence", "<u4")])),
        block_ns=55_560,
        last_block_ns=-42_580,
        channel_ns=-np.rint(1000 * _numbers(_P64_FIRING)).astype(np.int64),
        elevation_deg=_numbers(_P64_ELEVATION),
        azimuth_deg=np.array(_P64_AZIMUTH),
        matches=_is_p64,
        is_experimental=True,
    ),
    HesaiModel(
        name="PandarQT",
        packets=(_QT_PACKET,),
        block_ns=166_667,
        last_block_ns=0,
        channel_ns=np.rint(1000 * _numbers(_QT_FIRING)).astype(np.int64),
        elevation_deg=_numbers(_QT_ELEVATION),
        azimuth_deg=_numbers(_QT_AZIMUTH),
        matches=_is_qt,
        first_block_ns=25_710,
        is_experimental=True,
    ),
)
"""Supported sensors. Times and angles are from their user manuals, those of Pandar64 and PandarQT from Hesai's SDK."""


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
