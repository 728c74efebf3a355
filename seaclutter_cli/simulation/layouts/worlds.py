"""Worlds of wide physics: every parameter of water, weather, lidar and own ship is drawn from a range."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from seaclutter_cli.simulation.layouts.confined_water import harbour_basin, lock, moored_rows, narrow_channel, river
from seaclutter_cli.simulation.layouts.open_water import anchorage, fairway, open_sea, pile_field
from seaclutter_cli.simulation.layouts.plan import Plan, Position
from seaclutter_cli.simulation.lidar.models import LIDARS, NoiseParams
from seaclutter_cli.simulation.marine.physics import PhysicsParams
from seaclutter_cli.simulation.marine.scene import Scene, VesselParams
from seaclutter_cli.simulation.marine.sea import SeaParams

SECONDS = 5.0
_OTHERS = 0.06
_LEG_RAD = float(np.radians(8))


@dataclass(frozen=True)
class Between:
    """A range of numbers, drawn uniformly, or on a logarithmic scale."""

    low: float
    high: float
    logarithmic: bool = False

    def draw(self, rng: np.random.Generator) -> float:
        """Return a random number of the range, with four digits."""
        if self.logarithmic:
            return float(f"{np.exp(rng.uniform(np.log(self.low), np.log(self.high))):.4g}")
        return float(f"{rng.uniform(self.low, self.high):.4g}")


@dataclass(frozen=True)
class OneOf:
    """Values of which each is drawn as often."""

    values: tuple[Any, ...]

    def draw(self, rng: np.random.Generator) -> Any:
        """Return one of the values."""
        return self.values[int(rng.integers(len(self.values)))]


Range = Between | OneOf


def log(low: float, high: float) -> Between:
    """Return a range on a logarithmic scale."""
    return Between(low, high, logarithmic=True)


_BEAMS = {count: tuple(name for name, one in LIDARS.items() if len(one.rings) == count) for count in (16, 32, 64, 128)}

RANGES: Mapping[str, Range] = {
    "lidar": OneOf(_BEAMS[32] + _BEAMS[64]),
    "rate_hz": OneOf((5.0, 10.0, 10.0, 20.0)),
    # sea
    "sea_state": Between(0.0, 2.5),
    "peak_enhancement": Between(1.0, 5.0),
    "direction_deg": Between(-180, 180),
    "spikiness": log(0.05, 1.0),
    "foam_reflectivity": Between(0.1, 0.4),
    "foam_lifetime_s": log(2.0, 20.0),
    "visibility_km": log(2.0, 30.0),
    # water and wind
    "wind_ms": Between(0.0, 9.0),
    "wind_deg": Between(-180, 180),
    "shelter": log(0.05, 1.0),
    "backscatter": log(0.0005, 0.3),
    "patch_m": log(0.3, 1.5),
    "patch_s": log(0.1, 1.0),
    "whitecap_s": log(1.0, 6.0),
    "wake_m": Between(50, 150),
    "wake_height_m": Between(0.03, 0.16),
    "wake_cover": Between(0.02, 0.1),
    "wake_reflectivity": log(0.01, 0.06),
    # receiver
    "least_reflectivity": log(0.0005, 0.005),
    "intensity_offset": OneOf((0.0, 0.0, 0.0, 4.0, 10.0)),
    "intensity_exponent": OneOf((1.0, 1.0, 1.0, 0.7, 0.5)),
    "false_return_share": OneOf((0.0, 0.0, 0.002)),
    "mixed_pixel_share": Between(0.0, 0.3),
    "dropout": log(0.003, 0.05),
    # own ship
    "lidar_height_m": log(1.0, 8.0),
    "length_m": log(4.0, 20.0),
    "wave_response": Between(0.2, 0.9),
    "speed_ms": Between(0.0, 7.0),
    "turn_deg_s": Between(-2.0, 2.0),
    "roll_deg": Between(0.0, 1.5),
    "roll_s": Between(2.5, 7.0),
    "pitch_deg": Between(0.0, 0.7),
    # objects
    "wake_speed_ms": Between(4.0, 11.0),
    "small_number": Between(3, 8),
    "retro_number": Between(1, 4),
    "bloom_deg": log(0.2, 0.8),
}
"""Range of each parameter outside the families that change it."""


@dataclass(frozen=True)
class Family:
    """What a world can be an example of: ranges that replace those of `RANGES`, base layouts, and objects to add."""

    ranges: Mapping[str, Range]
    layouts: Sequence[Callable[[np.random.Generator], Scene]] = ()
    add: Callable[[Plan, Mapping[str, Any]], None] | None = None


def _anywhere(plan: Plan, low_m: float, high_m: float, radius_m: float) -> Position | None:
    """Return a free position around own ship, or None if there is none."""
    for _ in range(20):
        position = plan.position_around(low_m, high_m)
        if plan.reserve(position, radius_m):
            return position
    return None


def _add_wakes(plan: Plan, drawn: Mapping[str, Any]) -> None:
    """Add vessels under way that pass close by."""
    for _ in range(plan.integer(1, 3)):
        shape = plan.choice(("speedboat", "rhib", "cruise_ship", "barge"))
        size = _rhib(plan) if shape == "rhib" else plan.boat_size(shape, 40.0)
        distance, bearing = plan.log_uniform(12 + size[0] / 2, 60), plan.uniform(-np.pi, np.pi)
        position = distance * float(np.cos(bearing)), distance * float(np.sin(bearing))
        speed = drawn["wake_speed_ms"] * plan.uniform(0.5, 1.0)
        # Across the line of sight, so that they do not meet own ship.
        heading = float(np.degrees(bearing)) + 90 * (1 if plan.bernoulli(0.5) else -1) + plan.uniform(-35, 35)
        if plan.reserve(position, size[0] / 2):
            plan.add(shape, position, size, heading, speed_ms=round(speed, 2), reflectivity=plan.log_uniform(0.05, 0.8))


def _rhib(plan: Plan) -> tuple[float, float, float]:
    length = plan.uniform(4.5, 9.0)
    return length, length * 0.36, plan.uniform(1.3, 1.9)


def _add_small(plan: Plan, drawn: Mapping[str, Any]) -> None:
    """Add small buoys, swimmers, kayaks, floating logs, and RHIBs far away."""
    for _ in range(int(drawn["small_number"])):
        kind, wide = plan.choice(("buoy", "swimmer", "kayak", "log", "rhib")), plan.log_uniform(0.3, 0.6)
        far = 70 if kind == "rhib" else 30
        position = _anywhere(plan, 40 if kind == "rhib" else 6, far, 1.5)
        sizes = {
            "buoy": (wide, wide, wide * plan.uniform(0.8, 1.6)),
            "swimmer": (0.5, 0.5, plan.uniform(0.2, 0.4)),
            "kayak": plan.boat_size("kayak"),
            "log": (plan.uniform(1, 4), wide / 2, plan.uniform(0.12, 0.3)),
            "rhib": _rhib(plan),
        }
        if position:
            more = {"class_name": kind, "reflectivity": plan.log_uniform(0.08, 0.8)}
            plan.add("pontoon" if kind == "log" else kind, position, sizes[kind], plan.uniform(-180, 180), **more)


def _add_targets(plan: Plan) -> None:
    """Add targets of any kind within the range of few beams, so that every world has something to lose."""
    for _ in range(plan.integer(1, 3)):
        kind = plan.choice(("buoy", "speedboat", "sailing_boat", "kayak", "rhib"))
        wide = plan.log_uniform(0.5, 2.0)
        size = (wide, wide, 1.5 * wide) if kind == "buoy" else _rhib(plan) if kind == "rhib" else plan.boat_size(kind)
        if position := _anywhere(plan, 8, 45, size[0] / 2):
            speed = plan.uniform(0.5, 4) if kind != "buoy" and plan.bernoulli(0.5) else 0.0
            # Away from own ship.
            heading = float(np.degrees(np.arctan2(position[1], position[0]))) + plan.uniform(-100, 100)
            plan.add(kind, position, size, heading, speed_ms=speed, reflectivity=plan.log_uniform(0.06, 0.8))


def _add_birds(plan: Plan, drawn: Mapping[str, Any]) -> None:
    """Add birds in flight, which are to be ignored."""
    del drawn
    for _ in range(plan.integer(3, 12)):
        size = plan.uniform(0.3, 0.6), plan.uniform(0.5, 1.4), plan.log_uniform(0.8, 8.0)
        more = {"ignore": True, "reflectivity": plan.uniform(0.1, 0.5), "wave_response": 0.0}
        plan.add(
            "bird", plan.position_around(5, 50), size, plan.uniform(-180, 180), speed_ms=plan.uniform(5, 14), **more
        )


def _add_bridge(plan: Plan, drawn: Mapping[str, Any]) -> None:
    """Add a bridge ahead or overhead, with its piers."""
    ahead, high = plan.uniform(-15, 50), max(plan.uniform(3.5, 12), drawn["lidar_height_m"] + 2)
    wide, angle = plan.uniform(4, 20), plan.uniform(-20, 20)
    fixed = {"reflectivity": plan.log_uniform(0.1, 0.5)}
    plan.add_fixed("bridge", (ahead, 0.0), (wide, 160.0, high / 0.8), angle, **fixed)
    for side in (-1, 1):
        across = side * plan.uniform(9, 25)
        plan.add_fixed(
            "quay_wall", (ahead - across * np.tan(np.radians(angle)), across), (wide, 2.0, high), angle, **fixed
        )


def _add_quay(plan: Plan, drawn: Mapping[str, Any]) -> None:
    """Add a quay on one side, or both, which passes close by."""
    del drawn
    for side in (-1, 1)[: plan.integer(1, 2)]:
        distance, high = plan.log_uniform(7, 30), plan.log_uniform(0.6, 5)
        fixed = {"reflectivity": plan.log_uniform(0.05, 0.6)}
        plan.add_fixed("quay_wall", (plan.uniform(-20, 20), side * (distance + 1.5)), (200.0, 3.0, high), 0.0, **fixed)
        for _ in range(plan.integer(0, 5)):
            spot = plan.uniform(-40, 60), side * (distance - 0.4)
            plan.add_fixed("pile", spot, (0.4, 0.4, high + plan.uniform(0.2, 2)), **fixed)


def _add_reeds(plan: Plan, drawn: Mapping[str, Any]) -> None:
    """Add clumps of reeds along a bank."""
    del drawn
    side, distance = (1 if plan.bernoulli(0.5) else -1), plan.log_uniform(8, 30)
    for along in np.arange(-50, 60, 6.0).tolist():
        if plan.bernoulli(0.7):
            spot = along + plan.uniform(-2, 2), side * (distance + plan.uniform(0, 2))
            size = plan.uniform(4, 8), plan.uniform(1.5, 3), plan.uniform(1.2, 2.8)
            plan.add_fixed("reeds", spot, size, reflectivity=plan.uniform(0.2, 0.6))
    plan.add_fixed(
        "bank", (0.0, side * (distance + 6)), (140.0, 6.0, 1.5), 0.0 if side > 0 else 180.0, reflectivity=0.3
    )


_OPEN = open_sea, anchorage, fairway, pile_field
_CONFINED = harbour_basin, moored_rows, narrow_channel, lock, river
_SHELTERED: Mapping[str, Range] = {
    "sea_state": Between(0.0, 0.8),
    "speed_ms": Between(0.0, 2.5),
    "shelter": log(0.005, 0.5),
}

FAMILIES: Mapping[str, Family] = {
    "open": Family({}),
    "wakes": Family(
        {"wake_cover": Between(0.1, 0.7), "wake_reflectivity": log(0.02, 0.15), "sea_state": Between(0, 1.8)},
        add=_add_wakes,
    ),
    "wash": Family(
        {
            **_SHELTERED,
            "wash_m": Between(3, 10),
            "wake_cover": Between(0.1, 0.5),
            "wake_reflectivity": log(0.01, 0.08),
            "speed_ms": Between(0, 1),
        }
    ),
    "mirrors": Family(
        {**_SHELTERED, "sea_state": Between(0, 0.4), "shelter": log(0.001, 0.05), "wind_ms": Between(0, 3)}, _CONFINED
    ),
    "rain": Family({"rain_mm_h": log(2, 60), "drop_reflectivity": log(0.005, 0.05), "visibility_km": log(1, 8)}),
    "fog": Family({"visibility_km": log(0.04, 0.5)}),
    "spray": Family(
        {"spray": log(1, 12), "wind_ms": Between(7, 18), "sea_state": Between(1.5, 4), "speed_ms": Between(4, 11)}
    ),
    "glint": Family(
        {
            "spikiness": log(0.03, 0.15),
            "backscatter": log(0.05, 0.5),
            "patch_s": log(0.2, 2),
            "sea_state": Between(1, 3),
        }
    ),
    "rough": Family({"sea_state": Between(3, 5), "wind_ms": Between(8, 18), "shelter": OneOf((1.0,))}),
    "turning": Family({"turn_deg_s": OneOf((-20, -15, -10, 10, 15, 20)), "speed_ms": Between(0.3, 6)}),
    "rolling": Family({"roll_deg": Between(5, 10), "pitch_deg": Between(0.5, 3), "sea_state": Between(1, 3)}),
    "small targets": Family({"sea_state": Between(0, 1.5)}, add=_add_small),
    "harbour": Family(_SHELTERED, _CONFINED),
    "passing quay": Family({**_SHELTERED, "speed_ms": Between(2, 7)}, add=_add_quay),
    "bridge": Family({**_SHELTERED, "speed_ms": Between(1, 5)}, add=_add_bridge),
    "reeds": Family(_SHELTERED, add=_add_reeds),
    "birds": Family({}, add=_add_birds),
    "blooming": Family({"blooming": OneOf((True,))}),
    "low lidar": Family({"lidar_height_m": Between(1.0, 1.5), "length_m": log(3, 6)}),
    "high lidar": Family({"lidar_height_m": Between(5, 8), "length_m": log(12, 20)}),
    "few beams": Family({"lidar": OneOf(_BEAMS[16])}),
    "many beams": Family({"lidar": OneOf(_BEAMS[128])}),
}
"""Families of worlds by name; to add one, add a line here."""


def draw_world(seed: int, family: str | None = None) -> Scene:
    """Return a world: an example of a family, or of one at random, and by chance of others, too.

    The scene names all of them in ``physics.families``.
    """
    rng = np.random.default_rng([seed, 7])
    names = list(FAMILIES)
    main = names[int(rng.integers(len(names)))]
    others = [name for name in names[1:] if rng.random() < _OTHERS]
    chosen = [family or main]
    for name in others:
        # Families that change the same parameters exclude each other, so that all that are named are true.
        if all(FAMILIES[name].ranges.keys().isdisjoint(FAMILIES[one].ranges) and name != one for one in chosen):
            chosen.append(name)
    layouts = next((FAMILIES[name].layouts for name in chosen if FAMILIES[name].layouts), _OPEN)
    base = layouts[int(rng.integers(len(layouts)))](rng)
    drawn = _drawn(chosen, rng)
    plan = Plan(rng)
    if "harbour" not in chosen and layouts is _OPEN and rng.random() < 0.5:
        base = replace(base, objects=base.objects[: int(rng.integers(1, 5))])
    plan.extend(base.objects)
    _add_targets(plan)
    for name in chosen:
        if (add := FAMILIES[name].add) is not None:
            add(plan, drawn)
    scene = replace(base, objects=tuple(plan.objects))
    return _with(scene, drawn, tuple(chosen), f"A world of wide physics: {', '.join(chosen)}.", rng)


def with_wide_physics(scene: Scene, seed: int) -> Scene:
    """Return a scene with its objects in water, weather and by a lidar that are drawn from all ranges."""
    rng = np.random.default_rng([seed, 8])
    return _with(scene, _drawn([], rng), (), scene.recording.description, rng)


def _drawn(families: Sequence[str], rng: np.random.Generator) -> dict[str, Any]:
    """Return a value of each parameter."""
    ranges = dict(RANGES)
    for name in families:
        ranges |= FAMILIES[name].ranges
    return {key: ranges[key].draw(rng) for key in ranges}


def _with(
    scene: Scene, drawn: Mapping[str, Any], families: Sequence[str], about: str, rng: np.random.Generator
) -> Scene:
    """Return a scene with the drawn values."""

    def section(kind: type[Any]) -> dict[str, Any]:
        return {key.name: drawn[key.name] for key in fields(kind) if key.name in drawn}

    targets = [item.track_id for item in scene.objects if not item.ignore]
    retro = rng.permutation(targets)[: int(drawn["retro_number"])].tolist() if drawn.get("blooming") else ()
    physics = PhysicsParams(families=tuple(families), retro_tracks=tuple(retro), **section(PhysicsParams))
    recording = replace(
        scene.recording,
        description=about,
        lidar=drawn["lidar"],
        dropout=drawn["dropout"],
        frames=round(SECONDS * drawn["rate_hz"]),
        seed=int(rng.integers(2**31)),
    )
    noise = NoiseParams(**section(NoiseParams))
    return Scene(recording, SeaParams(**section(SeaParams)), _vessel(scene, drawn), scene.objects, noise, physics)


def _vessel(scene: Scene, drawn: Mapping[str, Any]) -> VesselParams:
    """Return own ship on a path that passes where that of the scene starts, and turns at the drawn rate."""
    length, speed, turn = drawn["length_m"], drawn["speed_ms"], float(np.radians(drawn["turn_deg_s"]))
    start = scene.vessel.track.legs[0]
    step_s = min(SECONDS, _LEG_RAD / abs(turn)) if turn else SECONDS
    steps = np.arange(-2, round(SECONDS / step_s) + 3)  # a heading is that in the middle of a leg
    ways = speed * step_s * np.exp(1j * (start.heading_rad + turn * step_s * (steps + 0.5)))
    path = np.cumsum(np.append(complex(start.x_m, start.y_m) - ways[:2].sum(), ways))
    return VesselParams(
        path=tuple((round(float(one.real), 4), round(float(one.imag), 4)) for one in path),
        speed_ms=speed,
        start_s=round(-2 * step_s, 4),
        length_m=length,
        width_m=round(0.35 * length, 2),
        lidar_height_m=drawn["lidar_height_m"],
        lidar_forward_m=round(0.2 * length, 2),
        wave_response=drawn["wave_response"],
    )
