"""Density-based clusters (DBSCAN), exact: what S3 evaluates with."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from seaclutter_cli.clustering.cells import Indices, Points
from seaclutter_cli.clustering.euclidean import ClusterFinder, numbered

Mask = NDArray[np.bool_]

_ROUNDING = 1e-9


def dbscan(xyz: Points, eps_m: float, min_points: int) -> Indices:
    """Return which cluster each point belongs to.

    A point with enough points near it is a core point. Core points near each other belong to one cluster; any other
    point belongs to the cluster of the nearest core point, if that is near, else to none [1]_. Near is at most
    ``eps_m`` away.

    Parameters
    ----------
    xyz : ndarray, shape (3, N), float64
        Finite coordinates in metres.
    eps_m : float
        Distance up to which, included, points are near.
    min_points : int
        Points near a core point, itself included.

    Returns
    -------
    ndarray, shape (N,), int64
        Number of the point's cluster, from 0 in the order of their first points; -1 for points in none.

    Notes
    -----
    The original gives a point between two clusters to the one that reaches it first, which depends on the order of the
    points; the nearest core point does not. Of several equally near ones any may be it.

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
    """Finds the density-based clusters of several subsets of the same points.

    Parameters
    ----------
    xyz : ndarray, shape (3, N), float64
        Coordinates in metres.
    among : ndarray, shape (N,), bool
        Points, with finite coordinates, that are in any of the subsets.
    eps_m, min_points : float, int
        As for `dbscan`.

    Notes
    -----
    All points of a cell with enough of them are core points, and the components of core points are found cell by cell
    (`ClusterFinder`). A tree is asked only about points of cells that hold few.
    """

    def __init__(self, xyz: Points, among: Mask, eps_m: float, min_points: int) -> None:
        self._xyz, self._eps_m, self._min_points = xyz, eps_m, min_points
        # Closer than the next number is at most this one.
        self._finder = ClusterFinder(xyz, among, float(np.nextafter(eps_m, np.inf)))

    def clusters(self, keep: Mask, min_cluster_points: int) -> Indices:
        """Return which cluster each point belongs to, as `dbscan` does; -1 for those not kept.

        Parameters
        ----------
        keep : ndarray, shape (N,), bool
            The subset.
        min_cluster_points : int
            Points that make a cluster; smaller ones are none.
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
        """Tell which points are core points of a subset."""
        core = self._finder.cell_sizes(keep) >= self._min_points
        few, kept = np.flatnonzero(keep & ~core), np.flatnonzero(keep)
        if len(few) and len(kept) >= self._min_points:
            distance, _ = self._nearest(kept, few, self._min_points)
            core[few] = distance[:, -1] <= self._eps_m
        return core

    def _nearest(self, among: Indices, of: Indices, count: int) -> tuple[NDArray[np.float64], Indices]:
        """Return distances to the nearest points and which they are, shape (n, count); infinite where not near."""
        tree = cKDTree(self._xyz[:, among].T, balanced_tree=False, compact_nodes=False)
        reach = self._eps_m * (1 + _ROUNDING)
        distance, index = tree.query(self._xyz[:, of].T, np.arange(1, count + 1), distance_upper_bound=reach)
        return distance, np.minimum(index, len(among) - 1)
