"""Motion of vessels, along a path and with the waves, and of the lidar on its vessel or vehicle."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from seaclutter_cli.arrays import Floats

_KNOTS = 6
Places = tuple[tuple[float, float], ...]


class Leg(NamedTuple):
    """A straight part of a path, at constant speed, from a start position; its end is infinite for a body at rest."""

    start_s: float
    end_s: float
    x_m: float
    y_m: float
    heading_rad: float
    speed_ms: float


class Track:
    """A path at constant speed, along one or more positions in metres in the world frame; the last leg has no end.

    ``heading_deg``, counter-clockwise from the world's x, is that of a path of a single position. The path starts at
    ``start_s``; before it, the first leg is extended backwards.
    """

    def __init__(self, path: Places, speed_ms: float, heading_deg: float, start_s: float) -> None:
        positions = np.array(path, np.float64)
        if speed_ms > 0 and len(positions) > 1:
            steps = np.diff(positions, axis=0).T
            headings = np.arctan2(steps[1], steps[0])
            times = start_s + np.append(0.0, np.cumsum(np.hypot(*steps)) / speed_ms)
        else:
            headings, times = np.array([np.radians(heading_deg)]), np.array([start_s, np.inf])
        ends = (*times[1:-1].tolist(), np.inf)
        self.legs = [
            Leg(float(start), end, float(x), float(y), float(heading), speed_ms)
            for start, end, (x, y), heading in zip(times, ends, positions, headings, strict=False)
        ]

    def at(self, times_s: Floats | float) -> tuple[Any, Any, Any]:
        """Return x and y in metres and the heading in radians at a time, or at several, shape (T,)."""
        legs = np.array(self.legs)
        which = np.clip(np.searchsorted(legs[:, 0], times_s, side="right") - 1, 0, None)
        start, _, x, y, heading, speed = legs[which].T
        along = speed * (times_s - start)
        return x + along * np.cos(heading), y + along * np.sin(heading), heading

    def smooth_at(self, times_s: Floats | float) -> tuple[Any, Any, Any]:
        """Return the same as `at`, with a heading that turns evenly from the middle of each leg to that of the next."""
        x, y, heading = self.at(times_s)
        middles = [(leg.start_s + leg.end_s) / 2 for leg in self.legs[:-1]]
        if middles:
            heading = np.interp(times_s, middles, np.unwrap([leg.heading_rad for leg in self.legs[:-1]]))
        return x, y, heading


def rotations(yaw: Floats | float, pitch: Floats | float = 0.0, roll: Floats | float = 0.0) -> Floats:
    """Return rotation matrices from body (x forward, y left, z up) to world, shape (T, 3, 3), of angles in radians.

    Without arrays, there is one, shape (3, 3).
    """
    cy, sy, cp, sp, cr, sr = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    rows = (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


@dataclass(frozen=True)
class Pose:
    """Position of a body in the world frame, shape (3,), and rotation from its frame to the world's, shape (3, 3)."""

    position: Floats
    rotation: Floats


Motion = Callable[[Floats, Floats, Floats], Floats]
"""Height in metres and slopes along x and y at positions and times, shape (T,) each, as shape (3, T)."""


@dataclass(frozen=True)
class Ride:
    """Position and attitude of the lidar over time.

    The lidar is at ``mast``, shape (3,), on a vessel or vehicle that follows a track, by its ``places``, and a share of
    the height and slopes of the terrain, shape (3, T), that ``motion`` returns for positions and times. The vessel may
    add pitch and roll, ``rocking`` at times, shape (T,), of its own.
    """

    places: Callable[[Floats], tuple[Floats, Floats, Floats]]
    motion: Motion
    wave_response: float
    mast: Floats
    rocking: Callable[[Floats], tuple[Floats, Floats]] | None = None

    def at(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return position and attitude of the lidar at given times, shapes (T, 3) and (T, 3, 3)."""
        x, y, yaw = self.places(times_s)
        waves = self.wave_response * self.motion(x, y, times_s)
        pitch = -np.arctan(waves[1] * np.cos(yaw) + waves[2] * np.sin(yaw))
        roll = np.arctan(waves[2] * np.cos(yaw) - waves[1] * np.sin(yaw))
        if self.rocking:
            own_pitch, own_roll = self.rocking(times_s)
            pitch, roll = pitch + own_pitch, roll + own_roll
        rotation = rotations(yaw, pitch, roll)
        return np.stack((x, y, waves[0]), axis=1) + rotation @ self.mast, rotation

    def interpolate(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return position and attitude at the many times of a frame, in ascending order, by interpolation."""
        knots = np.linspace(times_s[0], times_s[-1] + 1e-9, _KNOTS)
        positions, rotation = self.at(knots)
        # Knots are 20 ms apart, close enough to interpolate linearly: matrices remain orthogonal to 1e-6.
        values = np.concatenate((positions, rotation.reshape(-1, 9)), axis=1)
        out = np.stack([np.interp(times_s, knots, column) for column in values.T], axis=1)
        return out[:, :3], out[:, 3:].reshape(-1, 3, 3)

    def lidar(self, time_s: float) -> Pose:
        """Return the pose of the lidar at a time."""
        positions, rotation = self.interpolate(np.array([time_s]))
        return Pose(positions[0], rotation[0])
