"""Layouts of confined water: facades on at least two sides."""

from collections.abc import Callable

import numpy as np

from seaclutter_cli.simulation.layouts.plan import Line, Plan, moor, shore
from seaclutter_cli.simulation.marine.scene import Scene

_SMALL = ("speedboat", "sailing_boat", "kayak")
_MOORED = ("speedboat", "sailing_boat", "cruise_ship", "barge")


def harbour_basin(plan: Plan) -> Scene:
    """Return a basin with quays on two to four sides, with gaps, and boats along the quays."""
    rotation, height = plan.uniform(-180, 180), plan.log_uniform(0.6, 4.0)
    shares = np.array([plan.uniform(0.2, 0.8), plan.uniform(0.2, 0.8)])
    spans = np.array([plan.log_uniform(22, 95), plan.log_uniform(22, 95)])
    ahead, left = (spans * shares).tolist()
    astern, right = (spans * (1 - shares)).tolist()
    quays = ((left, -astern, ahead), (ahead, -left, right), (right, -ahead, astern), (astern, -right, left))
    sides = plan.rng.permutation(4)[: plan.integer(2, 4)].tolist()
    for index in sides:
        distance, start, end = quays[index]
        line = Line(distance, rotation + (0, -90, 180, 90)[index])
        _quay(plan, line, (start, end), height)
    plan.scatter(_SMALL, plan.integer(0, 3), 8, 0.5 * float(spans.min()))
    return plan.scene("A harbour basin.", speed_ms=plan.uniform(0, 1.5))


def _quay(plan: Plan, line: Line, extent_m: tuple[float, float], height_m: float) -> None:
    """Add a quay along one side of a basin, sometimes with an entrance, and the boats moored at it."""
    start, end = extent_m
    parts = [extent_m]
    if plan.bernoulli(0.4) and end - start > 30:
        gap = start + plan.uniform(0.2, 0.6) * (end - start)
        parts = [(start, gap), (gap + plan.uniform(8, 20), end)]
    occupancy = plan.uniform(0, 1)
    for part in parts:
        if part[1] - part[0] > 4:
            shore(plan, line, part, "quay_wall", height_m, houses=plan.uniform(0, 0.8))
            moor(plan, line, part, _MOORED, occupancy)


def moored_rows(plan: Plan) -> Scene:
    """Return rows of boats side by side along jetties, with own ship in the water between two of them."""
    lane, longest = plan.uniform(14, 34), plan.uniform(7, 14)
    share, kinds = plan.uniform(0.6, 1.0), _SMALL[:2] if plan.bernoulli(0.7) else (plan.choice(_SMALL[:2]),)
    start, end = -plan.uniform(20, 70), plan.uniform(20, 70)
    offset = plan.uniform(-0.25, 0.25) * lane
    for side in (1, -1):
        edge = lane / 2 + side * offset
        rows = [edge, edge + longest + 2.5]
        if plan.bernoulli(0.4):
            rows += [rows[1] + longest + lane, rows[1] + 2 * longest + lane + 2.5]
        for index, row in enumerate(rows):
            _row(plan, Line(row, side=side), (start, end), (longest, share, index % 2), kinds)
        for jetty in rows[1::2]:
            position = (start + end) / 2, side * (jetty - 1.25)
            plan.add_fixed("pontoon", position, (end - start, 1.8, 0.7), reflectivity=plan.log_uniform(0.1, 0.5))
    if plan.bernoulli(0.5):
        position = (start if plan.bernoulli(0.5) else end), 0.0
        plan.add_fixed(
            "quay_wall", position, (2 * lane, 2, plan.uniform(1, 3)), 90, reflectivity=plan.log_uniform(0.05, 0.5)
        )
    heading = plan.uniform(-15, 15) + 180 * plan.integer(0, 1) if plan.bernoulli(0.8) else plan.uniform(-180, 180)
    return plan.scene("Boats side by side along jetties.", heading_deg=heading, speed_ms=plan.uniform(0, 1.2))


def _row(
    plan: Plan, line: Line, extent_m: tuple[float, float], berths: tuple[float, float, int], kinds: tuple[str, ...]
) -> None:
    """Add boats side by side, bow or stern to the jetty, which is behind the first row and in front of the second."""
    longest, share, second = berths
    along = extent_m[0]
    while along < extent_m[1]:
        shape = plan.choice(kinds)
        length, width, height = plan.boat_size(shape, longest)
        if plan.bernoulli(share):
            beyond = length / 2 + plan.uniform(0, 0.4) if second else longest - length / 2 - plan.uniform(0, 0.4)
            heading = line.side * 90 + 180 * plan.integer(0, 1) + plan.uniform(-3, 3)
            position = line.at(along + width / 2, beyond)
            plan.add(shape, position, (length, width, height), heading, reflectivity=plan.log_uniform(0.03, 0.8))
        along += width + plan.log_uniform(0.4, 1.5)


def narrow_channel(plan: Plan) -> Scene:
    """Return a narrow channel, straight or curved, between walls or banks, sometimes with the piers of a bridge."""
    width, share = plan.log_uniform(14, 55), plan.uniform(0.3, 0.7)
    bend = plan.log_uniform(90, 500) * (1 if plan.bernoulli(0.5) else -1) if plan.bernoulli(0.6) else np.inf
    kind, height = ("quay_wall" if plan.bernoulli(0.6) else "bank"), plan.log_uniform(0.6, 5.0)
    ends = -plan.uniform(45, 130), plan.uniform(45, 130)
    for side, part in ((1, share), (-1, 1 - share)):
        line = Line(part * width, 0.0, side, bend)
        shore(plan, line, ends, kind, height, houses=plan.uniform(0, 0.4))
        moor(plan, line, ends, _MOORED[:3], plan.uniform(0, 0.3))
    middle = Line((share - 0.5) * width, 0.0, 1, bend)
    if plan.bernoulli(0.35):
        _bridge(plan, middle, plan.uniform(15, 60) * (1 if plan.bernoulli(0.5) else -1), width)
    for _ in range(plan.integer(0, 2)):
        position = middle.at(plan.uniform(-80, 80), plan.uniform(-0.25, 0.25) * width)
        plan.add_boat(_SMALL, position, 180 * plan.integer(0, 1), speed_ms=plan.uniform(0, 3), longest_m=10)
    heading = plan.uniform(-12, 12) + 180 * plan.integer(0, 1) if plan.bernoulli(0.85) else plan.uniform(-180, 180)
    speed = plan.uniform(0, 4) if abs(np.cos(np.radians(heading))) > 0.9 else 0.0
    return plan.scene("A narrow channel.", heading_deg=heading, speed_ms=speed)


def _bridge(plan: Plan, middle: Line, along_m: float, width_m: float) -> None:
    """Add the piers of a bridge."""
    for offset in (-0.25, 0.25):
        position, wide = middle.at(along_m, offset * width_m), plan.log_uniform(0.8, 2.5)
        if plan.reserve(position, 3.0):
            size = (plan.uniform(2, 6), wide, plan.uniform(6, 10))
            plan.add_fixed("building", position, size, reflectivity=plan.log_uniform(0.1, 0.5))


def lock(plan: Plan) -> Scene:
    """Return a lock: walls close on both sides, gates ahead and astern, either of which may be open."""
    width, height = plan.log_uniform(8, 26), plan.log_uniform(0.9, 7.0)
    offset = min(0.2, 0.5 - 3.2 / width)  # room for own ship
    share = plan.uniform(0.5 - offset, 0.5 + offset)
    ahead, astern = plan.log_uniform(18, 140), plan.log_uniform(14, 120)
    reflectivity = plan.log_uniform(0.02, 0.5)
    for side, part in ((1, share), (-1, 1 - share)):
        line = Line(part * width, side=side)
        shore(plan, line, (-astern - 10, ahead + 10), "quay_wall", height)
        moor(plan, line, (-astern, ahead), ("speedboat", "sailing_boat", "barge"), plan.uniform(0, 0.4) * (width > 14))
    across = (share - 0.5) * width
    closed = [distance for distance in (ahead, -astern) if plan.bernoulli(0.75)]
    for along in closed:
        size = width + 2, plan.uniform(0.5, 1.5), height * plan.uniform(0.6, 1.0)
        plan.add_fixed("quay_wall", (along, across), size, 90, class_name="gate", reflectivity=reflectivity)
    heading = plan.uniform(-4, 4) + 180 * plan.integer(0, 1)
    return plan.scene("A lock.", heading_deg=heading, speed_ms=plan.uniform(0, 0.6))


def river(plan: Plan) -> Scene:
    """Return a river between sloping banks with an uneven edge, with piles and moored boats."""
    width, share = plan.log_uniform(22, 70), plan.uniform(0.25, 0.75)
    bend = plan.log_uniform(150, 700) * (1 if plan.bernoulli(0.5) else -1)
    ends = -plan.uniform(60, 150), plan.uniform(60, 150)
    for side, part in ((1, share), (-1, 1 - share)):
        line = Line(part * width, 0.0, side, bend, _uneven(plan, plan.uniform(0.3, 2.5)))
        shore(plan, line, ends, "bank", plan.log_uniform(0.6, 5.0), houses=plan.uniform(0, 0.3))
        moor(plan, line, ends, _MOORED[:2], plan.uniform(0, 0.4))
        _piles(plan, line, ends)
    heading = plan.uniform(-20, 20) + 180 * plan.integer(0, 1)
    return plan.scene("A river between banks.", heading_deg=heading, speed_ms=plan.uniform(0, 4))


def _uneven(plan: Plan, height_m: float) -> Callable[[float], float]:
    """Return a random offset of a natural shore as a function of the distance along the axis."""
    waves, phases = plan.rng.uniform(20, 90, 3), plan.rng.uniform(0, 2 * np.pi, 3)
    return lambda along: height_m * float(np.sin(2 * np.pi * along / waves + phases).sum())


def _piles(plan: Plan, line: Line, extent_m: tuple[float, float]) -> None:
    """Add piles in front of a bank."""
    for _ in range(plan.integer(0, 8)):
        position, wide = line.at(plan.uniform(*extent_m), -plan.uniform(1, 5)), plan.log_uniform(0.25, 0.8)
        if plan.reserve(position, wide):
            plan.add_fixed("pile", position, (wide, wide, plan.uniform(1, 4)), reflectivity=plan.log_uniform(0.1, 0.5))
