"""Texture of elevations about each point, from co-occurrence matrices of an unordered cloud."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.airborne.neighborhoods import Neighborhoods, PointBlock

DIRECTIONS_DEG = (0, 45, 90, 135)
TEXTURE = ("homogeneity", "dissimilarity", "second_moment")
"""Names of the texture features, Eq. 7 to 9."""

_BINS = 1 << 19


@dataclass(frozen=True)
class Levels:
    """Grey levels of points, and those of their partners in the shifted clouds.

    Parameters
    ----------
    own : ndarray, shape (N,), int64
        Level of each point, 0 to K - 1.
    partner : ndarray, shape (4, N), int64
        For each direction, the level of the nearest point of the cloud shifted that way.
    count : int
        K.
    """

    own: NDArray[np.int64]
    partner: NDArray[np.int64]
    count: int

    @cached_property
    def weights(self) -> NDArray[np.float64]:
        """What each pair of levels adds to homogeneity and dissimilarity, shape (2, K * K)."""
        apart = np.abs(np.subtract.outer(np.arange(self.count), np.arange(self.count))).reshape(-1)
        return np.stack((1 / (1 + apart**2), apart)).astype(np.float64)


def grey_levels(height_m: NDArray[np.float64], count: int, max_height_m: float) -> NDArray[np.int64]:
    """Return heights as K grey levels of equal size, 0 to K - 1, shape (N,).

    Parameters
    ----------
    height_m : ndarray, shape (N,), float64
        Heights above the sea surface in metres.
    count : int
        Number of levels, K.
    max_height_m : float
        What is as high or higher has the last level; what is below 0 the first.

    Examples
    --------
    >>> grey_levels(np.array([-0.1, 0.3, 7.9, 30.0]), 32, 8.0)
    array([ 0,  1, 31, 31])
    """
    return np.clip(np.floor(height_m * (count / max_height_m)), 0, count - 1).astype(np.int64)


def levels_of(
    near: Neighborhoods, height_m: NDArray[np.float64], count: int, max_height_m: float, shift_m: float
) -> Levels:
    """Return the levels of points and of their partners.

    Parameters
    ----------
    near : Neighborhoods
        The points' places.
    height_m : ndarray, shape (N,), float64
        Their heights in metres.
    count, max_height_m : int and float
        As for `grey_levels`.
    shift_m : float
        How far the cloud is shifted, d, in metres.
    """
    own = grey_levels(height_m, count, max_height_m)
    angles = np.radians(DIRECTIONS_DEG)
    shifts = shift_m * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    partner = np.stack([own[near.nearest((float(x), float(y)))] for x, y in shifts])
    return Levels(own, partner, count)


def texture(block: PointBlock, levels: Levels) -> NDArray[np.float64]:
    r"""Return the texture features of a block's points, shape (B, 3), in the order of `TEXTURE`.

    Notes
    -----
    The cloud X is shifted by d along θ to become Y. Each neighbour of a point within r (itself included) is paired with
    the point of Y nearest to it (Eq. 5); the pairs' levels (c, d) make the matrix (Eq. 6), divided by their number:

    .. math:: Hom = \sum_{c,d} \frac{N(c, d)}{1 + (c - d)^2}, \quad Dis = \sum_{c,d} N(c, d) |c - d|, \quad
        ASM = \sum_{c,d} N(c, d)^2

    and the features are means over 0, 45, 90 and 135° [1]_. The paper leaves open: neighbours and partners are found in
    the plane, since the elevation is the grey level and the place what pixels are in an image; a partner is found for
    each neighbour, not looked up in the inverse of a map, in which some would have none; levels are of height above the
    sea surface with fixed bounds, so that an object has the same texture whatever else is in its tile.

    References
    ----------
    .. [1] Shi Liang, Xing Junxin, Cai Yanjing (2022). "Classification of ship LIDAR point cloud data based on machine
       learning algorithm". Ship Science and Technology 44(17), 140-143. doi:10.3404/j.issn.1672-7649.2022.17.028
    """
    out = np.zeros((len(block.points), 3))
    for partner in levels.partner:
        pair = levels.own * levels.count + partner
        out += _of_matrices(block, pair[block.neighbor], levels)
    return out / len(levels.partner)


def _of_matrices(block: PointBlock, pair: NDArray[np.int64], levels: Levels) -> NDArray[np.float64]:
    """Return the features of one direction from the pairs' codes."""
    total = block.count
    weighed = [block.total(weights[pair]) / total for weights in levels.weights]
    return np.stack((*weighed, _second_moment(block, pair, levels.count**2) / total**2), axis=1)


def _second_moment(block: PointBlock, pair: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """Return the sums of the squares of the matrices' counts, some matrices at a time."""
    step = max(1, _BINS // size)
    starts = range(0, len(block.points), step)
    ends = [*np.searchsorted(block.own, starts), len(pair)]
    sums = []
    for start, first, last in zip(starts, ends[:-1], ends[1:], strict=True):
        rows = min(step, len(block.points) - start)
        counts = np.bincount((block.own[first:last] - start) * size + pair[first:last], minlength=rows * size)
        sums.append((counts * counts).reshape(rows, size).sum(axis=1))
    return np.concatenate(sums)
