"""Exact Euclidean clusters, and density-based ones (DBSCAN) as in the evaluation of [Bi], in bounded memory."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from seaclutter_cli.arrays import Floats, Ints, Mask, group_sizes, group_starts

_REACH = 2
_FEW_CELLS = 1 << 20
_ALL_PAIRED = 100
_CELLS_AT_ONCE = 1 << 13
_TABLE = 32
_BLOCK = 1 << 14
_ROUNDING = 1e-9
_STEPS = np.array([(i, j) for i in range(_REACH + 1) for j in range(-_REACH, _REACH + 1) if (i, j) >= (0, 0)])
"""Steps along x and y to columns in reach, in one direction."""


def euclidean_clusters(xyz: Floats, tolerance_m: float, min_points: int) -> Ints:
    """Return the Euclidean cluster of each point, shape (N,), given finite coordinates in metres, shape (3, N).

    Clusters are the connected components with enough points, numbered from 0 in the order of their first points; points
    in no cluster have -1. Two points are connected if ``sqrt(dx**2 + dy**2 + dz**2) < tolerance_m`` in float64
    arithmetic, without additional allowance: points exactly that far apart are not connected, equal points are.
    """
    everything = np.ones(xyz.shape[1], np.bool_)
    finder = ClusterFinder(xyz, everything, tolerance_m)
    del xyz  # which the caller may have released
    return finder.clusters(everything, min_points)


class ClusterFinder:
    """Search for Euclidean clusters in several subsets of the same points, with shared preparation.

    All points of a cell of a fine grid are connected (`Cells`), so only cells need to be joined. They are first joined
    by the distances of three points of each cell. Cells that remain in different components are then joined by the
    minimum distance between their points. Memory is proportional to the number of points at any density; so is time,
    except for dense components that almost touch, which take a search tree.

    Coordinates have shape (3, N). ``among``, shape (N,), tells whether a point is in any of the subsets; these must
    have finite coordinates.
    """

    def __init__(self, xyz: Floats, among: Mask, tolerance_m: float) -> None:
        self._tolerance_m = tolerance_m
        members = np.flatnonzero(among)
        cells = cells_of(xyz if len(members) == len(among) else xyz[:, members], tolerance_m)
        self._order = members[cells.order]
        self._xyz = xyz.take(self._order, axis=1)
        self._cell = np.repeat(np.arange(len(cells)), cells.count)
        self._cells = len(cells)
        low, high = (reduce.reduceat(self._xyz, cells.start, axis=1) for reduce in (np.minimum, np.maximum))
        pairs = [np.empty((2, 0), np.int64)]
        for own, other in cells.pairs():
            above = low.take(own, axis=1) - high.take(other, axis=1)
            below = low.take(other, axis=1) - high.take(own, axis=1)
            boxes_near = np.flatnonzero(self._near(np.maximum(np.maximum(above, below), 0)))
            pairs.append(np.stack((own[boxes_near], other[boxes_near])))
        self._pairs = np.concatenate(pairs, axis=1)

    def clusters(self, keep: Mask, min_points: int) -> Ints:
        """Return the cluster of each point of a subset, as `euclidean_clusters` does; -1 for all other points."""
        kept = np.flatnonzero(keep[self._order])
        labels = np.full(len(keep), -1)
        if len(kept) < min_points:
            return labels
        xyz = self._xyz if len(kept) == len(self._order) else self._xyz.take(kept, axis=1)
        component = self._components(xyz, np.bincount(self._cell[kept], minlength=self._cells))
        labels[self._order[kept]] = component[self._cell[kept]]
        members = np.flatnonzero(keep & (labels >= 0))
        labels[members] = _numbered(labels[members], min_points)
        return labels

    def cell_sizes(self, keep: Mask) -> Ints:
        """Return the number of kept points in the cell of each kept point, all connected; 0 for other points."""
        kept = np.flatnonzero(keep[self._order])
        cell = self._cell[kept]
        sizes = np.zeros(len(keep), np.int64)
        sizes[self._order[kept]] = np.bincount(cell, minlength=self._cells)[cell]
        return sizes

    def _components(self, xyz: Floats, count: Ints) -> Ints:
        """Return the component of each cell, given the points, shape (3, n), in cell order and their count per cell."""
        start = np.cumsum(count) - count
        occupied, pairs = count > 0, self._pairs
        if not occupied.all():
            pairs = pairs[:, occupied[pairs[0]] & occupied[pairs[1]]]
        component = np.arange(len(count))
        for sample in (start, start + count // 2, start + count - 1):
            own, other = pairs
            points = xyz.take(np.minimum(sample, xyz.shape[1] - 1), axis=1)
            near = self._near(points.take(own, axis=1) - points.take(other, axis=1))
            component = _join(component, own[near], other[near])
            pairs = _in_different_components(component, pairs.take(np.flatnonzero(~near), axis=1))
        pairs = pairs.take(np.flatnonzero((count[pairs] > 1).any(axis=0)), axis=1)
        work = count[pairs].prod(axis=0)
        order = np.argsort(work)
        for block in blocks(work[order], _BLOCK):
            own, other = _in_different_components(component, pairs[:, order[block]])
            near = self._any_near(xyz, (start[own], count[own]), (start[other], count[other]))
            component = _join(component, own[near], other[near])
        return component

    def _any_near(self, xyz: Floats, own: tuple[Ints, Ints], other: tuple[Ints, Ints]) -> Mask:
        """Return which pairs of cells, given by start and count, have near points: small pairs, or one of any size."""
        if (own[1] * other[1] > _BLOCK).any():
            return np.array([self._any_near_of_many(*(xyz[:, spans(*cell)] for cell in (own, other)))])
        pair, a, b = _members(own, other)
        return np.bincount(pair, self._near(xyz[:, a] - xyz[:, b]), len(own[0])) > 0

    def _any_near_of_many(self, own: Floats, other: Floats) -> bool:
        """Return whether any point of one set is near a point of the other, both of shape (3, n)."""
        from scipy.spatial import cKDTree  # slow to import, rarely needed

        own, other = self._in_reach(own, other), self._in_reach(other, own)
        tree = cKDTree(other.T, balanced_tree=False, compact_nodes=False)
        reach = self._tolerance_m * (1 + _ROUNDING)
        distance, nearest = tree.query(own.T, distance_upper_bound=reach)
        found = np.isfinite(distance)
        return bool(self._near(own[:, found] - other[:, nearest[found]]).any())

    def _in_reach(self, points: Floats, others: Floats) -> Floats:
        low, high = others.min(axis=1, keepdims=True), others.max(axis=1, keepdims=True)
        return points[:, self._near(np.maximum(np.maximum(low - points, points - high), 0))]

    def _near(self, difference: Floats) -> Mask:
        """Return a mask of the vectors, shape (3, …), that are shorter than the tolerance."""
        x, y, z = difference
        with np.errstate(over="ignore"):
            return np.asarray(np.sqrt(x * x + y * y + z * z) < self._tolerance_m)


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
    """

    def __init__(self, xyz: Floats, among: Mask, eps_m: float, min_points: int) -> None:
        self._xyz, self._eps_m, self._min_points = xyz, eps_m, min_points
        # Closer than the next float means at most this one.
        self._finder = ClusterFinder(xyz, among, float(np.nextafter(eps_m, np.inf)))

    def clusters(self, keep: Mask, min_cluster_points: int) -> Ints:
        """Return the cluster of each point of a subset, shape (N,), by first points; -1 for others, and small ones."""
        core = self._core(keep)
        labels = self._finder.clusters(core, 1)
        kept, cores = np.flatnonzero(keep & ~core), np.flatnonzero(core)
        if len(kept) and len(cores):
            distance, nearest = self._nearest(cores, kept, 1)
            near = distance[:, 0] <= self._eps_m
            labels[kept[near]] = labels[cores[nearest[near, 0]]]
        members = np.flatnonzero(labels >= 0)
        labels[members] = _numbered(labels[members], min_cluster_points)
        return labels

    def _core(self, keep: Mask) -> Mask:
        core = self._finder.cell_sizes(keep) >= self._min_points
        few, kept = np.flatnonzero(keep & ~core), np.flatnonzero(keep)
        if len(few) and len(kept) >= self._min_points:
            distance, _ = self._nearest(kept, few, self._min_points)
            core[few] = distance[:, -1] <= self._eps_m
        return core

    def _nearest(self, among: Ints, query: Ints, count: int) -> tuple[Floats, Ints]:
        """Return distances and indices of the nearest points, both of shape (n, count); infinite where not near."""
        from scipy.spatial import cKDTree  # slow to import, not needed by other clusters

        tree = cKDTree(self._xyz[:, among].T, balanced_tree=False, compact_nodes=False)
        reach = self._eps_m * (1 + _ROUNDING)
        distance, index = tree.query(self._xyz[:, query].T, np.arange(1, count + 1), distance_upper_bound=reach)
        return distance, np.minimum(index, len(among) - 1)


def pairs_within(xyz: Floats, reach_m: float) -> Ints:
    """Return the pairs of finite points, shape (3, N), that are closer than a reach, each once, shape (2, n)."""
    cells = cells_of(xyz, reach_m)
    own, other = np.concatenate((np.tile(np.arange(len(cells)), (2, 1)), *cells.pairs()), axis=1)
    pair, a, b = _members((cells.start[own], cells.count[own]), (cells.start[other], cells.count[other]))
    a, b = np.stack((a, b)).compress((a < b) | (pair >= len(cells)), axis=1)  # the first pairs are of a cell and itself
    a, b = cells.order[a], cells.order[b]
    x, y, z = xyz.take(a, axis=1) - xyz.take(b, axis=1)
    return np.stack((a, b)).compress(np.sqrt(x * x + y * y + z * z) < reach_m, axis=1)


def _members(own: tuple[Ints, Ints], other: tuple[Ints, Ints]) -> tuple[Ints, Ints, Ints]:
    """Return the pairs of members of pairs of spans, given by start and count, with the number of their pair."""
    pair = np.repeat(np.arange(len(own[0])), own[1])
    times = other[1][pair]
    return np.repeat(pair, times), np.repeat(spans(*own), times), spans(other[0][pair], times)


def _numbered(component: Ints, min_points: int) -> Ints:
    """Return the cluster number of each point from its component, by first points; -1 for small components."""
    size = np.bincount(component)
    first = np.empty(len(size), np.int64)
    first[component[::-1]] = np.arange(len(component))[::-1]
    large = np.flatnonzero(size >= min_points)
    number = np.full(len(size), -1)
    number[large[np.argsort(first[large])]] = np.arange(len(large))
    return number[component]


def _in_different_components(component: Ints, pairs: Ints) -> Ints:
    return pairs.take(np.flatnonzero(component[pairs[0]] != component[pairs[1]]), axis=1)


def _join(component: Ints, own: Ints, other: Ints) -> Ints:
    """Join the components of pairs of cells.

    Each component takes the least number among those it is paired with, until no pair differs. The number of components
    that can still be joined halves in each round.
    """
    root = np.arange(len(component))
    own, other = component[own], component[other]
    while len(own):
        np.minimum.at(root, np.maximum(own, other), np.minimum(own, other))
        while (root != (further := root[root])).any():
            root = further
        own, other = root[own], root[other]
        differ = np.flatnonzero(own != other)
        own, other = own[differ], other[differ]
    return root[component]


@dataclass(frozen=True)
class Cells:
    """The C occupied cells of a grid over N points, sorted by column and height.

    The side of a cell is the tolerance divided by the root of 3, reduced by 1 part in 10^8. Any two points of a cell
    are closer than the tolerance, and points closer than it are at most two cells apart on each axis.

    ``order``, shape (N,), has the points in the order of their cells; ``start`` and ``count``, shape (C,), the index of
    a cell's first point in it, and the number of its points. ``column`` is the rank of a cell's column, ``height`` its
    height in it. ``columns``, shape (K,), are the numbers of the occupied columns, ascending, ``row`` is the difference
    between the numbers of columns that are neighbours along x.
    """

    order: Ints
    start: Ints
    count: Ints
    column: Ints
    height: Ints
    columns: Ints
    row: int

    def __len__(self) -> int:
        return len(self.start)

    def pairs(self) -> Iterator[Ints]:
        """Yield arrays, shape (2, n), with the pairs of cells at most two apart on each axis, each once; all of few."""
        if len(self) <= _ALL_PAIRED:
            yield np.stack(np.tril_indices(len(self), -1))
            return
        stride = int(self.height.max()) + 1 + _REACH
        before = _ranks(self.column * stride + self.height, len(self.columns) * stride)
        sought = self.columns + (_STEPS @ np.array((self.row, 1)))[:, None]
        other = _ranks(self.columns, int(sought[-1, -1]))(sought)
        known = np.append(self.columns, -1)[other] == sought
        for start in range(0, len(self), _CELLS_AT_ONCE):
            column = self.column[start : start + _CELLS_AT_ONCE]
            step, own = known[:, column].nonzero()
            beside = other[step, column[own]] * stride + self.height[own + start]
            first = before(beside - np.where(step, _REACH, -1))  # upwards only in the same column
            found = before(beside + _REACH + 1) - first
            yield np.stack((np.repeat(own + start, found), spans(first, found)))


def _ranks(ordered: Ints, largest: int) -> Callable[[Ints], Ints]:
    """Return a function that counts the ascending numbers below each of some others, which are 0 to ``largest``."""
    if largest > _TABLE * len(ordered):
        return lambda others: np.asarray(np.searchsorted(ordered, others))
    return np.cumsum(np.bincount(ordered + 1, minlength=largest + 1)).take


def cells_of(xyz: Floats, tolerance_m: float) -> Cells:
    """Return the cells of finite points, shape (3, N), in metres."""
    if not xyz.shape[1]:
        none = np.empty(0, np.int64)
        return Cells(none, none, none, none, none, none, 1)
    side = tolerance_m / np.sqrt(3) * (1 - 1e-8)
    y, z = (_along_axis(values, side, tolerance_m) for values in xyz[1:])
    row = int(y.max()) + 1 + _REACH
    column = _along_axis(xyz[0], side, tolerance_m)
    column *= row
    column += y
    stride = int(z.max()) + 1
    rank = column
    if int(column.max()) * stride >= 2**62:
        rank = np.unique(column, return_inverse=True)[1].reshape(-1)
    key = rank * stride
    key += z
    order = np.argsort(key)
    start = group_starts(key[order])
    columns = column[order[start]]
    first = group_starts(columns)
    rank = np.repeat(np.arange(len(first)), group_sizes(first, len(columns)))
    return Cells(order, start, group_sizes(start, len(order)), rank, z[order[start]], columns[first], row)


def blocks(sizes: Ints, limit: int) -> Iterator[slice]:
    """Yield slices over items whose sizes add up to at most a limit; a larger item forms a slice of its own."""
    ends = np.cumsum(sizes)
    start = 0
    while start < len(sizes):
        before = ends[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, before + limit, side="right")))
        yield slice(start, stop)
        start = stop


def spans(start: Ints, count: Ints) -> Ints:
    """Return the indices of all spans, one span after the other."""
    ends = np.cumsum(count)
    total = int(ends[-1]) if len(ends) else 0
    return np.arange(total) + np.repeat(start - ends + count, count)


def _along_axis(values: Floats, side: float, tolerance_m: float) -> Ints:
    least = values.min()
    with np.errstate(over="ignore"):
        if (values.max() - least) / side < _FEW_CELLS:
            return np.asarray((values - least) / side, np.int64)
    return _with_gaps(values, side, tolerance_m)


def _with_gaps(values: Floats, side: float, tolerance_m: float) -> Ints:
    """Return the cell numbers of widely spread coordinates, exactly: every gap is shortened to three cells."""
    order = np.argsort(values)
    ordered = values[order]
    with np.errstate(over="ignore"):
        gap = np.diff(ordered, prepend=ordered[0]) >= tolerance_m
    starts = np.flatnonzero(gap)
    segment = np.cumsum(gap)
    local = np.asarray((ordered - np.append(ordered[0], ordered[starts])[segment]) / side, np.int64)
    steps = local[starts - 1] + 1 + _REACH
    cells = np.empty(len(local), np.int64)
    cells[order] = local + np.append(0, np.cumsum(steps))[segment]
    return cells
