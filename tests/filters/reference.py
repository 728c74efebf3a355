"""Reference implementations of the filters as plain loops: slow, easy to verify, and compared with the program.

They share no code with the program except the codes of `Reason` and the config keys. Each method is a class with
``observe``, ``step`` and ``reset``, made from the method's params; `REFERENCES` maps the program's names to them.
"""

import math
from bisect import bisect_right
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from seaclutter_cli.frame import Frame, Reason
from tests.filters.reference_confirmed import ConfirmedObjects
from tests.filters.reference_points import (
    TIE,
    Answer,
    Point,
    RingCounts,
    distances_to_others,
    isolated_by_count,
    mean_and_deviation,
    mean_distances,
    outliers_of,
    points_of,
)


def reason_before_rings(point: Point, params: Any) -> Reason | None:
    """Return the reason of a point outside the range rings; None for all others."""
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
    """Return the index of the half-open range ring of a range between ``start_m`` and ``end_m`` (Eq. 3)."""
    last = len(params.initial_thresholds) - 1
    for ring in range(last):
        if range_m < params.start_m + (ring + 1) * params.ring_width_m:
            return ring
    return last


class Rings:
    """Range-ring thresholds, optionally followed by outliers and the correction of the next frame's thresholds.

    Thresholds are computed by Eq. 4 in double precision, as in the tables that a run writes. Shares are exact
    fractions: 0.29 of 100 points is 29.
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
            outliers = self.find_outliers(points, bright, everywhere) if self.outliers else []
            for i in set(members) - set(bright):
                reasons[i] = Reason.LOW_INTENSITY
            for i in outliers:
                reasons[i] = Reason.OUTLIER
            for i in set(bright) - set(outliers):
                reasons[i] = Reason.KEPT
            counts.points.append(len(members))
            counts.low_intensity.append(len(members) - len(bright))
            counts.outliers.append(len(outliers))
            # Eq. 8; 0 / 1 without outliers.
            total = math.fsum(points[i].intensity for i in outliers)
            self.corrections.append(total / (len(outliers) + 1) if self.correction else 0.0)
        return Answer([int(reason) for reason in reasons], counts)

    def ring(self, point: Point) -> int:
        return ring_of(point.range_m, self.params)

    def threshold(self, ring: int) -> float:
        """Return the threshold of a range ring in this frame (Eq. 4)."""
        initial = self.params.initial_thresholds[ring]
        if self.corrections[ring] == 0:
            return initial
        weight = self.params.update_weight
        return weight * initial + (1 - weight) * self.corrections[ring]

    def find_outliers(self, points: list[Point], bright: list[int], everywhere: list[int]) -> list[int]:
        """Return the outliers among a range ring's bright points; the adaptive radius rule uses all bright points."""
        if self.params.outlier_stage == "adaptive_radius":
            ratio, needed = self.params.outlier_radius_ratio, self.params.outlier_min_neighbors
            found = isolated_by_count([points[i] for i in everywhere], ratio, needed)
            return [everywhere[index] for index in found if everywhere[index] in bright]
        share = math.floor(Fraction(str(self.params.neighbor_fraction)) * len(bright))
        neighbors = max(1, min(self.params.max_neighbors, share))
        found = outliers_of([points[i] for i in bright], neighbors, self.params.std_ratio)
        return [bright[index] for index in found]


class GlobalIntensity:
    """One threshold per recording: given, or the smallest one with a given share of all points below it.

    The counts from ``start_m`` to ``end_m`` are reported as one range ring.
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
    """Method without state that processes all valid points together."""

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
    """Statistical outliers among all points."""

    def removed(self, points: list[Point]) -> list[int]:
        return outliers_of(points, self.params.neighbors, self.params.std_ratio)


class RadiusOutliers(WholeFrame):
    """Points with too few others within a distance."""

    def removed(self, points: list[Point]) -> list[int]:
        found = []
        for index, distances in enumerate(distances_to_others(points)):
            if bisect_right(distances, self.params.radius_m) < self.params.min_neighbors:
                found.append(index)
        return found


class DynamicRadiusOutliers(WholeFrame):
    """Points with too few points, including themselves, within a distance that grows with horizontal range."""

    def removed(self, points: list[Point]) -> list[int]:
        params, found = self.params, []
        for index, distances in enumerate(distances_to_others(points)):
            spacing = math.hypot(points[index].x, points[index].y) * math.sin(math.radians(params.angle_deg))
            radius = max(params.min_radius_m, params.radius_multiplier * 2 * spacing) * TIE
            if 1 + bisect_right(distances, radius) < params.min_points:
                found.append(index)
        return found


class AdaptiveRadiusOutliers(WholeFrame):
    """Points with too few others within a share of their range, by the preset of the scene."""

    def removed(self, points: list[Point]) -> list[int]:
        preset = self.params.presets[self.params.scene]
        return isolated_by_count(points, preset.radius_ratio, preset.min_neighbors)


class DynamicStatisticalOutliers(WholeFrame):
    """Points whose mean distance to their nearest others reaches a limit that grows with range."""

    def removed(self, points: list[Point]) -> list[int]:
        return [index for index, mean, limit in self.limits(points) if mean >= limit / TIE]

    def limits(self, points: list[Point]) -> list[tuple[int, float, float]]:
        """Return index, mean distance and limit of each point."""
        if len(points) < 2:
            return []
        means = mean_distances(points, self.params.neighbors)
        mean, deviation = mean_and_deviation(means)
        factor = (mean + self.params.std_ratio * deviation) * self.params.range_multiplier_per_m
        return [(index, means[index], factor * point.range_m) for index, point in enumerate(points)]


class WeakDynamicStatisticalOutliers(DynamicStatisticalOutliers):
    """Weak, near points whose mean distance exceeds the limit from all points."""

    def removed(self, points: list[Point]) -> list[int]:
        outliers = [index for index, mean, limit in self.limits(points) if mean > limit * TIE]
        return [index for index in outliers if self.weak_and_near(points[index])]

    def weak_and_near(self, point: Point) -> bool:
        return point.intensity < self.params.intensity_threshold and point.range_m < self.params.max_range_m


class WeakRadiusOutliers(RadiusOutliers):
    """Radius outliers that are weak and near, both bounds included."""

    def removed(self, points: list[Point]) -> list[int]:
        return [index for index in super().removed(points) if self.weak_and_near(points[index])]

    def weak_and_near(self, point: Point) -> bool:
        return point.intensity <= self.params.intensity_threshold and point.range_m <= self.params.max_range_m


class WeakAndNear(WholeFrame):
    """Weak, near points, regardless of their neighbours."""

    reason = Reason.LOW_INTENSITY

    def removed(self, points: list[Point]) -> list[int]:
        threshold, end = self.params.intensity_threshold, self.params.max_range_m
        return [i for i, point in enumerate(points) if point.intensity < threshold and point.range_m < end]


class SeaSurface(WholeFrame):
    """Points not above the opened surface of the lowest points of cells."""

    def removed(self, points: list[Point]) -> list[int]:
        params = self.params
        axis = "xyz".index(params.up[-1])
        sign = -1 if params.up.startswith("-") else 1
        half = math.floor(params.window_m / (2 * params.cell_m))
        cells, lowest = [], {}
        for point in points:
            xyz = [point.xyz[(axis + step) % 3] for step in (1, 2, 0)]
            cell = math.floor(xyz[0] / params.cell_m), math.floor(xyz[1] / params.cell_m)
            cells.append((cell, sign * xyz[2]))
            lowest[cell] = min(lowest.get(cell, math.inf), sign * xyz[2])
        surface = Opening(lowest, half)
        return [i for i, (cell, height) in enumerate(cells) if height - surface.opened(cell) <= params.height_m]


class Opening:
    """Erosion and dilation, cell by cell, of a grid stored as a dict and bounded by its outermost cells."""

    def __init__(self, lowest: dict[tuple[int, int], float], half: int) -> None:
        self.lowest = lowest
        self.half = half
        self.ranges = [range(min(line), max(line) + 1) for line in zip(*lowest, strict=True)]
        self.known: dict[tuple[str, tuple[int, int]], float] = {}

    def filled(self, cell: tuple[int, int]) -> float:
        """Return a cell's value, or the least of the nearest values on four sides, at most a window width away."""
        if cell in self.lowest:
            return self.lowest[cell]
        found = [math.inf]
        for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            line = ((cell[0] + i * step, cell[1] + j * step) for step in range(1, 2 * self.half + 2))
            found += [self.lowest[there] for there in line if there in self.lowest][:1]
        return min(found)

    def eroded(self, cell: tuple[int, int]) -> float:
        return min(self.once("eroded_row", (i, cell[1])) for i in self.window(cell, 0))

    def eroded_row(self, cell: tuple[int, int]) -> float:
        return min(self.once("filled", (cell[0], j)) for j in self.window(cell, 1))

    def opened(self, cell: tuple[int, int]) -> float:
        return max(self.once("dilated_row", (i, cell[1])) for i in self.window(cell, 0, whole=True))

    def dilated_row(self, cell: tuple[int, int]) -> float:
        eroded = [self.once("eroded", (cell[0], j)) for j in self.window(cell, 1, whole=True)]
        return max((value for value in eroded if value < math.inf), default=-math.inf)

    def window(self, cell: tuple[int, int], axis: int, *, whole: bool = False) -> range:
        """Return the indices in a window along an axis; ``whole``: only those with their own window inside the grid."""
        inside = self.ranges[axis]
        half = min(self.half, (len(inside) - 1) // 2)
        first, last = (inside[half], inside[-1 - half]) if whole else (inside[0], inside[-1])
        return range(max(first, cell[axis] - half), min(last, cell[axis] + half) + 1)

    def once(self, name: str, cell: tuple[int, int]) -> float:
        """Return the cached result of a method for a cell."""
        if (name, cell) not in self.known:
            self.known[name, cell] = getattr(self, name)(cell)
        return self.known[name, cell]


class Ground(WholeFrame):
    """Points that Patchwork++, called directly, takes for ground."""

    def __init__(self, params: Any) -> None:
        super().__init__(params)
        import pypatchworkpp

        given = pypatchworkpp.Parameters()
        given.enable_RNR = False
        names = {"sensor_height_m": "sensor_height", "min_range_m": "min_range", "max_range_m": "max_range"}
        names |= {"ground_distance_m": "th_dist", "seed_height_m": "th_seeds", "uprightness": "uprightness_thr"}
        names["min_points"] = "num_min_pts"
        for key, name in names.items():
            setattr(given, name, getattr(params, key))
        self.library = pypatchworkpp.patchworkpp(given)

    def removed(self, points: list[Point]) -> list[int]:
        near = [i for i, point in enumerate(points) if max(map(abs, point.xyz)) <= self.params.max_range_m]
        near.sort(key=lambda i: tuple(reversed(points[i].xyz)))
        if not near:
            return []
        self.library.estimateGround([points[i].xyz for i in near])
        return [near[number] for number in self.library.getGroundIndices()]


class Nothing(WholeFrame):
    """Method that keeps all points, including invalid ones."""

    def step(self, frame: Frame) -> Answer:
        return Answer([int(Reason.KEPT)] * frame.size)


REFERENCES: dict[str, Callable[[Any], Any]] = {
    "joint": lambda params: Rings(params, outliers=True, correction=True),
    "confirmed": ConfirmedObjects,
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
    "sea_surface": SeaSurface,
    "patchwork": Ground,
    "none": Nothing,
}
