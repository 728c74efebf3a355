"""Features of points, the input of the classifier: texture from co-occurrence matrices, and others of neighbours."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Interval

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.params import Positive, key
from seaclutter_cli.threads import executor, threads

DIRECTIONS_DEG = (0, 45, 90, 135)
TEXTURE = ("homogeneity", "dissimilarity", "second_moment")
"""Names of the texture features ([Shi2022], Eq. 7 to 9)."""

_OTHERS = (
    *("height", "mean_height", "height_deviation", "density", "linearity", "planarity"),
    *("intensity", "intensity_deviation", "context_height", "context_height_deviation", "context_density"),
)
FEATURES = {"texture": TEXTURE, "full": (*TEXTURE, *_OTHERS)}
"""Feature names by feature set."""
_BINS = 1 << 19
_BLOCK_PAIRS, _BLOCK_POINTS = 1 << 20, 1 << 13


class PointBlock:
    """A block of B points and their neighbours, P pairs.

    ``points``, shape (B,): indices of the points; ``own``, shape (P,): index of the point of each pair in ``points``,
    ascending; ``neighbor``, shape (P,): index of the neighbour among all points. Each point is its own neighbour, too.
    ``count``, shape (B,): number of neighbours of each point.
    """

    def __init__(self, points: Ints, own: Ints, neighbor: Ints) -> None:
        self.points, self.own, self.neighbor = points, own, neighbor
        self.count = np.bincount(own, minlength=len(points))

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


def _level_pairs(near: Neighborhoods, height_m: Floats, params: "FeatureParams") -> Ints:
    """Return the grey levels of each point and of its partner in each shifted cloud as one number, shape (4, N).

    It is K times the level of the point, at a height above the sea, plus that of the nearest point in the cloud. Levels
    are of equal size; heights above the upper bound of the last level have that level, heights below 0 the first.
    """
    steps = np.floor(height_m * (params.levels / params.max_height_m))
    own = np.clip(steps, 0, params.levels - 1).astype(np.int64)
    angles = np.radians(DIRECTIONS_DEG)
    shifts = params.shift_m * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    return np.stack([own * params.levels + own[near.nearest((float(x), float(y)))] for x, y in shifts])


def texture(block: PointBlock, level_pairs: Ints, levels: int) -> Floats:
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
    step = np.abs(np.subtract.outer(np.arange(levels), np.arange(levels))).reshape(-1)
    contributions = np.stack((1 / (1 + step**2), step))  # of each pair to homogeneity and dissimilarity
    out, total = np.zeros((len(block.points), 3)), block.count
    for pairs in level_pairs:
        pair = pairs[block.neighbor]
        weighted = [block.total(weights[pair]) / total for weights in contributions]
        out += np.stack((*weighted, _second_moment(block, pair, levels**2) / total**2), axis=1)
    return out / len(level_pairs)


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


@dataclass(frozen=True, kw_only=True)
class FeatureParams:
    """Features of the non-sea points."""

    features: Literal["texture", "full"] = key(
        "full", "Texture only, or texture with height, density, shape and intensity of the neighbourhood."
    )
    radius_m: Positive = key(3.0, "Radius of the neighbourhood in the plane, r.")
    shift_m: Positive = key(1.0, "Shift of the cloud for its co-occurrence matrix, d.")
    levels: Annotated[int, Interval(ge=2, le=64)] = key(32, "Number of grey levels of height, K.")
    max_height_m: Positive = key(8.0, "Height above the sea at the upper bound of the last level.")
    context_m: Positive = key(10.0, "Radius of the wider surroundings.")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the features."""
        return FEATURES[self.features]


@dataclass(frozen=True)
class NonSeaPoints:
    """The N non-sea points of a tile.

    ``xy``, shape (2, N): horizontal coordinates in metres; ``height_m``, shape (N,): height above the sea surface;
    ``intensity``, shape (N,): intensity in the sensor's unit; 0 where there is none; ``points_per_m2``: density of the
    whole tile, sea included, over the cells with points; ``least_m``: height that makes a point one of them.
    """

    xy: Floats
    height_m: Floats
    intensity: Floats
    points_per_m2: float
    least_m: float = 0.5


def features_of(points: NonSeaPoints, params: FeatureParams) -> Floats:
    r"""Return the features of points, shape (N, F), in the order of ``params.names``.

    For the texture, see `texture`. The full set adds the height of the point and, over its neighbours within r: mean
    and standard deviation of the height; density relative to the whole tile, whose density depends on the flight;
    linearity and planarity, :math:`(l_1 - l_2) / l_1` and :math:`(l_2 - l_3) / l_1` for the eigenvalues
    :math:`l_1 \ge l_2 \ge l_3` of the covariance of the positions; mean and relative standard deviation of the
    intensity. The wider surroundings distinguish the shore of an island from a rock: mean and standard deviation of
    the height, and density, over the cells of width r / 2 whose centroid is within ``context_m`` of the centroid of
    the point's own cell.
    """
    if not len(points.height_m):
        return np.empty((0, len(params.names)))
    near = Neighborhoods(points.xy)
    pairs = _level_pairs(near, points.height_m, params)
    if params.features == "texture":
        return near.apply(params.radius_m, lambda block: texture(block, pairs, params.levels))
    own = near.apply(params.radius_m, lambda block: _full(block, pairs, points, params))
    return np.hstack((own, _context(points, params)))


def _full(block: PointBlock, level_pairs: Ints, points: NonSeaPoints, params: FeatureParams) -> Floats:
    count = block.count
    height, intensity = points.height_m[block.neighbor], points.intensity[block.neighbor]
    mean = block.total(height) / count
    brightness = block.total(intensity) / count
    spread = np.sqrt(block.total((intensity - brightness[block.own]) ** 2) / count)
    deviation = np.sqrt(block.total((height - mean[block.own]) ** 2) / count)
    columns = (
        points.height_m[block.points],
        mean,
        deviation,
        count / (np.pi * params.radius_m**2 * points.points_per_m2),
        *_shape(block, points),
        brightness,
        spread / np.maximum(brightness, 1e-9),
    )
    return np.column_stack((texture(block, level_pairs, params.levels), *columns))


def _context(points: NonSeaPoints, params: FeatureParams) -> Floats:
    """Return mean and deviation of the height, and relative density, of the wider surroundings, shape (N, 3)."""
    side = np.floor((points.xy - points.xy.min(axis=1, keepdims=True)) / (params.radius_m / 2)).astype(np.int64)
    _, which, count = np.unique(side[0] * (side[1].max() + 1) + side[1], return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    x, y, height = (np.bincount(which, values) / count for values in (*points.xy, points.height_m))
    square = np.asarray(np.bincount(which, (points.height_m - height[which]) ** 2), np.float64)
    expected = np.pi * params.context_m**2 * points.points_per_m2

    def summed(block: PointBlock) -> Floats:
        weight = count[block.neighbor].astype(np.float64)
        total = block.total(weight)
        mean = block.total(weight * height[block.neighbor]) / total
        within = block.total(square[block.neighbor])
        between = block.total(weight * (height[block.neighbor] - mean[block.own]) ** 2)
        return np.column_stack((mean, np.sqrt((within + between) / total), total / expected))

    return Neighborhoods(np.stack((x, y))).apply(params.context_m, summed)[which]


def _shape(block: PointBlock, points: NonSeaPoints) -> tuple[Floats, Floats]:
    """Return linearity and planarity, shape (B,) each; 0 where all neighbours coincide."""
    center = block.points[block.own]
    offset = [axis[block.neighbor] - axis[center] for axis in (points.xy[0], points.xy[1], points.height_m)]
    count = block.count
    mean = [block.total(axis) / count for axis in offset]
    covariance = np.empty((len(block.points), 3, 3))
    for i in range(3):
        for j in range(i + 1):
            product = block.total(offset[i] * offset[j]) / count - mean[i] * mean[j]
            covariance[:, i, j] = covariance[:, j, i] = product
    least, middle, most = np.maximum(np.linalg.eigvalsh(covariance), 0).T
    scale = np.where(most > 0, most, 1)
    return (most - middle) / scale, (middle - least) / scale
