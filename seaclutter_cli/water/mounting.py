"""The attitude in which a lidar is mounted."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from seaclutter_cli.arrays import Floats

_DECIMALS = 15


@dataclass(frozen=True)
class Mounting:
    """The attitude of a lidar on a vessel that floats level, as roll and then pitch about fixed axes (REP 103).

    Parameters
    ----------
    roll_deg : float
        Angle about the x axis in degrees, -180 to 180; positive if the left side (+y) is up. 180 is upside down.
    pitch_deg : float
        Angle about the y axis in degrees, -90 to 90; positive if the front (+x) is down.

    Examples
    --------
    >>> Mounting(roll_deg=180).levelled(np.array([[1.0], [2.0], [3.0]])).ravel()
    array([ 1., -2., -3.])
    """

    roll_deg: float = 0.0
    pitch_deg: float = 0.0

    @classmethod
    def of_up(cls, up: Floats) -> Self:
        """Return the mounting of a lidar in whose frame a direction, shape (3,), points up.

        Examples
        --------
        >>> Mounting.of_up(np.array([0.0, 0.0, -1.0]))
        Mounting(roll_deg=180.0, pitch_deg=0.0)
        """
        x, y, z = up / np.linalg.norm(up)
        return cls(float(np.degrees(np.arctan2(y, z))), float(np.degrees(np.arcsin(-x))) + 0.0)

    @property
    def is_level(self) -> bool:
        """Whether the axes of the lidar are those of the levelled frame."""
        return self.roll_deg == 0 == self.pitch_deg

    @cached_property
    def rotation(self) -> Floats:
        """Rotation from the frame of the lidar to the levelled frame, shape (3, 3)."""
        roll, pitch = np.radians((self.roll_deg, self.pitch_deg))
        about_x = [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
        about_y = [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
        return np.round(np.array(about_y) @ np.array(about_x), _DECIMALS)  # a turn by 180° is exact

    @property
    def up(self) -> Floats:
        """Direction that points up, in the frame of the lidar, shape (3,)."""
        return np.asarray(self.rotation[2])

    def tilt_deg(self, other: "Mounting") -> float:
        """Return the angle between the upward directions of two mountings, in degrees."""
        return angle_deg(self.up, other.up)

    def levelled(self, xyz: Floats) -> Floats:
        """Return points of the lidar in the levelled frame, shape (3, N); the same array if the mounting is level."""
        return xyz if self.is_level else _turned(self.rotation, xyz)

    def unlevelled(self, xyz: Floats) -> Floats:
        """Return points of the levelled frame in the frame of the lidar, shape (3, N)."""
        return xyz if self.is_level else _turned(self.rotation.T, xyz)


def angle_deg(one: Floats, other: Floats) -> float:
    """Return the angle between two directions, shape (3,), in degrees."""
    cosine = one @ other / (np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _turned(rotation: Floats, xyz: Floats) -> Floats:
    # A matrix product may round a point differently at another position in the array.
    with np.errstate(invalid="ignore"):
        return np.stack([row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2] for row in rotation])
