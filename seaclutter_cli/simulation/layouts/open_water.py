"""Layouts of open water: separate objects."""

import numpy as np

from seaclutter_cli.simulation.layouts.plan import Line, Plan, shore
from seaclutter_cli.simulation.marine.scene import Scene

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
        plan.add_boat(
            kinds, plan.position_around(14, 150, even=True), wind + spread * float(plan.rng.standard_normal())
        )
    plan.scatter(_SMALL, plan.integer(0, 3), 12, 80)
    return plan.scene("An anchorage with many vessels.", speed_ms=plan.uniform(0, 3), direction_deg=wind + 180)


def fairway(plan: Plan) -> Scene:
    """Return a fairway between two rows of buoys, with traffic along it."""
    lane, step, side = plan.uniform(-15, 15), plan.log_uniform(15, 60), plan.log_uniform(12, 70)
    cos, sin = np.cos(np.radians(lane)), np.sin(np.radians(lane))

    def at(along: float, across: float) -> tuple[float, float]:
        return along * float(cos) - across * float(sin), along * float(sin) + across * float(cos)

    middle = plan.uniform(-0.3, 0.3) * side
    for along in np.arange(-150, 150, step) + plan.uniform(0, step):
        for sign in (-0.5, 0.5):
            plan.add_buoy(at(float(along) + plan.uniform(-3, 3), sign * side + middle + plan.uniform(-2, 2)))
    for _ in range(plan.integer(0, 6)):
        position = at(plan.uniform(-120, 120), plan.uniform(-0.4, 0.4) * side + middle)
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
    return plan.scene(
        "A rough sea full of clutter.",
        speed_ms=plan.uniform(0, 10),
        sea_state=plan.uniform(3.2, 5.5),
        reflectivity=plan.log_uniform(0.002, 0.015),
    )


def pile_field(plan: Plan) -> Scene:
    """Return a grid of piles, as in a wind farm, a fish farm or a mooring field."""
    step, rotation = plan.log_uniform(14, 45), plan.uniform(0, 90)
    wide, high = plan.log_uniform(0.3, 3.0), plan.log_uniform(1.0, 9.0)
    cos, sin = np.cos(np.radians(rotation)), np.sin(np.radians(rotation))
    shift = np.array([plan.uniform(0, step), plan.uniform(0, step)])
    for cell in np.ndindex(9, 9):
        x, y = (np.array(cell) - 4.0) * step + shift + plan.rng.normal(0, 0.05 * step, 2)
        position = float(cos * x - sin * y), float(sin * x + cos * y)
        if plan.bernoulli(0.8) and plan.reserve(position, wide):
            plan.add("pile", position, (wide, wide, high), reflectivity=plan.log_uniform(0.08, 0.6), wave_response=0.0)
    plan.scatter(_SMALL, plan.integer(0, 5), 10, 90)
    return plan.scene("A grid of piles in open sea.", speed_ms=plan.uniform(0, 5))
