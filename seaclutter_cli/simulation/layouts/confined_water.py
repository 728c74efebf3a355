"""Confined water: facades on two sides at least."""

from collections.abc import Callable

import numpy as np

from seaclutter_cli.simulation.layouts.plan import Plan
from seaclutter_cli.simulation.layouts.shore import Line, moor, shore
from seaclutter_cli.simulation.marine.scene import Scene

_SMALL = ("speedboat", "sailing_boat", "kayak")
_MOORED = ("speedboat", "sailing_boat", "cruise_ship", "barge")


def harbour_basin(rng: np.random.Generator) -> Scene:
    """Make a basin with quays on two to four sides, with gaps, and boats along them."""
    plan = Plan(rng)
    turned, height = plan.uniform(-180, 180), plan.log(0.6, 4.0)
    shares = np.array([plan.uniform(0.2, 0.8), plan.uniform(0.2, 0.8)])
    spans = np.array([plan.log(22, 95), plan.log(22, 95)])
    ahead, left = (spans * shares).tolist()
    astern, right = (spans * (1 - shares)).tolist()
    quays = ((left, -astern, ahead), (ahead, -left, right), (right, -ahead, astern), (astern, -right, left))
    built = rng.permutation(4)[: plan.count(2, 4)].tolist()
    for number in built:
        away, start, end = quays[number]
        line = Line(away, turned + (0, -90, 180, 90)[number])
        _quay(plan, line, (start, end), height)
    plan.scatter(_SMALL, plan.count(0, 3), 8, 0.5 * float(spans.min()))
    return plan.scene("A harbour basin.", speed_ms=plan.uniform(0, 1.5))


def _quay(plan: Plan, line: Line, extent_m: tuple[float, float], height_m: float) -> None:
    """Add a quay along one side of a basin, perhaps with an entrance in it, and what lies along it."""
    start, end = extent_m
    parts = [extent_m]
    if plan.chance(0.4) and end - start > 30:
        gap = start + plan.uniform(0.2, 0.6) * (end - start)
        parts = [(start, gap), (gap + plan.uniform(8, 20), end)]
    taken = plan.uniform(0, 1)
    for part in parts:
        if part[1] - part[0] > 4:
            shore(plan, line, part, "quay_wall", height_m, houses=plan.uniform(0, 0.8))
            moor(plan, line, part, _MOORED, taken)


def moored_rows(rng: np.random.Generator) -> Scene:
    """Make rows of boats side by side along jetties; own vessel lies in the water between two of them."""
    plan = Plan(rng)
    lane, longest = plan.uniform(14, 34), plan.uniform(7, 14)
    share, kinds = plan.uniform(0.6, 1.0), _SMALL[:2] if plan.chance(0.7) else (plan.pick(_SMALL[:2]),)
    start, end = -plan.uniform(20, 70), plan.uniform(20, 70)
    offset = plan.uniform(-0.25, 0.25) * lane
    for side in (1, -1):
        edge = lane / 2 + side * offset
        rows = [edge, edge + longest + 2.5]
        if plan.chance(0.4):
            rows += [rows[1] + longest + lane, rows[1] + 2 * longest + lane + 2.5]
        for number, row in enumerate(rows):
            _row(plan, Line(row, side=side), (start, end), (longest, share, number % 2), kinds)
        for jetty in rows[1::2]:
            place = (start + end) / 2, side * (jetty - 1.25)
            plan.fixed("pontoon", place, (end - start, 1.8, 0.7), reflectivity=plan.log(0.1, 0.5))
    if plan.chance(0.5):
        place = (start if plan.chance(0.5) else end), 0.0
        plan.fixed("quay_wall", place, (2 * lane, 2, plan.uniform(1, 3)), 90, reflectivity=plan.log(0.05, 0.5))
    heading = plan.uniform(-15, 15) + 180 * plan.count(0, 1) if plan.chance(0.8) else plan.uniform(-180, 180)
    return plan.scene("Boats side by side along jetties.", heading_deg=heading, speed_ms=plan.uniform(0, 1.2))


def _row(
    plan: Plan, line: Line, extent_m: tuple[float, float], berths: tuple[float, float, int], kinds: tuple[str, ...]
) -> None:
    """Add boats side by side, bow or stern to the jetty, which is behind the first row and before the second."""
    longest, share, second = berths
    along = extent_m[0]
    while along < extent_m[1]:
        shape = plan.pick(kinds)
        length, width, height = plan.boat(shape, longest)
        if plan.chance(share):
            beyond = length / 2 + plan.uniform(0, 0.4) if second else longest - length / 2 - plan.uniform(0, 0.4)
            heading = line.side * 90 + 180 * plan.count(0, 1) + plan.uniform(-3, 3)
            place = line.at(along + width / 2, beyond)
            plan.add(shape, place, (length, width, height), heading, reflectivity=plan.log(0.03, 0.8))
        along += width + plan.log(0.4, 1.5)


def narrow_channel(rng: np.random.Generator) -> Scene:
    """Make a narrow channel, straight or bending, between walls or banks, perhaps with the piers of a bridge."""
    plan = Plan(rng)
    width, share = plan.log(14, 55), plan.uniform(0.3, 0.7)
    bend = plan.log(90, 500) * (1 if plan.chance(0.5) else -1) if plan.chance(0.6) else np.inf
    kind, height = ("quay_wall" if plan.chance(0.6) else "bank"), plan.log(0.6, 5.0)
    ends = -plan.uniform(45, 130), plan.uniform(45, 130)
    for side, part in ((1, share), (-1, 1 - share)):
        line = Line(part * width, 0.0, side, bend)
        shore(plan, line, ends, kind, height, houses=plan.uniform(0, 0.4))
        moor(plan, line, ends, _MOORED[:3], plan.uniform(0, 0.3))
    middle = Line((share - 0.5) * width, 0.0, 1, bend)
    if plan.chance(0.35):
        _bridge(plan, middle, plan.uniform(15, 60) * (1 if plan.chance(0.5) else -1), width)
    for _ in range(plan.count(0, 2)):
        place = middle.at(plan.uniform(-80, 80), plan.uniform(-0.25, 0.25) * width)
        plan.afloat(_SMALL, place, 180 * plan.count(0, 1), speed_ms=plan.uniform(0, 3), longest_m=10)
    heading = plan.uniform(-12, 12) + 180 * plan.count(0, 1) if plan.chance(0.85) else plan.uniform(-180, 180)
    speed = plan.uniform(0, 4) if abs(np.cos(np.radians(heading))) > 0.9 else 0.0
    return plan.scene("A narrow channel.", heading_deg=heading, speed_ms=speed)


def _bridge(plan: Plan, middle: Line, along_m: float, width_m: float) -> None:
    """Add the piers of a bridge."""
    for aside in (-0.25, 0.25):
        place, wide = middle.at(along_m, aside * width_m), plan.log(0.8, 2.5)
        if plan.claim(place, 3.0):
            size = (plan.uniform(2, 6), wide, plan.uniform(6, 10))
            plan.fixed("building", place, size, reflectivity=plan.log(0.1, 0.5))


def lock(rng: np.random.Generator) -> Scene:
    """Make a lock: close walls on both sides, gates ahead and astern, one of which may be open."""
    plan = Plan(rng)
    width, height = plan.log(8, 26), plan.log(0.9, 7.0)
    aside = min(0.2, 0.5 - 3.2 / width)  # room for own hull
    share = plan.uniform(0.5 - aside, 0.5 + aside)
    ahead, astern = plan.log(18, 140), plan.log(14, 120)
    bright = plan.log(0.02, 0.5)
    for side, part in ((1, share), (-1, 1 - share)):
        line = Line(part * width, side=side)
        shore(plan, line, (-astern - 10, ahead + 10), "quay_wall", height)
        moor(plan, line, (-astern, ahead), ("speedboat", "sailing_boat", "barge"), plan.uniform(0, 0.4) * (width > 14))
    across = (share - 0.5) * width
    closed = [away for away in (ahead, -astern) if plan.chance(0.75)]
    for along in closed:
        size = width + 2, plan.uniform(0.5, 1.5), height * plan.uniform(0.6, 1.0)
        plan.fixed("quay_wall", (along, across), size, 90, class_name="gate", reflectivity=bright)
    heading = plan.uniform(-4, 4) + 180 * plan.count(0, 1)
    return plan.scene("A lock.", heading_deg=heading, speed_ms=plan.uniform(0, 0.6))


def river(rng: np.random.Generator) -> Scene:
    """Make a river between sloping banks of uneven edge, with jetties, piles and moored boats."""
    plan = Plan(rng)
    width, share = plan.log(22, 70), plan.uniform(0.25, 0.75)
    bend = plan.log(150, 700) * (1 if plan.chance(0.5) else -1)
    ends = -plan.uniform(60, 150), plan.uniform(60, 150)
    for side, part in ((1, share), (-1, 1 - share)):
        line = Line(part * width, 0.0, side, bend, _uneven(plan, plan.uniform(0.3, 2.5)))
        shore(plan, line, ends, "bank", plan.log(0.6, 5.0), houses=plan.uniform(0, 0.3))
        moor(plan, line, ends, _MOORED[:2], plan.uniform(0, 0.4))
        _piles(plan, line, ends)
    heading = plan.uniform(-20, 20) + 180 * plan.count(0, 1)
    return plan.scene("A river between banks.", heading_deg=heading, speed_ms=plan.uniform(0, 4))


def _uneven(plan: Plan, height_m: float) -> Callable[[float], float]:
    """Return a random function of the way along an axis, of an edge that nature made."""
    waves, phases = plan.rng.uniform(20, 90, 3), plan.rng.uniform(0, 2 * np.pi, 3)
    return lambda along: height_m * float(np.sin(2 * np.pi * along / waves + phases).sum())


def _piles(plan: Plan, line: Line, extent_m: tuple[float, float]) -> None:
    """Add piles before a bank."""
    for _ in range(plan.count(0, 8)):
        place, wide = line.at(plan.uniform(*extent_m), -plan.uniform(1, 5)), plan.log(0.25, 0.8)
        if plan.claim(place, wide):
            plan.fixed("pile", place, (wide, wide, plan.uniform(1, 4)), reflectivity=plan.log(0.1, 0.5))
