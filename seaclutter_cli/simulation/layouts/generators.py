"""Generators of random scenes: open water with separate objects, confined water with facades on two sides, plantations.

Plantations are as in [Bi]: rows of trees, measured by a solid-state lidar on a vehicle between the rows.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seaclutter_cli.simulation.layouts.plan import Extent, Line, Plan, moor, rotated, shore
from seaclutter_cli.simulation.lidar import NoiseParams
from seaclutter_cli.simulation.marine.scene import RecordingParams, Scene, VesselParams
from seaclutter_cli.simulation.marine.terrain import GroundParams

_SMALL = ("speedboat", "sailing_boat", "kayak")
_ALL = (*_SMALL, "cruise_ship", "barge", "cargo_ship")


def open_sea(plan: Plan) -> Scene:
    """Return open sea with a few vessels and buoys."""
    plan.scatter(_ALL, plan.integer(0, 6), 10, 140)
    for _ in range(plan.integer(0, 5)):
        plan.add_buoy(plan.position_around(8, 80))
    return plan.scene("Open sea with a few vessels and buoys.", speed_ms=plan.uniform(0, 9))


def anchorage(plan: Plan) -> Scene:
    """Return an anchorage with many vessels, most of them heading into the wind."""
    wind, spread = plan.uniform(-180, 180), plan.uniform(3, 25)
    kinds = _ALL if plan.bernoulli(0.6) else ("sailing_boat", "speedboat", "cruise_ship")
    for _ in range(plan.integer(10, 45)):
        position = plan.position_around(14, 150, even=True)
        plan.add_boat(kinds, position, wind + spread * float(plan.rng.standard_normal()))
    plan.scatter(_SMALL, plan.integer(0, 3), 12, 80)
    return plan.scene("An anchorage with many vessels.", speed_ms=plan.uniform(0, 3), direction_deg=wind + 180)


def fairway(plan: Plan) -> Scene:
    """Return a fairway between two rows of buoys, with traffic along it."""
    lane, step, side = plan.uniform(-15, 15), plan.log_uniform(15, 60), plan.log_uniform(12, 70)
    middle = plan.uniform(-0.3, 0.3) * side
    for along in np.arange(-150, 150, step) + plan.uniform(0, step):
        for sign in (-0.5, 0.5):
            x, y = float(along) + plan.uniform(-3, 3), sign * side + middle + plan.uniform(-2, 2)
            plan.add_buoy(rotated(x, y, lane))
    for _ in range(plan.integer(0, 6)):
        position = rotated(plan.uniform(-120, 120), plan.uniform(-0.4, 0.4) * side + middle, lane)
        plan.add_boat(_ALL, position, lane + 180 * plan.integer(0, 1), speed_ms=plan.uniform(0.5, 6))
    return plan.scene("A fairway between rows of buoys.", speed_ms=plan.uniform(1, 8))


def regatta(plan: Plan) -> Scene:
    """Return a regatta: many small sailing boats close together, each on one of two tacks."""
    wind, longest = plan.uniform(-180, 180), plan.uniform(5.5, 12)
    nearest, farthest = plan.uniform(10, 25), plan.uniform(50, 130)
    for _ in range(plan.integer(12, 50)):
        tack = 45 if plan.bernoulli(0.5) else -45
        heading, speed = wind + tack + plan.uniform(-8, 8), plan.uniform(0.5, 3.5)
        position = plan.position_around(nearest, farthest, even=True)
        plan.add_boat(["sailing_boat"], position, heading, speed_ms=speed, longest_m=longest)
    for _ in range(plan.integer(1, 4)):
        plan.add_buoy(plan.position_around(10, 90))
    return plan.scene("A regatta of many small sailing boats.", speed_ms=plan.uniform(0, 5))


def coast(plan: Plan) -> Scene:
    """Return open water with a coast on one side, beyond the range at which facades count."""
    distance, bearing = plan.log_uniform(68, 115), plan.uniform(-180, 180)
    wiggle, wave = plan.uniform(0, 7), plan.log_uniform(40, 120)
    line = Line(distance, bearing - 90, wiggle=lambda along: wiggle * float(np.sin(along / wave * 2 * np.pi)))
    kind = "bank" if plan.bernoulli(0.7) else "quay_wall"
    shore(plan, line, (-140, 140), kind, plan.log_uniform(2.0, 9.0), houses=plan.uniform(0, 0.5))
    plan.scatter(_ALL, plan.integer(0, 7), 10, 70)
    return plan.scene("Open water off a coast.", speed_ms=plan.uniform(0, 8))


def rough_sea(plan: Plan) -> Scene:
    """Return a rough sea full of clutter, with few objects."""
    plan.scatter(_ALL, plan.integer(0, 4), 12, 120, moving=0.8)
    for _ in range(plan.integer(0, 3)):
        plan.add_buoy(plan.position_around(8, 60))
    speed, sea_state, reflectivity = plan.uniform(0, 10), plan.uniform(3.2, 5.5), plan.log_uniform(0.002, 0.015)
    about = "A rough sea full of clutter."
    return plan.scene(about, speed_ms=speed, sea_state=sea_state, reflectivity=reflectivity)


def pile_field(plan: Plan) -> Scene:
    """Return a grid of piles, as in a wind farm, a fish farm or a mooring field."""
    step, rotation = plan.log_uniform(14, 45), plan.uniform(0, 90)
    wide, high = plan.log_uniform(0.3, 3.0), plan.log_uniform(1.0, 9.0)
    shift = np.array([plan.uniform(0, step), plan.uniform(0, step)])
    for cell in np.ndindex(9, 9):
        x, y = (np.array(cell) - 4.0) * step + shift + plan.rng.normal(0, 0.05 * step, 2)
        position = rotated(x, y, rotation)
        if plan.bernoulli(0.8) and plan.reserve(position, wide):
            plan.add("pile", position, (wide, wide, high), reflectivity=plan.log_uniform(0.08, 0.6), wave_response=0.0)
    plan.scatter(_SMALL, plan.integer(0, 5), 10, 90)
    return plan.scene("A grid of piles in open sea.", speed_ms=plan.uniform(0, 5))


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


def _quay(plan: Plan, line: Line, extent_m: Extent, height_m: float) -> None:
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
        size = 2 * lane, 2, plan.uniform(1, 3)
        plan.add_fixed("quay_wall", position, size, 90, reflectivity=plan.log_uniform(0.05, 0.5))
    heading = plan.uniform(-15, 15) + 180 * plan.integer(0, 1) if plan.bernoulli(0.8) else plan.uniform(-180, 180)
    return plan.scene("Boats side by side along jetties.", heading_deg=heading, speed_ms=plan.uniform(0, 1.2))


def _row(plan: Plan, line: Line, extent_m: Extent, berths: tuple[float, float, int], kinds: tuple[str, ...]) -> None:
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
        along = plan.uniform(15, 60) * (1 if plan.bernoulli(0.5) else -1)
        for offset in (-0.25, 0.25):
            position, wide = middle.at(along, offset * width), plan.log_uniform(0.8, 2.5)
            if plan.reserve(position, 3.0):
                size = (plan.uniform(2, 6), wide, plan.uniform(6, 10))
                plan.add_fixed("building", position, size, reflectivity=plan.log_uniform(0.1, 0.5))
    for _ in range(plan.integer(0, 2)):
        position = middle.at(plan.uniform(-80, 80), plan.uniform(-0.25, 0.25) * width)
        plan.add_boat(_SMALL, position, 180 * plan.integer(0, 1), speed_ms=plan.uniform(0, 3), longest_m=10)
    heading = plan.uniform(-12, 12) + 180 * plan.integer(0, 1) if plan.bernoulli(0.85) else plan.uniform(-180, 180)
    speed = plan.uniform(0, 4) if abs(np.cos(np.radians(heading))) > 0.9 else 0.0
    return plan.scene("A narrow channel.", heading_deg=heading, speed_ms=speed)


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
        for _ in range(plan.integer(0, 8)):
            position, wide = line.at(plan.uniform(*ends), -plan.uniform(1, 5)), plan.log_uniform(0.25, 0.8)
            if plan.reserve(position, wide):
                size = (wide, wide, plan.uniform(1, 4))
                plan.add_fixed("pile", position, size, reflectivity=plan.log_uniform(0.1, 0.5))
    heading = plan.uniform(-20, 20) + 180 * plan.integer(0, 1)
    return plan.scene("A river between banks.", heading_deg=heading, speed_ms=plan.uniform(0, 4))


def _uneven(plan: Plan, height_m: float) -> Callable[[float], float]:
    """Return a random offset of a natural shore as a function of the distance along the axis."""
    waves, phases = plan.rng.uniform(20, 90, 3), plan.rng.uniform(0, 2 * np.pi, 3)
    return lambda along: height_m * float(np.sin(2 * np.pi * along / waves + phases).sum())


OPEN_BASES = open_sea, anchorage, fairway, pile_field
CONFINED_BASES = harbour_basin, moored_rows, narrow_channel, lock, river
"""Generators of the objects with which worlds of wide physics begin."""

_REACH_M = 30.0


@dataclass(frozen=True)
class Trees:
    """Trees of one kind: class in the labels, shape of the labelled part, minima and maxima of distances and sizes.

    Distances are those between rows, and between trees in a row. ``reach_m`` is the distance to either side up to which
    there are rows; farther rows would be hidden by dense ones. The crown above the labelled part, if its width is not
    0, is an area to ignore.
    """

    kind: str
    shape: str
    row_m: tuple[float, float]
    step_m: tuple[float, float]
    width_m: tuple[float, float]
    height_m: tuple[float, float]
    reach_m: float
    crown_m: float
    description: str


APPLE = Trees(
    *("apple tree", "apple_tree", (2.6, 3.8), (0.8, 1.2), (0.8, 1.2), (2.2, 3.2), 9.0, 0.0),
    "Dense rows of dwarf apple trees.",
)
POPLAR = Trees("poplar", "trunk", (2.6, 3.6), (2.6, 3.6), (0.16, 0.32), (2.4, 3.2), 16.0, 1.8, "Well-spaced poplars.")
WILLOW = Trees(
    *("willow", "trunk", (3.0, 4.5), (3.0, 4.5), (0.08, 0.18), (1.9, 2.6), 16.0, 2.6),
    "Well-spaced willows with thin stems.",
)


def plantation(trees: Trees, plan: Plan) -> Scene:
    """Return rows of trees of one kind."""
    row, step, missing = plan.uniform(*trees.row_m), plan.uniform(*trees.step_m), plan.uniform(0, 0.08)
    rotation = plan.uniform(-4, 4) if trees is APPLE else plan.uniform(-30, 30)
    shift = plan.uniform(-0.15, 0.15) * row
    ends = plan.uniform(12, _REACH_M + 4) if plan.bernoulli(0.3) else _REACH_M + 4
    rows = np.arange(-7.5, 8) * row
    for across in rows[np.abs(rows) <= trees.reach_m]:
        for along in np.arange(-2.0, ends, step) + plan.uniform(0, step):
            x, y = float(along) + plan.uniform(-0.1, 0.1), float(across) + shift + plan.uniform(-0.08, 0.08)
            position = rotated(x, y, rotation)
            if not plan.bernoulli(missing) and np.hypot(*position) > 1.2:
                _tree(plan, trees, position, step)
    return _scene(plan, trees.description)


def _tree(plan: Plan, trees: Trees, position: tuple[float, float], step_m: float) -> None:
    width, height, reflectivity = plan.uniform(*trees.width_m), plan.uniform(*trees.height_m), plan.uniform(0.3, 0.65)
    length = max(width, 1.15 * step_m) if trees is APPLE else width
    heading = 180.0 * plan.integer(0, 1) if trees is APPLE else plan.uniform(-180, 180)
    still = {"class_name": trees.kind, "reflectivity": reflectivity, "wave_response": 0.0}
    plan.add(trees.shape, position, (length, width, height), heading, **still)
    if trees.crown_m:
        crown = trees.crown_m * plan.uniform(0.8, 1.2)
        size = crown, crown, height + plan.uniform(3, 6)
        plan.add_fixed("crown", position, size, class_name="crown", reflectivity=0.3)


def _scene(plan: Plan, description: str) -> Scene:
    """Return the trees added so far as a scene, with a CE30-D on a small vehicle on uneven ground."""
    recording = RecordingParams(description=description, lidar="CE30-D", frames=50, seed=int(plan.rng.integers(2**31)))
    ground = GroundParams(roughness_m=plan.uniform(0.0, 0.03), reflectivity=plan.uniform(0.1, 0.4))
    noise = NoiseParams(
        false_return_share=plan.uniform(0.02, 0.3),
        false_return_reach_m=plan.log_uniform(0.3, 1.2),
        mixed_pixel_share=plan.uniform(0.2, 0.8),
    )
    vehicle = VesselParams(
        path=((0.0, 0.0), (1000.0, plan.uniform(-50, 50))),
        speed_ms=plan.uniform(0.2, 1.5),
        length_m=1.5,
        width_m=1.0,
        lidar_height_m=plan.uniform(0.7, 1.4),
        lidar_forward_m=0.85,
        wave_response=plan.uniform(0.1, 0.6),
    )
    return Scene(recording, ground, vehicle, tuple(plan.objects), noise)
