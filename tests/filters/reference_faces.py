"""Faces of the method ``confirmed`` as plain loops, for `reference_confirmed`; only the constants are shared."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from seaclutter_cli.water import faces

XYZ = tuple[float, float, float]


@dataclass
class Face:
    """Lowest and highest z of the face that a point belongs to."""

    low: float
    top: float
    run: int = 1

    @property
    def height(self) -> float:
        return self.top - self.low

    def above(self, level: float) -> float:
        """Return the height of the part above z of the water."""
        return self.top - max(self.low, level)


@dataclass
class Pair:
    """Two neighbours, by their numbers, and whether they lie on one surface."""

    one: int
    other: int
    joined: bool


@dataclass
class Faces:
    """The face of each point, and all pairs of neighbours."""

    of_point: list[Face]
    pairs: list[Pair]

    def neighbors(self, among: Sequence[bool]) -> tuple[list[int], list[int]]:
        """Return how many neighbours of each point, among some, lie on one surface with it, and how many do not."""
        joined, loose = [0] * len(among), [0] * len(among)
        for pair in self.pairs:
            if among[pair.one] and among[pair.other]:
                counts = joined if pair.joined else loose
                counts[pair.one] += 1
                counts[pair.other] += 1
        return joined, loose


def faces_of(points: Sequence[XYZ], elevations: Sequence[float], gaps: Sequence[float]) -> Faces:
    """Return the faces of points at elevations, with the angles to the beams above them, in degrees."""
    distances = [math.hypot(x, y) for x, y, _ in points]
    bearings = [math.degrees(math.atan2(y, x)) + 180 for x, y, _ in points]
    found = Faces([Face(z, z) for _, _, z in points], [])
    for shift in (0.0, 0.5):
        columns = [int(bearing / faces._COLUMN_DEG + shift) % faces._COLUMNS for bearing in bearings]
        for members in grouped(columns):
            members.sort(key=lambda k: elevations[k])
            steps = []
            for low, high in pairwise(members):
                reach = max(faces._LEAST_GAP_DEG, faces._GAP_BEAMS * gaps[low])
                slope = faces._RAKE * abs(points[high][2] - points[low][2])
                near = elevations[high] - elevations[low] <= reach
                steps.append(step_between(low, high, distances, slope, near=near))
            record(found, steps)
            chain = members[:1]
            for step in steps:
                if not (step.near and step.close):
                    stand(found, chain, points)
                    chain = []
                chain.append(step.second)
            stand(found, chain, points)
    beams = grouped([round((elevation + 90) / faces._BEAM_DEG) for elevation in elevations])
    reach = reach_deg(beams, bearings)
    for members in beams:
        members.sort(key=lambda k: bearings[k])
        steps = []
        for left, right in pairwise(members):
            turn = bearings[right] - bearings[left]
            slope = math.radians(turn) * distances[right]
            steps.append(step_between(left, right, distances, slope, near=turn <= reach))
        record(found, steps)
        count_runs(found, members, steps)
    return found


def reach_deg(beams: Sequence[list[int]], bearings: Sequence[float]) -> float:
    """Return the angle between neighbours of a beam, from the steps of all beams."""
    ordered = [sorted(bearings[k] for k in members) for members in beams]
    steps = sorted(right - left for one in ordered for left, right in pairwise(one))
    steps = [step for step in steps if step > faces._LEAST_STEP_DEG]
    finest = steps[len(steps) // faces._FINEST] if steps else 0.0
    return min(max(faces._STEPS * finest, faces._STEP_DEG), faces._MAX_STEP_DEG)


def grouped(keys: Sequence[int]) -> list[list[int]]:
    """Return the numbers of the points with each key."""
    members: dict[int, list[int]] = {}
    for number, key in enumerate(keys):
        members.setdefault(key, []).append(number)
    return list(members.values())


@dataclass
class Step:
    """The step from an echo to the next in a column or beam."""

    first: int
    second: int
    change: float
    limit: float
    near: bool
    close: bool


def step_between(first: int, second: int, distances: Sequence[float], slope: float, *, near: bool) -> Step:
    """Return a step; the ranges of close ones differ by no more than noise, divergence and slope explain."""
    change = distances[second] - distances[first]
    limit = faces._NOISE_M + faces._DIVERGENCE * distances[second]
    near = near and abs(change) <= faces._APART_M
    return Step(first, second, change, limit, near, abs(change) <= limit + slope)


def record(found: Faces, steps: Sequence[Step]) -> None:
    """Record the pairs of neighbours; they are on one surface if close, or if their ranges change evenly."""
    even = [False] * len(steps)
    for k in range(1, len(steps)):
        before, here = steps[k - 1], steps[k]
        if before.near and here.near and abs(here.change - before.change) <= here.limit:
            even[k - 1] = even[k] = True
    for step, is_even in zip(steps, even, strict=True):
        if step.near:
            found.pairs.append(Pair(step.first, step.second, step.close or is_even))


def count_runs(found: Faces, members: Sequence[int], steps: Sequence[Step]) -> None:
    """Count the points beside each other in a beam, up to where the range changes."""
    chain = [members[0]]
    for step in steps:
        chain = [*(chain if step.near and step.close else ()), step.second]
        for k in chain:
            found.of_point[k].run = len(chain)


def stand(found: Faces, chain: Sequence[int], points: Sequence[XYZ]) -> None:
    """Let the points of a chain have its face, if it is higher than theirs."""
    heights = [points[k][2] for k in chain]
    low, top = min(heights), max(heights)
    for k in chain:
        if top - low > found.of_point[k].height:
            found.of_point[k] = Face(low, top)
