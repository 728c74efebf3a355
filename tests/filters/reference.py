"""The filters once more, as plain loops: slow, easy to check by eye, and what the program is held against.

Nothing here shares code with the program but the numbers of `Reason` and the config keys. Each method is a class with
``observe``, ``step`` and ``reset``, made from the method's params; `REFERENCES` lists them under the program's names.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from seaclutter_cli.frame import Frame, Reason

TIE = 1 + 1e-9
"""Relative excess over the limit from which a distance counts as longer.

Distances that are equal on paper differ in their last bits by the order of the additions, so a strict comparison would
remove points of an evenly spaced row by chance. This is far above rounding (1e-16 for each of a few thousand terms) and
far below anything that a lidar resolves.
"""

MANY = 400
"""Number of points from which a row of distances is computed by numpy, which takes a tenth of the time."""


class Point(NamedTuple):
    """A point in double precision; the intensity is None where the cloud has none."""

    x: float
    y: float
    z: float
    intensity: float | None

    @property
    def place(self) -> tuple[float, float, float]:
        return self.x, self.y, self.z

    @property
    def range_m(self) -> float:
        return math.sqrt(self.x * self.x + self.y * self.y + self.z * self.z)

    @property
    def invalid(self) -> bool:
        numbers = [*self.place, 0.0 if self.intensity is None else self.intensity]
        return not all(math.isfinite(number) for number in numbers) or self.place == (0, 0, 0)

    def inside(self, box: tuple[float, ...]) -> bool:
        x_min, x_max, y_min, y_max, z_min, z_max = box
        return x_min <= self.x <= x_max and y_min <= self.y <= y_max and z_min <= self.z <= z_max


@dataclass
class RingCounts:
    """What happened in the rings, a value a ring."""

    thresholds: list[float]
    corrections: list[float]
    points: list[int]
    low_intensity: list[int]
    outliers: list[int]


@dataclass
class Answer:
    """A reason for every point."""

    reason: list[int]
    rings: RingCounts | None = None


def points_of(frame: Frame) -> list[Point]:
    """Return the points of a frame whose intensity field, if any, is called ``intensity``."""
    columns = [frame.cloud.points[axis].tolist() for axis in "xyz"]
    if "intensity" in frame.cloud.points.dtype.names:
        columns.append(frame.cloud.points["intensity"].tolist())
    else:
        columns.append([None] * frame.size)
    return [Point(*values) for values in zip(*columns, strict=True)]


def reason_before_rings(point: Point, params: Any) -> Reason | None:
    """Return the reason of a point that lies in no ring; None for all others."""
    if point.invalid:
        return Reason.INVALID
    if any(point.inside(box) for box in params.exclude_boxes):
        return Reason.EXCLUDED
    if point.range_m < params.start_m:
        return Reason.NEAR if params.near == "drop" else Reason.KEPT
    if point.range_m >= params.end_m:
        return Reason.FAR if params.far == "drop" else Reason.KEPT
    return None


def ring_of(range_m: float, params: Any) -> int:
    """Return the number of the half-open ring, from 0, of a range between ``start_m`` and ``end_m`` (Eq. 3)."""
    last = len(params.initial_thresholds) - 1
    for ring in range(last):
        if range_m < params.start_m + (ring + 1) * params.ring_width_m:
            return ring
    return last


def distances_to_others(points: list[Point]) -> Iterator[list[float]]:
    """Yield for each point the distances to all others, the nearest first."""
    if len(points) < MANY:
        for index, here in enumerate(points):
            yield sorted(math.dist(here.place, there.place) for i, there in enumerate(points) if i != index)
    else:
        places = np.array([point.place for point in points])
        for index, here in enumerate(places):
            distances = np.sqrt(((places - here) ** 2).sum(axis=1))
            yield np.sort(np.delete(distances, index)).tolist()


def mean_distances(points: list[Point], neighbors: int) -> list[float]:
    """Return the mean distance of each of at least two points to its nearest others."""
    nearest = [distances[:neighbors] for distances in distances_to_others(points)]
    return [math.fsum(distances) / len(distances) for distances in nearest]


def mean_and_deviation(values: list[float]) -> tuple[float, float]:
    """Return the mean and the sample standard deviation."""
    mean = math.fsum(values) / len(values)
    return mean, math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1))


def outliers_of(points: list[Point], neighbors: int, std_ratio: float) -> list[int]:
    """Return the indices of points whose mean distance to their nearest others exceeds the limit (Eq. 6, 7)."""
    if len(points) < 2:
        return []
    means = mean_distances(points, neighbors)
    mean, deviation = mean_and_deviation(means)
    limit = (mean + std_ratio * deviation) * TIE
    return [index for index, value in enumerate(means) if value > limit]


def sparse_of(points: list[Point], radius_ratio: float, min_neighbors: int) -> list[int]:
    """Return the indices of points with too few others within a share of their range: by counting (S3, Eq. 5, 6)."""
    found = []
    for index, distances in enumerate(distances_to_others(points)):
        radius = radius_ratio * points[index].range_m * TIE
        if sum(distance <= radius for distance in distances) < min_neighbors:
            found.append(index)
    return found


def sparse_by_rank(points: list[Point], radius_ratio: float, min_neighbors: int) -> list[int]:
    """Return the same by the distance to the N-th nearest other point; too few others are infinitely far."""
    found = []
    for index, distances in enumerate(distances_to_others(points)):
        farthest = [*distances, *[math.inf] * min_neighbors][min_neighbors - 1]
        if farthest > radius_ratio * points[index].range_m * TIE:
            found.append(index)
    return found


class Rings:
    """A threshold a ring, then outliers, then the correction of the next frame's thresholds; the last two on request.

    Thresholds are the numbers that Eq. 4 gives in double precision, for those stand in the tables that a run writes.
    Shares are exact fractions: 0.29 of 100 points are 29.
    """

    def __init__(self, params: Any, *, outliers: bool, correction: bool) -> None:
        self.params = params
        self.outliers = outliers
        self.correction = correction
        self.reset()

    def reset(self) -> None:
        self.corrections = [0.0] * len(self.params.initial_thresholds)

    def observe(self, frame: Frame) -> None:
        raise AssertionError("one pass is enough")

    def step(self, frame: Frame) -> Answer:
        points = points_of(frame)
        reasons = [reason_before_rings(point, self.params) for point in points]
        used = self.corrections
        thresholds = [self.threshold(ring) for ring in range(len(used))]
        counts = RingCounts(thresholds, used, [], [], [])
        self.corrections = []
        in_rings = [i for i, reason in enumerate(reasons) if reason is None]
        everywhere = [i for i in in_rings if points[i].intensity >= thresholds[self.ring(points[i])]]
        for ring, threshold in enumerate(thresholds):
            members = [i for i, point in enumerate(points) if reasons[i] is None and self.ring(point) == ring]
            bright = [i for i in members if points[i].intensity >= threshold]
            lonely = self.find_outliers(points, bright, everywhere) if self.outliers else []
            for i in set(members) - set(bright):
                reasons[i] = Reason.LOW_INTENSITY
            for i in lonely:
                reasons[i] = Reason.OUTLIER
            for i in set(bright) - set(lonely):
                reasons[i] = Reason.KEPT
            counts.points.append(len(members))
            counts.low_intensity.append(len(members) - len(bright))
            counts.outliers.append(len(lonely))
            # Eq. 8; without outliers it is 0 / 1.
            total = math.fsum(points[i].intensity for i in lonely)
            self.corrections.append(total / (len(lonely) + 1) if self.correction else 0.0)
        return Answer([int(reason) for reason in reasons], counts)

    def ring(self, point: Point) -> int:
        return ring_of(point.range_m, self.params)

    def threshold(self, ring: int) -> float:
        """Return the threshold of a ring in this frame (Eq. 4)."""
        initial = self.params.initial_thresholds[ring]
        if self.corrections[ring] == 0:
            return initial
        weight = self.params.update_weight
        return weight * initial + (1 - weight) * self.corrections[ring]

    def find_outliers(self, points: list[Point], bright: list[int], everywhere: list[int]) -> list[int]:
        """Return the outliers among the bright points of a ring; some rules look at those everywhere."""
        if self.params.outlier_stage == "adaptive_radius":
            ratio, needed = self.params.outlier_radius_ratio, self.params.outlier_min_neighbors
            found = sparse_of([points[i] for i in everywhere], ratio, needed)
            return [everywhere[index] for index in found if everywhere[index] in bright]
        share = math.floor(Fraction(str(self.params.neighbor_fraction)) * len(bright))
        neighbors = max(1, min(self.params.max_neighbors, share))
        found = outliers_of([points[i] for i in bright], neighbors, self.params.std_ratio)
        return [bright[index] for index in found]


class GlobalIntensity:
    """One threshold a recording, given or found as the smallest one below which lies a share of all points.

    What it does from ``start_m`` to ``end_m`` is told as of one ring.
    """

    def __init__(self, params: Any) -> None:
        self.params = params
        self.reset()

    def reset(self) -> None:
        self.seen: list[float] = []

    def observe(self, frame: Frame) -> None:
        in_range = [point for point in points_of(frame) if reason_before_rings(point, self.params) is None]
        self.seen += [point.intensity for point in in_range]

    def threshold(self) -> float:
        if self.params.threshold is not None:
            return self.params.threshold
        whole = all(value == math.floor(value) for value in self.seen)
        for below, value in enumerate(sorted(self.seen), start=1):
            if below / len(self.seen) >= self.params.filter_rate:
                return value + 1 if whole else math.nextafter(value, math.inf)
        return 0.0

    def step(self, frame: Frame) -> Answer:
        threshold = self.threshold()
        counts = RingCounts([threshold], [0.0], [0], [0], [0])
        reasons = []
        for point in points_of(frame):
            reason = reason_before_rings(point, self.params)
            if reason is None:
                low = point.intensity < threshold
                reason = Reason.LOW_INTENSITY if low else Reason.KEPT
                counts.points[0] += 1
                counts.low_intensity[0] += low
            reasons.append(int(reason))
        return Answer(reasons, counts)


class WholeFrame:
    """A method without state that looks at all valid points together."""

    reason = Reason.OUTLIER

    def __init__(self, params: Any) -> None:
        self.params = params

    def reset(self) -> None:
        pass

    def observe(self, frame: Frame) -> None:
        raise AssertionError("one pass is enough")

    def step(self, frame: Frame) -> Answer:
        points = points_of(frame)
        valid = [i for i, point in enumerate(points) if not point.invalid]
        reasons = [int(Reason.INVALID)] * len(points)
        for i in valid:
            reasons[i] = int(Reason.KEPT)
        for index in self.removed([points[i] for i in valid]):
            reasons[valid[index]] = int(self.reason)
        return Answer(reasons)

    def removed(self, points: list[Point]) -> list[int]:
        raise NotImplementedError


class StatisticalOutliers(WholeFrame):
    """Outliers among all points."""

    def removed(self, points: list[Point]) -> list[int]:
        return outliers_of(points, self.params.neighbors, self.params.std_ratio)


class RadiusOutliers(WholeFrame):
    """Points with too few others within a distance."""

    def removed(self, points: list[Point]) -> list[int]:
        found = []
        for index, distances in enumerate(distances_to_others(points)):
            within = [distance for distance in distances if distance <= self.params.radius_m]
            if len(within) < self.params.min_neighbors:
                found.append(index)
        return found


class DynamicRadiusOutliers(WholeFrame):
    """Points with too few, themselves included, within a distance that grows with horizontal range."""

    def removed(self, points: list[Point]) -> list[int]:
        params, found = self.params, []
        for index, distances in enumerate(distances_to_others(points)):
            beside = math.hypot(points[index].x, points[index].y) * math.sin(math.radians(params.angle_deg))
            radius = max(params.min_radius_m, params.radius_multiplier * 2 * beside) * TIE
            within = [0.0, *(distance for distance in distances if distance <= radius)]
            if len(within) < params.min_points:
                found.append(index)
        return found


class AdaptiveRadiusOutliers(WholeFrame):
    """Points with too few others within a share of their range, which goes by the scene."""

    def removed(self, points: list[Point]) -> list[int]:
        preset = self.params.presets[self.params.scene]
        return sparse_of(points, preset.radius_ratio, preset.min_neighbors)


class DynamicStatisticalOutliers(WholeFrame):
    """Points whose mean distance to their nearest others reaches a limit that grows with range."""

    def removed(self, points: list[Point]) -> list[int]:
        return [index for index, mean, limit in self.limits(points) if mean >= limit / TIE]

    def limits(self, points: list[Point]) -> list[tuple[int, float, float]]:
        """Return each point's number, mean distance and limit."""
        if len(points) < 2:
            return []
        means = mean_distances(points, self.params.neighbors)
        mean, deviation = mean_and_deviation(means)
        factor = (mean + self.params.std_ratio * deviation) * self.params.range_multiplier_per_m
        return [(index, means[index], factor * point.range_m) for index, point in enumerate(points)]


class WeakDynamicStatisticalOutliers(DynamicStatisticalOutliers):
    """Weak, near points whose mean distance exceeds such a limit, which is that of all points."""

    def removed(self, points: list[Point]) -> list[int]:
        beyond = [index for index, mean, limit in self.limits(points) if mean > limit * TIE]
        return [index for index in beyond if self.weak_and_near(points[index])]

    def weak_and_near(self, point: Point) -> bool:
        return point.intensity < self.params.intensity_threshold and point.range_m < self.params.max_range_m


class WeakRadiusOutliers(RadiusOutliers):
    """Radius outliers that are weak and near, both bounds included."""

    def removed(self, points: list[Point]) -> list[int]:
        return [index for index in super().removed(points) if self.weak_and_near(points[index])]

    def weak_and_near(self, point: Point) -> bool:
        return point.intensity <= self.params.intensity_threshold and point.range_m <= self.params.max_range_m


class WeakAndNear(WholeFrame):
    """Weak, near points, whatever lies around them."""

    reason = Reason.LOW_INTENSITY

    def removed(self, points: list[Point]) -> list[int]:
        threshold, end = self.params.intensity_threshold, self.params.max_range_m
        return [i for i, point in enumerate(points) if point.intensity < threshold and point.range_m < end]


class Nothing(WholeFrame):
    """Keeps everything, invalid points too."""

    def step(self, frame: Frame) -> Answer:
        return Answer([int(Reason.KEPT)] * frame.size)


REFERENCES: dict[str, Callable[[Any], Any]] = {
    "joint": lambda params: Rings(params, outliers=True, correction=True),
    "ring_intensity_outlier": lambda params: Rings(params, outliers=True, correction=False),
    "ring_intensity": lambda params: Rings(params, outliers=False, correction=False),
    "global_intensity": GlobalIntensity,
    "sor": StatisticalOutliers,
    "ror": RadiusOutliers,
    "dror": DynamicRadiusOutliers,
    "adaptive_radius": AdaptiveRadiusOutliers,
    "dsor": DynamicStatisticalOutliers,
    "lior": WeakRadiusOutliers,
    "lidsor": WeakDynamicStatisticalOutliers,
    "naive": WeakAndNear,
    "none": Nothing,
}
