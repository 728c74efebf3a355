"""Exact density-based clusters (DBSCAN), as in the evaluation of [Bi]."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.clustering.cells import Indices, Points
from seaclutter_cli.clustering.euclidean import ClusterFinder, numbered

Mask = NDArray[np.bool_]

_ROUNDING = 1e-9


def dbscan(xyz: Points, eps_m: float, min_points: int) -> Indices:
    """Return the density-based cluster of each point.

    Two points are near each other if their distance is at most ``eps_m``. A point with enough points near it is a core
    point. Core points near each other belong to one cluster; any other point belongs to the cluster of the nearest core
    point if that is near, otherwise to no cluster [1]_.

    Parameters
    ----------
    xyz : ndarray, shape (3, N), float64
        Finite coordinates in metres.
    eps_m : float
        Maximum distance between near points in metres, bound included.
    min_points : int
        Minimum number of points near a core point, including itself.

    Returns
    -------
    ndarray, shape (N,), int64
        Cluster number, from 0 in the order of the clusters' first points; -1 for points in no cluster.

    Notes
    -----
    The original method assigns a point between two clusters to the cluster that reaches it first, which depends on the
    order of the points; the nearest core point does not. Ties between core points are resolved arbitrarily.

    References
    ----------
    .. [1] Ester Martin, Kriegel Hans-Peter, Sander Jörg, Xu Xiaowei (1996). "A Density-Based Algorithm for Discovering
       Clusters in Large Spatial Databases with Noise". KDD-96, 226-231.

    Examples
    --------
    >>> dbscan(np.array([[0.0, 1, 2, 3.5, 9, 9.5], [0] * 6, [0] * 6]), 1.5, 3)
    array([ 0,  0,  0,  0, -1, -1])
    """
    everything = np.ones(xyz.shape[1], np.bool_)
    return DbscanFinder(xyz, everything, eps_m, min_points).clusters(everything, 1)


class DbscanFinder:
    """Search for density-based clusters in several subsets of the same points.

    Parameters
    ----------
    xyz : ndarray, shape (3, N), float64
        Coordinates in metres.
    among : ndarray, shape (N,), bool
        Whether a point is in any of the subsets; these points must have finite coordinates.
    eps_m, min_points : float, int
        As for `dbscan`.

    Notes
    -----
    All points of a cell with enough points are core points, and the components of core points are found cell by cell
    (`ClusterFinder`). Only points of cells with fewer points need a search tree.
    """

    def __init__(self, xyz: Points, among: Mask, eps_m: float, min_points: int) -> None:
        self._xyz, self._eps_m, self._min_points = xyz, eps_m, min_points
        # Closer than the next float means at most this one.
        self._finder = ClusterFinder(xyz, among, float(np.nextafter(eps_m, np.inf)))

    def clusters(self, keep: Mask, min_cluster_points: int) -> Indices:
        """Return the cluster of each point of a subset, as `dbscan` does; -1 for all other points.

        Parameters
        ----------
        keep : ndarray, shape (N,), bool
            Whether a point is in the subset.
        min_cluster_points : int
            Minimum number of points in a cluster.
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
