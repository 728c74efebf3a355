"""Points, objects and their evidence in the method ``confirmed`` as plain loops, for `reference_confirmed`."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from seaclutter_cli.filters import confirmed
from seaclutter_cli.filters.confirmation import beams, objects
from seaclutter_cli.filters.confirmation import echoes as heights
from tests.filters.reference_points import Point
from tests.filters.reference_water import Surface

XY = tuple[float, float]


def places_of(positions: Iterable[Sequence[float]]) -> np.ndarray:
    """Return positions as an array, one row each."""
    return np.array(list(positions))


def distances(here: Sequence[float], there: np.ndarray) -> np.ndarray:
    """Return the distances of a position to others."""
    total = np.zeros(len(there))
    for own, others in zip(here, there.T, strict=bool(len(there))):
        total = total + (own - others) * (own - others)
    return np.sqrt(total)


def nearest(here: Sequence[float], there: np.ndarray) -> float:
    """Return the distance of a position to the nearest of others; infinite if there are none."""
    return float(distances(here, there).min()) if len(there) else math.inf


@dataclass
class Echo:
    """A point that may belong to water or objects."""

    number: int
    point: Point
    ring: int  # -1: near, number of range rings: far
    threshold: float
    height: float
    rise: float
    wave: float
    upright: bool
    grows: bool
    bright: bool
    low: bool
    unseen: float

    @property
    def xyz(self) -> tuple[float, float, float]:
        return self.point.xyz

    @property
    def xy(self) -> XY:
        return self.point.x, self.point.y

    @property
    def range_m(self) -> float:
        return self.point.range_m

    @property
    def elevation_bin(self) -> int:
        return bin_of(self.point.z, self.xy)

    @property
    def near(self) -> bool:
        return self.ring < 0

    @property
    def high(self) -> bool:
        return self.height > self.rise

    @property
    def brightness(self) -> float:
        return self.point.intensity / self.threshold if self.threshold > 0 else 1.0


def bin_of(z: float, place: XY) -> int:
    """Return the number of the elevation bin of a point."""
    elevation = math.degrees(math.atan2(z, math.hypot(*place)))
    return round((elevation + beams._HALF_DEG) / beams._BIN_DEG)


def echo_of(number: int, point: Point, ring: int, water: Surface | None, params: Any, *, upright: bool) -> Echo:
    """Return a point with all that the water says of it; without water, every point is high."""
    height, deviation, shown = point.z + heights._UNSEEN_M, 0.0, 0.0
    if water is not None:
        height, deviation, shown = water.above(*point.xyz)
    beyond = heights._RISE_PER_M * max(point.range_m - heights._RISE_FROM_M, 0)
    rise = max(params.min_rise_m, params.rise_sigmas * deviation) + beyond
    threshold = [*params.initial_thresholds, -math.inf][max(ring, 0)]
    reached = params.use_intensity and point.intensity >= threshold
    return Echo(
        number,
        point,
        ring,
        threshold,
        height,
        rise,
        wave=heights._WAVE_SIGMAS * deviation + beyond,
        upright=upright,
        grows=height > max(params.growth_height_m, heights._GROWTH_SIGMAS * deviation),
        bright=reached and abs(height) <= rise,
        low=not reached,
        unseen=min(max((heights._SHOWN - shown) / (heights._SHOWN - heights._OWN), 0.0), 1.0),
    )


def candidates_of(echoes: Sequence[Echo], lidar: "Beams") -> list[Echo]:
    """Return high and upright points, and bright ones with enough bright or high ones around them."""
    among = places_of(echo.xyz for echo in echoes if echo.bright or echo.high)
    found = []
    for echo in echoes:
        dense = False
        if echo.bright:
            reach = confirmed._RADIUS_RATIO * echo.range_m
            above = math.tan(math.radians(lidar.gaps([echo])[1])) * echo.range_m
            in_one_beam = echo.unseen > 0 and echo.height + above >= confirmed._ONE_BEAM_RISES * echo.rise
            needed = confirmed._MIN_IN_ONE_BEAM if in_one_beam else confirmed._MIN_NEIGHBORS
            dense = (distances(echo.xyz, among) <= reach).sum() - 1 >= needed
        if echo.high or echo.upright or dense:
            found.append(echo)
    return found


@dataclass(eq=False)
class Thing:
    """An object in one frame."""

    echoes: list[Echo]
    evidence: float
    near: bool

    @property
    def cells(self) -> list[XY]:
        """Mean position of the points in each cell of half a metre."""
        members: dict[tuple[int, int], list[XY]] = {}
        for echo in self.echoes:
            cell = math.floor(echo.point.x / objects._CELL_M), math.floor(echo.point.y / objects._CELL_M)
            members.setdefault(cell, []).append(echo.xy)
        return [(mean([x for x, _ in own]), mean([y for _, y in own])) for _, own in sorted(members.items())]

    @property
    def top(self) -> float:
        return max(echo.height for echo in self.echoes)

    @property
    def center(self) -> XY:
        x, y = (mean(values) for values in zip(*(echo.xy for echo in self.echoes), strict=True))
        return x, y


def mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def clusters_of(echoes: Sequence[Echo], lidar: "Beams", params: Any) -> list[list[Echo]]:
    """Return groups of points connected by distances below the tolerance, in the order of their first points.

    Heights are scaled down where neighbouring beams are more than half of the tolerance apart.
    """
    reach, places = params.cluster_tolerance_m / objects._BEAMS_IN_REACH, []
    for x, y, z, range_m in ((*echo.xyz, echo.range_m) for echo in echoes):
        apart = math.tan(math.radians(lidar.spacing_deg)) * range_m
        places.append((x, y, z * (reach / max(apart, reach))))
    places, free, found = places_of(places), np.ones(len(echoes), bool), []
    for first in range(len(echoes)):
        if not free[first]:
            continue
        free[first] = False
        group = [first]
        for member in group:  # grows in the loop
            joined = np.flatnonzero(free & (distances(places[member], places) < params.cluster_tolerance_m)).tolist()
            free[joined] = False
            group += joined
        if len(group) >= params.min_cluster_points:
            found.append([echoes[number] for number in sorted(group)])
    return found


class Beams:
    """The elevations at which the first frames have points."""

    def __init__(self) -> None:
        self.seen: set[int] = set()
        self.frames = 0

    def learn(self, echoes: Sequence[Echo]) -> None:
        if echoes and self.frames < beams._FRAMES:
            self.frames += 1
            self.seen |= {echo.elevation_bin for echo in echoes}

    @property
    def spacing_deg(self) -> float:
        """Median angle between neighbouring beams."""
        ordered = sorted(self.seen)
        steps = sorted(high - low for low, high in pairwise(ordered) if high - low > 1)
        middle = len(steps) // 2
        return (steps[middle] + steps[~middle]) / 2 * beams._BIN_DEG if steps else 0.0

    def gaps(self, echoes: Sequence[Echo]) -> XY:
        """Return the angles from a group of points to the beams below and above."""
        bins = [echo.elevation_bin for echo in echoes]
        below = [min(bins) - one for one in self.seen if one < min(bins) - 1]
        above = [one - max(bins) for one in self.seen if one > max(bins) + 1]
        low, high = (min(min([math.inf, *steps]) * beams._BIN_DEG, beams._OPEN_DEG) for steps in (below, above))
        return low, high

    def beside(self, echoes: Sequence[Echo]) -> XY:
        """Return how far below and above a group of points the next beams pass."""
        distance = mean([echo.range_m for echo in echoes])
        low, high = (math.tan(math.radians(gap)) * distance for gap in self.gaps(echoes))
        return low, high

    def meets(self, place: XY, top: float, water: Surface | None) -> bool:
        """Return whether a beam meets a body from the water to a height above it."""
        if water is None:
            return True
        level = water.level(*place)
        low, high = (bin_of(z, place) for z in (level, level + top))
        return any(low <= one <= high for one in self.seen)


def evidence_of(echoes: Sequence[Echo], sigma: float, lidar: Beams, params: Any) -> float:
    """Return the evidence of an object's shape."""
    count = len(echoes)
    ordered = sorted(echo.height for echo in echoes)
    extent = ordered[-1] - ordered[0]
    top = ordered[count - min(max(count // 4, 1), 3)]
    rise, wave = mean([echo.rise for echo in echoes]), mean([echo.wave for echo in echoes])
    below, above = lidar.beside(echoes)
    upright = any(echo.upright for echo in echoes)
    stands = upright * extent / max(params.min_extent_m, params.extent_sigmas * sigma)
    possible = objects._POSSIBLE * min(top, extent + below)
    share = max(stands, (top - wave) / rise, possible / rise)
    shape = min(max(share, 0.0), objects._MAX_SHARE) - objects._FLAT
    if shape >= 0:
        return shape
    hidden = min(max((top + above) / rise - 1, 0.0), 1.0) * mean([echo.unseen for echo in echoes])
    return (1 - hidden) * shape + hidden * evidence_of_brightness(echoes, params)


def evidence_of_brightness(echoes: Sequence[Echo], params: Any) -> float:
    if not params.use_intensity:
        return 0.0
    median = sorted(echo.brightness for echo in echoes)[len(echoes) // 2]
    if median < 1:
        return 0.0
    share = min(math.log2(median) / objects._BRIGHT_OCTAVES, 1.0)
    return objects._BRIGHT_EVIDENCE * (objects._DIM_SHARE + (1 - objects._DIM_SHARE) * share)
