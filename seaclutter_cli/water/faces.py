"""Faces: echoes beside each other at nearly one range, which the surfaces of bodies have and water, spray and rain have not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.groups import group_sizes

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

_COLUMN_DEG = 0.3
_BEAM_DEG = 0.1
_STEP_DEG = 0.65
_NOISE_M = 0.15
_DIVERGENCE = 0.003
_RAKE = 0.3
_REACH_M = 3.0
_BEAMS = 1.5
_LEAST_GAP_DEG = 0.7


@dataclass(frozen=True)
class Faces:
    """The surfaces that N echoes belong to.

    Echoes above each other form a face from ``low_m`` to ``top_m`` along z, shape (N,) each. ``pairs``, shape (2, P),
    are neighbours at most 3 m apart; they are ``joined``, shape (P,), if they lie on one surface.
    """

    low_m: Floats
    top_m: Floats
    pairs: Indices
    joined: Mask

    @classmethod
    def of(cls, xyz: Floats, elevation_deg: Floats, above_deg: Floats) -> "Faces":
        """Return the faces of echoes, given positions, shape (3, N), the elevations of their beams and the angles to the beams above.

        Notes
        -----
        Echoes within 0.3° of bearing are ordered by elevation, those of one beam by bearing. Neighbours belong to one
        surface if their ranges differ by at most the range noise, the divergence of the beam and the rake of a hull.
        The slope of a wave spreads its heights over ranges, and spray and rain fill a volume. Of two divisions into
        bearings, half a step apart, the higher face counts.
        """
        x, y, z = xyz
        low, top = z.copy(), z.copy()
        if len(x) < 2:
            return cls(low, top, np.empty((2, 0), np.intp), np.empty(0, np.bool_))
        found = []
        distance = np.hypot(x, y)
        bearing = np.degrees(np.arctan2(y, x)) + 180
        beam = np.rint((elevation_deg + 90) / _BEAM_DEG).astype(np.uint16)
        upwards = np.argsort(elevation_deg, kind="stable")
        gap_deg = np.maximum(_LEAST_GAP_DEG, _BEAMS * above_deg)
        for shift in (0.0, 0.5):
            column = (bearing / _COLUMN_DEG + shift).astype(np.uint16)
            order = upwards[np.argsort(column[upwards], kind="stable")]
            near = (column[order][1:] == column[order][:-1]) & (np.diff(elevation_deg[order]) <= gap_deg[order[:-1]])
            found.append(_pairs(order, near, distance, _RAKE * np.abs(np.diff(z[order]))))
            start = np.ones(len(order), np.bool_)
            start[found[-1][1][found[-1][2]]] = False
            start = np.flatnonzero(start)
            size = group_sizes(start, len(order))
            ends = np.repeat([np.minimum.reduceat(z[order], start), np.maximum.reduceat(z[order], start)], size, axis=1)
            higher = ends[1] - ends[0] > (top - low)[order]
            low[order[higher]], top[order[higher]] = ends[0][higher], ends[1][higher]
        along = np.argsort(bearing, kind="stable")
        order = along[np.argsort(beam[along], kind="stable")]
        step = np.diff(bearing[order])
        near = (beam[order][1:] == beam[order][:-1]) & (step <= _STEP_DEG)
        found.append(_pairs(order, near, distance, np.radians(step) * distance[order][1:]))
        pairs = [np.stack((order[second - 1], order[second])) for order, second, _ in found]
        return cls(low, top, np.concatenate(pairs, axis=1), np.concatenate([joined for *_, joined in found]))

    def counts(self, among: Mask) -> tuple[Floats, Floats]:
        """Return how many neighbours among some echoes lie on one surface with each echo, and how many do not."""
        both = among[self.pairs].all(axis=0)
        return tuple(
            np.bincount(self.pairs[:, both & chosen].reshape(-1), minlength=len(among)).astype(np.float64)
            for chosen in (self.joined, ~self.joined)
        )

    def above_m(self, level: Floats) -> Floats:
        """Return the heights of the faces above z of the water, shape (N,)."""
        return self.top_m - np.maximum(self.low_m, level)


def _pairs(order: Indices, near: Mask, distance: Floats, slope_m: Floats) -> tuple[Indices, Indices, Mask]:
    """Return the ordered positions of the second of each pair of neighbours, and which lie on one surface."""
    ordered = distance[order]
    apart = np.abs(np.diff(ordered))
    second = np.flatnonzero(near & (apart <= _REACH_M)) + 1
    joined = apart[second - 1] <= _NOISE_M + _DIVERGENCE * ordered[second] + slope_m[second - 1]
    return order, second, joined
