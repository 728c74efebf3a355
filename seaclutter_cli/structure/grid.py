"""Directions in which a lidar measures, as beams by azimuth."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.frame import Frame
from seaclutter_cli.structure.mask import Floats, azimuth_deg, elevation_deg

_AZIMUTH_STEP_DEG = 1.0
_COLUMNS = round(360 / _AZIMUTH_STEP_DEG)
_ELEVATION_STEP_DEG = 1.0
_RING_NAMES = ("ring", "channel", "line", "laser_id")
_MAX_RINGS = 1024
_MIN_BEAMS = 2
_SAME_DEG = 0.02
_GAP_DEG = 0.15
_MIN_SHARE, _MOST_SPREAD_DEG = 0.002, 0.3


@dataclass(frozen=True)
class BeamGrid:
    """Rows of elevation, between the beams of a lidar if they are known, by columns of 1° of azimuth.

    ``edges_deg``, shape (R + 1,), are the limits of the rows, ascending.
    """

    edges_deg: Floats

    @classmethod
    def of(cls, frame: Frame) -> Self:
        """Return the grid for the lidar of a frame: by its beams if they are known, otherwise rows of 1°.

        Beams are known by the field of the ring, or by the gaps between elevations.
        """
        elevation = elevation_deg(frame.coordinates[:, frame.valid], frame.range_m[frame.valid])
        beams = _numbered_beams(frame, elevation)
        if beams is None:
            beams = _parted_beams(elevation)
        if beams is not None:
            middle = (beams[1:] + beams[:-1]) / 2
            first, last = 2 * beams[0] - middle[0], 2 * beams[-1] - middle[-1]
            return cls(np.concatenate(([first], middle, [last])))
        first, last = np.floor(elevation.min()) - 1, np.ceil(elevation.max()) + 1
        return cls(np.arange(first, last + _ELEVATION_STEP_DEG, _ELEVATION_STEP_DEG))

    @property
    def rows(self) -> int:
        """Number of rows, R."""
        return len(self.edges_deg) - 1

    @property
    def size(self) -> int:
        """Number of directions."""
        return self.rows * _COLUMNS

    @property
    def centers(self) -> Floats:
        """Unit vectors to the centres of all directions, shape (3, size)."""
        elevation = np.radians((self.edges_deg[1:] + self.edges_deg[:-1]) / 2)[:, None]
        azimuth = np.radians(-180 + (np.arange(_COLUMNS) + 0.5) * _AZIMUTH_STEP_DEG)
        flat = np.cos(elevation)
        parts = (flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation) + 0 * azimuth)
        return np.stack([part.reshape(-1) for part in parts])

    def directions(self, frame: Frame) -> NDArray[np.int64]:
        """Return the direction of each valid point of a frame; points outside the rows have that of the nearest."""
        xyz = frame.coordinates[:, frame.valid]
        elevation = elevation_deg(xyz, frame.range_m[frame.valid])
        row = np.clip(np.searchsorted(self.edges_deg, elevation, "right") - 1, 0, self.rows - 1)
        column = np.clip(((azimuth_deg(xyz) + 180) / _AZIMUTH_STEP_DEG).astype(np.int64), 0, _COLUMNS - 1)
        return np.asarray(row * _COLUMNS + column, np.int64)

    def unfolded(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values by direction, shape (size, B) or (size,), as an array of shape (rows, columns, B)."""
        return values.reshape(self.rows, _COLUMNS, -1)

    def between(self, first: int, end: int) -> "BeamGrid":
        """Return the grid of some rows."""
        return BeamGrid(self.edges_deg[first : end + 1])

    def of_rows(self, values: NDArray[Any], whole: "BeamGrid") -> NDArray[Any]:
        """Return those of the values by direction of the whole grid, shape (size, B), that are of these rows."""
        first = int(np.searchsorted(whole.edges_deg, self.edges_deg[0])) * _COLUMNS
        return values[first : first + self.size]

    def limits(self, row: int, column: int) -> tuple[float, float, float, float]:
        """Return the limits of a direction: elevation, then azimuth, in degrees."""
        left = -180 + column * _AZIMUTH_STEP_DEG
        return float(self.edges_deg[row]), float(self.edges_deg[row + 1]), left, left + _AZIMUTH_STEP_DEG


def _numbered_beams(frame: Frame, elevation: Floats) -> Floats | None:
    """Return the elevations of the beams, ascending; None if no field numbers beams of constant elevation."""
    points = frame.cloud.points
    name = next((name for name in _RING_NAMES if name in (points.dtype.names or ())), None)
    if name is None or points.dtype[name].shape or points.dtype[name].kind not in "iu":
        return None
    rings, ring = np.unique(points[name][frame.valid], return_inverse=True)
    if not _MIN_BEAMS <= len(rings) <= _MAX_RINGS:
        return None
    order = np.argsort(ring, kind="stable")
    parts = np.split(elevation[order], np.cumsum(np.bincount(ring))[:-1])
    middle = np.sort([np.median(part) for part in parts])
    beams = middle[np.concatenate(([True], np.diff(middle) > _SAME_DEG))]
    spread = np.median([np.quantile(part, 0.9) - np.quantile(part, 0.1) for part in parts])
    return beams if len(beams) >= _MIN_BEAMS and spread <= np.median(np.diff(beams)) else None


def _parted_beams(elevation: Floats) -> Floats | None:
    """Return the elevations of the beams, ascending; None if the elevations of the points are not in narrow groups."""
    groups = np.split(np.sort(elevation), np.flatnonzero(np.diff(np.sort(elevation)) > _GAP_DEG) + 1)
    groups = [group for group in groups if len(group) >= _MIN_SHARE * len(elevation)]
    if len(groups) < _MIN_BEAMS or max(group[-1] - group[0] for group in groups) > _MOST_SPREAD_DEG:
        return None
    return np.array([np.median(group) for group in groups])
