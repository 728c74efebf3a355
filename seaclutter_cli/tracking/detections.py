"""Detections: the clusters of a filtered frame, reduced to what tracks need of them."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.clustering import euclidean_clusters
from seaclutter_cli.frame import FilterResult, Reason
from seaclutter_cli.groups import group_sizes, group_starts

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

DIRECTIONS = 36
_CELL_M = 0.5
_MAX_CELL = 1 << 19
_FLATTENED = np.array([[1], [1], [0.2]])
_THINNED_M = np.array([[0.2], [0.2], [1]])
_MAX_DETECTIONS = 2000
_UP = np.array([0.0, 0.0, 1.0])
_ANGLES = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
_COS, _SIN = (part(_ANGLES)[:, None].astype(np.float32) for part in (np.cos, np.sin))


class Pose(NamedTuple):
    """Position in metres and yaw in radians of a lidar."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

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
    detection by detection, ``owner``, shape (m,), the detection of each.
    """

    hulls: Floats
    centers: Floats
    spans: Floats
    rises: Floats
    points: Indices
    kept: NDArray[np.bool_]
    cells: Floats
    owner: Indices

    def __len__(self) -> int:
        return len(self.points)

    def moved(self, pose: Pose) -> "Detections":
        """Return the detections in the coordinates in which the lidar has a pose."""
        hulls, centers, cells = (pose.applied(points) for points in (self.hulls, self.centers, self.cells))
        return replace(self, hulls=hulls, centers=centers, cells=cells)

    @classmethod
    def of(cls, result: FilterResult, tolerance_m: float, min_points: int, up: Floats = _UP) -> "Detections":
        """Return the clusters of the points that a filter kept, then those of points that it did not confirm.

        Vertical distances count a fifth, because beams far from each other meet one body at different heights. Of more
        than 2,000 clusters, those with the most points are detections.
        """
        frame = result.frame
        # Without thresholds, the reason of the water is the same as that of objects.
        doubtful = np.equal(result.reason, Reason.UNCONFIRMED) & (result.rings is not None)
        subsets = [np.flatnonzero(mask & frame.valid) for mask in (result.keep, doubtful)]
        members, numbers, kept = [], [], 0
        for subset in subsets:
            cluster = _clusters(frame.coordinates.take(subset, axis=1), tolerance_m, min_points)
            order = np.argsort(cluster, kind="stable")[np.count_nonzero(cluster < 0) :]
            members.append(subset[order])
            numbers.append(cluster[order] + kept)
            kept = kept or int(cluster.max(initial=-1)) + 1
        kept *= bool(len(members[0]))
        return cls.made(frame.coordinates.take(np.concatenate(members), axis=1), np.concatenate(numbers), kept, up)

    @classmethod
    def made(cls, xyz: Floats, cluster: Indices, kept: int, up: Floats = _UP) -> "Detections":
        """Return the detections of points, shape (3, n), sorted by cluster; the first ``kept`` clusters are kept."""
        if not len(cluster):
            none = np.empty((0, 2))
            whole = np.empty(0, np.int64)
            return cls(np.empty((0, DIRECTIONS, 2)), none, none, none, whole, np.empty(0, np.bool_), none, whole)
        starts = group_starts(cluster)
        count = group_sizes(starts, len(cluster))
        chosen = np.sort(np.argsort(-count, kind="stable")[:_MAX_DETECTIONS])
        xy = xyz[:2]
        spans, rises = (
            np.stack([reduce.reduceat(z, starts) for reduce in (np.minimum, np.maximum)], axis=1)
            for z in (xyz[2], up[0] * xyz[0] + up[1] * xyz[1] + up[2] * xyz[2])
        )
        centers = (np.add.reduceat(xy, starts, axis=1) / count).T
        hulls = np.empty((len(chosen), DIRECTIONS, 2))
        for row, k in zip(hulls, chosen.tolist(), strict=True):
            own = xy[:, starts[k] : starts[k] + count[k]]
            x, y = own.astype(np.float32)  # not by a product of matrices, whose threads wait for each other
            row[:] = own[:, (_COS * x + _SIN * y).argmax(axis=1)].T
        number = np.full(len(starts), -1)
        number[chosen] = np.arange(len(chosen))
        owner = number[cluster]
        return cls(
            hulls,
            centers[chosen],
            spans[chosen],
            rises[chosen],
            count[chosen],
            chosen < kept,
            *_cells(xy[:, owner >= 0], owner[owner >= 0]),
        )


def _clusters(xyz: Floats, tolerance_m: float, min_points: int) -> Indices:
    """Return the cluster of each point, shape (N,), by first points; -1 for small ones.

    One point of each cell of 0.2 m by 0.2 m by 1 m is searched for neighbours.
    """
    if not xyz.shape[1]:
        return np.empty(0, np.int64)
    column, row, level = np.clip(np.floor(xyz / _THINNED_M), -_MAX_CELL, _MAX_CELL - 1).astype(np.int64) + _MAX_CELL
    _, first, cell = np.unique((column * (2 * _MAX_CELL) + row) * (2 * _MAX_CELL) + level, True, True)
    number = euclidean_clusters(xyz.take(first, axis=1) * _FLATTENED, tolerance_m, 1)[cell.ravel()]
    large = np.bincount(number) >= min_points
    return np.asarray(np.where(large, np.cumsum(large) - 1, -1)[number])


def _cells(xy: Floats, owner: Indices) -> tuple[Floats, Indices]:
    """Return the mean positions of points in cells of 0.5 m of each owner, and the owner of each cell."""
    column, row = np.clip(np.floor(xy / _CELL_M), -_MAX_CELL, _MAX_CELL - 1).astype(np.int64) + _MAX_CELL
    key = (owner * (2 * _MAX_CELL) + column) * (2 * _MAX_CELL) + row
    order = np.argsort(key, kind="stable")
    first = group_starts(key[order])
    return (np.add.reduceat(xy[:, order], first, axis=1) / group_sizes(first, len(key))).T, owner[order[first]]
