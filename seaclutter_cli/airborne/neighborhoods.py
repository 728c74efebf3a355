"""Neighbours within a radius for blocks of points, from one k-d tree."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.threads import executor, threads

_BLOCK_PAIRS = 1 << 20
_BLOCK_POINTS = 1 << 13


@dataclass(frozen=True)
class PointBlock:
    """A block of B points and their neighbours, P pairs.

    ``points``, shape (B,): indices of the points; ``own``, shape (P,): index of the point of each pair in ``points``,
    ascending; ``neighbor``, shape (P,): index of the neighbour among all points. Each point is its own neighbour, too.
    """

    points: Ints
    own: Ints
    neighbor: Ints

    @property
    def count(self) -> Ints:
        """Number of neighbours of each point, shape (B,), itself included."""
        return np.asarray(np.bincount(self.own, minlength=len(self.points)), np.int64)

    def total(self, values: Floats) -> Floats:
        """Return sums over the neighbours of each point, shape (B,), of a value for each pair, shape (P,)."""
        return np.asarray(np.bincount(self.own, values, minlength=len(self.points)), np.float64)


class Neighborhoods:
    """Neighbours of points in the horizontal plane.

    ``xy``, shape (2, N): coordinates in metres.
    """

    def __init__(self, xy: Floats) -> None:
        # Moved to the origin, because coordinates of millions of metres would round the distances.
        self._points = np.ascontiguousarray((xy - xy.min(axis=1, keepdims=True, initial=0.0)).T)
        self._tree = _tree(self._points)

    def nearest(self, shift_m: tuple[float, float]) -> Ints:
        """Return for each point the index of the nearest point in the shifted cloud, shape (N,)."""
        return np.asarray(self._tree.query(self._points - np.array(shift_m), workers=threads())[1], np.int64)

    def apply(self, radius_m: float, function: Callable[[PointBlock], Floats]) -> Floats:
        """Return the values that a function computes for each point, shape (N, F).

        ``radius_m``: radius of the neighbourhoods in metres, inclusive; ``function``: called with blocks, in several
        threads; returns values for their points, shape (B, F).
        """
        parts = self._parts(radius_m)
        with executor(threads(), "neighborhoods") as pool:
            found = list(pool.map(lambda part: function(self._block(part, radius_m)), parts))
        out = np.empty((len(self._points), found[0].shape[1] if found else 0))
        for points, values in zip(parts, found, strict=True):
            out[points] = values
        return out

    def _parts(self, radius_m: float) -> list[Ints]:
        """Return the points in parts, each with a bounded total number of neighbours."""
        counts = self._tree.query_ball_point(self._points, radius_m, return_length=True, workers=threads())
        order = np.asarray(self._tree.indices, np.int64)  # keeps neighbours together
        pairs = np.cumsum(counts[order])
        ends = [0]
        while ends[-1] < len(order):
            before = pairs[ends[-1] - 1] if ends[-1] else 0
            end = int(np.searchsorted(pairs, before + _BLOCK_PAIRS, "right"))
            ends.append(min(max(end, ends[-1] + 1), ends[-1] + _BLOCK_POINTS, len(order)))
        return [order[start:end] for start, end in pairwise(ends)]

    def _block(self, points: Ints, radius_m: float) -> PointBlock:
        part = _tree(self._points[points])
        found = part.sparse_distance_matrix(self._tree, radius_m, output_type="ndarray")
        order = np.argsort(found["i"].astype(np.uint16), kind="stable")
        return PointBlock(points, found["i"][order], found["j"][order])


def _tree(points: Floats) -> Any:
    """Return a k-d tree of points, shape (N, 2), that is fast to build."""
    from scipy.spatial import KDTree  # slow to import, not needed for settings

    return KDTree(points, balanced_tree=False, compact_nodes=False)
