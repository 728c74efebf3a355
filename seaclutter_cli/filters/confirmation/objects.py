"""Objects of a frame, and what their shapes say for a target or for water."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Indices, Ints, Mask, group_sizes, group_starts
from seaclutter_cli.clustering import euclidean_clusters
from seaclutter_cli.filters.confirmation.echoes import Echoes, Heights, Sea
from seaclutter_cli.filters.confirmation.evidence import OF_SHAPE, OF_VOLUME, log_odds
from seaclutter_cli.neighbors import nearest
from seaclutter_cli.water.beams import Beams

_CELL_M = 0.5
_BEAMS_IN_REACH = 2.0
_MAX_CELL = 1 << 19
_DENSITY_AT_M = 10.0
_LEAST_M, _LEAST_SPACING_M, _FEW, _LEAST_BRIGHTNESS = 0.05, 0.01, 0.01, 0.1
_APART_M = 1e4
_VOLUME = 2.5
_LEAST_SHARE = 0.002


@dataclass(frozen=True, eq=False)
class DetectedObject:
    """An object in one frame.

    ``points`` are the indices of its points among the echoes of the frame, or in the frame while it waits; ``evidence``
    is positive for a target, negative for water; ``cells``, shape (m, 2), and ``center``, shape (2,), are the mean
    horizontal positions of its points in each cell of 0.5 m and of all; ``top_m`` is the height of the highest above
    the water; ``features``, shape (F,), are those of its shape, as in `features_of`. It is ``near`` if it is nearer
    than ``start_m``, where own ship is.
    """

    points: NDArray[np.integer]
    evidence: float
    cells: Floats
    center: Floats
    top_m: float = 0.0
    near: bool = False
    features: Floats = field(default_factory=lambda: np.zeros(OF_SHAPE))


@dataclass(frozen=True)
class Clusters:
    """K clusters of n points.

    ``points``, shape (n,), are indices among the echoes of the frame, cluster by cluster; a cluster's first is at
    ``start``, and it has ``count`` of them, shape (K,).
    """

    points: Indices
    start: Ints
    count: Ints

    @classmethod
    def among(cls, sea: Sea, echoes: Echoes, among: Mask, heights: Heights | None = None) -> "Clusters":
        """Return the Euclidean clusters of some echoes.

        Where the beams are more than half of the tolerance apart, vertical distances are shortened to that, so that the
        echoes of several beams from one body stay together. Echoes that are ``apart`` do not join others. Those that
        are ``awash`` join others that they are near, but not through each other.
        """
        members, tolerance_m = np.flatnonzero(among), sea.params.cluster_tolerance_m
        positions, reach = echoes.xyz.take(members, axis=1), tolerance_m / _BEAMS_IN_REACH
        apart = np.tan(np.radians(sea.beams.spacing_deg)) * echoes.range_m[members]
        positions[2] *= reach / np.maximum(apart, reach)
        if heights is not None and heights.apart is not None:
            positions[2, heights.apart[members]] += _APART_M
            awash = heights.awash[members]
            if awash.any() and not awash.all():
                _, distance = nearest(positions[:, ~awash].T, positions[:, awash].T)
                positions[2, np.flatnonzero(awash)[distance >= tolerance_m]] -= 2 * _APART_M  # below all others
        labels = euclidean_clusters(positions, tolerance_m, sea.params.min_cluster_points)
        clustered = np.flatnonzero(labels >= 0)
        order = clustered[np.argsort(labels[clustered], kind="stable")]
        count = np.bincount(labels[clustered])
        return cls(members[order], np.cumsum(count) - count, count)

    def __len__(self) -> int:
        return len(self.start)

    def members(self, k: int) -> Indices:
        """Return the indices of the points of a cluster."""
        return self.points[self.start[k] : self.start[k] + self.count[k]]

    def objects(
        self, echoes: Echoes, heights: Heights, evidence: Floats, features: Floats, *, near: bool
    ) -> list[DetectedObject]:
        """Return the objects that the clusters are, sorted by their centres."""
        xy = echoes.xyz[:2].take(self.points, axis=1)
        column, row = np.clip(np.floor(xy / _CELL_M), -_MAX_CELL, _MAX_CELL - 1).astype(np.int64) + _MAX_CELL
        cluster = np.repeat(np.arange(len(self)), self.count)
        key = (cluster * (2 * _MAX_CELL) + column) * (2 * _MAX_CELL) + row
        order = np.argsort(key, kind="stable")
        first = group_starts(key[order])
        cells = (np.add.reduceat(xy.take(order, axis=1), first, axis=1) / group_sizes(first, len(key))).T
        bounds = np.searchsorted(first, np.append(self.start, len(key))).tolist()
        center = (np.add.reduceat(xy, self.start, axis=1) / self.count).T
        top, shape = self.greatest(heights.height_m).tolist(), evidence.tolist()
        own = [cells[start:end] for start, end in pairwise(bounds)]
        return [
            DetectedObject(self.members(k), shape[k], own[k], center[k], top[k], near, features[:, k])
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

    def ranked(self, values: Floats, *ranks: Ints) -> list[Floats]:
        """Return the points' values of given ranks in each cluster, shape (K,) each; rank 0 is the lowest."""
        ordered = values[self.points]
        by_value = np.argsort(ordered)
        cluster = np.repeat(np.arange(len(self), dtype=np.min_scalar_type(len(self))), self.count)
        ordered = ordered[by_value[np.argsort(cluster[by_value], kind="stable")]]
        return [np.asarray(ordered[self.start + rank]) for rank in ranks]


def find_objects(sea: Sea, echoes: Echoes, candidates: Mask, heights: Heights, *, near: bool) -> list[DetectedObject]:
    """Return the objects that candidate points form, with the evidence of their shapes."""
    clusters = Clusters.among(sea, echoes, candidates, heights)
    if not len(clusters):
        return []
    features = features_of(echoes, clusters, heights, sea.beams)
    evidence = log_odds(features)
    evidence[clusters.sum(heights.loose) > _VOLUME * clusters.sum(heights.linked) + 1] = OF_VOLUME
    return clusters.objects(echoes, heights, evidence, features, near=near)


def features_of(echoes: Echoes, clusters: Clusters, heights: Heights, beams: Beams) -> Floats:
    """Return the features of each cluster, shape (F, K), in the order of `FEATURES`; the last only with intensities."""
    count = clusters.count
    (top,) = clusters.ranked(heights.height_m, count - np.clip(count // 4, 1, 3))
    (face,) = clusters.ranked(heights.face_m, count - 1 - count // 4)
    (lowest,) = clusters.ranked(heights.height_m, count // 10)
    range_m, beside = clusters.mean(echoes.range_m), clusters.sum(heights.linked + heights.loose)
    extent = clusters.greatest(heights.height_m) - lowest
    spacing = np.maximum(sum(_beside(echoes, clusters, beams)) / 2, _LEAST_SPACING_M)
    width = _width_m(echoes, clusters)
    shape = (
        top,
        extent,
        np.log2(count * (range_m / _DENSITY_AT_M) ** 2),
        np.log2(np.maximum(beside, _FEW) / count),
        np.minimum(face, np.maximum(top, 0)) / np.maximum(top, _LEAST_M),
        np.log2((width + _LEAST_M) / np.maximum(extent + spacing, _LEAST_M)),
        clusters.mean(heights.alone) * np.log2(clusters.mean(heights.run)),
        clusters.mean(np.log2(heights.seen + _LEAST_SHARE)),
    )
    if echoes.intensity is None:
        return np.array(shape)
    (brightness,) = clusters.ranked(heights.brightness, count // 2)
    bright = clusters.mean((heights.brightness >= 1).astype(np.int32))
    return np.array((*shape, bright, np.log2(np.maximum(brightness, _LEAST_BRIGHTNESS))))


def _width_m(echoes: Echoes, clusters: Clusters) -> Floats:
    """Return the width of each cluster across the line of sight to its centre, shape (K,)."""
    x, y, _ = echoes.xyz
    azimuth = np.repeat(np.arctan2(clusters.mean(y), clusters.mean(x)), clusters.count)
    across = np.zeros(echoes.size)
    across[clusters.points] = np.cos(azimuth) * y[clusters.points] - np.sin(azimuth) * x[clusters.points]
    return clusters.greatest(across) - clusters.least(across)


def _beside(echoes: Echoes, clusters: Clusters, beams: Beams) -> tuple[Floats, Floats]:
    """Return how far below the lowest point and above the highest point of each cluster the next beams pass."""
    elevation = np.zeros(echoes.size)
    elevation[clusters.points] = beams.elevation_deg(echoes.xyz.take(clusters.points, axis=1))
    lowest, highest = clusters.least(elevation), clusters.greatest(elevation)
    distance = clusters.mean(echoes.range_m)
    below, above = (np.tan(np.radians(gap)) * distance for gap in beams.gaps(lowest, highest))
    return below, above
