"""The mean plane of the water, fitted to the lowest echoes around the lidar."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from seaclutter_cli.arrays import Floats, Ints, Mask, group_sizes, group_starts

NEAREST_M, FARTHEST_M = 5.0, 45.0
_BEARINGS = 36
_STEP_M = 3.0
_RINGS = int((FARTHEST_M - NEAREST_M) / _STEP_M) + 1
_UPRIGHT = 0.1
_COARSE_M, _SCALES_M = (0.8, 0.6, 0.45), (0.3, 0.2, 0.13, 0.09, 0.06)
_ABOVE = 0.4
_OTHERS_M, _PASSES, _MOST, _WIDER = 2.0, 6, 0.98, 1.5
_SUPPORT, LEAST_SUPPORT = 0.4, 1.0
_TILT_RIDGE = 5.0
_MIN_CELLS = 8
_FLAT_M, _ENOUGH, _SURE_M, _BESIDE = 0.3, 3.0, 20.0, 0.1
_BELOW_M = 1.0
_OF_BODIES = _BEARINGS * _RINGS
_DEEPEST_M, _CELL_CM = 100.0, 20000
MIN_SUPPORT = 3
_START_SHARES = (0.02, 0.1, 0.3, 0.5, 0.7)


@dataclass(frozen=True)
class Plane:
    """A plane in the frame of the lidar: its height at the lidar, negative if that is above it, and its slopes."""

    level_m: float
    slope_x: float
    slope_y: float

    def height(self, x: Floats, y: Floats) -> Floats:
        """Return z of the plane at given positions, in metres."""
        return self.level_m + self.slope_x * x + self.slope_y * y

    def turned(self, rotation: Floats) -> "Plane":
        """Return the plane in axes to which a rotation, shape (3, 3), turns those of the lidar."""
        up = np.array((-self.slope_x, -self.slope_y, 1.0))
        x, y, z = (rotation @ up).tolist()
        return Plane(self.level_m / z, -x / z, -y / z) if z > _UPRIGHT else self

    def tilt_from(self, other: "Plane") -> float:
        """Return the difference of the slopes of two planes."""
        return math.hypot(self.slope_x - other.slope_x, self.slope_y - other.slope_y)


@dataclass(frozen=True)
class PolarCells:
    """The occupied polar cells around the lidar, C of them, of 10° by 3 m.

    ``cell`` is the number of each of N points' cells, shape (N,); `_OF_BODIES` for points that belong to bodies.
    ``lowest``, shape (3, C), and ``number``, shape (C,), are the lowest point and the number of each occupied cell, and
    the feet of the bodies in it; ``trust``, shape (C,), is 1 where three echoes are near the lowest, and a third for
    one: calm water returns few, at one height in all directions. ``top``, shape (C,), is z of the top of the bodies
    above feet, infinite for points beside bodies, and NaN for others.
    """

    cell: Ints
    lowest: Floats
    number: Ints
    trust: Floats
    top: Floats

    @classmethod
    def of(cls, xyz: Floats, bodies: Floats | None = None) -> "PolarCells":
        """Return the cells of points between `NEAREST_M` and `FARTHEST_M`, shape (3, N).

        ``bodies``, shape (4, M), are the horizontal positions of faces of bodies, and z of their feet and tops. What is
        higher than feet in its cell, and those beside and before it, is part of a body, such as a deck. Feet stand in
        the water or are mirrored, as is what is below them, so they count little. What else fills a cell upwards is
        fog, or spray.
        """
        z, cell = xyz[2], _cell(xyz)
        if bodies is not None:
            top = np.full(_OF_BODIES, -np.inf)
            np.maximum.at(top, _cell(bodies), bodies[3])
            of_feet, feet = _lowest_feet(bodies)
            foot = np.full(_OF_BODIES, np.inf)
            foot[of_feet] = feet[2]
            foot = _lowest_around(foot.reshape(_BEARINGS, _RINGS))
            cell[z > np.minimum.accumulate(foot, axis=1).reshape(-1)[cell] + _FLAT_M] = _OF_BODIES
        low = np.full(_OF_BODIES + 1, np.inf)
        np.minimum.at(low, cell, z)
        low[_OF_BODIES] = np.inf
        lowest = np.empty(len(low), np.int64)
        at = np.flatnonzero(z == low[cell])[::-1]
        lowest[cell[at]] = at  # the first of several
        number = np.flatnonzero(low < np.inf)
        flat = np.bincount(cell[z <= low[cell] + _FLAT_M], minlength=len(low))[number]
        lows = xyz.take(lowest[number], axis=1)
        trust = _nearness(lows) * np.minimum(flat, _ENOUGH) / _ENOUGH
        if bodies is None:
            return cls(cell, lows, number, trust, np.full(len(number), np.nan))
        beside = np.isfinite(foot.reshape(-1)[number])
        trust[beside] *= _BESIDE
        trust *= (flat / np.bincount(cell, minlength=len(low))[number]) ** 2
        trust = np.concatenate((trust, _BESIDE * _nearness(feet)))
        top = np.concatenate((np.where(beside, np.inf, np.nan), top[of_feet]))
        return cls(cell, np.concatenate((lows, feet), axis=1), np.concatenate((number, of_feet)), trust, top)

    @property
    def enough(self) -> bool:
        """Whether the cells can hold a plane."""
        bearings = np.count_nonzero(np.bincount(self.number // _RINGS))
        return bool(len(self.number) >= _MIN_CELLS and bearings >= MIN_SUPPORT)

    def contradict(self, plane: Plane, weight: Floats) -> bool:
        """Return whether more cells contradict a plane than support it, by their weights in its fit, shape (C,).

        Echoes below the water are images of bodies, and those are at least as high as their images are deep.
        """
        level = plane.height(*self.lowest[:2])
        rise = np.nan_to_num(self.top - level, nan=0.0, posinf=np.inf)
        below = np.count_nonzero(self.lowest[2] - level + rise < -_BELOW_M)
        return bool(below > np.count_nonzero(self._are_water(weight)))

    def covariance(self, plane: Plane, weight: Floats) -> Floats:
        """Return the covariance of level and slopes of a fitted plane, shape (3, 3), by the weights of the cells, (C,).

        Since neighbouring cells see the same waves, cells count as many observations as their weights add up to.
        """
        x, y, z = self.lowest
        rows = np.stack((np.ones_like(x), x, y))
        normal = (weight * rows) @ rows.T + np.diag((0, _TILT_RIDGE, _TILT_RIDGE))
        mean_square = weight @ np.square(z - plane.height(x, y)) / weight.sum()
        return np.asarray(mean_square * np.linalg.inv(normal))

    def in_water(self, weight: Floats) -> Mask:
        """Return which of the N points are in cells of water, given the weights of the cells in its fit, shape (C,)."""
        of_water = np.zeros(_OF_BODIES + 1, np.bool_)
        of_water[self.number[self._are_water(weight)]] = True
        return of_water[self.cell]

    def _are_water(self, weight: Floats) -> Mask:
        return weight > _ABOVE / 3 * self.trust


def in_reach(x: Floats, y: Floats) -> Mask:
    """Return which positions are between `NEAREST_M` and `FARTHEST_M` from the lidar."""
    distance = np.hypot(x, y)
    return (distance >= NEAREST_M) & (distance < FARTHEST_M)


def _nearness(xyz: Floats) -> Floats:
    return np.asarray(1 / (1 + (xyz[0] ** 2 + xyz[1] ** 2) / _SURE_M**2))


def _lowest_around(foot: Floats) -> Floats:
    """Return the least of each cell's values, shape (36, 14), those beside it, and those before them."""
    around = np.minimum(foot, np.minimum(np.roll(foot, 1, axis=0), np.roll(foot, -1, axis=0)))
    around[:, 1:] = np.minimum(around[:, 1:], around[:, :-1])
    return np.asarray(around)


def _lowest_feet(bodies: Floats) -> tuple[Ints, Floats]:
    """Return the occupied cells, and one foot for each, in its middle.

    It is higher than a tenth of the feet in its cell: those are mirrored.
    """
    cm = np.clip((bodies[2] + _DEEPEST_M) * 100, 0, _CELL_CM - 1).astype(np.int64)
    ordered = np.sort(_cell(bodies) * _CELL_CM + cm)
    start = group_starts(ordered // _CELL_CM)
    cell, cm = np.divmod(ordered[start + group_sizes(start, len(ordered)) // 10], _CELL_CM)
    bearing = (cell // _RINGS + 0.5) * (2 * np.pi / _BEARINGS) - np.pi
    distance = NEAREST_M + (cell % _RINGS + 0.5) * _STEP_M
    return cell, np.stack((distance * np.cos(bearing), distance * np.sin(bearing), cm / 100 - _DEEPEST_M))


def _cell(xyz: Floats) -> Ints:
    """Return the number of the cell of each point."""
    x, y = xyz[:2]
    bearing = ((np.arctan2(y, x) + np.pi) * (_BEARINGS / (2 * np.pi))).astype(np.int64)
    bearing[bearing == _BEARINGS] = 0
    ring = np.maximum((np.hypot(x, y) - NEAREST_M) / _STEP_M, 0).astype(np.int64)
    return np.asarray(bearing * _RINGS + np.minimum(ring, _RINGS - 1))


def fit_plane(cells: PolarCells, start: Plane | None) -> tuple[Plane, Floats]:
    """Return the plane of the lowest points, and the weight of each cell, shape (C,).

    The fit is iteratively reweighted least squares with Tukey's weights, at finer and finer scales. Of the finest, that
    counts at which the cells are most likely: calm water is at one height, whatever is above and below it, and rough
    water is not. Cells are weighed with one and a half of that scale, so that crests count. Points above the plane
    count 40 %, since what rises out of the water is above it. From a start, it is the likelier of two fits, with and
    without coarse scales: those follow a jump of own ship, but amid images and decks they leave calm water for these.
    Without a start, it starts from several levels and returns the lowest plane with at least 40 % of the weight of the
    best one: decks and quays can have more cells than the water. Planes below the lidar come first, unless they hold
    less than one cell that is fully trusted, and of those, planes that no more cells contradict than support.
    """
    if start is not None:
        plane, weight, _ = max((_reweighted(cells, start, coarse) for coarse in (_COARSE_M, ())), key=itemgetter(2))
        return plane, weight
    order = np.argsort(cells.lowest[2], kind="stable")
    total = np.cumsum(cells.trust[order])
    starts = cells.lowest[2, order[np.searchsorted(total, np.array(_START_SHARES) * total[-1])]]
    fits = [_reweighted(cells, Plane(level, 0.0, 0.0))[:2] for level in starts.tolist()]
    sure = [fit for fit in fits if fit[0].level_m < 0 and fit[1].sum() >= LEAST_SUPPORT]  # water is below the lidar
    sure = [fit for fit in sure or fits if not cells.contradict(*fit)] or sure
    needed = _SUPPORT * max(float(weight.sum()) for _, weight in sure or fits)
    return min((fit for fit in sure or fits if fit[1].sum() >= needed), key=lambda fit: fit[0].level_m)


def _reweighted(cells: PolarCells, plane: Plane, coarse: Sequence[float] = _COARSE_M) -> tuple[Plane, Floats, float]:
    """Return the plane of a fit, the weights of the cells, and the logarithm of its likelihood."""
    x, y, z = cells.lowest
    products = np.stack((np.ones_like(x), x, y, z, x * x, x * y, y * y, x * z, y * z))
    fits, residual = [], z - plane.height(x, y)
    for scale in (*coarse, *_SCALES_M):
        weight = _weight(residual, scale) * cells.trust
        sums = (products @ weight).tolist()
        if sums[0] < LEAST_SUPPORT:
            break
        plane = _least_squares(sums)
        residual = z - plane.height(x, y)
        fits.append((scale, plane, residual))
    if not fits:
        return plane, weight, -math.inf
    scales, planes, residuals = zip(*(fits[len(coarse) :] or fits[-1:]), strict=True)
    likelihoods = _log_likelihoods(np.array(residuals), np.array(scales)[:, None], cells.trust)
    best = int(likelihoods.argmax())
    return planes[best], _weight(residuals[best], _WIDER * scales[best]) * cells.trust, float(likelihoods[best])


def _weight(residual: Floats, scale: float) -> Floats:
    """Return Tukey's weights of points at heights above a plane; of those above it, a part."""
    weight = np.maximum(1 - (residual / (3 * scale)) ** 2, 0) ** 2
    weight[residual > 0] *= _ABOVE
    return np.asarray(weight)


def _log_likelihoods(residuals: Floats, scales: Floats, trust: Floats) -> Floats:
    """Return the logarithms of the likelihoods of the residuals of the cells, shape (S, C), at scales, shape (S, 1).

    Some cells are water, whose deviation is the scale, others are within two metres; how many is most likely as well.
    """
    water = np.exp(-0.5 * (residuals / scales) ** 2) / (scales * math.sqrt(2 * math.pi))
    share = np.full_like(scales, 0.5)
    for _ in range(_PASSES):
        of_water = share * water
        share = (of_water / (of_water + (1 - share) / _OTHERS_M)) @ trust[:, None] / trust.sum()
        share = np.clip(share, 1 - _MOST, _MOST)
    return np.asarray(np.log(share * water + (1 - share) / _OTHERS_M) @ trust)


def _least_squares(sums: Sequence[float]) -> Plane:
    """Return the plane of least squares with a ridge on its slopes, from weighted sums of products of coordinates."""
    # A solver for matrices takes longer than all else in a pass.
    n, x, y, z, xx, xy, yy, xz, yz = sums
    xx, xy, yy = xx - x * x / n + _TILT_RIDGE, xy - x * y / n, yy - y * y / n + _TILT_RIDGE
    xz, yz = xz - x * z / n, yz - y * z / n
    determinant = xx * yy - xy * xy  # at least the square of the ridge
    slope_x, slope_y = (yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant
    return Plane((z - slope_x * x - slope_y * y) / n, slope_x, slope_y)


def mean_level(cells: PolarCells, height_m: Floats, of_water: Mask, band_m: float) -> tuple[float, float]:
    """Return the offset of the mean water from a plane and its standard deviation, from echoes within a band.

    Heights above the plane, and whether points are echoes ``of_water``, have the shape (N,). Each cell counts the same,
    whatever the number of its echoes.
    """
    used = np.flatnonzero(of_water & (np.abs(height_m) <= band_m))
    if not len(used):
        return 0.0, 0.0
    cell, height, trust = cells.cell[used], height_m[used], np.zeros(_OF_BODIES)
    trust[cells.number] = cells.trust
    share = trust[cell] / np.bincount(cell)[cell]
    order = np.argsort(height)
    total, height = np.cumsum(share[order]), height[order]
    low, middle = (float(height[np.searchsorted(total, total[-1] * part)]) for part in (0.16, 0.5))
    return middle, middle - low
