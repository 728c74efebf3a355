"""Layout and writers of RoboSense packets."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Ints
from seaclutter_cli.sensors.packets import unix_seconds
from seaclutter_cli.sensors.robosense.models import CLASSIC_ID, INFO_BYTES, RobosenseModel

VERTICAL_AT = 468
"""Offset of the vertical angles in device information."""
_MIN_ANGLE, ANGLE_LIMIT = -9000, 18000
_SIXTEEN = 16
_HALF_HEADER = 4
_MAX_S = 9_000_000_000
DATA_PORT, INFO_PORT = 6699, 7788
INFO_ID = bytes.fromhex("a5ff005a11115555")

_VERSIONS, _SERIAL, _CALIBRATED = bytes.fromhex("06020900000803010000"), bytes.fromhex("5ea000000001"), 0xC1

CHANNEL = np.dtype([("distance", ">u2"), ("intensity", "u1")])
CLASSIC_TIME = np.dtype([("date", "u1", (6,)), ("milliseconds", ">u2"), ("microseconds", ">u2")])
HELIOS_TIME = np.dtype([("high", ">u2"), ("low", ">u4"), ("microseconds", ">u4")])


def header_times(packets: NDArray[Any]) -> Ints:
    """Return the header times of data packets, shape (P,), in nanoseconds of UTC; 0 for invalid times."""
    time = packets["time"]
    if time.dtype == HELIOS_TIME:
        seconds = time["high"].astype(np.int64) << 32 | time["low"]
        return np.where(seconds < _MAX_S, seconds, 0) * 10**9 + time["microseconds"].astype(np.int64) * 1000
    year, month, day, hour, minute, second = time["date"].astype(np.int64).T
    seconds = unix_seconds(year + 2000, month, day, hour, minute, second)
    valid = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31) & (hour < 24) & (minute < 60) & (second <= 60)
    microseconds = time["milliseconds"].astype(np.int64) * 1000 + time["microseconds"]
    return np.where(valid & (seconds < _MAX_S), seconds * 10**9 + microseconds * 1000, 0)


@cache
def data_layout(model: RobosenseModel) -> np.dtype[Any]:
    """Return the layout of a data packet (MSOP); channels are raw bytes, which copy several times faster."""
    layout = model.format
    size = CHANNEL.itemsize * model.channels + (_HALF_HEADER if layout.has_halves else 0)
    block = np.dtype([("id", ">u2"), ("azimuth", ">u2"), ("channels", f"V{size}")])
    time = HELIOS_TIME if layout.is_utc else CLASSIC_TIME
    return np.dtype(
        {
            "names": ["id", "time", "temperature", "blocks"],
            "formats": ["S8", time, ("u1", (2,)), (block, (model.blocks,))],
            "offsets": [0, layout.time_at, layout.temperature_at, layout.begin],
            "itemsize": model.packet_bytes,
        }
    )


def channels(raw: NDArray[Any]) -> NDArray[Any]:
    """Return the channels of blocks, shape (B, C), structured, from their bytes, shape (B,)."""
    if raw.dtype.itemsize % CHANNEL.itemsize:  # the header of the second half lies between
        half = (raw.dtype.itemsize - _HALF_HEADER) // 2
        pieces = np.ascontiguousarray(raw).view(np.uint8).reshape(len(raw), -1)
        joined = np.concatenate([pieces[:, :half], pieces[:, half + _HALF_HEADER :]], axis=1)
        return joined.view(CHANNEL)
    return np.ascontiguousarray(raw).view(CHANNEL).reshape(len(raw), -1)


def temperature_degc(first: int, second: int, *, big_endian: bool) -> float:
    """Return the temperature in two bytes of a data packet, in degrees Celsius: a sign, and sixteenths."""
    size = (first & 0x7F) << 4 | second >> 4 if big_endian else (second & 0x7F) << 5 | first >> 3
    return (-size if (first if big_endian else second) & 0x80 else size) / 16


@dataclass(frozen=True)
class Angles:
    """Elevation and azimuth offset of each channel of a block, shape (C,), in hundredths of a degree."""

    vertical: Ints
    horizontal: Ints

    @property
    def rings(self) -> NDArray[np.uint16]:
        """Ring of each channel, shape (C,): the number of lasers with a lower elevation."""
        first, second = np.split(self.vertical, 2)
        lasers = first if np.array_equal(first, second) else self.vertical
        return np.searchsorted(np.sort(lasers), self.vertical).astype(np.uint16)


def make_angles(vertical: Ints, horizontal: Ints) -> Angles | None:
    """Return the angles of all channels of a block (those of 16 lasers repeat); None if an angle is out of range."""
    both = np.stack([vertical, horizontal])
    if ((both < _MIN_ANGLE) | (both >= ANGLE_LIMIT)).any():
        return None
    vertical, horizontal = np.tile(both, 2 if both.shape[1] == _SIXTEEN else 1)
    return Angles(vertical, horizontal)


@dataclass(frozen=True)
class Columns:
    """Measurements of a sensor by block: P packets of B blocks with C channels.

    Azimuths of blocks, shape (B P,), are in hundredths of a degree, clockwise seen from above. Distances, shape
    (B P, C), are in metres, 0 for no return. Times, shape (P,), are those of the first firing of each packet, in
    nanoseconds of Unix time.
    """

    azimuth: NDArray[Any]
    distance_m: NDArray[Any]
    intensity: NDArray[Any]
    times_ns: Ints


def write_data(model: RobosenseModel, columns: Columns) -> Bytes:
    """Return data packets, shape (P, L), with distances rounded to the unit of the model."""
    packets = np.zeros(len(columns.times_ns), data_layout(model))
    blocks = packets["blocks"]
    blocks["id"], blocks["azimuth"] = model.format.block_id[1], columns.azimuth.reshape(blocks.shape)
    units = np.rint(np.asarray(columns.distance_m, np.float64) / model.unit_m)
    measured = np.empty(units.shape, CHANNEL)
    measured["distance"], measured["intensity"] = np.clip(units, 0, 65535), columns.intensity
    blocks["channels"] = measured.view(blocks["channels"].dtype).reshape(blocks.shape)
    is_classic = model.format.id == CLASSIC_ID
    packets["id"] = CLASSIC_ID + bytes.fromhex("5aa550a0") if is_classic else model.format.id
    if model.format.is_utc:
        seconds, rest = np.divmod(columns.times_ns, 10**9)
        packets["time"]["high"], packets["time"]["low"] = seconds >> 32, seconds & 0xFFFFFFFF
        packets["time"]["microseconds"] = rest // 1000
    else:
        times_ns = columns.times_ns
        time, moments = packets["time"], (times_ns // 10**9).astype("datetime64[s]").tolist()
        time["date"] = [(one.year - 2000, one.month, one.day, one.hour, one.minute, one.second) for one in moments]
        time["milliseconds"], time["microseconds"] = times_ns // 10**6 % 1000, times_ns // 1000 % 1000
    return packets.view(np.uint8).reshape(-1, model.packet_bytes)


def write_info(model: RobosenseModel, angles: Angles) -> Bytes:
    """Return a device information packet (DIFOP), shape (1248,), of a sensor with 600 rpm and one return."""
    packet = np.zeros(INFO_BYTES, np.uint8)
    ports = DATA_PORT.to_bytes(2, "big") * 2 + INFO_PORT.to_bytes(2, "big") * 2
    pieces = {0: INFO_ID, 8: (600).to_bytes(2, "big"), 24: ports, 34: (36000).to_bytes(2, "big")}
    pieces |= {40: _VERSIONS, 291: bytes((_CALIBRATED,)), 292: _SERIAL, 300: b"\1"}
    for offset, piece in pieces.items():
        packet[offset : offset + len(piece)] = np.frombuffer(piece, np.uint8)
    if model.name == "RS-LiDAR-16":
        values = np.abs(angles.vertical[: model.lasers]) * 100
        packet[1165:1213] = np.stack([values >> 16, values >> 8 & 255, values & 255], 1).astype(np.uint8).reshape(-1)
        return packet
    for begin, values in ((VERTICAL_AT, angles.vertical), (model.format.horizontal_at, angles.horizontal)):
        units = np.rint(values[: model.lasers] / model.angle_unit).astype(np.int64)
        size = np.abs(units)
        signed = np.stack([units < 0, size >> 8, size & 255], 1).astype(np.uint8)
        packet[begin : begin + 3 * model.lasers] = signed.reshape(-1)
    return packet
