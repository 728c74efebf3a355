"""Ways in which Hesai sensors scan: what a frame is, and the directions of beams.

A scan numbers the frames of firings: of P packets with F firings and C channels. `RotorScan` says what its methods do.
"""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.hesai.angles import DEGREE, MirrorAngles, parse_angles, parse_corrections
from seaclutter_cli.sensors.hesai.models import HesaiModel
from seaclutter_cli.sensors.packets import DecoderOptions, read_calibration

FULL_CIRCLE = 36_000
"""Hundredths of a degree in a revolution."""
_EDGE = 100
_MAX_GAP_NS = 10_000_000_000
_FINE = DEGREE // 100
_TURN_NS = 300_000_000
_FIRST_DEG, _LAST_DEG = 32, 148

Directions = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Azimuth in radians, cosine and sine of the elevation of N points."""


class RotorScan:
    """Scan of a rotor: a frame is a revolution, positions are azimuths in hundredths of a degree.

    Azimuths are unwrapped with the clock and the motor speed, so jitter, late packets and gaps longer than a revolution
    do not disturb the count. The first packet determines the direction of rotation, or the first two firings. Channels
    have an elevation and an offset from the azimuth of the rotor, shape (C,), in degrees; a channel enters the next
    revolution when it crosses azimuth 0 itself.
    """

    def __init__(self, elevation_deg: NDArray[np.float64], azimuth_deg: NDArray[np.float64]) -> None:
        self._azimuth_deg, self._offsets = azimuth_deg, azimuth_deg * 100
        self._cos, self._sin = np.cos(np.radians(elevation_deg)), np.sin(np.radians(elevation_deg))
        self._sign = 0
        self._knows_direction = False
        self._azimuth = self._time_ns = self._first = self._angle = self._top = 0

    def positions(self, blocks: NDArray[np.void]) -> NDArray[np.int64]:
        """Return the position of the motor in blocks, any shape, in the unit of the scan."""
        return np.asarray(blocks["azimuth"].astype(np.int64))

    def count(
        self, positions: NDArray[np.int64], times_ns: NDArray[np.int64], rpm: NDArray[np.int64]
    ) -> NDArray[np.int64]:
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

    def directions(
        self, positions: NDArray[np.int64], firings: NDArray[np.int64], channels: NDArray[np.int64]
    ) -> Directions:
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

    def _begin(self, azimuths: NDArray[np.int64], time_ns: int) -> None:
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

    Fields are counted with the clock, so that late packets and gaps longer than a turn do not disturb the count.
    """

    def __init__(self, angles: MirrorAngles) -> None:
        self._angles = angles
        self._mirrors = len(angles.starts)
        self._position = self._first = self._time_ns = -1
        self._number = self.done = 0

    def positions(self, blocks: NDArray[np.void]) -> NDArray[np.int64]:
        """Return the positions of the motor in blocks."""
        return np.asarray(blocks["azimuth"].astype(np.int64) * _FINE + blocks["fine"])

    def count(
        self,
        positions: NDArray[np.int64],
        times_ns: NDArray[np.int64],
        rpm: NDArray[np.int64],  # noqa: ARG002 - the mirrors have one speed
    ) -> NDArray[np.int64]:
        """Return the field of each firing and channel, as `RotorScan.count`."""
        if self._first < 0:
            self._first = self._position = int(positions[0, 0])
            self._time_ns = int(times_ns[0, 0])
        mirrors, fields = self._mirrors, self._angles.fields(positions.ravel())
        before = int(self._angles.fields(np.array(self._position)))
        waits_ns = np.clip(np.diff(times_ns.ravel(), prepend=self._time_ns), 0, None)
        steps = np.diff(fields, prepend=before) % mirrors
        steps += mirrors * np.rint(waits_ns / _TURN_NS - steps / mirrors).astype(np.int64)
        numbers = self._number + np.cumsum(steps)
        tops = np.maximum(np.maximum.accumulate(numbers), self.done)
        self._number, self.done = int(numbers[-1]), int(tops[-1])
        self._position, self._time_ns = int(positions[-1, -1]), int(times_ns[-1, -1])
        # A late firing of an earlier field belongs to the present one, as that field is complete.
        shape = (*positions.shape, len(self._angles.elevation))
        return np.broadcast_to(tops.reshape(positions.shape)[..., None], shape)

    def directions(
        self, positions: NDArray[np.int64], firings: NDArray[np.int64], channels: NDArray[np.int64]
    ) -> Directions:
        """Return the directions of points, as `RotorScan.directions`."""
        azimuths, elevations = (
            np.radians(angles / DEGREE) for angles in self._angles.directions(positions[firings], channels)
        )
        return azimuths, np.cos(elevations), np.sin(elevations)

    def is_partial(self, frame: int) -> bool:
        """Return whether the firings so far begin or end within a field, between azimuths of 32 and 148 degrees."""
        first, last = self._angles.turned(np.array([self._first, self._position])) / DEGREE
        return bool((frame == 0 and first > _FIRST_DEG) or (frame == self.done and last < _LAST_DEG))

    def skip(self) -> None:
        """Start a new frame in the same field."""
        self._number = self.done = self.done + 1


Scan = RotorScan | MirrorScan


def make_scan(model: HesaiModel, options: DecoderOptions) -> tuple[Scan, str]:
    """Return the scan of a sensor, and where its angles are from; `InputError` if they are missing or wrong."""
    if options.calibration is not None:
        data, name, source = read_calibration(options.calibration), str(options.calibration), options.calibration.name
    elif options.recorded is not None:
        data, name = options.recorded, "recorded with the packets"
        source = name
    elif model.has_mirrors:
        raise InputError(
            f"{model.name}: the angles of the unit are needed; pass its angle correction file (.dat) with --calibration"
        )
    else:
        return RotorScan(*model.angles_deg), "nominal"
    if model.has_mirrors:
        return MirrorScan(parse_corrections(data, name, model.channels)), source
    return RotorScan(*parse_angles(data, name, model.channels)), source
