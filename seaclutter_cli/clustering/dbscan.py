"""Exact density-based clusters (DBSCAN), as in the evaluation of [Bi]."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.clustering.cells import Indices, Points
from seaclutter_cli.clustering.euclidean import ClusterFinder, numbered

Mask = NDArray[np.bool_]

_ROUNDING = 1e-9


class DbscanFinder:
    """Search for density-based clusters [1]_ in several subsets of the same points; see `ClusterFinder`.

    Two points are near each other if their distance is at most ``eps_m``. A point with ``min_points`` near it, itself
    included, is a core point. Core points near each other belong to one cluster; any other point belongs to the cluster
    of the nearest core point if that is near, otherwise to no cluster. The original method assigns a point between two
    clusters to the one that reaches it first, which depends on the order of the points. Ties between core points are
    resolved arbitrarily.

    All points of a cell with enough points are core points, and the components of core points are found cell by cell.
    Only points of cells with fewer points need a search tree.

    References
    ----------
    .. [1] Ester Martin, Kriegel Hans-Peter, Sander Jörg, Xu Xiaowei (1996). "A Density-Based Algorithm for Discovering
       Clusters in Large Spatial Databases with Noise". KDD-96, 226-231.

    Examples
    --------
    >>> everything = np.ones(6, np.bool_)
    >>> finder = DbscanFinder(np.array([[0.0, 1, 2, 3.5, 9, 9.5], [0] * 6, [0] * 6]), everything, 1.5, 3)
    >>> finder.clusters(everything, 1)
    array([ 0,  0,  0,  0, -1, -1])
    """

    def __init__(self, xyz: Points, among: Mask, eps_m: float, min_points: int) -> None:
        self._xyz, self._eps_m, self._min_points = xyz, eps_m, min_points
        # Closer than the next float means at most this one.
        self._finder = ClusterFinder(xyz, among, float(np.nextafter(eps_m, np.inf)))

    def clusters(self, keep: Mask, min_cluster_points: int) -> Indices:
        """Return the cluster of each point of a subset, shape (N,), numbered by first points; -1 for all others.

        Clusters with fewer than ``min_cluster_points`` are left out.
        """
        core = self._core(keep)
        labels = self._finder.clusters(core, 1)
        kept, cores = np.flatnonzero(keep & ~core), np.flatnonzero(core)
        if len(kept) and len(cores):
            distance, nearest = self._nearest(cores, kept, 1)
            near = distance[:, 0] <= self._eps_m
            labels[kept[near]] = labels[cores[nearest[near, 0]]]
        members = np.flatnonzero(labels >= 0)
        labels[members] = numbered(labels[members], min_cluster_points)
        return labels

    def _core(self, keep: Mask) -> Mask:
        """Return a mask of the core points of a subset."""
        core = self._finder.cell_sizes(keep) >= self._min_points
        few, kept = np.flatnonzero(keep & ~core), np.flatnonzero(keep)
        if len(few) and len(kept) >= self._min_points:
            distance, _ = self._nearest(kept, few, self._min_points)
            core[few] = distance[:, -1] <= self._eps_m
        return core

    def _nearest(self, among: Indices, query: Indices, count: int) -> tuple[NDArray[np.float64], Indices]:
        """Return distances and indices of the nearest points, both of shape (n, count); infinite where not near."""
        from scipy.spatial import cKDTree  # slow to import, not needed by other clusters

        tree = cKDTree(self._xyz[:, among].T, balanced_tree=False, compact_nodes=False)
        reach = self._eps_m * (1 + _ROUNDING)
        distance, index = tree.query(self._xyz[:, query].T, np.arange(1, count + 1), distance_upper_bound=reach)
        return distance, np.minimum(index, len(among) - 1)
