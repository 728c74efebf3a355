"""Ways in which Hesai sensors scan: what a frame is, and the directions of beams."""

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.hesai.angles import parse_angles
from seaclutter_cli.sensors.hesai.corrections import DEGREE, MirrorAngles, parse_corrections
from seaclutter_cli.sensors.hesai.models import HesaiModel
from seaclutter_cli.sensors.hesai.revolutions import RevolutionCounter
from seaclutter_cli.sensors.packets import DecoderOptions

_FINE = DEGREE // 100
_TURN_NS = 300_000_000
_FIRST_DEG, _LAST_DEG = 32, 148


class Scan(Protocol):
    """Frames and directions of a sensor. Its state is the number of the current frame."""

    @property
    def done(self) -> int:
        """Number of the first incomplete frame."""
        ...

    def positions(self, blocks: NDArray[np.void]) -> NDArray[np.int64]:
        """Return the position of the motor in blocks, any shape, in the unit of the scan."""
        ...

    def count(
        self, positions: NDArray[np.int64], times_ns: NDArray[np.int64], rpm: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the frame of each of C channels of F firings in P packets, shape (P, F, C), at least `done`.

        Parameters
        ----------
        positions, times_ns : ndarray, shape (P, F), int64
            Position of the motor and time of each firing.
        rpm : ndarray, shape (P,), int64
            Motor speed in revolutions per minute; 0 if unknown.
        """
        ...

    def directions(
        self, positions: NDArray[np.int64], firings: NDArray[np.int64], channels: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return azimuth in radians, cosine and sine of the elevation of points, shape (N,).

        Parameters
        ----------
        positions : ndarray, shape (F,), int64
            Position of the motor in each firing.
        firings, channels : ndarray, shape (N,), int64
            Firing and channel of each point.
        """
        ...

    def is_partial(self, frame: int) -> bool:
        """Return whether the firings so far begin or end within a frame."""
        ...

    def skip(self) -> None:
        """Start a new frame although the motor has not reached it."""
        ...


class RotorScan(RevolutionCounter):
    """Scan of a rotor: a frame is a revolution, positions are azimuths in hundredths of a degree.

    Parameters
    ----------
    elevation_deg, azimuth_deg : ndarray, shape (C,), float64
        Elevation of each channel, and its offset from the azimuth of the rotor, in degrees.
    """

    def __init__(self, elevation_deg: NDArray[np.float64], azimuth_deg: NDArray[np.float64]) -> None:
        super().__init__(azimuth_deg * 100)
        self._azimuth_deg = azimuth_deg
        self._cos, self._sin = np.cos(np.radians(elevation_deg)), np.sin(np.radians(elevation_deg))

    def positions(self, blocks: NDArray[np.void]) -> NDArray[np.int64]:
        """Return the azimuths of blocks."""
        return np.asarray(blocks["azimuth"].astype(np.int64))

    def directions(
        self, positions: NDArray[np.int64], firings: NDArray[np.int64], channels: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the directions of points, as `Scan.directions`."""
        azimuths = np.radians(positions / 100)[firings] + np.radians(self._azimuth_deg)[channels]
        return azimuths, self._cos[channels], self._sin[channels]


class MirrorScan:
    """Scan of rotating mirrors: a frame is one mirror's field, positions are those of the motor in 1/25600 of a degree.

    Fields are counted with the clock, so that late packets and gaps longer than a turn do not disturb the count.

    Parameters
    ----------
    angles : MirrorAngles
        Angles of the unit.
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
        """Return the field of each firing and channel, as `Scan.count`."""
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
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the directions of points, as `Scan.directions`."""
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


def make_scan(model: HesaiModel, options: DecoderOptions) -> tuple[Scan, str]:
    """Return the scan of a sensor, and where its angles are from; `InputError` if they are missing or wrong."""
    found = _corrections(options)
    if model.has_mirrors:
        if found is None:
            raise InputError(
                f"{model.name}: the angles of the unit are needed; "
                "pass its angle correction file (.dat) with --calibration"
            )
        data, name, source = found
        return MirrorScan(parse_corrections(data, name, model.channels)), source
    if found is None:
        return RotorScan(model.elevation_deg, model.azimuth_deg), "nominal"
    data, name, source = found
    return RotorScan(*parse_angles(data, name, model.channels)), source


def _corrections(options: DecoderOptions) -> tuple[bytes, str, str] | None:
    """Return the content of the angle correction file, its name for errors, and its name for display."""
    if options.calibration is not None:
        return _read(options.calibration), str(options.calibration), options.calibration.name
    if options.recorded is not None:
        return options.recorded, "recorded with the packets", "recorded with the packets"
    return None


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
