"""Objects of a frame, and what their shapes say for a target or for water."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.clustering import euclidean_clusters
from seaclutter_cli.filters.confirmation import ConfirmedParams
from seaclutter_cli.filters.confirmation.echoes import ALONE, Echoes, Heights
from seaclutter_cli.groups import group_sizes, group_starts
from seaclutter_cli.water.beams import Beams

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_CELL_M = 0.5
_BEAMS_IN_REACH = 2.0
_MAX_CELL = 1 << 19
_FLAT = 0.5
_MAX_SHARE = 1.5
_POSSIBLE = 0.7
_LOOSE_SHARE = 0.2
_LEAST_OWN, _MOSTLY_OWN = 0.15, 0.45
_REACH_CELLS = 120
_BRIGHT_EVIDENCE, _UNBROKEN_EVIDENCE = 0.4, 0.8
_DIM_SHARE = 0.25
_BRIGHT_OCTAVES = 2.0
SHORT_RUN, _LONG_RUN = 3, 5.0


@dataclass(frozen=True, eq=False)
class DetectedObject:
    """An object in one frame.

    ``points`` are the indices of its points among the echoes of the frame, or in the frame while it waits; ``evidence``
    is positive for a target, negative for water; ``cells``, shape (m, 2), and ``center``, shape (2,), are the mean
    horizontal positions of its points in each cell of 0.5 m and of all; ``top_m`` is the height of the highest above
    the water. It is ``near`` if it is nearer than ``start_m``, where own ship is, and ``lone`` if half of its points
    are in faces where the water has no echoes.
    """

    points: NDArray[np.integer]
    evidence: float
    cells: Floats
    center: Floats
    top_m: float = 0.0
    near: bool = False
    lone: bool = False


@dataclass(frozen=True)
class Clusters:
    """K clusters of n points.

    ``points``, shape (n,), are indices among the echoes of the frame, cluster by cluster; a cluster's first is at
    ``start``, and it has ``count`` of them, shape (K,).
    """

    points: Indices
    start: NDArray[np.int64]
    count: NDArray[np.int64]

    @classmethod
    def among(cls, echoes: Echoes, among: NDArray[np.bool_], beams: Beams, params: ConfirmedParams) -> "Clusters":
        """Return the Euclidean clusters of some echoes.

        Where the beams are more than half of the tolerance apart, vertical distances are shortened to that, so that the
        echoes of several beams from one body stay together.
        """
        members = np.flatnonzero(among)
        tolerance_m = params.cluster_tolerance_m
        labels = euclidean_clusters(
            _lowered(echoes, members, beams, tolerance_m), tolerance_m, params.min_cluster_points
        )
        clustered = np.flatnonzero(labels >= 0)
        order = clustered[np.argsort(labels[clustered], kind="stable")]
        count = np.bincount(labels[clustered])
        return cls(members[order], np.cumsum(count) - count, count)

    def __len__(self) -> int:
        return len(self.start)

    def members(self, k: int) -> Indices:
        """Return the indices of the points of a cluster."""
        return self.points[self.start[k] : self.start[k] + self.count[k]]

    def objects(self, echoes: Echoes, heights: Heights, evidence: Floats, *, near: bool) -> list[DetectedObject]:
        """Return the objects that the clusters are, sorted by their centres."""
        if not len(self):
            return []
        xy = echoes.xyz[:2].take(self.points, axis=1)
        column, row = np.clip(np.floor(xy / _CELL_M), -_MAX_CELL, _MAX_CELL - 1).astype(np.int64) + _MAX_CELL
        cluster = np.repeat(np.arange(len(self)), self.count)
        key = (cluster * (2 * _MAX_CELL) + column) * (2 * _MAX_CELL) + row
        order = np.argsort(key, kind="stable")
        first = group_starts(key[order])
        cells = (np.add.reduceat(xy.take(order, axis=1), first, axis=1) / group_sizes(first, len(key))).T
        bounds = np.searchsorted(first, np.append(self.start, len(key))).tolist()
        center = (np.add.reduceat(xy, self.start, axis=1) / self.count).T
        in_lone_faces = (heights.upright & (heights.alone > ALONE)).astype(np.int32)
        lone = (2 * self.sum(in_lone_faces) >= self.count).tolist()
        top, shape = self.greatest(heights.height_m).tolist(), evidence.tolist()
        return [
            DetectedObject(
                self.members(k), shape[k], cells[bounds[k] : bounds[k + 1]], center[k], top[k], near, lone[k]
            )
            for k in np.lexsort(center.T[::-1]).tolist()
        ]

    def sum(self, values: Floats | NDArray[np.int32]) -> Floats:
        """Return the sum of the points' values in each cluster, shape (K,)."""
        return np.asarray(np.add.reduceat(values[self.points], self.start))

    def mean(self, values: Floats | NDArray[np.int32]) -> Floats:
        """Return the mean of the points' values in each cluster, shape (K,)."""
        return self.sum(values) / self.count

    def least(self, values: Floats) -> Floats:
        """Return the least of the points' values in each cluster, shape (K,)."""
        return np.minimum.reduceat(values[self.points], self.start)

    def greatest(self, values: Floats) -> Floats:
        """Return the greatest of the points' values in each cluster, shape (K,)."""
        return np.maximum.reduceat(values[self.points], self.start)

    def ranked(self, values: Floats, *ranks: NDArray[np.int64]) -> list[Floats]:
        """Return the points' values of given ranks in each cluster, shape (K,) each; rank 0 is the lowest."""
        ordered = values[self.points]
        by_value = np.argsort(ordered)
        cluster = np.repeat(np.arange(len(self), dtype=np.min_scalar_type(len(self))), self.count)
        ordered = ordered[by_value[np.argsort(cluster[by_value], kind="stable")]]
        return [np.asarray(ordered[self.start + rank]) for rank in ranks]


def _lowered(echoes: Echoes, members: Indices, beams: Beams, tolerance_m: float) -> Floats:
    """Return the positions of some echoes, shape (3, n), with shortened heights where beams are far apart."""
    positions = echoes.xyz.take(members, axis=1)
    apart = np.tan(np.radians(beams.spacing_deg)) * echoes.range_m[members]
    reach = tolerance_m / _BEAMS_IN_REACH
    positions[2] *= reach / np.maximum(apart, reach)
    return positions


def find_objects(
    echoes: Echoes,
    candidates: NDArray[np.bool_],
    heights: Heights,
    beams: Beams,
    params: ConfirmedParams,
    *,
    near: bool,
) -> list[DetectedObject]:
    """Return the objects that candidate points form, with the evidence of their shapes."""
    clusters = Clusters.among(echoes, candidates, beams, params)
    if not len(clusters):
        return []
    evidence = _evidence(echoes, clusters, heights, beams, params)
    return clusters.objects(echoes, heights, evidence, near=near)


def _evidence(echoes: Echoes, clusters: Clusters, heights: Heights, beams: Beams, params: ConfirmedParams) -> Floats:
    """Return the evidence of each cluster, shape (K,), from -0.5 (flat on the water) to 1 (upright)."""
    (top,) = clusters.ranked(heights.height_m, clusters.count - np.clip(clusters.count // 4, 1, 3))
    (face,) = clusters.ranked(heights.face_m, clusters.count - 1 - clusters.count // 4)
    rise, wave = clusters.mean(heights.rise_m), clusters.mean(heights.wave_m)
    below, above = _beside(echoes, clusters, beams)
    linked, loose = clusters.sum(heights.linked), clusters.sum(heights.loose)
    # A body has a face, but for what is between the beams. Where few neighbours lie on one surface, a face is chance.
    solid = np.clip((linked + 1) / (linked + loose + 1) / _LOOSE_SHARE - 1, 0, 1)
    # A body hides the water. Where most echoes are of the water, what stands out is wash, unless it is bright.
    (brightness,) = clusters.ranked(heights.brightness, clusters.count // 2)
    octaves = np.log2(np.maximum(brightness, 1))
    own = np.clip((_own_share(echoes, clusters, heights) - _LEAST_OWN) / (_MOSTLY_OWN - _LEAST_OWN), octaves, 1)
    stands = own * solid * face / np.maximum(params.min_extent_m, params.extent_sigmas * heights.sigma_m)
    # What is higher than any wave is no water, if its face or its surface shows that it is a body.
    surface = np.clip(2 * linked / np.maximum(linked + loose, 1) - 1, 0, 1)
    tall = np.maximum(np.minimum(np.maximum(top - wave, _POSSIBLE * top), face + below), surface * (top - wave))
    shape = np.clip(np.maximum(stands, own * tall / rise), 0, _MAX_SHARE) - _FLAT
    # Where the next beam passes above all but tall bodies, a flat cluster is no evidence. Brightness decides, or echoes
    # that are beside each other; unless the water has echoes all around, since it is bright at times.
    hidden = np.where(shape < 0, np.clip((top + above) / rise - 1, 0, 1), 0.0)
    unseen, alone = clusters.mean(heights.unseen), clusters.mean(heights.alone)
    if not (hidden * alone).any():
        return np.asarray(shape)
    brighter = np.minimum(octaves / _BRIGHT_OCTAVES, 1)
    bright = np.where(brightness >= 1, _BRIGHT_EVIDENCE * (_DIM_SHARE + (1 - _DIM_SHARE) * brighter), 0.0)
    unbroken = _UNBROKEN_EVIDENCE * np.clip((clusters.mean(heights.run) - SHORT_RUN) / _LONG_RUN, 0, 1)
    return np.asarray((1 - hidden * alone) * shape + hidden * np.maximum(unseen * bright, alone * unbroken))


def _own_share(echoes: Echoes, clusters: Clusters, heights: Heights) -> Floats:
    """Return the share of its own echoes among those in the cells of each cluster, shape (K,).

    Other echoes count if they are near the water and within 60 m.
    """
    side = 2 * _REACH_CELLS + 1
    place = np.clip(np.floor(echoes.xyz[:2] / _CELL_M) + _REACH_CELLS, 0, side - 1).astype(np.int32)
    number = place[0] * np.int32(side) + place[1]
    within = (np.abs(place - _REACH_CELLS) < _REACH_CELLS).all(axis=0)
    of_water = within & (np.abs(heights.height_m) <= heights.rise_m)
    of_water[clusters.points] = False
    water = np.bincount(number[of_water], minlength=side * side)
    pairs = np.unique(np.repeat(np.arange(len(clusters)), clusters.count) * side * side + number[clusters.points])
    cluster, cell = np.divmod(pairs, side * side)
    beside = np.bincount(cluster, weights=water[cell], minlength=len(clusters))
    return np.asarray(clusters.count / (clusters.count + beside))


def _beside(echoes: Echoes, clusters: Clusters, beams: Beams) -> tuple[Floats, Floats]:
    """Return how far below the lowest point and above the highest point of each cluster the next beams pass."""
    elevation = np.zeros(echoes.size)
    elevation[clusters.points] = beams.elevation_deg(echoes.xyz.take(clusters.points, axis=1))
    lowest, highest = clusters.least(elevation), clusters.greatest(elevation)
    distance = clusters.mean(echoes.range_m)
    below, above = (np.tan(np.radians(gap)) * distance for gap in beams.gaps(lowest, highest))
    return below, above
