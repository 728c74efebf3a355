"""Ways in which Hesai sensors scan: what a frame is, and the directions of beams, from the unit's angles.

A scan numbers the frames of firings: of P packets with F firings and C channels. `RotorScan` says what its methods do.
"""

import csv
from hashlib import sha256
from pathlib import Path

import numpy as np

from seaclutter_cli.arrays import Floats, Ints, Rows
from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.hesai.models import HesaiModel
from seaclutter_cli.sensors.packets import DecoderOptions
from seaclutter_cli.text import count

FULL_CIRCLE = 36_000
"""Hundredths of a degree in a revolution."""
_EDGE = 100
_MAX_GAP_NS = 10_000_000_000
_DEGREE = 25_600
"""Angles of mirrors are in this part of a degree."""
_FINE = _DEGREE // 100
_TURN_NS = 300_000_000
_FIRST_DEG, _LAST_DEG = 32, 148
_MARK = b"\xee\xff"
_HEADER_BYTES, _HASH_BYTES = 16, 32
_VERSION, _KNOWN_VERSION = 3, 5
_NODES = 180
_STEP = 360 * _DEGREE // _NODES
_MIRRORS = range(2, 17)

Directions = tuple[Floats, Floats, Floats]
"""Azimuth in radians, cosine and sine of the elevation of N points."""


class RotorScan:
    """Scan of a rotor: a frame is a revolution, positions are azimuths in hundredths of a degree.

    Azimuths are unwrapped with the clock and the motor speed, so jitter, late packets and gaps longer than a revolution
    do not disturb the count. The first packet determines the direction of rotation, or the first two firings. Channels
    have an elevation and an offset from the azimuth of the rotor, shape (C,), in degrees; a channel enters the next
    revolution when it crosses azimuth 0 itself.
    """

    def __init__(self, elevation_deg: Floats, azimuth_deg: Floats) -> None:
        self._azimuth_deg, self._offsets = azimuth_deg, azimuth_deg * 100
        self._cos, self._sin = np.cos(np.radians(elevation_deg)), np.sin(np.radians(elevation_deg))
        self._sign = 0
        self._knows_direction = False
        self._azimuth = self._time_ns = self._first = self._angle = self._top = 0

    def positions(self, blocks: Rows) -> Ints:
        """Return the position of the motor in blocks, any shape, in the unit of the scan."""
        return np.asarray(blocks["azimuth"].astype(np.int64))

    def count(self, positions: Ints, times_ns: Ints, rpm: Ints) -> Ints:
        """Return the number of the frame of each firing and channel, shape (P, F, C), at least `done`.

        Positions of the motor and times of firings have the shape (P, F); the motor speed of each packet, shape (P,),
        is in revolutions per minute, 0 if unknown.
        """
        if not self._knows_direction:
            self._begin(positions, int(times_ns[0, 0]))
        waits_ns = np.clip(np.diff(times_ns.ravel(), prepend=self._time_ns), 0, _MAX_GAP_NS)
        speeds = np.repeat(np.where(rpm > 0, rpm, 600) * (FULL_CIRCLE / 60e9), positions.shape[1])
        steps = self._sign * np.diff(positions.ravel(), prepend=self._azimuth) % FULL_CIRCLE
        steps += FULL_CIRCLE * np.rint((waits_ns * speeds - steps) / FULL_CIRCLE).astype(np.int64)
        angles = self._angle + np.cumsum(steps)
        tops = np.maximum(np.maximum.accumulate(angles), self._top)
        self._azimuth, self._time_ns = int(positions[-1, -1]), int(times_ns[-1, -1])
        self._angle, self._top = int(angles[-1]), int(tops[-1])
        revolutions = np.floor((angles[:, None] + self._sign * self._offsets) / FULL_CIRCLE).astype(np.int64)
        completed = np.floor((tops + (self._sign * self._offsets).min()) / FULL_CIRCLE).astype(np.int64)
        return np.asarray(np.maximum(revolutions, completed[:, None]).reshape(*positions.shape, -1))

    def directions(self, positions: Ints, firings: Ints, channels: Ints) -> Directions:
        """Return the directions of points, given the position in each of F firings, and firing and channel of each."""
        azimuths = np.radians(positions / 100)[firings] + np.radians(self._azimuth_deg)[channels]
        return azimuths, self._cos[channels], self._sin[channels]

    @property
    def done(self) -> int:
        """Number of the first incomplete frame."""
        return int((self._top + (self._sign * self._offsets).min()) // FULL_CIRCLE)

    def is_partial(self, frame: int) -> bool:
        """Return whether the firings so far begin or end within a frame, by more than 1° in any channel."""
        late = self._first + (self._sign * self._offsets).max() > frame * FULL_CIRCLE + _EDGE
        early = self._top + (self._sign * self._offsets).min() < (frame + 1) * FULL_CIRCLE - _EDGE
        return bool(late or early)

    def skip(self) -> None:
        """Start a new frame although the motor has not reached it."""
        self._angle += FULL_CIRCLE
        self._top = max(self._top, self._angle)

    def _begin(self, azimuths: Ints, time_ns: int) -> None:
        """Set the direction and the start azimuth from the first packets, shape (P, F)."""
        first = azimuths[0]
        if self._sign or len(first) == 1:  # packets with one firing show no direction by themselves
            flat = azimuths.ravel() if self._sign == 0 else np.append(self._azimuth, azimuths)
            first = np.append(flat[0], flat[flat != flat[0]][:1])
        steps = (np.diff(first) + FULL_CIRCLE // 2) % FULL_CIRCLE - FULL_CIRCLE // 2
        self._knows_direction = len(first) > 1
        self._sign, before = -1 if steps.sum() < 0 else 1, self._sign
        if before == 0:
            self._azimuth, self._time_ns = int(first[0]), time_ns
        if before != self._sign:
            self._first = self._angle = self._top = self._sign * self._azimuth % FULL_CIRCLE


class MirrorScan:
    """Scan of rotating mirrors: a frame is one mirror's field, positions are those of the motor in 1/25600 of a degree.

    Fields are counted with the clock, so that late packets and gaps longer than a turn do not disturb the count. A
    field of M is a range of positions, from its start to that of the next one; ``starts``, shape (M,), are ascending.
    ``angles``, shape (2, C), are azimuth and elevation of channels, all in 1/25600 of a degree; their ``offsets``,
    shape (2, C, 180), are for every two degrees of the motor's position, in hundredths of a degree.
    """

    def __init__(self, starts: Ints, angles: Ints, offsets: Ints) -> None:
        self._starts, self._angles, self._offsets = starts, angles, offsets
        self._position = self._first = self._time_ns = -1
        self._number = self.done = 0

    def positions(self, blocks: Rows) -> Ints:
        """Return the positions of the motor in blocks."""
        return np.asarray(blocks["azimuth"].astype(np.int64) * _FINE + blocks["fine"])

    def count(self, positions: Ints, times_ns: Ints, _rpm: Ints) -> Ints:
        """Return the field of each firing and channel, as `RotorScan.count`; the mirrors have one speed."""
        if self._first < 0:
            self._first = self._position = int(positions[0, 0])
            self._time_ns = int(times_ns[0, 0])
        mirrors, fields = len(self._starts), self._fields(positions.ravel())
        before = int(self._fields(np.array(self._position)))
        waits_ns = np.clip(np.diff(times_ns.ravel(), prepend=self._time_ns), 0, None)
        steps = np.diff(fields, prepend=before) % mirrors
        steps += mirrors * np.rint(waits_ns / _TURN_NS - steps / mirrors).astype(np.int64)
        numbers = self._number + np.cumsum(steps)
        tops = np.maximum(np.maximum.accumulate(numbers), self.done)
        self._number, self.done = int(numbers[-1]), int(tops[-1])
        self._position, self._time_ns = int(positions[-1, -1]), int(times_ns[-1, -1])
        # A late firing of an earlier field belongs to the present one, as that field is complete.
        shape = (*positions.shape, self._angles.shape[1])
        return np.broadcast_to(tops.reshape(positions.shape)[..., None], shape)

    def directions(self, positions: Ints, firings: Ints, channels: Ints) -> Directions:
        """Return the directions of points, as `RotorScan.directions`."""
        at = positions[firings]
        node, rest = np.divmod(at, _STEP)
        share = rest / _STEP
        between = (
            (1 - share) * table[channels, node] + share * table[channels, (node + 1) % _NODES]
            for table in self._offsets
        )
        azimuth, elevation = (np.copysign(np.floor(np.abs(one) + 0.5), one).astype(np.int64) for one in between)
        azimuths = np.radians((self._turned(at) - self._angles[0, channels] + azimuth * _FINE) / _DEGREE)
        elevations = np.radians((self._angles[1, channels] + elevation * _FINE) / _DEGREE)
        return azimuths, np.cos(elevations), np.sin(elevations)

    def is_partial(self, frame: int) -> bool:
        """Return whether the firings so far begin or end within a field, between azimuths of 32 and 148 degrees."""
        first, last = self._turned(np.array([self._first, self._position])) / _DEGREE
        return bool((frame == 0 and first > _FIRST_DEG) or (frame == self.done and last < _LAST_DEG))

    def skip(self) -> None:
        """Start a new frame in the same field."""
        self._number = self.done = self.done + 1

    def _fields(self, positions: Ints) -> Ints:
        """Return the fields of positions, as numbers from 0 to M - 1; any shape."""
        return np.asarray((np.searchsorted(self._starts, positions, side="right") - 1) % len(self._starts))

    def _turned(self, positions: Ints) -> Ints:
        """Return how far beams are turned at positions, without the angles of channels; twice as far as the motor."""
        return np.asarray(2 * ((positions - self._starts[self._fields(positions)]) % (360 * _DEGREE)))


Scan = RotorScan | MirrorScan


def make_scan(model: HesaiModel, options: DecoderOptions) -> tuple[Scan, str]:
    """Return the scan of a sensor, and where its angles are from; `InputError` if they are missing or wrong."""
    if options.unit is None:
        if not model.has_mirrors:
            return RotorScan(*model.angles_deg), "nominal"
        raise InputError(
            f"{model.name}: the angles of the unit are needed; pass its angle correction file (.dat) with --calibration"
        )
    data, name = options.unit
    if model.has_mirrors:
        return parse_corrections(data, name, model.channels), Path(name).name
    return RotorScan(*parse_angles(data, name, model.channels)), Path(name).name


def parse_angles(data: bytes, name: str, channels: int) -> tuple[Floats, Floats]:
    """Return elevation and azimuth offset of each channel, shape (channels,), in degrees, from a correction file.

    It has lines of ``Laser id,Elevation,Azimuth`` in degrees, with channels numbered from 1; errors contain its name.
    `InputError` if it is another file, or does not list exactly these channels.
    """
    try:
        lines = data.decode("utf-8-sig").splitlines()
        rows = [row for row in csv.reader(lines) if row and row[0].strip().isdecimal()]
        angles = {int(row[0]): (float(row[1]), float(row[2])) for row in rows}
    except (UnicodeDecodeError, ValueError, IndexError, csv.Error) as error:
        raise InputError(f"{name}: not a Hesai angle correction file (Laser id,Elevation,Azimuth): {error}") from error
    if sorted(angles) != list(range(1, channels + 1)) or not np.isfinite(list(angles.values())).all():
        raise InputError(
            f"{name}: expected finite angles of channels 1 to {channels}, got {count(len(angles), 'channel')}"
        )
    table = np.array([angles[channel] for channel in sorted(angles)])
    return table[:, 0], table[:, 1]


def parse_corrections(data: bytes, name: str, channels: int) -> "MirrorScan":
    """Return the scan of a binary angle correction file, version 1.5; `InputError` if it is not one of this sensor."""
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
    positions = np.sort(unit * starts % (360 * _DEGREE))
    return MirrorScan(positions, unit * angles.reshape(2, channels), unit * offsets.reshape(2, channels, _NODES))
