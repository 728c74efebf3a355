"""Texture of the elevations around each point, from co-occurrence matrices of an unordered cloud."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from seaclutter_cli.airborne.neighborhoods import Neighborhoods, PointBlock
from seaclutter_cli.arrays import Floats, Ints

DIRECTIONS_DEG = (0, 45, 90, 135)
TEXTURE = ("homogeneity", "dissimilarity", "second_moment")
"""Names of the texture features ([Shi2022], Eq. 7 to 9)."""

_BINS = 1 << 19


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
