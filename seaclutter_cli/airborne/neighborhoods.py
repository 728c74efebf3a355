"""All neighbours within a radius, a block of points at a time, from one k-d tree."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]

_BLOCK_PAIRS = 1 << 20
_BLOCK_POINTS = 1 << 13


@dataclass(frozen=True)
class PointBlock:
    """Some points and their neighbours, P pairs.

    Parameters
    ----------
    points : ndarray, shape (B,), int64
        Indices of the points.
    own : ndarray, shape (P,), int64
        For each pair, which of the B points it belongs to, from 0; ascending.
    neighbor : ndarray, shape (P,), int64
        Index of the neighbour among all points. Each point is its own neighbour too.
    """

    points: NDArray[np.int64]
    own: NDArray[np.int64]
    neighbor: NDArray[np.int64]

    @property
    def count(self) -> NDArray[np.int64]:
        """Number of each point's neighbours, shape (B,), itself included."""
        return np.asarray(np.bincount(self.own, minlength=len(self.points)), np.int64)

    def total(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return sums over the neighbours of a value for each pair, shape (P,), as shape (B,)."""
        return np.asarray(np.bincount(self.own, values, minlength=len(self.points)), np.float64)


class Neighborhoods:
    """Neighbours in the plane.

    Parameters
    ----------
    xy : ndarray, shape (2, N), float64
        Places in metres.
    """

    def __init__(self, xy: NDArray[np.float64]) -> None:
        # Near the origin, distances are not rounded by coordinates of millions of metres.
        self._places = np.ascontiguousarray((xy - xy.min(axis=1, keepdims=True, initial=0.0)).T)
        self._tree = _tree(self._places)

    def nearest(self, shift_m: tuple[float, float]) -> NDArray[np.int64]:
        """Return for each point the nearest one of the cloud shifted by so much, shape (N,)."""
        return np.asarray(self._tree.query(self._places - np.array(shift_m), workers=threads())[1], np.int64)

    def apply(self, radius_m: float, function: Callable[[PointBlock], Values]) -> Values:
        """Return what a function says of each point.

        Parameters
        ----------
        radius_m : float
            Neighbours are points no farther than this, in metres.
        function : callable
            Is given blocks, in several threads, and returns values for their points, shape (B, F).

        Returns
        -------
        ndarray, shape (N, F), float64
        """
        parts = self._parts(radius_m)
        with ThreadPoolExecutor(threads()) as pool:
            found = list(pool.map(lambda part: function(self._block(part, radius_m)), parts))
        out = np.empty((len(self._places), found[0].shape[1] if found else 0))
        for points, values in zip(parts, found, strict=True):
            out[points] = values
        return out

    def _parts(self, radius_m: float) -> list[NDArray[np.int64]]:
        """Return the points in parts that have bounded numbers of neighbours together."""
        counts = self._tree.query_ball_point(self._places, radius_m, return_length=True, workers=threads())
        order = self._along_the_tree()
        pairs = np.cumsum(counts[order])
        ends = [0]
        while ends[-1] < len(order):
            before = pairs[ends[-1] - 1] if ends[-1] else 0
            end = int(np.searchsorted(pairs, before + _BLOCK_PAIRS, "right"))
            ends.append(min(max(end, ends[-1] + 1), ends[-1] + _BLOCK_POINTS, len(order)))
        return [order[start:end] for start, end in pairwise(ends)]

    def _along_the_tree(self) -> NDArray[np.int64]:
        """Return the points in an order in which near ones are close together."""
        return np.asarray(self._tree.indices, np.int64)

    def _block(self, points: NDArray[np.int64], radius_m: float) -> PointBlock:
        part = _tree(self._places[points])
        found = part.sparse_distance_matrix(self._tree, radius_m, output_type="ndarray")
        order = np.argsort(found["i"].astype(np.uint16), kind="stable")
        return PointBlock(points, found["i"][order], found["j"][order])


def threads() -> int:
    """Count the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _tree(places: NDArray[np.float64]) -> Any:
    """Return a tree of places, shape (N, 2), that is quick to build."""
    from scipy.spatial import KDTree  # takes a while to load, which settings alone are spared

    return KDTree(places, balanced_tree=False, compact_nodes=False)
