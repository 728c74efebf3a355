"""Faces: echoes beside each other at nearly one range. Bodies have them; water, spray and rain do not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Indices, Mask, group_sizes

Int32s = NDArray[np.int32]

LEAST_M = 0.25
"""Height of the lowest face that calm water does not have; in waves, their standard deviation is added."""
_COLUMN_DEG = 0.3
_COLUMNS = round(360 / _COLUMN_DEG)
_BEAM_DEG = 0.1
_STEP_DEG, _STEPS, _MAX_STEP_DEG = 0.65, 1.5, 1.1
_LEAST_STEP_DEG, _FINEST = 0.02, 50
_NOISE_M, _DIVERGENCE, _RAKE = 0.15, 0.003, 0.3
_APART_M = 3.0
_GAP_BEAMS, _LEAST_GAP_DEG = 1.5, 0.7


@dataclass(frozen=True)
class Faces:
    """The surfaces that N echoes belong to.

    Echoes above each other form a face from ``low_m`` to ``top_m`` along z, shape (N,) each. ``pairs``, shape (2, P),
    are neighbours at most 3 m apart in range; they are ``joined``, shape (P,), if they lie on one surface. ``run``,
    shape (N,), is the number of echoes beside each other in one beam, at nearly one range.

    Notes
    -----
    Echoes within 0.3° of bearing are ordered by elevation, those of one beam by bearing. Neighbours lie on one surface
    if their ranges differ by no more than range noise, the divergence of the beam and the rake of a hull explain. The
    slope of a wave spreads its heights over ranges, and spray and rain fill a volume. Of two divisions into bearings,
    half a step apart, the higher face counts. Ranges that change evenly, as along an oblique wall, are of one surface.
    """

    low_m: Floats
    top_m: Floats
    pairs: Int32s
    joined: Mask
    run: Int32s

    @classmethod
    def of(cls, xyz: Floats, elevation_deg: Floats | None = None, above_deg: Floats | None = None) -> "Faces":
        """Return the faces of echoes at positions of shape (3, N).

        ``elevation_deg`` are the elevations of their beams, ``above_deg`` the angles to the beams above, shape (N,); by
        default, elevations are those of the positions, and the beams are close.
        """
        x, y, z = xyz
        if elevation_deg is None:
            elevation_deg = np.degrees(np.arctan2(z, np.hypot(x, y)))
        if above_deg is None:
            above_deg = np.zeros_like(elevation_deg)
        distance, bearing = np.hypot(x, y), np.degrees(np.arctan2(y, x)) + 180
        beam = np.rint((elevation_deg + 90) / _BEAM_DEG).astype(np.uint16)
        along = np.argsort(bearing, kind="stable").astype(np.int32)
        order = along[np.argsort(beam[along], kind="stable")]
        step = np.diff(bearing[order])
        near = _same(beam[order])
        near &= step <= _reach_deg(step[near])
        *neighbors, _, size = _neighbors(order, near, distance, np.radians(step) * distance[order][1:])
        found, run = [neighbors], np.empty(len(z), np.int32)
        run[order] = np.repeat(size, size)
        low, top = z.copy(), z.copy()
        upwards = np.argsort(elevation_deg, kind="stable").astype(np.int32)  # less to hold
        for shift in (0.0, 0.5):
            column = (bearing / _COLUMN_DEG + shift).astype(np.uint16) % np.uint16(_COLUMNS)
            order = upwards[np.argsort(column[upwards], kind="stable")]
            gap_deg = np.maximum(_LEAST_GAP_DEG, _GAP_BEAMS * above_deg[order[:-1]])
            near = _same(column[order]) & (np.diff(elevation_deg[order]) <= gap_deg)
            *neighbors, start, size = _neighbors(order, near, distance, _RAKE * np.abs(np.diff(z[order])))
            found.append(neighbors)
            del gap_deg, near, column  # less to hold
            ends = np.repeat([chain.reduceat(z[order], start) for chain in (np.minimum, np.maximum)], size, axis=1)
            higher = ends[1] - ends[0] > (top - low)[order]
            low[order[higher]], top[order[higher]] = ends[:, higher]
        pairs, joined = zip(*found, strict=True)
        return cls(low, top, np.concatenate(pairs, axis=1), np.concatenate(joined), run)

    @property
    def height_m(self) -> Floats:
        """Heights of the faces, shape (N,)."""
        return self.top_m - self.low_m

    def stands(self, level: Floats, sigma_m: float) -> Mask:
        """Return which echoes belong to faces that water of a deviation does not have, above its z, shape (N,)."""
        return np.asarray(self.above_m(level) > LEAST_M + sigma_m)

    def above_m(self, level: Floats) -> Floats:
        """Return the heights of the faces above z of the water, shape (N,)."""
        return self.top_m - np.maximum(self.low_m, level)

    def neighbors(self, among: Mask) -> tuple[Int32s, Int32s]:
        """Return how many neighbours of each echo among some are on one surface with it, and how many are not.

        Both have the shape (N,).
        """
        both = among[self.pairs].all(axis=0)
        joined, loose = (
            np.bincount(self.pairs[:, both & chosen].reshape(-1), minlength=len(among)).astype(np.int32)
            for chosen in (self.joined, ~self.joined)
        )
        return joined, loose


def _neighbors(order: Int32s, near: Mask, distance: Floats, slope_m: Floats) -> tuple[Int32s, Mask, Indices, Indices]:
    """Return the neighbours among N echoes in order; ``near`` and the ranges allowed by a slope are (N - 1,).

    These are the numbers of each pair, shape (2, P), whether they are joined, because their ranges are nearly equal or
    change evenly, and start and size of the chains of echoes at nearly equal ranges.
    """
    ordered = distance[order]
    step = np.diff(ordered)
    near = near & (np.abs(step) <= _APART_M)
    limit = _NOISE_M + _DIVERGENCE * ordered[1:]
    even = near[1:] & near[:-1] & (np.abs(np.diff(step)) <= limit[1:])
    close = np.abs(step) <= limit + slope_m
    joined = close | np.append(even, values=False) | np.insert(even, 0, values=False)
    start = np.flatnonzero(np.insert(~(near & close), 0, values=True)[: len(order)])
    return np.stack((order[:-1][near], order[1:][near])), joined[near], start, group_sizes(start, len(order))


def _reach_deg(step: Floats) -> float:
    """Return the angle within which echoes of a beam are neighbours, given the steps between echoes, shape (n,).

    It is one and a half steps of the lidar, that is of the finest step but for 2 %, and at least 0.65°.
    """
    step = step[step > _LEAST_STEP_DEG]
    finest = np.partition(step, len(step) // _FINEST)[len(step) // _FINEST] if len(step) else 0.0
    return float(np.clip(_STEPS * finest, _STEP_DEG, _MAX_STEP_DEG))


def _same(ordered: NDArray[np.uint16]) -> Mask:
    return np.asarray(ordered[1:] == ordered[:-1])
