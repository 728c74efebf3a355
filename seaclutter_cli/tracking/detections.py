"""Detections: the clusters of a filtered frame, reduced to what tracks need of them."""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Ints, Mask, group_sizes, group_starts
from seaclutter_cli.clustering import euclidean_clusters, pairs_within, spans
from seaclutter_cli.frame import FilterResult, Reason

DIRECTIONS = 36
_SECTORS, _BESIDE = 1440, np.array([1, -1])
_SECTORS_A_RADIAN = _SECTORS / (2 * np.pi)
YAWS = 45
_CELL_M, _COVERED_M = 0.5, 0.4
_MAX_CELL = 1 << 19
_FLATTENED = np.array([[1], [1], [0.2]])
_THINNED_M = np.array([[0.1], [0.1], [1]])
_MAX_DETECTIONS = 2000
_CRAFT_M, _CRAFT_WIDE_M = 15.0, 3.5
_STERN_M, _BROADEST = 2.5, 0.45
_CLOSE, _CLOSE_ACROSS, _NEAR = 0.45, 0.2, 0.8
_LEAST_SHARE = 0.4
_FEW, _AROUND = 0.1, np.add.outer((-2 * _MAX_CELL, 0, 2 * _MAX_CELL), (-1, 0, 1)).reshape(-1)
_SPREAD, _APART = 0.015, 2e3
_UP = np.array([0.0, 0.0, 1.0])
_TOWARDS = np.array([part(np.arange(2 * YAWS) * (np.pi / 2 / YAWS)) for part in (np.cos, np.sin)], np.float32)
_SKIN_M = 0.1
_AZIMUTHS = 6000  # 0.06° each, less than the steps of rotating lidars
_HALF = DIRECTIONS // 2
_HALF_TURN = np.array([part(np.arange(_HALF) * (np.pi / _HALF)) for part in (np.cos, np.sin)], np.float32)


class Pose(NamedTuple):
    """Position in metres and yaw in radians of a lidar; poses of another ``path`` may be apart from these."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    path: tuple[tuple[str, int], ...] = ()

    def applied(self, points: Floats) -> Floats:
        """Return points, shape (…, 2), of the cloud in the coordinates of the pose."""
        return np.asarray(self.turned(points) + (self.x, self.y))  # noqa: RUF005 - an array

    def turned(self, vectors: Floats) -> Floats:
        """Return vectors, shape (…, 2), in the axes of the cloud in those of the pose."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return np.asarray(vectors @ ((cos, sin), (-sin, cos)))

    def undone(self, points: Floats) -> Floats:
        """Return points, shape (…, 2), of the coordinates of the pose in those of the cloud."""
        return Pose(yaw=-self.yaw).turned(points - (self.x, self.y))


@dataclass(frozen=True)
class Detections:
    """K objects of a frame, in the coordinates of its cloud.

    ``hulls``, shape (K, 36, 2), are the outermost points in 36 directions, seen from above; ``centers``, shape (K, 2),
    the mean positions; ``spans``, shape (K, 2), the lowest and the highest z; ``rises``, the same along the direction
    that is up; ``points``, shape (K,), the numbers of points. A detection is ``kept``, shape (K,), unless it consists
    of points of objects that were not confirmed. ``cells``, shape (m, 2), are the mean positions in cells of 0.5 m,
    detection by detection, ``owner``, shape (m,), the detection of each. ``ends``, shape (K, 2, 2), are the outermost
    points to the left and to the right, seen from the lidar; one is ``hidden``, shape (K, 2), if a nearer detection is
    beside it, behind which more of the object may be. ``outlines``, shape (K, 36, 2), are the hulls without wash,
    extended on both sides by half an angular step, because the edges of an object lie between two directions.
    """

    hulls: Floats
    outlines: Floats
    ends: Floats
    hidden: Mask
    centers: Floats
    spans: Floats
    rises: Floats
    points: Ints
    kept: Mask
    cells: Floats
    owner: Ints
    lidar: tuple[float, float] = (0.0, 0.0)

    def __len__(self) -> int:
        return len(self.points)

    def moved(self, pose: Pose) -> "Detections":
        """Return the detections in the coordinates in which the lidar has a pose."""
        names = "hulls", "outlines", "ends", "centers", "cells"
        moved: dict[str, Any] = {name: pose.applied(getattr(self, name)) for name in names}
        return replace(self, lidar=pose[:2], **moved)

    def misfits(self) -> Floats:
        """Return how badly rectangles at yaws of 0°, 2°, … 88° fit the detections, shape (K, 45).

        This is the logarithm of their area and of the mean distance of cells from the nearest side.
        """
        hull = _projected(self.hulls - self.centers[:, None])
        low, high = hull.min(axis=1), hull.max(axis=1)
        cells = _projected(self.cells - self.centers[self.owner])
        inside = np.minimum(cells - low[self.owner], high[self.owner] - cells)
        starts = group_starts(self.owner)
        depth = np.add.reduceat(np.minimum(inside[:, :YAWS], inside[:, YAWS:]), starts)
        depth /= group_sizes(starts, len(self.owner))[:, None]
        widths = high - low + _SKIN_M
        return np.asarray(np.log(np.maximum(depth, 0) + _SKIN_M) + np.log(widths[:, :YAWS]) + np.log(widths[:, YAWS:]))

    def cover(self, rows: Ints) -> Mask:
        """Return which detections are in the direction of the middle of n of them, shape (n, K)."""
        own = _bearings(self.hulls, self.centers)
        bearing = _bearing(self.centers)
        apart = (bearing[rows, None] - bearing + np.pi) % (2 * np.pi) - np.pi
        return np.asarray((own.min(axis=1) <= apart) & (apart <= own.max(axis=1)))

    @classmethod
    def of(cls, result: FilterResult, tolerance_m: float, min_points: int, up: Floats = _UP) -> "Detections":
        """Return the clusters of the points that a filter kept, then those of points that it did not confirm.

        Vertical distances count a fifth, because beams far from each other meet one body at different heights. Of more
        than 2,000 clusters, those with the most points are detections.
        """
        frame = result.frame
        # Without thresholds, the reason of the water is the same as that of objects.
        doubtful = np.equal(result.reason, Reason.UNCONFIRMED) & (result.rings is not None)
        members = np.flatnonzero((result.keep | doubtful) & frame.valid)
        doubtful = doubtful[members]
        cluster = _clusters(frame.coordinates.take(members, axis=1), doubtful, tolerance_m, min_points)
        seen = np.flatnonzero(cluster >= 0)
        key = (doubtful * len(members) + cluster)[seen]
        # Five times faster than a stable `numpy.argsort`.
        key, place = np.divmod(np.sort(key * len(members) + seen), max(len(members), 1))
        kept = int(np.count_nonzero(key[group_starts(key)] < len(members)))
        return cls.made(frame.coordinates.take(members[place], axis=1), key, kept, up)

    @classmethod
    def made(cls, xyz: Floats, cluster: Ints, kept: int, up: Floats = _UP) -> "Detections":
        """Return the detections of points, shape (3, n), sorted by cluster; the first ``kept`` clusters are kept."""
        starts = group_starts(cluster)
        count = group_sizes(starts, len(cluster))
        if len(count) > _MAX_DETECTIONS:
            chosen = np.sort(np.argsort(-count, kind="stable")[:_MAX_DETECTIONS])
            points = spans(starts[chosen], count[chosen])
            return cls.made(xyz.take(points, axis=1), cluster[points], int(np.count_nonzero(chosen < kept)), up)
        xy = xyz[:2]
        heights, rises = (
            np.stack([reduce.reduceat(z, starts) for reduce in (np.minimum, np.maximum)], axis=1)
            for z in (xyz[2], up[0] * xyz[0] + up[1] * xyz[1] + up[2] * xyz[2])
        )
        centers = (np.add.reduceat(xy, starts, axis=1) / count).T
        every = np.arange(len(count))
        number = np.repeat(every, count)
        cells, owner, cell, key = _cells(xy, number)
        hulls, is_wash = _hulls(xy, number), _are_of_wash(cell, owner, key)
        outlines = _outlines(hulls, xy, number, is_wash[cell], centers)
        bearings = _bearings(hulls, centers)
        ends = hulls[every[:, None], np.stack((bearings.argmax(axis=1), bearings.argmin(axis=1)), axis=1)]
        hidden = _are_hidden(ends, cells, owner)
        return cls(hulls, outlines, ends, hidden, centers, heights, rises, count, every < kept, cells, owner)


def _hulls(xy: Floats, number: Ints) -> Floats:
    """Return the outermost points of each cluster in 36 directions, shape (K, 36, 2)."""
    starts = group_starts(number)
    ends = [*starts.tolist(), len(number)][1:]
    across, farthest = _across(xy), np.empty((len(starts), DIRECTIONS), np.int64)
    for row, start, end in zip(farthest, starts.tolist(), ends, strict=True):
        own = across[:, start:end]
        row[:_HALF], row[_HALF:] = own.argmax(axis=1), own.argmin(axis=1)
    return np.asarray(xy.T[farthest + starts[:, None]])


def _outlines(hulls: Floats, xy: Floats, number: Ints, is_wash: Mask, centers: Floats) -> Floats:
    """Return the hulls of clusters without points of wash, extended on both sides by half an angular step."""
    washed = np.bincount(number, is_wash) > 0
    body = np.flatnonzero(~is_wash & washed[number])
    hulls = hulls.copy()
    if len(body):
        hulls[washed] = _hulls(xy[:, body], number[body])
    bearings = _bearings(hulls, centers)
    steps = _half_steps(xy[:, ~is_wash], number[~is_wash], bearings, centers)
    return np.asarray(hulls + np.sign(bearings)[:, :, None] * steps[:, None])


def _are_of_wash(cell: Ints, owner: Ints, key: Ints) -> Mask:
    """Return which cells are of wash or spray beside bodies, given the cell of each point, and their owners and keys.

    They have less than a tenth of the points that are usual in the cells of their owner, and are beside none with more.
    """
    count = np.bincount(cell)
    usual = np.bincount(owner, count**2) / np.bincount(owner, count)
    few = count < _FEW * usual[owner]
    if few.any():
        few &= ~np.isin(key, key[~few][:, None] + _AROUND)
    return np.asarray(few)


def _bearing(points: Floats) -> Floats:
    """Return the directions of points, shape (…, 2), seen from the lidar."""
    return np.arctan2(points[..., 1], points[..., 0])


def _bearings(hulls: Floats, centers: Floats) -> Floats:
    """Return the directions of the outermost points against that of the centre, shape (K, 36)."""
    x, y = centers.T[:, :, None]
    to_x, to_y = hulls.transpose(2, 0, 1)
    return np.asarray(np.arctan2(x * to_y - y * to_x, x * to_x + y * to_y))


def _half_steps(xy: Floats, number: Ints, bearings: Floats, centers: Floats) -> Floats:
    """Return half the mean angular step between echoes of each detection, as a vector to the left, (K, 2)."""
    met = np.zeros((len(centers), _AZIMUTHS), np.bool_)
    met[number, ((_bearing(xy.T) + np.pi) * (_AZIMUTHS / 2 / np.pi)).astype(np.int64) % _AZIMUTHS] = True
    half = np.ptp(bearings, axis=1) / np.maximum(np.count_nonzero(met, axis=1) - 1, 1) / 2
    return np.asarray(half[:, None] * centers[:, ::-1] * (-1, 1))


def _are_hidden(ends: Floats, cells: Floats, owner: Ints) -> Mask:
    """Return beside which ends of detections, shape (K, 2, 2), another detection is nearer, shape (K, 2)."""
    distance_m = np.hypot(*cells.T)
    order = np.argsort(-distance_m)
    half = np.ceil(_SECTORS_A_RADIAN * _COVERED_M / np.maximum(distance_m[order], _CELL_M)).astype(np.int64)
    nearest = np.full(_SECTORS, -1)
    middle = np.floor(_bearing(cells[order]) * _SECTORS_A_RADIAN).astype(np.int64)
    nearest[spans(middle - half, 2 * half + 1) % _SECTORS] = np.repeat(order, 2 * half + 1)  # the nearest is the last
    beside = np.floor(_bearing(ends) * _SECTORS_A_RADIAN + _BESIDE).astype(np.int64)
    found = nearest[beside % _SECTORS]
    is_other = (found >= 0) & (owner[found] != np.arange(len(ends))[:, None])
    return np.asarray(is_other & (distance_m[found] < np.hypot(*ends.transpose(2, 0, 1)) - _CELL_M))


def _clusters(xyz: Floats, doubtful: Mask, tolerance_m: float, min_points: int) -> Ints:
    """Return the cluster of each point, shape (N,), doubtful ones apart from others; -1 for small ones.

    What is larger than a small craft is divided at gaps of half the tolerance, a fifth across the line of sight, far
    off at wider ones. One point of each cell of 0.1 m by 0.1 m by 1 m is searched for neighbours.
    """
    if not xyz.shape[1]:
        return np.empty(0, np.int64)
    column, row, level = np.clip(np.floor(xyz / _THINNED_M), -_MAX_CELL, _MAX_CELL - 1).astype(np.int64) + _MAX_CELL
    column += doubtful * (2 * _MAX_CELL)
    first, cell = _unique((column * (2 * _MAX_CELL) + row) * (2 * _MAX_CELL) + level)
    thinned, doubtful = xyz.take(first, axis=1), doubtful[first]
    flat = thinned * _FLATTENED
    flat[0] += doubtful * (np.ptp(flat[0]) + 2 * tolerance_m)
    number = euclidean_clusters(flat, tolerance_m, 1)
    is_small = _are_small(*_widths(thinned[:2], number))
    nearest_m = np.full(len(is_small), np.inf)
    np.minimum.at(nearest_m, number, np.hypot(*thinned[:2]))
    tight_m = np.minimum(np.maximum(_CLOSE * tolerance_m, _SPREAD * nearest_m), tolerance_m)
    wide = np.flatnonzero(~is_small[number] & (tight_m < tolerance_m)[number])
    if len(wide):
        across_m = np.minimum(np.maximum(_CLOSE_ACROSS * tolerance_m, _SPREAD * nearest_m), tight_m)
        scaled = _along_and_across(thinned.take(wide, axis=1), number[wide]) * _FLATTENED
        scaled /= np.stack((tight_m, across_m / np.maximum(nearest_m, _CELL_M), tight_m))[:, number[wide]]
        scaled[0] += _APART * number[wide]  # clusters are searched at once, far behind each other
        parts = euclidean_clusters(scaled, 1.0, 1)
        joined = _joined(thinned[:2, wide], parts, doubtful[wide], tolerance_m)
        number[wide] = np.where(joined < 0, -1, number.max() + 1 + joined)
    number = number[cell]
    large = np.bincount(number + 1)[1:] >= min_points
    return np.append(np.where(large, np.cumsum(large) - 1, -1), -1)[number]


def _projected(points: Floats) -> NDArray[np.float32]:
    """Return the coordinates of points, shape (…, 2), in directions at 0°, 2°, … 178°."""
    x, y = (points[..., k, None].astype(np.float32) for k in (0, 1))
    along = x * _TOWARDS[0]
    along += y * _TOWARDS[1]
    return np.asarray(along)


def _along_and_across(xyz: Floats, number: Ints) -> Floats:
    """Return the distance, the bearing from that of the middle of its cluster, and z of each point, shape (3, N).

    A gap across the line of sight is open water; along it, it may be hidden by what is in front.
    """
    x, y, z = xyz
    to_x, to_y = (np.bincount(number, values)[number] for values in (x, y))
    return np.stack((np.hypot(x, y), np.arctan2(to_x * y - to_y * x, to_x * x + to_y * y), z))


def _joined(xy: Floats, part: Ints, doubtful: Mask, tolerance_m: float) -> Ints:
    """Return the number of the whole of each point: parts that are near each other, up to the size of a small craft.

    So boats beside each other, too wide together, or beside a quay are apart, and a boat that is seen in pieces is one.
    What is small beside the largest part is of none, -1, because it may be of a pontoon or a neighbour.
    """
    cells, owner, *_ = _cells(xy, part)
    low, high = _widths(xy, part)
    small = np.flatnonzero(_are_small(low, high)[owner])
    level = np.zeros(low.shape[1])
    level[part] = tolerance_m * doubtful
    pairs = small[pairs_within(np.column_stack((cells, level[owner]))[small].T, _NEAR * tolerance_m)]
    pairs = pairs[:, owner[pairs[0]] != owner[pairs[1]]]
    of = np.sort(owner[pairs], axis=0)
    gap = np.hypot(*(cells[pairs[0]] - cells[pairs[1]]).T)
    of = of[:, np.lexsort((*of, gap))].T
    whole = np.arange(low.shape[1])
    _, nearest = np.unique(of @ (len(whole), 1), return_index=True)
    for a, b in of[np.sort(nearest)].tolist():
        one, other = whole[a], whole[b]
        if one == other:
            continue
        least, most = np.minimum(low[:, one], low[:, other]), np.maximum(high[:, one], high[:, other])
        widths = (most - least).tolist()
        beam, length = min(widths), max(widths)
        if length <= _CRAFT_M and beam <= min(_CRAFT_WIDE_M, max(_STERN_M, _BROADEST * length)):
            whole[whole == other] = one
            low[:, one], high[:, one] = least, most
    size, largest = np.bincount(owner), np.zeros(len(whole), np.int64)
    np.maximum.at(largest, whole, size)
    return np.where(size < _LEAST_SHARE * largest[whole], -1, whole)[part]


def _widths(xy: Floats, number: Ints) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the least and the greatest coordinates of each cluster of points, in 18 directions, shape (18, K)."""
    order = np.argsort(number)
    starts = group_starts(number[order])
    across = _across(xy[:, order])
    return np.minimum.reduceat(across, starts, axis=1), np.maximum.reduceat(across, starts, axis=1)


def _across(xy: Floats) -> NDArray[np.float32]:
    """Return the coordinates of points, shape (2, n), in directions at 0°, 10°, … 170°, shape (18, n)."""
    x, y = xy.astype(np.float32)
    cos, sin = _HALF_TURN[..., None]
    across = cos * x  # not a product of matrices, whose threads wait for each other
    across += sin * y
    return np.asarray(across)


def _are_small(low: NDArray[np.float32], high: NDArray[np.float32]) -> Mask:
    """Return which clusters are not longer or wider than a small craft."""
    widths = high - low
    return np.asarray((widths.max(axis=0) <= _CRAFT_M) & (widths.min(axis=0) <= _CRAFT_WIDE_M))


def _cells(xy: Floats, owner: Ints) -> tuple[Floats, Ints, Ints, Ints]:
    """Return the mean positions of points in cells of 0.5 m of each owner, and the owner of each cell.

    The third array has the cell of each point, the fourth a key of each cell, to which `_AROUND` adds its neighbours.
    """
    column, row = np.clip(np.floor(xy / _CELL_M), -_MAX_CELL, _MAX_CELL - 1).astype(np.int64) + _MAX_CELL
    keys = (owner * (2 * _MAX_CELL) + column) * (2 * _MAX_CELL) + row
    first, cell = _unique(keys)
    count = np.bincount(cell)
    return np.stack([np.bincount(cell, values) / count for values in xy], axis=1), owner[first], cell, keys[first]


def _unique(keys: Ints) -> tuple[Ints, Ints]:
    """Return where each different key is first, and the number of each key among them, faster than `numpy.unique`."""
    order = np.argsort(keys)
    starts = group_starts(keys[order])
    number = np.empty_like(order)
    number[order] = np.repeat(np.arange(len(starts)), group_sizes(starts, len(keys)))
    return np.minimum.reduceat(order, starts), number
