"""How vessels move: along a path, and with the waves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Leg:
    """A straight part of a path, driven at one speed.

    Parameters
    ----------
    start_s, end_s : float
        When it is driven; infinite where something lies still.
    x_m, y_m : float
        Where it starts.
    heading_rad : float
        Where it leads, counter-clockwise from the world's x.
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
        Places in metres in the world's frame, one or more; the last leg goes on for ever.
    speed_ms : float
        Speed in m/s.
    heading_deg : float
        Heading where the path is a single place, counter-clockwise from the world's x.
    start_s : float
        When the path begins; before that, its first leg is thought to reach back.
    """

    def __init__(
        self, path: tuple[tuple[float, float], ...], speed_ms: float, heading_deg: float, start_s: float
    ) -> None:
        places = np.array(path, np.float64)
        steps = np.diff(places, axis=0)
        lengths = np.hypot(steps[:, 0], steps[:, 1])
        if speed_ms > 0 and len(steps):
            headings = np.arctan2(steps[:, 1], steps[:, 0])
            times = start_s + np.concatenate(([0.0], np.cumsum(lengths) / speed_ms))
        else:
            headings, times = np.array([np.radians(heading_deg)]), np.array([start_s, np.inf])
        ends = (*times[1:-1].tolist(), np.inf)
        self.legs = [
            Leg(float(start), end, float(x), float(y), float(heading), speed_ms)
            for start, end, (x, y), heading in zip(times, ends, places, headings, strict=False)
        ]

    def at(self, times_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Return x and y in metres and the heading in radians at some times, shape (T,) each."""
        starts = np.array([leg.start_s for leg in self.legs])
        which = np.clip(np.searchsorted(starts, times_s, side="right") - 1, 0, None)
        fields = ("x_m", "y_m", "heading_rad", "speed_ms", "start_s")
        x, y, heading, speed, start = (np.array([getattr(leg, name) for leg in self.legs])[which] for name in fields)
        along = speed * (times_s - start)
        return x + along * np.cos(heading), y + along * np.sin(heading), heading


class Tracks:
    """Many paths, O of them, each asked at its own time.

    Parameters
    ----------
    tracks : sequence of Track
        The paths.
    """

    def __init__(self, tracks: Sequence[Track]) -> None:
        most = max((len(track.legs) for track in tracks), default=1)
        names = ("start_s", "x_m", "y_m", "heading_rad", "speed_ms")
        # A path with fewer legs than others goes on with legs that never start.
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
    """Place and attitude of a body.

    Parameters
    ----------
    place : ndarray, shape (3,), float64
        Its origin in the world's frame, in metres.
    turn : ndarray, shape (3, 3), float64
        Rotation from its frame to the world's.
    """

    place: Floats
    turn: Floats

    @classmethod
    def of(cls, place: Floats, *, yaw: float, pitch: float = 0.0, roll: float = 0.0) -> "Pose":
        """Return the pose of angles in radians."""
        return cls(place, rotations(np.array([yaw]), np.array([pitch]), np.array([roll]))[0])
