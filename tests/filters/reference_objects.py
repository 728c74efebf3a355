"""Points, objects and their evidence in the method ``confirmed`` as plain loops, for `reference_confirmed`."""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli.filters.confirmation import background, evidence, objects
from seaclutter_cli.filters.confirmation import echoes as heights
from seaclutter_cli.water import beams
from seaclutter_cli.water import surface as water_surface
from seaclutter_cli.water.faces import LEAST_M
from tests.filters.reference_faces import Faces
from tests.filters.reference_points import Point
from tests.filters.reference_water import Surface, grid_cell

XY = tuple[float, float]


def places_of(positions: Iterable[Sequence[float]]) -> np.ndarray:
    """Return positions as an array, one row each."""
    return np.array(list(positions))


def distances(here: Sequence[float], there: np.ndarray) -> np.ndarray:
    """Return the distances of a position to others."""
    if not len(there):
        return np.zeros(0)
    apart = there.T - np.array(here)[:, None]
    return np.sqrt(sum(apart * apart))


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
    deviation: float
    grows: bool
    unseen: float
    bright: bool = False
    low: bool = True
    alone: float = 0.0
    elsewhere: float = 0.0
    beside: bool = True
    face: float = 0.0
    run: int = 1
    linked: int = 0
    loose: int = 0
    high: bool = False
    upright: bool = False
    isolated: bool = False
    mirrored: bool = False
    deep: bool = False
    awash: bool = False

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
    def brightness(self) -> float:
        return self.point.intensity / self.threshold if self.threshold > 0 else 1.0


def elevation_of(z: float, place: XY) -> float:
    """Return the elevation of a point in degrees."""
    return math.degrees(math.atan2(z, math.hypot(*place)))


def bin_of(z: float, place: XY) -> int:
    """Return the number of the elevation bin of a point."""
    return round((elevation_of(z, place) + beams._HALF_DEG) / beams._BIN_DEG)


class Background:
    """How often cells of length, ring and sector had runs of echoes of water, of at least this octave of length."""

    def __init__(self) -> None:
        self.seen: dict[tuple[int, int, int], float] = {}
        self.time_s = -math.inf

    def mark(self, echoes: Sequence[Echo], time_s: float) -> None:
        """Set how alone echoes are, which may be echoes of the water themselves, and let those grow that are."""
        kept = math.exp(-max(time_s - self.time_s, 0) / background._MEMORY_S)
        self.time_s = time_s
        of_water = {cell_of(echo) for echo in echoes if abs(echo.height) <= echo.rise and not echo.upright}
        now = {
            (shorter, ring + step, sector)
            for length, ring, sector in of_water
            for shorter in range(length + 1)
            for step in (-1, 0, 1)
        }
        cells = now | self.seen.keys()
        self.seen = {cell: kept * self.seen.get(cell, 0.0) + (1 - kept) * (cell in now) for cell in cells}
        here = set(map(cell_of, echoes))
        shares = {cell: self.share(*cell) for cell in here | {(0, *place) for _, *place in here}}
        for echo in echoes:
            echo.elsewhere = shares[(0, *cell_of(echo)[1:])]
            single = max(echo.unseen, 1 - echo.elsewhere / heights._COMMON)
            of_row = max(echo.unseen, 1 - shares[cell_of(echo)] / heights._COMMON)
            echo.alone = single if echo.high or echo.bright else of_row
            bare = single > heights._ALONE
            is_row = of_row > heights._ALONE and echo.run >= heights._ROW
            echo.grows |= bare and not echo.deep
            echo.isolated = (bare or is_row) and not echo.deep
            echo.awash = echo.bright and not (echo.high or echo.upright) and not bare

    def share(self, length: int, ring: int, sector: int) -> float:
        """Return how often the other sectors of a ring had runs of this length."""
        others = other_sectors(sector)
        return sum(self.seen.get((length, ring, other), 0.0) for other in others) / len(others)


@cache
def other_sectors(sector: int) -> set[int]:
    """Return the sectors but one and those beside it."""
    own = {(sector + step) % background._SECTORS for step in range(-background._BESIDE, background._BESIDE + 1)}
    return set(range(background._SECTORS)) - own


def cell_of(echo: Echo) -> tuple[int, int, int]:
    """Return octave of the run, ring and sector of an echo."""
    ring = background._PER_OCTAVE * math.log2(1 + math.hypot(*echo.xy) / background._NEAR_M)
    sector = (math.atan2(echo.point.y, echo.point.x) + math.pi) * background._SECTORS / (2 * math.pi)
    length = min(echo.run.bit_length(), background._LENGTHS) - 1
    return length, min(int(ring), background._RINGS - 1), int(sector) % background._SECTORS


def echoes_of(used: Sequence[tuple[int, Point, int]], water: Surface | None, faces: Faces, params: Any) -> list[Echo]:
    """Return points, of which numbers and range rings are given, with all that the water and the faces say of them."""
    echoes = []
    for (number, point, ring), face in zip(used, faces.of_point, strict=True):
        one = echo_of(number, point, ring, water, params)
        one.face, one.run = face.above(point.z - one.height), face.run
        echoes.append(one)
    linked, loose = faces.neighbors([one.height > one.rise for one in echoes])
    for one, joined, apart in zip(echoes, linked, loose, strict=True):
        one.linked, one.loose = joined, apart
    sigma = 0.0 if water is None else water.sigma
    for one in echoes:
        one.high = one.height > one.rise
        one.upright = one.face > LEAST_M + sigma
        one.deep = water is not None and water.is_below(*one.point.xyz)
    bodies = {coarse_cell(*one.xy) for one in echoes if (one.high or one.upright) and not one.deep} - {None}
    around = {(x + i, y + j) for x, y in bodies for i in (-1, 0, 1) for j in (-1, 0, 1)} | {None}
    for one in echoes:
        one.mirrored = one.deep and coarse_cell(*one.xy) in around
        one.deep = one.mirrored or (water is not None and water.is_below(*one.point.xyz, water_surface._LONG_WAVES))
        one.upright &= not one.deep
        one.grows = one.grows or one.upright
    bodies = {grid_cell(*one.xy) for one in echoes if one.upright} - {None}
    around = {(x + i, y + j) for x, y in bodies for i in (-1, 0, 1) for j in (-1, 0, 1)} | {None}
    for one in echoes:
        one.beside = water is None or grid_cell(*one.xy) in around
    if params.use_intensity:
        mark_bright(echoes, water, params.cluster_tolerance_m)
    return echoes


def mark_bright(echoes: Sequence[Echo], water: Surface | None, tolerance_m: float) -> None:
    """Set which echoes reach their threshold or four times the intensity of the water, and which of them are bright."""
    near: dict[int, list[Echo]] = {}
    for one in echoes:
        near.setdefault(min(int(math.hypot(*one.xy) / tolerance_m), heights._MAX_RING), []).append(one)
    reach = heights._RINGS // 2
    for ring, here in near.items():
        around = [one for other in range(ring - reach, ring + reach + 1) for one in near.get(other, [])]
        of_water = [one for one in around if abs(one.height) <= one.rise and not one.upright]
        count = sum(1 / one.run for one in of_water)
        total = sum(one.point.intensity / one.run for one in of_water)
        for one in here:
            if water is not None and count >= heights._LEAST_ECHOES - 1e-9 and total > 0:
                one.threshold = min(one.threshold, heights._BRIGHTER * total / count)
            one.low = one.point.intensity < one.threshold
            one.bright = not one.low and abs(one.height) <= one.rise
    rings: dict[int, list[Echo]] = {}
    for one in echoes:
        if one.bright and not one.beside:
            rings.setdefault(int(math.hypot(*one.xy) / tolerance_m), []).append(one)
    for ring, bright in rings.items():
        bright.sort(key=lambda one: -one.point.intensity)
        for one in bright[math.ceil(heights._NEIGHBORS * (2 * ring + 1)) :]:
            one.bright = False


def coarse_cell(x: float, y: float) -> tuple[int, int] | None:
    """Return the cell of a position on a grid of four times the size; None beyond that."""
    return grid_cell(x / water_surface._COARSE, y / water_surface._COARSE)


def echo_of(number: int, point: Point, ring: int, water: Surface | None, params: Any) -> Echo:
    """Return a point with all that the water says of it; without water, every point is high."""
    height, deviation, shown = point.z + heights._UNSEEN_M, 0.0, 0.0
    if water is not None:
        height, deviation, shown = water.above(*point.xyz)
    threshold = [*params.initial_thresholds, -math.inf][max(ring, 0)]
    rise = max(params.min_rise_m, params.rise_sigmas * deviation)
    return Echo(
        number,
        point,
        ring,
        threshold,
        height,
        rise,
        deviation=deviation,
        grows=height > max(params.growth_height_m, heights._GROWTH_SIGMAS * deviation),
        unseen=min(max((heights._SHOWN - shown) / (heights._SHOWN - heights._OWN), 0.0), 1.0),
    )


def candidates_of(echoes: Sequence[Echo]) -> list[Echo]:
    """Return points in faces, high and bright ones, and those that grow where the water has no echoes."""
    return [echo for echo in echoes if echo.upright or echo.high or echo.bright or echo.isolated]


@dataclass(eq=False)
class Thing:
    """An object in one frame."""

    echoes: list[Echo]
    evidence: float
    near: bool
    features: dict[str, float]

    @cached_property
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

    @cached_property
    def center(self) -> XY:
        x, y = (mean(values) for values in zip(*(echo.xy for echo in self.echoes), strict=True))
        return x, y


def mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def clusters_of(echoes: Sequence[Echo], lidar: "Beams", params: Any) -> list[list[Echo]]:
    """Return groups of points connected by distances below the tolerance, in the order of their first points.

    Heights are scaled down where neighbouring beams are more than half of the tolerance apart. What is beside a face
    and what is not are clusters of their own; what is awash joins what is not only directly.
    """
    reach, places = params.cluster_tolerance_m / objects._BEAMS_IN_REACH, []
    apart_per_m = math.tan(math.radians(lidar.spacing_deg))
    for x, y, z, range_m, beside in ((*echo.xyz, echo.range_m, echo.beside) for echo in echoes):
        places.append((x, y, z * (reach / max(apart_per_m * range_m, reach)) + (0 if beside else objects._APART_M)))
    firm = places_of(place for place, echo in zip(places, echoes, strict=True) if not echo.awash)
    for k, echo in enumerate(echoes):
        if echo.awash and len(firm) and nearest(places[k], firm) >= params.cluster_tolerance_m:
            x, y, z = places[k]
            places[k] = x, y, z - 2 * objects._APART_M
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

    def learn(self, bins: Sequence[int]) -> None:
        if bins and self.frames < beams._FRAMES:
            self.frames += 1
            self.seen |= set(bins)

    @property
    def spacing_deg(self) -> float:
        """Median angle between neighbouring beams."""
        ordered = sorted(self.seen)
        steps = sorted(high - low for low, high in pairwise(ordered) if high - low > 1)
        middle = len(steps) // 2
        return (steps[middle] + steps[~middle]) / 2 * beams._BIN_DEG if steps else 0.0

    def below(self, lowest: int) -> float:
        """Return the angle from an elevation bin to the beam below."""
        steps = [lowest - one for one in self.seen if one < lowest - 1]
        return min(min([math.inf, *steps]) * beams._BIN_DEG, beams._OPEN_DEG)

    def above(self, highest: int) -> float:
        """Return the angle from an elevation bin to the beam above."""
        steps = [one - highest for one in self.seen if one > highest + 1]
        return min(min([math.inf, *steps]) * beams._BIN_DEG, beams._OPEN_DEG)

    def beside(self, echoes: Sequence[Echo]) -> XY:
        """Return how far below and above a group of points the next beams pass."""
        distance = mean([echo.range_m for echo in echoes])
        bins = [echo.elevation_bin for echo in echoes]
        gaps = self.below(min(bins)), self.above(max(bins))
        low, high = (math.tan(math.radians(gap)) * distance for gap in gaps)
        return low, high

    def meets(self, place: XY, top: float, water: Surface | None) -> bool:
        """Return whether a beam meets a body from the water to a height above it."""
        if water is None:
            return True
        level = water.level(*place)
        low, high = (bin_of(z, place) for z in (level, level + top))
        return any(low <= one <= high for one in self.seen)


def evidence_of(groups: Sequence[Sequence[Echo]], lidar: Beams, params: Any) -> list[tuple[float, dict[str, float]]]:
    """Return the evidence of the shape of each object, one curve for each of its features, and these."""
    stored = tables()["all" if params.use_intensity else "shape"]
    found = []
    for own in groups:
        features = shape_of(own, lidar)
        if params.use_intensity:
            features |= light_of(own)
        assert {*features, *evidence.OF_TRACKS} == set(stored["curves"])
        odds = stored["offset"] + math.fsum(on_curve(stored["curves"][name], value) for name, value in features.items())
        spread = sum(echo.loose for echo in own) > objects._VOLUME * sum(echo.linked for echo in own) + 1
        found.append((-100.0 if spread else odds, features))
    return found


@cache
def tables() -> dict[str, Any]:
    """Return the curves of objects with intensities, "all", and of those without, "shape"."""
    stored: dict[str, Any] = json.loads(Path(evidence.__file__).with_name("evidence.json").read_text("utf-8"))
    return stored


def on_curve(curve: dict[str, list[float]], value: float) -> float:
    """Return the value of a curve of straight pieces, level beyond its ends."""
    known, odds = curve["value"], curve["log_odds"]
    if value <= known[0]:
        return odds[0]
    for (left, right), (low, high) in zip(pairwise(known), pairwise(odds), strict=True):
        if value <= right:
            return low + (high - low) * (value - left) / (right - left)
    return odds[-1]


def shape_of(echoes: Sequence[Echo], lidar: Beams) -> dict[str, float]:
    """Return the features of an object's shape by name."""
    count = len(echoes)
    ordered = sorted(echo.height for echo in echoes)
    top = ordered[count - min(max(count // 4, 1), 3)]
    face = sorted(echo.face for echo in echoes)[count - 1 - count // 4]
    beside = sum(echo.linked + echo.loose for echo in echoes)
    extent = ordered[-1] - ordered[count // 10]
    spacing = max(sum(lidar.beside(echoes)) / 2, 0.01)
    azimuth = math.atan2(*(mean([echo.xy[axis] for echo in echoes]) for axis in (1, 0)))
    across = [math.cos(azimuth) * echo.point.y - math.sin(azimuth) * echo.point.x for echo in echoes]
    return {
        "height_m": top,
        "extent_m": extent,
        "density": math.log2(count * (mean([echo.range_m for echo in echoes]) / 10) ** 2),
        "echoes_beside": math.log2(max(beside, 0.01) / count),
        "face_share": min(face, max(top, 0)) / max(top, 0.05),
        "slenderness": math.log2((max(across) - min(across) + 0.05) / max(extent + spacing, 0.05)),
        "row": mean([echo.alone for echo in echoes]) * math.log2(mean([echo.run for echo in echoes])),
        "background": mean([math.log2(echo.elsewhere + 0.002) for echo in echoes]),
    }


def light_of(echoes: Sequence[Echo]) -> dict[str, float]:
    """Return the features of an object's intensities by name."""
    ordered = sorted(echo.brightness for echo in echoes)
    return {
        "bright_share": mean([not echo.low for echo in echoes]),
        "brightness": math.log2(max(ordered[len(ordered) // 2], 0.1)),
    }
