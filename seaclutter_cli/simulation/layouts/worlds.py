"""Worlds of wide physics: every parameter of water, weather, lidar, own ship and objects is drawn from a range."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Rng
from seaclutter_cli.simulation.layouts.generators import CONFINED_BASES, OPEN_BASES
from seaclutter_cli.simulation.layouts.plan import Plan, Position
from seaclutter_cli.simulation.lidar import LIDARS, NoiseParams
from seaclutter_cli.simulation.marine.motion import Places
from seaclutter_cli.simulation.marine.physics import PhysicsParams
from seaclutter_cli.simulation.marine.scene import RecordingParams, Scene, SceneObjectParams, VesselParams
from seaclutter_cli.simulation.marine.sea import SeaParams

SECONDS = 5.0
_OTHERS = 0.06
_TRIES = 20
_CLEARANCE_M = 0.5
_LEG_RAD = float(np.radians(8))

Range = Callable[[Rng], Any]
"""A random number or choice."""


def between(low: float, high: float) -> Range:
    """Return a range that is drawn from uniformly."""
    return lambda rng: float(f"{rng.uniform(low, high):.4g}")


def log(low: float, high: float) -> Range:
    """Return a range that is drawn from uniformly on a logarithmic scale."""
    return lambda rng: float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")


def one_of(*values: Any) -> Range:
    """Return values that are drawn equally often."""
    return lambda rng: values[int(rng.integers(len(values)))]


_NOTHING, _BRIGHTNESS = one_of(0.0), log(0.06, 0.8)
_BEAMS = {count: tuple(name for name, one in LIDARS.items() if len(one.rings) == count) for count in (16, 32, 64, 128)}

RANGES: Mapping[str, Range] = {
    "lidar": one_of(*_BEAMS[32], *_BEAMS[64]),
    "rate_hz": one_of(5.0, 10.0, 10.0, 20.0),
    # sea
    "sea_state": between(0.0, 2.5),
    "peak_enhancement": between(1.0, 5.0),
    "direction_deg": between(-180, 180),
    "spikiness": log(0.05, 1.0),
    "foam_reflectivity": between(0.1, 0.4),
    "foam_lifetime_s": log(2.0, 20.0),
    "visibility_km": log(2.0, 30.0),
    # water and wind
    "wind_ms": between(0.0, 9.0),
    "wind_deg": between(-180, 180),
    "shelter": log(0.05, 1.0),
    "backscatter": log(0.0005, 0.3),
    "patch_m": log(0.3, 1.5),
    "patch_s": log(0.1, 1.0),
    "whitecap_s": log(1.0, 6.0),
    "wake_m": between(50, 150),
    "wake_height_m": between(0.03, 0.16),
    "wake_cover": between(0.02, 0.1),
    "wake_reflectivity": log(0.01, 0.06),
    # receiver
    "least_reflectivity": log(0.0005, 0.005),
    "intensity_offset": one_of(0.0, 0.0, 0.0, 4.0, 10.0),
    "intensity_exponent": one_of(1.0, 1.0, 1.0, 0.7, 0.5),
    "false_return_share": one_of(0.0, 0.0, 0.002),
    "mixed_pixel_share": between(0.0, 0.3),
    "dropout": log(0.003, 0.05),
    # own ship
    "lidar_height_m": log(1.0, 8.0),
    "length_m": log(4.0, 20.0),
    "wave_response": between(0.2, 0.9),
    "speed_ms": between(0.0, 7.0),
    "turn_deg_s": between(-2.0, 2.0),
    "roll_deg": between(0.0, 1.5),
    "roll_s": between(2.5, 7.0),
    "pitch_deg": between(0.0, 0.7),
    # retro-reflectors
    "retro_number": between(1, 4),
    "bloom_deg": log(0.2, 0.8),
}
"""Range of each parameter outside the families that change it."""


@dataclass(frozen=True)
class Thing:
    """Objects of a shape, in a number, at a distance or in rows, of some sizes and speeds; a name in the labels.

    A distance is from own ship, in any direction; rows are on both sides of its course, at positions along and a
    distance beside it. Sizes are None for the usual ones of a boat. What moves passes, and so does not meet own ship.
    """

    shape: str
    number: Range
    place: Range | tuple[Range, Range]
    size_m: tuple[Range, Range, Range] | None = None
    speed_ms: Range = _NOTHING
    name: str = ""

    def add(self, plan: Plan) -> None:
        """Add the objects to a scene, as far as there is room; land and birds are areas to ignore."""
        rng, ignore = plan.rng, self.shape in _IGNORED
        more: dict[str, Any] = {"class_name": self.name or self.shape.replace("_", " "), "ignore": ignore}
        more |= {"wave_response": 0.0} if ignore else {}
        beside = self.place[1](rng) if isinstance(self.place, tuple) else 0.0
        for number in range(int(self.number(rng))):
            size = tuple(one(rng) for one in self.size_m) if self.size_m else plan.boat_size(self.shape, 40.0)
            more |= {"speed_ms": self.speed_ms(rng), "reflectivity": _BRIGHTNESS(rng)}
            for _ in range(_TRIES):
                position, heading = self._place(rng, beside * (-1) ** number)
                if ignore or plan.reserve(position, size[0] / 2):
                    plan.add(self.shape, position, size, heading, **more)
                    break

    def _place(self, rng: Rng, beside_m: float) -> tuple[Position, float]:
        if isinstance(self.place, tuple):  # land is to the left of an object
            return (self.place[0](rng), beside_m), 0.0 if beside_m >= 0 else 180.0
        bearing = rng.uniform(-np.pi, np.pi)
        distance, across = self.place(rng), rng.choice((-90.0, 90.0)) + rng.uniform(-35.0, 35.0)
        position = distance * float(np.cos(bearing)), distance * float(np.sin(bearing))
        return position, float(np.degrees(bearing) + across)


_IGNORED = ("quay_wall", "pile", "bridge", "reeds", "bank", "bird")
_UNDER_WAY, _NEAR, _CLOSE = one_of(0.0, 0.5, 2.0, 4.0), log(10, 45), log(6, 30)
TARGETS = (
    Thing("buoy", one_of(0, 1), _NEAR, (between(0.5, 2), between(0.5, 2), between(0.7, 3))),
    *(Thing(shape, one_of(0, 1), _NEAR, None, _UNDER_WAY) for shape in ("speedboat", "sailing_boat", "kayak", "rhib")),
)
"""Targets that worlds of all families may have."""

_SHELTERED: Mapping[str, Range] = {
    "sea_state": between(0.0, 0.8),
    "speed_ms": between(0.0, 2.5),
    "shelter": log(0.005, 0.5),
}


@dataclass(frozen=True)
class Family:
    """What a world can be an example of: ranges that replace those of `RANGES`, objects to add, and base layouts."""

    ranges: Mapping[str, Range]
    things: Sequence[Thing] = ()
    layouts: Sequence[Callable[[Plan], Scene]] = ()


FAMILIES: Mapping[str, Family] = {
    "open": Family({}),
    "wakes": Family(
        {"wake_cover": between(0.1, 0.7), "wake_reflectivity": log(0.02, 0.15), "sea_state": between(0, 1.8)},
        [
            Thing(shape, one_of(0, 1, 1), log(20, 60), None, between(2, 11))
            for shape in ("speedboat", "rhib", "cruise_ship", "barge")
        ],
    ),
    "wash": Family(
        {
            **_SHELTERED,
            "wash_m": between(3, 10),
            "wake_cover": between(0.1, 0.5),
            "wake_reflectivity": log(0.01, 0.08),
            "speed_ms": between(0, 1),
        }
    ),
    "mirrors": Family(
        {**_SHELTERED, "sea_state": between(0, 0.4), "shelter": log(0.001, 0.05), "wind_ms": between(0, 3)},
        layouts=CONFINED_BASES,
    ),
    "rain": Family({"rain_mm_h": log(2, 60), "drop_reflectivity": log(0.05, 0.3), "visibility_km": log(1, 8)}),
    "fog": Family({"visibility_km": log(0.04, 0.5)}),
    "spray": Family(
        {"spray": log(3, 30), "wind_ms": between(7, 18), "sea_state": between(1.5, 4), "speed_ms": between(4, 11)}
    ),
    "glint": Family(
        {
            "spikiness": log(0.03, 0.15),
            "backscatter": log(0.05, 0.5),
            "patch_s": log(0.2, 2),
            "sea_state": between(1, 3),
        }
    ),
    "rough": Family({"sea_state": between(3, 5), "wind_ms": between(8, 18), "shelter": one_of(1.0)}),
    "turning": Family({"turn_deg_s": one_of(-20, -15, -10, 10, 15, 20), "speed_ms": between(0.3, 6)}),
    "rolling": Family({"roll_deg": between(5, 10), "pitch_deg": between(0.5, 3), "sea_state": between(1, 3)}),
    "small targets": Family(
        {"sea_state": between(0, 1.5)},
        [
            Thing("buoy", one_of(1, 2), _CLOSE, (between(0.3, 0.6), between(0.3, 0.6), between(0.3, 0.9))),
            Thing("swimmer", one_of(0, 1, 2), _CLOSE, (between(0.4, 0.6), between(0.4, 0.6), between(0.2, 0.4))),
            Thing("pontoon", one_of(0, 1), _CLOSE, (between(1, 4), between(0.15, 0.3), between(0.12, 0.3)), name="log"),
            Thing("kayak", one_of(0, 1, 2), log(8, 35), None, between(0, 2)),
            Thing("rhib", one_of(0, 1), between(45, 70)),
        ],
    ),
    "harbour": Family(_SHELTERED, layouts=CONFINED_BASES),
    "passing quay": Family(
        {**_SHELTERED, "speed_ms": between(2, 7)},
        [
            Thing("quay_wall", one_of(1, 2), (between(-20, 20), log(9, 32)), (one_of(200.0), one_of(3.0), log(0.6, 5))),
            Thing("pile", one_of(0, 3, 6), (between(-40, 60), log(7, 30)), (one_of(0.4), one_of(0.4), between(1, 6))),
        ],
    ),
    "bridge": Family(
        {**_SHELTERED, "speed_ms": between(1, 5), "lidar_height_m": log(1, 3.5)},
        [Thing("bridge", one_of(1), (between(-15, 50), _NOTHING), (between(4, 20), between(100, 200), between(7, 15)))],
    ),
    "reeds": Family(
        _SHELTERED,
        [
            Thing(
                "reeds",
                between(6, 24),
                (between(-50, 60), log(8, 28)),
                (between(4, 8), between(1.5, 3), between(1.2, 2.8)),
            ),
            Thing("bank", one_of(1, 2), (_NOTHING, between(33, 40)), (one_of(140.0), one_of(6.0), between(1, 3))),
        ],
    ),
    "birds": Family(
        {},
        [
            Thing(
                "bird", between(3, 12), log(5, 50), (between(0.3, 0.6), between(0.5, 1.4), log(0.8, 8)), between(5, 14)
            )
        ],
    ),
    "blooming": Family({"blooming": one_of(True)}),
    "low lidar": Family({"lidar_height_m": between(1.0, 1.5), "length_m": log(3, 6)}),
    "high lidar": Family({"lidar_height_m": between(5, 8), "length_m": log(12, 20)}),
    "few beams": Family({"lidar": one_of(*_BEAMS[16])}),
    "many beams": Family({"lidar": one_of(*_BEAMS[128])}),
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
    layouts = next((FAMILIES[name].layouts for name in chosen if FAMILIES[name].layouts), OPEN_BASES)
    base = layouts[int(rng.integers(len(layouts)))](Plan(rng))
    drawn = _drawn(chosen, rng)
    plan = Plan(rng)
    if "harbour" not in chosen and layouts is OPEN_BASES and rng.random() < 0.5:
        base = replace(base, objects=base.objects[: int(rng.integers(1, 5))])
    plan.extend(base.objects)
    for thing in (*TARGETS, *(thing for name in chosen for thing in FAMILIES[name].things)):
        thing.add(plan)
    scene = replace(base, objects=tuple(plan.objects))
    world = _with(scene, drawn, tuple(chosen), f"A world of wide physics: {', '.join(chosen)}.", rng)
    return replace(world, objects=tuple(item for item in world.objects if clearance_m(world, item) > _CLEARANCE_M))


def with_wide_physics(scene: Scene, seed: int) -> Scene:
    """Return a scene with its objects in water, weather and by a lidar that are drawn from all ranges."""
    rng = np.random.default_rng([seed, 8])
    return _with(scene, _drawn([], rng), (), scene.recording.description, rng)


def clearance_m(scene: Scene, item: SceneObjectParams) -> float:
    """Return how near own ship's side comes to an object on the water; negative if it runs into it."""
    if item.shape in ("bridge", "bird"):
        return np.inf
    times_s = np.arange(0.0, SECONDS, 0.2)
    x, y, heading = scene.vessel.track.smooth_at(times_s)
    keel = x + 1j * y + np.exp(1j * heading) * scene.vessel.length_m * np.linspace(-0.5, 0.5, 5)[:, None]
    x, y, heading = item.track.at(times_s)
    offset = (keel - x - 1j * y) * np.exp(-1j * heading)
    outside = np.abs(offset.real) - item.size_m[0] / 2, np.abs(offset.imag) - item.size_m[1] / 2
    return float(np.hypot(*np.maximum(outside, 0.0)).min() - scene.vessel.width_m / 2)


def _drawn(families: Sequence[str], rng: Rng) -> dict[str, Any]:
    ranges = dict(RANGES)
    for name in families:
        ranges |= FAMILIES[name].ranges
    return {key: ranges[key](rng) for key in ranges}


def _with(scene: Scene, drawn: Mapping[str, Any], families: Sequence[str], about: str, rng: Rng) -> Scene:
    """Return a scene with the drawn parameters in all sections, and own ship on a path that turns at the drawn rate.

    The path passes where that of the scene starts.
    """

    def section(kind: type[Any], **others: Any) -> Any:
        return kind(**others, **{key.name: drawn[key.name] for key in fields(kind) if key.name in drawn})

    targets = [item.track_id for item in scene.objects if not item.ignore]
    retro = rng.permutation(targets)[: int(drawn["retro_number"])].tolist() if drawn.get("blooming") else ()
    physics = section(PhysicsParams, families=tuple(families), retro_tracks=tuple(retro))
    frames, seed = round(SECONDS * drawn["rate_hz"]), int(rng.integers(2**31))
    recording = section(RecordingParams, description=about, frames=frames, seed=seed)
    path, start_s = _path(scene, drawn["speed_ms"], float(np.radians(drawn["turn_deg_s"])))
    length = drawn["length_m"]
    sides = {"width_m": round(0.35 * length, 2), "lidar_forward_m": round(0.2 * length, 2)}
    vessel = section(VesselParams, path=path, start_s=start_s, **sides)
    return Scene(recording, section(SeaParams), vessel, scene.objects, section(NoiseParams), physics)


def _path(scene: Scene, speed_ms: float, turn_rad_s: float) -> tuple[Places, float]:
    start = scene.vessel.track.legs[0]
    step_s = min(SECONDS, _LEG_RAD / abs(turn_rad_s)) if turn_rad_s else SECONDS
    steps = np.arange(-2, round(SECONDS / step_s) + 3)  # a heading is that in the middle of a leg
    ways = speed_ms * step_s * np.exp(1j * (start.heading_rad + turn_rad_s * step_s * (steps + 0.5)))
    path = np.cumsum(np.append(complex(start.x_m, start.y_m) - ways[:2].sum(), ways))
    places = tuple((round(float(one.real), 4), round(float(one.imag), 4)) for one in path)
    return places, round(-2 * step_s, 4)
