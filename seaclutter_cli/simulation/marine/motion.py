"""Motion of vessels: along a path, and with the waves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Leg:
    """A straight part of a path, at constant speed.

    Parameters
    ----------
    start_s, end_s : float
        Start and end time; infinite end for a body at rest.
    x_m, y_m : float
        Start position.
    heading_rad : float
        Heading, counter-clockwise from the world's x.
    speed_ms : float
        Speed in m/s.
    """

    start_s: float
    end_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_ms: float


_NEVER = Leg(np.inf, np.inf, 0.0, 0.0, 0.0, 0.0)


class Track:
    """A path at constant speed.

    Parameters
    ----------
    path : sequence of (float, float)
        Positions in metres in the world frame, one or more; the last leg has no end.
    speed_ms : float
        Speed in m/s.
    heading_deg : float
        Heading if the path is a single position, counter-clockwise from the world's x.
    start_s : float
        Start time of the path; before it, the first leg is extended backwards.
    """

    def __init__(
        self, path: tuple[tuple[float, float], ...], speed_ms: float, heading_deg: float, start_s: float
    ) -> None:
        positions = np.array(path, np.float64)
        steps = np.diff(positions, axis=0)
        lengths = np.hypot(steps[:, 0], steps[:, 1])
        if speed_ms > 0 and len(steps):
            headings = np.arctan2(steps[:, 1], steps[:, 0])
            times = start_s + np.concatenate(([0.0], np.cumsum(lengths) / speed_ms))
        else:
            headings, times = np.array([np.radians(heading_deg)]), np.array([start_s, np.inf])
        ends = (*times[1:-1].tolist(), np.inf)
        self.legs = [
            Leg(float(start), end, float(x), float(y), float(heading), speed_ms)
            for start, end, (x, y), heading in zip(times, ends, positions, headings, strict=False)
        ]

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return x and y in metres and the heading in radians at given times, shape (T,) each."""
        starts = np.array([leg.start_s for leg in self.legs])
        which = np.clip(np.searchsorted(starts, times_s, side="right") - 1, 0, None)
        fields = ("x_m", "y_m", "heading_rad", "speed_ms", "start_s")
        x, y, heading, speed, start = (np.array([getattr(leg, name) for leg in self.legs])[which] for name in fields)
        along = speed * (times_s - start)
        return x + along * np.cos(heading), y + along * np.sin(heading), heading


class Tracks:
    """Many paths, O of them, each evaluated at its own time.

    Parameters
    ----------
    tracks : sequence of Track
        The paths.
    """

    def __init__(self, tracks: Sequence[Track]) -> None:
        most = max((len(track.legs) for track in tracks), default=1)
        names = ("start_s", "x_m", "y_m", "heading_rad", "speed_ms")
        # Shorter paths are padded with legs that never start.
        padded = [[*track.legs, *[_NEVER] * (most - len(track.legs))] for track in tracks]
        legs = [[[getattr(leg, name) for leg in row] for row in padded] for name in names]
        self._start, self._x, self._y, self._heading, self._speed = np.array(legs, np.float64).reshape(5, -1, most)
        self._rows = np.arange(len(tracks))

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return x and y in metres and the heading in radians of each path at its time, shape (O,) each."""
        which = np.clip((self._start <= times_s[:, None]).sum(axis=1) - 1, 0, None)
        start, x, y, heading, speed = (
            part[self._rows, which] for part in (self._start, self._x, self._y, self._heading, self._speed)
        )
        along = speed * (times_s - start)
        return x + along * np.cos(heading), y + along * np.sin(heading), heading


def rotations(yaw: Floats, pitch: Floats, roll: Floats) -> Floats:
    """Return rotation matrices from body (x forward, y left, z up) to world, shape (T, 3, 3); angles in radians.

    Examples
    --------
    >>> rotations(np.array([np.pi / 2]), np.zeros(1), np.zeros(1)).round(3)[0] @ [1, 0, 0]
    array([0., 1., 0.])
    """
    cy, sy, cp, sp, cr, sr = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.moveaxis(np.array(rows), -1, 0)


@dataclass(frozen=True)
class Pose:
    """Position and attitude of a body.

    Parameters
    ----------
    position : ndarray, shape (3,), float64
        Origin of the body in the world frame, in metres.
    rotation : ndarray, shape (3, 3), float64
        Rotation from the frame of the body to that of the world.
    """

    position: Floats
    rotation: Floats

    @classmethod
    def of(cls, position: Floats, *, yaw: float, pitch: float = 0.0, roll: float = 0.0) -> "Pose":
        """Return a pose from angles in radians."""
        return cls(position, rotations(np.array([yaw]), np.array([pitch]), np.array([roll]))[0])
