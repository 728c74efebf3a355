"""Layout and writers of RoboSense packets."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.robosense.angles import Angles
from seaclutter_cli.sensors.robosense.models import BLOCKS, CHANNELS, CLASSIC_ID, RobosenseModel

PACKET_BYTES = 1248
DATA_PORT, INFO_PORT = 6699, 7788
INFO_ID = bytes.fromhex("a5ff005a11115555")
NO_BLOCK = 65535
"""Invalid azimuth for blocks to leave out of a packet."""

CHANNEL = np.dtype([("distance", ">u2"), ("intensity", "u1")])
BLOCK = np.dtype([("id", ">u2"), ("azimuth", ">u2"), ("channels", "V96")])
"""A block. Its channels are raw bytes, which copy several times faster; see `channels`."""
CLASSIC_TIME = np.dtype([("date", "u1", (6,)), ("milliseconds", ">u2"), ("microseconds", ">u2")])
HELIOS_TIME = np.dtype([("high", ">u2"), ("low", ">u4"), ("microseconds", ">u4")])
DATA: np.dtype[Any] = np.dtype(
    {
        "names": ["id", "classic_time", "helios_time", "temperature", "blocks"],
        "formats": ["S8", CLASSIC_TIME, HELIOS_TIME, ("u1", (2,)), (BLOCK, (BLOCKS,))],
        "offsets": [0, 20, 20, 38, 42],
        "itemsize": PACKET_BYTES,
    }
)
"""A data packet (MSOP)."""
BLOCK_ID = 0xFFEE


def channels(raw: NDArray[Any]) -> NDArray[Any]:
    """Return the channels of blocks, shape (B, 32), structured, from their bytes, shape (B,)."""
    return np.ascontiguousarray(raw).view(CHANNEL).reshape(-1, CHANNELS)


def temperatures_degc(packets: NDArray[Any]) -> NDArray[np.float64]:
    """Return the temperature in each data packet, shape (P,), in degrees Celsius.

    Examples
    --------
    >>> packets = np.zeros(2, DATA)
    >>> packets["temperature"] = (0x18, 0x01), (0x18, 0x81)
    >>> temperatures_degc(packets)
    array([ 2.1875, -2.1875])
    """
    low, high = packets["temperature"].astype(np.int64).T
    sixteenths = (high & 0x7F) << 5 | low >> 3
    return np.asarray(np.where(high & 0x80, -sixteenths, sixteenths) / 16)


@dataclass(frozen=True)
class Columns:
    """Measurements of a sensor by block: P packets of 12 blocks.

    Parameters
    ----------
    azimuth : ndarray, shape (12 P,), integer
        Azimuth of each block in hundredths of a degree, clockwise seen from above; or `NO_BLOCK`.
    distance_m : ndarray, shape (12 P, 32)
        Distance of each channel in metres; 0 for no return.
    intensity : ndarray, shape (12 P, 32), uint8
        Intensity of each channel.
    times_ns : ndarray, shape (P,), int64
        Unix time of the first firing of each packet.
    """

    azimuth: NDArray[Any]
    distance_m: NDArray[Any]
    intensity: NDArray[Any]
    times_ns: NDArray[np.int64]


def write_data(model: RobosenseModel, columns: Columns) -> NDArray[np.uint8]:
    """Return data packets, shape (P, 1248), with distances rounded to the unit of the model."""
    packets = np.zeros(len(columns.times_ns), DATA)
    blocks = packets["blocks"].reshape(-1)
    missing = columns.azimuth == NO_BLOCK
    blocks["id"] = np.where(missing, 0, BLOCK_ID)
    blocks["azimuth"] = np.where(missing, 0, columns.azimuth)
    units = np.rint(np.asarray(columns.distance_m, np.float64) / model.unit_m)
    measured = np.empty(units.shape, CHANNEL)
    measured["distance"], measured["intensity"] = np.clip(units, 0, 65535), columns.intensity
    blocks["channels"] = measured.view("V96")[:, 0]
    packets["blocks"] = blocks.reshape(packets["blocks"].shape)
    payloads = packets.view(np.uint8).reshape(-1, PACKET_BYTES)
    if model.header == CLASSIC_ID:
        _write_classic_time(packets, columns.times_ns)
        packets["id"] = CLASSIC_ID + bytes.fromhex("5aa550a0")
    else:
        seconds, rest = np.divmod(columns.times_ns, 10**9)
        packets["helios_time"]["high"], packets["helios_time"]["low"] = seconds >> 32, seconds & 0xFFFFFFFF
        packets["helios_time"]["microseconds"] = rest // 1000
        packets["id"] = model.header
    return payloads


def _write_classic_time(packets: NDArray[Any], times_ns: NDArray[np.int64]) -> None:
    microseconds = (times_ns // 1000).astype("datetime64[us]")
    day, month = microseconds.astype("datetime64[D]"), microseconds.astype("datetime64[M]")
    time, date = packets["classic_time"], packets["classic_time"]["date"]
    date[:, 0] = month.astype("datetime64[Y]").astype(int) - 30
    date[:, 1] = month.astype(int) % 12 + 1
    date[:, 2] = (day - month).astype(int) + 1
    seconds = times_ns // 10**9 % 86400
    for index, (size, count) in enumerate(((3600, 24), (60, 60), (1, 60)), 3):
        date[:, index] = seconds // size % count
    time["milliseconds"], time["microseconds"] = times_ns // 10**6 % 1000, times_ns // 1000 % 1000


@dataclass(frozen=True)
class DeviceSettings:
    """Settings in a device information packet.

    Parameters
    ----------
    rpm : int
        Revolutions per minute.
    fov : tuple of int
        Start and end of the field of view, in hundredths of a degree.
    return_mode : int
        Mode number of the model; 0 for two returns.
    versions : tuple of bytes
        Firmware versions of the top and the bottom board, five bytes each.
    intensity_mode : int
        0xC1 if the sensor calibrates its intensities.
    serial : bytes
        Serial number, six bytes.
    """

    rpm: int = 600
    fov: tuple[int, int] = (0, 36000)
    return_mode: int = 1
    versions: tuple[bytes, bytes] = (bytes((6, 2, 9, 0, 0)), bytes((8, 3, 1, 0, 0)))
    intensity_mode: int = 0xC1
    serial: bytes = bytes.fromhex("5ea000000001")


def write_info(
    model: RobosenseModel, angles: Angles | None, settings: DeviceSettings | None = None
) -> NDArray[np.uint8]:
    """Return a device information packet (DIFOP), shape (1248,); without angles, its tables are unprogrammed."""
    settings = settings or DeviceSettings()
    packet = np.zeros(PACKET_BYTES, np.uint8)
    start, end = settings.fov
    pieces = {0: INFO_ID, 40: settings.versions[0], 45: settings.versions[1], 292: settings.serial}
    pieces |= {offset: number.to_bytes(2, "big") for offset, number in ((8, settings.rpm), (32, start), (34, end))}
    pieces[24] = DATA_PORT.to_bytes(2, "big") * 2 + INFO_PORT.to_bytes(2, "big") * 2
    for offset, piece in pieces.items():
        packet[offset : offset + len(piece)] = np.frombuffer(piece, np.uint8)
    packet[300], packet[291] = settings.return_mode, settings.intensity_mode
    if angles is None:
        packet[468:660] = packet[1165:1213] = 0xFF
    elif model.lasers == CHANNELS:
        factor = 1 if model.name == "RS-Helios" else 10
        packet[468:564] = _signed(angles.vertical * factor)
        packet[564:660] = _signed(angles.horizontal * factor)
    else:
        values = np.abs(angles.vertical[: model.lasers]) * 100
        packet[1165:1213] = np.stack([values >> 16, values >> 8 & 255, values & 255], 1).astype(np.uint8).reshape(-1)
    return packet


def _signed(values: NDArray[np.int64]) -> NDArray[np.uint8]:
    size = np.abs(values)
    return np.stack([values < 0, size >> 8, size & 255], 1).astype(np.uint8).reshape(-1)
