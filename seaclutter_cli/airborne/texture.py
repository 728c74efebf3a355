"""Neighbours of points from one k-d tree, and texture of the elevations around each, from co-occurrence matrices."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.threads import executor, threads

DIRECTIONS_DEG = (0, 45, 90, 135)
TEXTURE = ("homogeneity", "dissimilarity", "second_moment")
"""Names of the texture features ([Shi2022], Eq. 7 to 9)."""

_BINS = 1 << 19
_BLOCK_PAIRS, _BLOCK_POINTS = 1 << 20, 1 << 13


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


@dataclass(frozen=True)
class Levels:
    """Grey levels of points and of their partners in the shifted clouds.

    ``own``, shape (N,): level of each point, 0 to K - 1; ``partner``, shape (4, N): for each direction, the level of
    the nearest point in the cloud shifted that way; ``count``: number of levels, K.
    """

    own: Ints
    partner: Ints
    count: int

    @cached_property
    def weights(self) -> Floats:
        """Contribution of each pair of levels to homogeneity and dissimilarity, shape (2, K * K)."""
        distance = np.abs(np.subtract.outer(np.arange(self.count), np.arange(self.count))).reshape(-1)
        return np.stack((1 / (1 + distance**2), distance)).astype(np.float64)


def grey_levels(height_m: Floats, count: int, max_height_m: float) -> Ints:
    """Return heights quantised to K grey levels of equal size, 0 to K - 1, shape (N,).

    ``height_m``, shape (N,): heights above the sea surface in metres; ``count``: number of levels, K; ``max_height_m``:
    upper bound of the last level. Greater heights have the last level, heights below 0 the first.

    Examples
    --------
    >>> grey_levels(np.array([-0.1, 0.3, 7.9, 30.0]), 32, 8.0)
    array([ 0,  1, 31, 31])
    """
    return np.clip(np.floor(height_m * (count / max_height_m)), 0, count - 1).astype(np.int64)


def levels_of(near: Neighborhoods, height_m: Floats, count: int, max_height_m: float, shift_m: float) -> Levels:
    """Return the grey levels of points and of their partners.

    ``near``: neighbourhoods of the points; ``height_m``, shape (N,): heights of the points in metres; ``count``,
    ``max_height_m``: as for `grey_levels`; ``shift_m``: shift of the cloud, d, in metres.
    """
    own = grey_levels(height_m, count, max_height_m)
    angles = np.radians(DIRECTIONS_DEG)
    shifts = shift_m * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    partner = np.stack([own[near.nearest((float(x), float(y)))] for x, y in shifts])
    return Levels(own, partner, count)


def texture(block: PointBlock, levels: Levels) -> Floats:
    r"""Return the texture features of a block's points, shape (B, 3), in the order of `TEXTURE`.

    The cloud Y is the cloud X shifted by d along θ. Each neighbour of a point within r (itself included) is paired with
    the nearest point of Y (Eq. 5). The levels (c, d) of the pairs form the matrix N (Eq. 6), divided by their number:

    .. math:: Hom = \sum_{c,d} \frac{N(c, d)}{1 + (c - d)^2}, \quad Dis = \sum_{c,d} N(c, d) |c - d|, \quad
        ASM = \sum_{c,d} N(c, d)^2

    The features are means over 0, 45, 90 and 135° [1]_. The paper leaves three details open. Here, neighbours and
    partners are found in the plane, since the elevation is the grey level and the horizontal position corresponds to
    the pixel of an image. A partner is found for each neighbour; the inverse of a mapping would lack some partners.
    Levels are of height above the sea surface with fixed bounds: the texture of an object does not depend on the rest
    of its tile.

    References
    ----------
    .. [1] Shi Liang, Xing Junxin, Cai Yanjing (2022). "Classification of ship LIDAR point cloud data based on machine
       learning algorithm". Ship Science and Technology 44(17), 140-143. doi:10.3404/j.issn.1672-7649.2022.17.028
    """
    out, total = np.zeros((len(block.points), 3)), block.count
    for partner in levels.partner:
        pair = (levels.own * levels.count + partner)[block.neighbor]
        weighted = [block.total(weights[pair]) / total for weights in levels.weights]
        out += np.stack((*weighted, _second_moment(block, pair, levels.count**2) / total**2), axis=1)
    return out / len(levels.partner)


def _second_moment(block: PointBlock, pair: Ints, size: int) -> Ints:
    """Return the sum of the squared counts of each matrix, computed for a few matrices at a time."""
    step = max(1, _BINS // size)
    starts = range(0, len(block.points), step)
    ends = [*np.searchsorted(block.own, starts), len(pair)]
    sums = []
    for start, first, last in zip(starts, ends[:-1], ends[1:], strict=True):
        rows = min(step, len(block.points) - start)
        counts = np.bincount((block.own[first:last] - start) * size + pair[first:last], minlength=rows * size)
        sums.append((counts * counts).reshape(rows, size).sum(axis=1))
    return np.concatenate(sums)
