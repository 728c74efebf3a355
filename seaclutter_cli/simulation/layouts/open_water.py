"""Open water: separate objects."""

import numpy as np

from seaclutter_cli.simulation.layouts.plan import Plan
from seaclutter_cli.simulation.layouts.shore import Line, shore
from seaclutter_cli.simulation.marine.scene import Scene

_SMALL = ("speedboat", "sailing_boat", "kayak")
_ALL = (*_SMALL, "cruise_ship", "barge", "cargo_ship")


def open_sea(rng: np.random.Generator) -> Scene:
    """Make a wide sea with a few vessels and buoys."""
    plan = Plan(rng)
    plan.scatter(_ALL, plan.count(0, 6), 10, 140)
    for _ in range(plan.count(0, 5)):
        plan.buoy(plan.around(8, 80))
    return plan.scene("Open sea with few vessels and buoys.", speed_ms=plan.uniform(0, 9))


def anchorage(rng: np.random.Generator) -> Scene:
    """Make an anchorage: many vessels at anchor, all with their bows about in the wind."""
    plan = Plan(rng)
    wind, turning = plan.uniform(-180, 180), plan.uniform(3, 25)
    kinds = _ALL if plan.chance(0.6) else ("sailing_boat", "speedboat", "cruise_ship")
    for _ in range(plan.count(10, 45)):
        plan.afloat(kinds, plan.around(14, 150, even=True), wind + turning * float(rng.standard_normal()))
    plan.scatter(_SMALL, plan.count(0, 3), 12, 80)
    return plan.scene("An anchorage: many separate vessels.", speed_ms=plan.uniform(0, 3), direction_deg=wind + 180)


def fairway(rng: np.random.Generator) -> Scene:
    """Make a fairway between two rows of buoys, with traffic along it."""
    plan = Plan(rng)
    lane, step, side = plan.uniform(-15, 15), plan.log(15, 60), plan.log(12, 70)
    cos, sin = np.cos(np.radians(lane)), np.sin(np.radians(lane))

    def at(along: float, aside: float) -> tuple[float, float]:
        return along * float(cos) - aside * float(sin), along * float(sin) + aside * float(cos)

    middle = plan.uniform(-0.3, 0.3) * side
    for along in np.arange(-150, 150, step) + plan.uniform(0, step):
        for sign in (-0.5, 0.5):
            plan.buoy(at(float(along) + plan.uniform(-3, 3), sign * side + middle + plan.uniform(-2, 2)))
    for _ in range(plan.count(0, 6)):
        place = at(plan.uniform(-120, 120), plan.uniform(-0.4, 0.4) * side + middle)
        plan.afloat(_ALL, place, lane + 180 * plan.count(0, 1), speed_ms=plan.uniform(0.5, 6))
    return plan.scene("A fairway between rows of buoys.", speed_ms=plan.uniform(1, 8))


def regatta(rng: np.random.Generator) -> Scene:
    """Make a regatta: many small sailing boats close to each other, on one tack or the other."""
    plan = Plan(rng)
    wind, longest = plan.uniform(-180, 180), plan.uniform(5.5, 12)
    nearest, farthest = plan.uniform(10, 25), plan.uniform(50, 130)
    for _ in range(plan.count(12, 50)):
        tack = 45 if plan.chance(0.5) else -45
        heading, speed = wind + tack + plan.uniform(-8, 8), plan.uniform(0.5, 3.5)
        place = plan.around(nearest, farthest, even=True)
        plan.afloat(["sailing_boat"], place, heading, speed_ms=speed, longest_m=longest)
    for _ in range(plan.count(1, 4)):
        plan.buoy(plan.around(10, 90))
    return plan.scene("A regatta: many small sailing boats.", speed_ms=plan.uniform(0, 5))


def coast(rng: np.random.Generator) -> Scene:
    """Make open water off a coast on one side, farther away than where facades count."""
    plan = Plan(rng)
    away, bearing = plan.log(68, 115), plan.uniform(-180, 180)
    wiggle, wave = plan.uniform(0, 7), plan.log(40, 120)
    line = Line(away, bearing - 90, wiggle=lambda along: wiggle * float(np.sin(along / wave * 2 * np.pi)))
    kind = "bank" if plan.chance(0.7) else "quay_wall"
    shore(plan, line, (-140, 140), kind, plan.log(2.0, 9.0), houses=plan.uniform(0, 0.5))
    plan.scatter(_ALL, plan.count(0, 7), 10, 70)
    return plan.scene("Open water off a coast.", speed_ms=plan.uniform(0, 8))


def rough_sea(rng: np.random.Generator) -> Scene:
    """Make a rough sea full of clutter, with little else."""
    plan = Plan(rng)
    plan.scatter(_ALL, plan.count(0, 4), 12, 120, moving=0.8)
    for _ in range(plan.count(0, 3)):
        plan.buoy(plan.around(8, 60))
    return plan.scene(
        "A rough sea full of clutter.",
        speed_ms=plan.uniform(0, 10),
        sea_state=plan.uniform(3.2, 5.5),
        reflectivity=plan.log(0.002, 0.015),
    )


def pile_field(rng: np.random.Generator) -> Scene:
    """Make a field of piles or mooring buoys in a grid, as of a wind farm, a fish farm or moorings."""
    plan = Plan(rng)
    step, turned = plan.log(14, 45), plan.uniform(0, 90)
    wide, high = plan.log(0.3, 3.0), plan.log(1.0, 9.0)
    cos, sin = np.cos(np.radians(turned)), np.sin(np.radians(turned))
    shift = np.array([plan.uniform(0, step), plan.uniform(0, step)])
    for cell in np.ndindex(9, 9):
        x, y = (np.array(cell) - 4.0) * step + shift + rng.normal(0, 0.05 * step, 2)
        place = float(cos * x - sin * y), float(sin * x + cos * y)
        if plan.chance(0.8) and plan.claim(place, wide):
            plan.add("pile", place, (wide, wide, high), reflectivity=plan.log(0.08, 0.6), wave_response=0.0)
    plan.scatter(_SMALL, plan.count(0, 5), 10, 90)
    return plan.scene("Piles in the open sea.", speed_ms=plan.uniform(0, 5))
