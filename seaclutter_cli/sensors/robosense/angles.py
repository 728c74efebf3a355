"""Laser angles of a unit, from its packets or from a file."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import InputError
from seaclutter_cli.sensors.robosense.models import RobosenseModel

VERTICAL_AT = 468
"""Offset of the vertical angles in device information."""
_MIN_ANGLE, _ANGLE_LIMIT = -9000, 18000
_SIXTEEN = 16


@dataclass(frozen=True)
class Angles:
    """Directions of the channels of a block.

    Parameters
    ----------
    vertical, horizontal : ndarray, shape (C,), int64
        Elevation and azimuth offset of each channel, in hundredths of a degree.
    """

    vertical: NDArray[np.int64]
    horizontal: NDArray[np.int64]

    @property
    def rings(self) -> NDArray[np.uint16]:
        """Ring of each channel, shape (C,): the number of lasers with a lower elevation."""
        first, second = np.split(self.vertical, 2)
        lasers = first if np.array_equal(first, second) else self.vertical
        return np.searchsorted(np.sort(lasers), self.vertical).astype(np.uint16)


def make_angles(vertical: NDArray[np.int64], horizontal: NDArray[np.int64]) -> Angles | None:
    """Return the angles of all channels of a block from those of its lasers; None if an angle is out of range.

    The channels of 16 lasers repeat.
    """
    both = np.stack([vertical, horizontal])
    if ((both < _MIN_ANGLE) | (both >= _ANGLE_LIMIT)).any():
        return None
    vertical, horizontal = np.tile(both, 2 if both.shape[1] == _SIXTEEN else 1)
    return Angles(vertical, horizontal)


def packet_angles(model: RobosenseModel, packet: NDArray[np.uint8]) -> Angles | None:
    """Return the angles in a device information packet, shape (1248,); None if they are not programmed."""
    if model.name != "RS-LiDAR-16":
        begins, size = (VERTICAL_AT, model.format.horizontal_at), 3 * model.lasers
        tables = np.stack([packet[begin : begin + size] for begin in begins]).astype(np.int64).reshape(2, -1, 3)
        if (tables[..., 0] == 0xFF).any() or (model.name == "RS-LiDAR-32" and not tables[0, 0].any()):
            return None
        sizes = tables[..., 1] << 8 | tables[..., 2]
        # Single precision, and halves rounded up, as in the vendor's driver.
        sizes = np.floor((sizes.astype(np.float32) * np.float32(model.angle_unit)).astype(np.float64) + 0.5).astype(
            np.int64
        )
        vertical, horizontal = np.where(tables[..., 0] != 0, -sizes, sizes)
        return make_angles(vertical, horizontal)
    table = packet[1165:1213].astype(np.int64).reshape(16, 3)
    if (packet[1165:1169] == 0).all() or (packet[1165:1169] == 0xFF).all():
        return None
    sizes = (table[:, 0] << 16 | table[:, 1] << 8 | table[:, 2]) // 100
    return make_angles(np.where(np.arange(16) < 8, -sizes, sizes), np.zeros(16, np.int64))


def file_angles(model: RobosenseModel, path: Path) -> Angles:
    """Return the angles in a file that RoboSense ships with a unit.

    The file has one line per laser: its elevation and, after a comma, its azimuth offset, in degrees.

    Raises
    ------
    InputError
        If the file cannot be read, or does not contain one line per laser.
    """
    try:
        lines = path.read_text("utf-8", "replace").splitlines()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    rows = [row for line in lines if (row := _numbers(line))]
    if len(rows) != model.lasers:
        raise InputError(f"{path}: expected {model.lasers} lines of angles for the {model.name}, got {len(rows)}")
    table = np.array([[*row, 0.0][:2] for row in rows])
    hundredths = np.where(np.isfinite(table), np.rint(np.clip(table, -1000, 1000) * 100), _ANGLE_LIMIT).astype(np.int64)
    angles = make_angles(*hundredths.T)
    if angles is None:
        raise InputError(f"{path}: angles must be between -90 and 180 degrees")
    return angles


def _numbers(line: str) -> list[float]:
    try:
        return [float(part) for part in re.split(r"[,;\s]+", line.strip()) if part]
    except ValueError:
        return []
