"""Search for water at another attitude than that in which a lidar is said to be mounted."""

import math
from typing import Self

import numpy as np

from seaclutter_cli.arrays import Floats
from seaclutter_cli.water.mounting import Mounting, angle_deg
from seaclutter_cli.water.plane import FARTHEST_M, PolarCells, fit_plane, in_reach

_TOLERANCE_DEG = 10.0
_MAX_TILT_DEG = 55.0
_START_TILT_DEG = 30.0
_STARTS = 6
_FITS = 2
_VOXEL_M = 0.7
_MIN_HEIGHT_M, _MAX_HEIGHT_M = 0.5, 20.0
_FLAT_M = 0.6
_TOP_M = 1.0
_BELOW_M = 1.0
_BELOW_WEIGHT = 2
_MIN_SCORE = 20
_BETTER = 3
_INTERVAL_S = 0.5
_FRAMES = 20
_FRAMES_WITHOUT = 8
_MIN_SPAN_S = 3.0
_MIN_SHARE = 0.6
_AGREEMENT_DEG = 15.0


class MountingSearch:
    """Search of the first seconds of a topic for water at another attitude than the one of the configuration.

    Notes
    -----
    Water is a plane 0.5 to 20 m below the lidar that the lowest echoes of polar cells form, and nothing is below it.
    The plane is fitted as by `WaterTracker`, from the given attitude and, if that gives no water, from attitudes around
    it and upside down. Its score is the number of cells of 10° by 3 m in which all echoes are near the plane, minus
    twice the number of cells with echoes more than a metre below it. Walls, hulls and the edges of quays have few such
    cells: their echoes are above each other.

    A frame shows another attitude if its score there is at least 20, and three times that at the given attitude. The
    result is the mean over frames half a second apart, so that own ship's roll averages out.

    Attitudes from 55° to 125° off the given one are not searched: there, a wall can look like water.

    **State**: the upward direction in each of at most 20 frames, and their times.
    """

    def __init__(self, given: Mounting) -> None:
        self._given = given
        self._starts = [given, *_around(given.up), *(Mounting.of_up(-one.up) for one in (given, *_around(given.up)))]
        self._frames: list[tuple[float, Floats | None]] = []

    def wants(self, time_s: float) -> bool:
        """Return whether a frame at this time should be added."""
        return not self.complete and not (self._frames and 0 <= time_s - self._frames[-1][0] < _INTERVAL_S)

    @property
    def complete(self) -> bool:
        """Whether enough frames were added; fewer are enough if none of them shows another attitude."""
        return len(self._frames) >= (_FRAMES if self._ups else _FRAMES_WITHOUT)

    @property
    def _ups(self) -> list[Floats]:
        return [up for _, up in self._frames if up is not None]

    def add(self, xyz: Floats, time_s: float) -> None:
        """Add a frame: finite points in the frame of the lidar, without own ship, shape (3, N)."""
        self._frames.append((time_s, self._other(_thinned(xyz))))

    def __iadd__(self, later: Self) -> Self:
        """Add the frames of a search of a later recording, as long as there are not enough."""
        for frame in later._frames:
            if not self.complete:
                self._frames.append(frame)
        return self

    def found(self) -> Mounting | None:
        """Return the mounting that most frames show, in whole degrees; None if it is the given one, or unknown.

        In less than three seconds, own ship can heel but not turn over, so that only a lidar upside down is found.
        """
        ups, times_s = self._ups, [time_s for time_s, _ in self._frames]
        if not ups:
            return None
        mean = np.mean(ups, axis=0)
        agreeing = [up for up in ups if angle_deg(up, mean) <= _AGREEMENT_DEG]
        if len(agreeing) < _MIN_SHARE * len(times_s):
            return None
        up = np.mean(agreeing, axis=0)
        tilt = angle_deg(up, self._given.up)
        heels = tilt < 90 and max(times_s) - min(times_s) < _MIN_SPAN_S
        if heels or tilt <= _TOLERANCE_DEG:
            return None
        exact = Mounting.of_up(up)
        roll = round(exact.roll_deg)
        return Mounting(180.0 if roll == -180 else float(roll), float(round(exact.pitch_deg)))

    def _other(self, xyz: Floats) -> Floats | None:
        """Return the upward direction of water at another attitude in a frame, shape (3,)."""
        level, best, other = 0, -math.inf, None
        for start in self._starts:
            fit = _fit(xyz, start)
            if fit is None:
                continue
            up, score = fit
            tilt = angle_deg(up, self._given.up)
            if tilt <= _TOLERANCE_DEG:
                level = max(level, score)
            elif not _MAX_TILT_DEG < tilt < 180 - _MAX_TILT_DEG and score > best:
                best, other = score, up
            if level >= _MIN_SCORE:
                return None
        return other if best >= max(_MIN_SCORE, _BETTER * level) else None


def _around(up: Floats) -> list[Mounting]:
    """Return mountings whose upward directions surround a direction at 30°."""
    side = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < abs(up[1]) else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    tilt, bearings = np.radians(_START_TILT_DEG), np.arange(_STARTS) * (2 * np.pi / _STARTS)
    sides = np.outer(np.cos(bearings), side) + np.outer(np.sin(bearings), np.cross(up, side))
    return [Mounting.of_up(one) for one in np.cos(tilt) * up + np.sin(tilt) * sides]


def _thinned(xyz: Floats) -> Floats:
    """Return the lowest point of each voxel that may be within reach of the fit, so that dense walls take no longer."""
    xyz = xyz[:, np.abs(xyz).max(axis=0) < 2 * FARTHEST_M]
    voxel = np.floor(xyz / _VOXEL_M).astype(np.int64)
    number = (voxel[0] << 40) + (voxel[1] << 20) + voxel[2]
    order = np.lexsort((xyz[2], number))
    _, first = np.unique(number[order], return_index=True)
    return xyz[:, order[first]]


def _fit(xyz: Floats, start: Mounting) -> tuple[Floats, int] | None:
    """Return the upward normal of the plane that a fit finds from an attitude, shape (3,), and how well it is water.

    None if there is no plane 0.5 to 20 m below the lidar.
    """
    mounting = start
    for _ in range(_FITS):  # the second is free of the first's small angles
        cells = PolarCells.of(_within_reach(mounting.levelled(xyz)))
        if not cells.enough:
            return None
        plane, _ = fit_plane(cells, None)
        normal = np.array([-plane.slope_x, -plane.slope_y, 1.0])
        mounting = Mounting.of_up(mounting.rotation.T @ normal)
        level_m = plane.level_m / float(np.linalg.norm(normal))
        if not _MIN_HEIGHT_M <= -level_m <= _MAX_HEIGHT_M:
            return None
    return mounting.up, _score(_within_reach(mounting.levelled(xyz)), level_m)


def _within_reach(xyz: Floats) -> Floats:
    return xyz[:, in_reach(*xyz[:2])]


def _score(xyz: Floats, level_m: float) -> int:
    """Return the number of cells with nothing but water, minus twice that of cells with echoes below it."""
    if not xyz.size:
        return 0
    cells = PolarCells.of(xyz)
    highest = np.full(cells.number.max() + 1, -np.inf)
    np.maximum.at(highest, cells.cell, xyz[2] - level_m)
    low, high = cells.lowest[2] - level_m, highest[cells.number]
    flat = (np.abs(low) < _FLAT_M) & (high < _TOP_M)
    return int(np.count_nonzero(flat) - _BELOW_WEIGHT * np.count_nonzero(low < -_BELOW_M))
