"""Exact distances to nearest neighbours, with duplicates, on all cores; the number of cores does not affect results."""

import os
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.threads import threads

# Otherwise idle OpenMP threads spin and take cores from the threads that read and compress.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
try:
    from small_gicp import KdTree as _FastTree
except ImportError:  # no wheel for this platform
    _FastTree = None

Points = NDArray[np.float64]
Distances = NDArray[np.float64]
Search = Callable[[Points, int], tuple[NDArray[np.int64], Distances]]

_BLOCK_DISTANCES = 1 << 19
_FEW_POINTS, _FEW_DISTANCES = 4000, 5000  # below, waking other threads takes longer
_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)


def mean_neighbor_distance(points: Points, neighbors: int) -> Distances:
    """Return the mean distance of points, shape (N, 3), finite, to their 1 to N - 1 nearest other points, shape (N,).

    Equal points are neighbours of each other at distance 0.
    """

    def reduce(distance: Distances, others: NDArray[np.int64] | None) -> Distances:
        if others is None:
            return np.asarray(distance[:, 1:].sum(axis=1) / neighbors)
        before = np.cumsum(others, axis=1) - others
        used = np.clip(neighbors - before, 0, others)
        return np.asarray(np.einsum("ij,ij->i", distance, used) / neighbors)

    return _over_neighbors(points, neighbors, reduce)


def nth_neighbor_distance(points: Points, rank: int, query: NDArray[np.intp] | None = None) -> Distances:
    """Return the distance of points, shape (N, 3), finite, to their n-th nearest other point, n < N, shape (N,).

    Equal points are neighbours of each other at distance 0. With ``query``, the indices of M points, the shape is (M,);
    neighbours are always searched among all N. The distance is at most a radius if and only if at least n other points
    lie within it, bound included.
    """

    def reduce(distance: Distances, others: NDArray[np.int64] | None) -> Distances:
        if others is None:
            return distance[:, rank]
        enough = np.cumsum(others, axis=1) >= rank
        return np.asarray(distance[np.arange(len(distance)), np.argmax(enough, axis=1)])

    return _over_neighbors(points, rank, reduce, query)


def nearest(points: Points, query: Points) -> tuple[NDArray[np.int64], Distances]:
    """Return the nearest of N points, at least one, to each of M others, shape (N, D) and (M, D), and its distance.

    Coordinates are finite, of two or three dimensions; index and distance have the shape (M,).
    """
    if points.shape[1] == 2:
        points, query = (np.column_stack((flat, np.zeros(len(flat)))) for flat in (points, query))
    index, distance = _searcher(np.ascontiguousarray(points))(np.ascontiguousarray(query), 1)
    return index.reshape(-1), distance.reshape(-1)


def _over_neighbors(
    points: Points,
    count: int,
    reduce: Callable[[Distances, NDArray[np.int64] | None], Distances],
    query: NDArray[np.intp] | None = None,
) -> Distances:
    """Return the reduced neighbour distances, shape (M,), from a search among distinct points.

    Equal points stall the trees. ``reduce`` also gets the number of points at each distance; None if all are distinct.
    """
    first, inverse, multiplicity = _distinct(points)
    distinct, index_of = (points, np.arange(len(points))) if len(first) == len(points) else (points[first], inverse)
    index_of = index_of if query is None else index_of[query]
    queried = np.flatnonzero(np.bincount(index_of, minlength=len(distinct)))
    search, k = _searcher(distinct), min(count + 1, len(distinct))
    out = np.empty(len(distinct))
    size = max(1, _BLOCK_DISTANCES // k)
    for start in range(0, len(queried), size):
        block = slice(start, start + size) if len(queried) == len(distinct) else queried[start : start + size]
        index, distance = search(distinct[block], k)
        others = None if distinct is points else multiplicity[index]
        if others is not None:
            others[:, 0] -= 1  # the nearest of distinct points is the point itself
        out[block] = reduce(distance, others)
    return out[index_of]


def _distinct(points: Points) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices of the distinct points, the distinct point of every point, and the count of each."""
    key = _keys(points)
    ordered = np.sort(key)
    if (ordered[1:] != ordered[:-1]).all():
        every = np.arange(len(points))
        return every, every, np.ones_like(every)
    _, first, inverse, multiplicity = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
    if len(first) < len(points) and not np.array_equal(points[first[inverse]], points):
        _, first, inverse, multiplicity = np.unique(  # two points share a key
            points + 0.0, axis=0, return_index=True, return_inverse=True, return_counts=True
        )
    return first, inverse.reshape(-1), multiplicity


def _keys(points: Points) -> NDArray[np.uint64]:
    """Return a key of each point, shape (N,): equal points have equal keys, others hardly ever."""
    key = np.zeros(len(points), np.uint64)
    for shift, (axis, factor) in enumerate(zip(points.T, _MIX, strict=True)):
        bits = (axis + 0.0).view(np.uint64)  # -0.0 equals 0.0
        mixed = bits >> np.uint64(32)
        mixed ^= bits
        mixed *= factor
        mixed >>= np.uint64(shift)
        key ^= mixed
    return key


def _searcher(points: Points) -> Search:
    """Return a function that finds the k nearest of ``points``, nearest first."""
    if _FastTree is not None:
        fast = _FastTree(points, num_threads=threads() if len(points) > _FEW_POINTS else 1)

        def search(query: Points, k: int) -> tuple[NDArray[np.int64], Distances]:
            used = threads() if len(query) * k > _FEW_DISTANCES else 1
            index, squared = fast.batch_knn_search(query, k, num_threads=used)
            return index.view(np.int64), np.sqrt(squared)

        return search
    from scipy.spatial import cKDTree

    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    return lambda query, k: tree.query(query, np.arange(1, k + 1), workers=threads())[::-1]
