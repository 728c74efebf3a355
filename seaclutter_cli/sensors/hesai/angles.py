"""Angles of a Hesai sensor from the unit's angle correction file: text for rotors, binary for rotating mirrors."""

import csv
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.text import count

DEGREE = 25_600
"""Angles are in this part of a degree."""
_FINE = DEGREE // 100
_MARK = b"\xee\xff"
_HEADER_BYTES, _HASH_BYTES = 16, 32
_VERSION, _KNOWN_VERSION = 3, 5
_NODES = 180
_STEP = 360 * DEGREE // _NODES
_MIRRORS = range(2, 17)
_NOT_ANGLES = "{}: not a Hesai angle correction file (Laser id,Elevation,Azimuth): {}"


def parse_angles(data: bytes, name: str, channels: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return elevation and azimuth offset of each channel, shape (channels,), in degrees, from a correction file.

    It has lines of ``Laser id,Elevation,Azimuth`` in degrees, with channels numbered from 1; errors contain its name.
    `InputError` if it is another file, or does not list exactly these channels.
    """
    try:
        lines = data.decode("utf-8-sig").splitlines()
        rows = [row for row in csv.reader(lines) if row and row[0].strip().isdecimal()]
        angles = {int(row[0]): (float(row[1]), float(row[2])) for row in rows}
    except (UnicodeDecodeError, ValueError, IndexError, csv.Error) as error:
        raise InputError(_NOT_ANGLES.format(name, error)) from error
    if sorted(angles) != list(range(1, channels + 1)) or not np.isfinite(list(angles.values())).all():
        raise InputError(
            f"{name}: expected finite angles of channels 1 to {channels}, got {count(len(angles), 'channel')}"
        )
    table = np.array([angles[channel] for channel in sorted(angles)])
    return table[:, 0], table[:, 1]


@dataclass(frozen=True)
class MirrorAngles:
    """Angles of a sensor with M mirrors and C channels, as whole numbers in 1/25600 of a degree.

    A mirror has a field: a range of positions of the motor, from its start to the start of the next one. ``starts``,
    shape (M,), are ascending; offsets, shape (C, 180), are for every two degrees of the motor's position, in hundredths
    of a degree.
    """

    starts: NDArray[np.int64]
    elevation: NDArray[np.int64]
    azimuth: NDArray[np.int64]
    elevation_offsets: NDArray[np.int64]
    azimuth_offsets: NDArray[np.int64]

    def fields(self, positions: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the fields of positions, as numbers from 0 to M - 1; any shape."""
        return np.asarray((np.searchsorted(self.starts, positions, side="right") - 1) % len(self.starts))

    def turned(self, positions: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return how far beams are turned at positions, without the angles of channels; twice as far as the motor."""
        return np.asarray(2 * ((positions - self.starts[self.fields(positions)]) % (360 * DEGREE)))

    def directions(
        self, positions: NDArray[np.int64], channels: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return azimuth and elevation of points, shape (N,), from the motor's position and the channel of each."""
        node, rest = np.divmod(positions, _STEP)
        share = rest / _STEP
        azimuth, elevation = (
            _rounded((1 - share) * table[channels, node] + share * table[channels, (node + 1) % _NODES])
            for table in (self.azimuth_offsets, self.elevation_offsets)
        )
        return (
            self.turned(positions) - self.azimuth[channels] + azimuth * _FINE,
            self.elevation[channels] + elevation * _FINE,
        )


def _rounded(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the nearest whole numbers, of two the one further from 0."""
    return np.copysign(np.floor(np.abs(values) + 0.5), values).astype(np.int64)


def parse_corrections(data: bytes, name: str, channels: int) -> MirrorAngles:
    """Return the angles in a binary angle correction file, version 1.5; a prefix, as in a message, is skipped.

    Errors contain its name. `InputError` if it is another file, of another sensor, or damaged.
    """
    data = data[max(data.find(_MARK), 0) :]
    if len(data) < _HEADER_BYTES or not data.startswith(_MARK):
        raise InputError(f"{name}: not a binary angle correction file of Hesai (.dat or .bin)")
    if data[_VERSION] != _KNOWN_VERSION:
        raise InputError(f"{name}: angle corrections of version {data[2]}.{data[_VERSION]} are not supported, only 1.5")
    found, mirrors, unit = data[4], data[5], data[_HEADER_BYTES - 1]
    if found != channels or mirrors not in _MIRRORS or not unit:
        raise InputError(
            f"{name}: expected angles of {count(channels, 'channel')} and at least two mirrors, "
            f"got {count(found, 'channel')} and {count(mirrors, 'mirror')}"
        )
    end = _HEADER_BYTES + 8 * mirrors + (8 + 2 * _NODES) * channels
    if sha256(data[:end]).digest() != data[end : end + _HASH_BYTES]:
        raise InputError(f"{name}: the angle corrections are damaged (wrong SHA-256); read them from the sensor again")
    starts = np.frombuffer(data, "<u4", mirrors, _HEADER_BYTES).astype(np.int64)
    angles = np.frombuffer(data, "<i4", 2 * channels, _HEADER_BYTES + 8 * mirrors).astype(np.int64)
    offsets = np.frombuffer(data, "i1", 2 * channels * _NODES, end - 2 * channels * _NODES).astype(np.int64)
    azimuth, elevation = unit * angles.reshape(2, channels)
    azimuth_offsets, elevation_offsets = unit * offsets.reshape(2, channels, _NODES)
    positions = np.sort(unit * starts % (360 * DEGREE))
    return MirrorAngles(positions, elevation, azimuth, elevation_offsets, azimuth_offsets)
