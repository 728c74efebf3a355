"""Points and their neighbourhoods as plain loops, and the answers of methods, for `reference`."""

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from seaclutter_cli.frame import Frame

TIE = 1 + 1e-9
"""Relative excess over the limit from which a distance counts as longer.

Distances that are mathematically equal differ in their last bits with the order of the additions, so a strict
comparison would remove arbitrary points of an evenly spaced row. The value is far above rounding (1e-16 for each of a
few thousand terms) and far below the resolution of any lidar.
"""

MANY = 100
"""Number of points from which distances are computed by numpy, ten times as fast; a test compares the two ways."""


@dataclass
class RingCounts:
    """Thresholds, corrections and counts, one value per range ring."""

    thresholds: list[float]
    corrections: list[float]
    points: list[int]
    low_intensity: list[int]
    outliers: list[int]


@dataclass
class Answer:
    """Reason of every point, and counts of the range rings."""

    reason: list[int]
    rings: RingCounts | None = None


class Point(NamedTuple):
    """Point in double precision; the intensity is None if the cloud has no intensity."""

    x: float
    y: float
    z: float
    intensity: float | None

    @property
    def xyz(self) -> tuple[float, float, float]:
        return self.x, self.y, self.z

    @property
    def range_m(self) -> float:
        return math.sqrt(self.x * self.x + self.y * self.y + self.z * self.z)

    @property
    def invalid(self) -> bool:
        numbers = [*self.xyz, 0.0 if self.intensity is None else self.intensity]
        return not all(math.isfinite(number) for number in numbers) or self.xyz == (0, 0, 0)

    def inside(self, box: tuple[float, ...]) -> bool:
        x_min, x_max, y_min, y_max, z_min, z_max = box
        return x_min <= self.x <= x_max and y_min <= self.y <= y_max and z_min <= self.z <= z_max


def points_of(frame: Frame) -> list[Point]:
    """Return the points of a frame; an intensity field must be called ``intensity``."""
    columns = [frame.cloud.points[axis].tolist() for axis in "xyz"]
    if "intensity" in frame.cloud.points.dtype.names:
        columns.append(frame.cloud.points["intensity"].tolist())
    else:
        columns.append([None] * frame.size)
    return [Point(*values) for values in zip(*columns, strict=True)]


def distances_to_others(points: list[Point], most: int | None = None) -> Iterator[list[float]]:
    """Yield the distances of each point to all others, or to at most so many, nearest first."""
    if len(points) < MANY:
        for index, here in enumerate(points):
            yield sorted(math.dist(here.xyz, there.xyz) for i, there in enumerate(points) if i != index)[:most]
    else:
        x, y, z = np.array([point.xyz for point in points]).T.copy()
        for index, here in enumerate(points):
            distances = np.sqrt((x - here.x) ** 2 + (y - here.y) ** 2 + (z - here.z) ** 2)
            yield np.sort(np.delete(distances, index))[:most].tolist()


def mean_distances(points: list[Point], neighbors: int) -> list[float]:
    """Return the mean distance of each point to its nearest others, for at least two points."""
    return [math.fsum(distances) / len(distances) for distances in distances_to_others(points, neighbors)]


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


def isolated_by_count(points: list[Point], radius_ratio: float, min_neighbors: int) -> list[int]:
    """Return the indices of points with too few others within a share of their range, by counting ([Bi], Eq. 5, 6)."""
    found = []
    for index, distances in enumerate(distances_to_others(points)):
        radius = radius_ratio * points[index].range_m * TIE
        if bisect_right(distances, radius) < min_neighbors:
            found.append(index)
    return found


def isolated_by_rank(points: list[Point], radius_ratio: float, min_neighbors: int) -> list[int]:
    """Return the same indices from the distance to the N-th nearest other point; it is infinite if there is none."""
    found = []
    for index, distances in enumerate(distances_to_others(points, min_neighbors)):
        farthest = [*distances, *[math.inf] * min_neighbors][min_neighbors - 1]
        if farthest > radius_ratio * points[index].range_m * TIE:
            found.append(index)
    return found
