"""Scenes of `fft_sea`: lidar, own ship, weather and bodies of each family."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from fft_bodies import (
    KINDS,
    Array,
    Body,
    Pair,
    Part,
    Random,
    Sea,
    Waves,
    box,
    dinghy,
    pile,
    pillar,
    rotation,
    speedboat,
    yacht,
)

ELEVATIONS_DEG = {
    16: np.arange(-15, 16, 2.0),
    32: np.array([
        -25, -14.638, -10.281, -7.91, -6.424, -5.407, -4.667, -4, -3.667, -3.333, -3, -2.667, -2.333, -2, -1.667,
        -1.333, -1, -0.667, -0.333, 0, 0.333, 0.667, 1, 1.333, 1.667, 2.333, 3.333, 4.667, 7, 10.333, 12.5, 15.0,
    ]),
    64: np.linspace(-16.6, 16.6, 64),
    128: np.linspace(-22.5, 22.5, 128),
}  # fmt: skip
COLUMNS = {  # by number of beams, then by rate
    16: {5: 3600, 10: 1800, 20: 900},
    32: {5: 3600, 10: 1800, 20: 900},
    64: {5: 2048, 10: 1024, 20: 1024},
    128: {5: 1024, 10: 1024, 20: 512},
}


class Lidar:
    """Beams and columns; columns are measured one after the other, or all at once."""

    def __init__(self, beams: int, rate_hz: int, *, sweeps: bool) -> None:
        self.period_s, self.sweeps, columns = 1 / rate_hz, sweeps, COLUMNS[beams][rate_hz]
        self.elevations = np.radians(ELEVATIONS_DEG[beams])
        self.azimuths = -np.pi + (np.arange(columns) + 0.5) * 2 * np.pi / columns
        level, up = np.cos(self.elevations)[:, None], np.sin(self.elevations)[:, None]
        self.rays = np.stack([level * np.cos(self.azimuths), level * np.sin(self.azimuths), up + 0 * self.azimuths], -1)

    def times(self, start: float, azimuths: Array) -> Array:
        """Return when a scan that begins at a time looks to azimuths."""
        if self.sweeps:
            return np.asarray(start + (azimuths + np.pi) / (2 * np.pi) * self.period_s)
        return np.full(len(azimuths), start)


@dataclass
class Wake:
    """Foam behind a ship: clumps in it, their number so that a frame has about so many echoes of them."""

    body: Body
    length_m: float
    echoes: float
    clumps: float = 4000


@dataclass
class World:
    """What a log is made from. Waves, weather and bodies are filled in by its family."""

    seed: int
    beams: int
    rate_hz: int
    frames: int
    height_m: float
    wind_rad: float
    heading: float
    speed_ms: float
    length_m: float
    roll_s: float
    water_reach_m: float  # up to which flat water is seen
    water_share: float  # of rays that can see the water, the share that do
    sweeps: bool
    imu: bool
    wind: Array = field(default_factory=lambda: np.zeros(2))
    yaw_rate: float = 0.0
    roll_deg: float = 1.5
    ripple: float = 0.05  # slope
    rough_m: float = 0.02
    extinction: float = 0.0  # per metre
    mirror_slope: float = 0.0  # 0: no mirrored echoes
    own_wake: int = 0  # clumps alive
    bow_spray_hz: float = 0.0  # drops
    bow_s: float = 3.0
    crest_spray_hz: float = 0.0
    whitecaps_hz: float = 0.0
    glints: int = 0
    rain: float = 0.0  # echoes in a frame
    rain_m: float = 6.0
    rain_intensity: float = 8.0
    waves: Sequence[Waves] = ()
    bodies: Sequence[Body] = ()
    wake: Wake | None = None
    deck: Sequence[Part] = ()
    deck_box: tuple[Array, Array] | None = None

    @property
    def duration_s(self) -> float:
        return self.frames / self.rate_hz


class Own:
    """Own ship on the sea, from the first frame on."""

    def __init__(self, world: World, sea: Sea, rng: Random) -> None:
        period_s = 1 / world.rate_hz
        self.height_m, self.times = world.height_m, np.arange(world.frames + 2) * period_s
        t, step = self.times, world.speed_ms * period_s
        yaw = world.heading + world.yaw_rate * t + 0.02 * np.sin(0.7 * t)
        middle = (yaw[1:] + yaw[:-1]) / 2
        x, y = (np.concatenate([[0], np.cumsum(step * along(middle))]) for along in (np.cos, np.sin))
        water = np.zeros((len(t), 3))
        phase = rng.uniform(0, 6.28, 4)
        for i, time in enumerate(t):
            sea.update(time)
            water[i] = sea.attitude(x[i], y[i], yaw[i], world.length_m, world.length_m / 3)
        z, pitch, roll = water[:, 0], 0.7 * np.arctan(water[:, 1]), 0.9 * np.arctan(water[:, 2])
        lean = np.radians(world.roll_deg)
        roll += lean * np.sin(2 * np.pi * t / world.roll_s + phase[0]) + lean * 0.2 * np.sin(2.9 * t + phase[1])
        pitch += np.radians(0.7) * np.sin(2 * np.pi * t / (0.7 * world.roll_s) + phase[2])
        self.track = np.column_stack([x, y, z, roll, pitch, yaw])

    def lidar(self, time: Array) -> tuple[Array, Array]:
        """Return places, shape (N, 3), and rotations, shape (N, 3, 3), of the lidar at times."""
        pose = np.column_stack([np.interp(time, self.times, column) for column in self.track.T])
        turn = rotation(pose[:, 3], pose[:, 4], pose[:, 5])
        return pose[:, :3] + turn @ np.array([0, 0, self.height_m]), turn


def place(
    world: World,
    rng: Random,
    kinds: Sequence[str],
    span: Pair,
    speeds: Mapping[str, Pair] | None = None,
    spans: Mapping[str, Pair] | None = None,
) -> list[Body]:
    """Return bodies at random places, near enough and clear of each other and of own ship; some find no place."""
    times = np.linspace(0, world.duration_s, 12)
    path = _path(world, times)
    bodies: list[Body] = []
    for kind in kinds:
        low, high = (spans or {}).get(kind, span)
        for _ in range(400):
            body = _somewhere(world, rng, kind, (path[6], low, high), (speeds or {}).get(kind))
            gap = np.hypot(*(body.way(times)[0] - path).T) - body.radius
            near = gap.min() >= max(4, low * 0.6) and gap.max() <= max(high * 1.3, 30)
            if near and all(_gap(body, other, times) > 3 for other in bodies):
                bodies.append(body)
                break
    return bodies


def _path(world: World, times: Array) -> Array:
    """Return the places of own ship at times from 0 on."""
    course = world.heading + world.yaw_rate * times[1:]
    steps = (world.speed_ms * np.diff(times) * along(course) for along in (np.cos, np.sin))
    return np.column_stack([np.concatenate([[0], np.cumsum(step)]) for step in steps])


def _somewhere(world: World, rng: Random, kind: str, ring: tuple[Array, float, float], speeds: Pair | None) -> Body:
    """Return a body that is within a ring at the middle of the log."""
    parts, (center, low, high) = KINDS[kind](rng), ring
    away, bearing = rng.uniform(low, high), rng.uniform(-np.pi, np.pi)
    speed = rng.uniform(*speeds) if speeds else 0.0
    yaw = rng.uniform(-np.pi, np.pi)
    middle = center + away * np.array([np.cos(bearing), np.sin(bearing)])
    start = middle - speed * world.duration_s / 2 * np.array([np.cos(yaw), np.sin(yaw)])
    return Body(kind, parts, start, yaw, speed)


def _gap(body: Body, other: Body, times: Array) -> float:
    way = body.way(times)[0] - other.way(times)[0]
    return float((np.hypot(*way.T) - body.radius - other.radius).min())


def _wind_sea(world: World, rng: Random, height_m: Pair, period_s: Pair, sharp: float = 0.6) -> list[Waves]:
    return [Waves(rng, 160, rng.uniform(*height_m), rng.uniform(*period_s), world.wind_rad, sharp=sharp)]


def wake(world: World, rng: Random, index: int) -> None:
    world.waves = _wind_sea(world, rng, (0.3, 0.6), (2.5, 3.5))
    world.height_m = rng.uniform(2.5, 6)
    kind = ["ship", "speedboat", "ship"][index % 3]
    (maker,) = place(world, rng, [kind], (18, 32), {"ship": (3, 5), "speedboat": (4, 7)})
    buoys = place(world, rng, ["navbuoy"] * 3, (15, 35))
    world.bodies = [maker, *(buoy for buoy in buoys if np.hypot(*(buoy.start - maker.start)) > 30)]
    world.wake = Wake(maker, maker.speed * 3.5, rng.uniform(500, 1500))
    world.own_wake = 300


def swell(world: World, rng: Random, index: int) -> None:
    world.waves = [
        Waves(rng, 400, rng.uniform(1.0, 3.0), rng.uniform(7, 9.5), world.wind_rad, spread=20, sharp=0.3),
        Waves(rng, 90, rng.uniform(0.15, 0.35), rng.uniform(1.8, 2.5), world.wind_rad + 0.5),
    ]
    world.height_m = rng.uniform(2.5, 6)
    kinds = ["speedboat", "navbuoy", "yacht", "navbuoy"][: 4 - index % 2]
    world.bodies = place(world, rng, kinds, (15, 50), {"speedboat": (2, 5)})


def chop(world: World, rng: Random, _: int) -> None:
    world.waves = _wind_sea(world, rng, (0.6, 1.0), (2.8, 3.8), 1.0)
    world.whitecaps_hz, world.wind, world.ripple = rng.uniform(6, 14), 2 * world.wind, 0.1
    world.bodies = place(world, rng, ["speedboat", "navbuoy", "dinghy"], (12, 45), {"speedboat": (2, 6)})


def port(world: World, rng: Random, index: int) -> None:
    world.waves = [Waves(rng, 160, 0.06, 1.5, world.wind_rad)]
    world.mirror_slope, world.ripple, world.rough_m, world.roll_deg, world.heading = 0.02, 0.02, 0.005, 0.4, 0.0
    world.speed_ms = rng.uniform(0, 1.5)
    quay_m = rng.uniform(22, 35)
    quays = [
        Body("quay", [box((-80, 0, -3), (80, 15, rng.uniform(1.5, 2.5)), 0.3)], (0, quay_m), fixed=True),
        Body(
            "quay",
            [box((0, -60, -3), (15, 60, rng.uniform(1.5, 2.5)), 0.3)],
            (rng.uniform(50, 60), quay_m - 61),
            fixed=True,
        ),
    ]
    houses = [Body("house", [box((-8, 0, 1.5), (8, 8, 9), 0.4)], (x, quay_m + 4), fixed=True) for x in (-30, 10)]
    pontoon = _pontoon(rng, index)
    moored = Body("yacht", yacht(rng), (rng.uniform(-25, -12), quay_m - 2.6))
    moving = Body("speedboat", speedboat(rng), (25, 8), np.pi, rng.uniform(1.5, 3))
    world.bodies = [*quays, *houses, *pontoon, moored, moving]


def _pontoon(rng: Random, index: int) -> list[Body]:
    """Return a pontoon, its piles and the boats at it."""
    y = -rng.uniform(14, 22)
    x = rng.uniform(-5, 5)
    bodies = [
        Body("pontoon", [box((-20, -1.2, -0.3), (20, 1.2, 0.45), 0.3)], (x, y), fixed=True),
        *(
            Body("pile", [pillar(0, 0, 0.2, (-2, 3), 0.25)], (x + along, y - 1.5), fixed=True)
            for along in (-18, -6, 6, 18)
        ),
    ]
    for along, make in ((-15, speedboat), (-6, yacht), (3, dinghy), (12, speedboat))[: 2 + index]:
        boat = Body(make.__name__, make(rng), (x + along, 0), np.pi / 2)
        boat.start[1] = y + 1.2 + boat.length / 2 + 0.4
        bodies.append(boat)
    return bodies


def spray(world: World, rng: Random, _: int) -> None:
    world.waves = _wind_sea(world, rng, (0.8, 1.3), (3.2, 4.2), 0.9)
    world.bow_spray_hz, world.bow_s = rng.uniform(6000, 15000), rng.uniform(2, 3.5)
    world.crest_spray_hz, world.whitecaps_hz = rng.uniform(4, 10), 3.0
    world.speed_ms, world.wind, world.ripple = rng.uniform(3, 6), 2.2 * world.wind, 0.1
    speeds = {"speedboat": (3.0, 6.0), "yacht": (2.0, 4.0)}
    world.bodies = place(world, rng, ["speedboat", "navbuoy", "yacht"], (15, 45), speeds)


def turning(world: World, rng: Random, index: int) -> None:
    world.waves = _wind_sea(world, rng, (0.2, 0.5), (2.5, 3.5))
    world.yaw_rate = np.radians(rng.uniform(10, 20)) * rng.choice([-1, 1])
    world.roll_deg, world.speed_ms, world.own_wake = 8, rng.uniform(2, 4), 300
    kinds = ["yacht", "speedboat", "dinghy", "navbuoy", "ship"][: 4 + index % 2]
    world.bodies = place(world, rng, kinds, (12, 45))


def rain(world: World, rng: Random, index: int) -> None:
    """Rain; in every third log, fog."""
    world.waves = _wind_sea(world, rng, (0.3, 0.6), (2.5, 3.5))
    if index % 3 == 1:
        world.rain, world.rain_m, world.extinction, world.rain_intensity = rng.uniform(2000, 5000), 3.0, 0.015, 10.0
    else:
        world.rain, world.rain_m, world.extinction = rng.uniform(500, 2000), 9.0, 0.003
    world.bodies = place(world, rng, ["speedboat", "navbuoy", "yacht", "dinghy"], (12, 40), {"speedboat": (2, 5)})


def glint(world: World, rng: Random, _: int) -> None:
    world.waves = _wind_sea(world, rng, (0.3, 0.6), (2.2, 3.0), 0.9)
    world.glints, world.ripple = int(rng.integers(8, 20)), 0.1
    world.bodies = place(world, rng, ["speedboat", "navbuoy", "dinghy"], (12, 45), {"speedboat": (2, 5)})


def small(world: World, rng: Random, _: int) -> None:
    world.waves = _wind_sea(world, rng, (0.1, 0.3), (1.8, 2.5))
    world.speed_ms = rng.uniform(0, 2)
    kinds, speeds = ["buoy", "buoy", "buoy", "swimmer", "kayak"], {"swimmer": (0.4, 0.9), "kayak": (1.0, 2.0)}
    world.bodies = place(world, rng, kinds, (10, 40), speeds, {"swimmer": (10, 20), "kayak": (12, 40)})


def mirror(world: World, rng: Random, _: int) -> None:
    world.waves = [Waves(rng, 160, 0.04, 1.3, world.wind_rad)]
    world.mirror_slope, world.ripple, world.rough_m, world.roll_deg, world.heading = 0.008, 0.01, 0.003, 0.5, 0.0
    world.speed_ms, world.water_reach_m = rng.uniform(0, 2), rng.uniform(15, 30)
    quay_m = rng.uniform(20, 40)
    quay = Body("quay", [box((-60, 0, -3), (60, 12, rng.uniform(2, 3)), 0.35)], (0, quay_m), fixed=True)
    piles = [Body("pile", pile(rng), (x, -quay_m * 0.6), fixed=True) for x in (-12, 0, 12)]
    ends = np.array([0, world.duration_s])
    boats = [
        body
        for body in place(world, rng, ["ship", "yacht", "speedboat", "dinghy"], (14, 50), {"speedboat": (1, 3)})
        if max(body.way(ends)[0][:, 1]) + body.radius < quay_m - 1
        and all(np.hypot(*(body.start - pile.start)) > body.radius + 1 for pile in piles)
    ]
    world.bodies = [quay, *piles, *(boats or [Body("yacht", yacht(rng), (18, 4), 1.0)])]


def sparse(world: World, rng: Random, index: int) -> None:
    world.height_m, world.water_share = ((1.2, 0.02), (1.0, 0.04), (2.0, 0.08))[index % 3]
    world.water_reach_m, world.ripple = 11 * world.height_m, 0.02
    world.waves = _wind_sea(world, rng, (0.1, 0.25), (2.0, 2.8))
    kinds = ["speedboat", "yacht", "navbuoy", "dinghy", "ship"][: 4 + index % 2]
    world.bodies = place(world, rng, kinds, (24, 65), {"speedboat": (2, 5)})


def open_sea(world: World, rng: Random, index: int) -> None:
    """No bodies."""
    states = (0.3, 2.5, 0, 8), (0.8, 3.3, 4, 3), (1.4, 4.5, 8, 5)
    height_m, period_s, world.whitecaps_hz, world.height_m = states[index % 3]
    world.waves = [Waves(rng, 160, height_m, period_s, world.wind_rad, sharp=0.8)]
    world.own_wake, world.speed_ms = 400, rng.uniform(2, 5)
    if index % 3 == 2:
        world.wind = 2 * world.wind


FAMILIES: dict[str, Callable[[World, Random, int], None]] = {
    "wake": wake,
    "swell": swell,
    "chop": chop,
    "port": port,
    "spray": spray,
    "turning": turning,
    "rain": rain,
    "glint": glint,
    "small": small,
    "mirror": mirror,
    "sparse": sparse,
    "open": open_sea,
}


def draw(family: str, index: int) -> World:
    """Return the world of a log."""
    number = list(FAMILIES).index(family)
    seed = 880000 + 100 * number + index
    rng = np.random.default_rng(seed)
    beams = [16, 32, 64, 128][int(rng.integers(4))]
    if family in ("small", "wake"):  # 16 beams hardly meet them
        beams = [64, 128, 32][index % 3]
    world = World(
        seed=seed,
        beams=beams,
        rate_hz=[5, 10, 20][(number + 2 * index) % 3],
        frames=int(rng.integers(60, 81)),
        height_m=rng.uniform(1.5, 5),
        wind_rad=rng.uniform(-np.pi, np.pi),
        heading=rng.uniform(-3, 3),
        speed_ms=rng.uniform(0, 4),
        length_m=rng.uniform(5, 9),
        roll_s=rng.uniform(3, 5),
        water_reach_m=rng.uniform(20, 55),
        water_share=rng.uniform(0.1, 0.33),
        sweeps=index % 3 == 1,
        imu=bool((number + index) % 2),
    )
    world.wind = 5 * np.array([np.cos(world.wind_rad), np.sin(world.wind_rad)])
    FAMILIES[family](world, rng, index)
    if family != "port" and not world.imu:
        _add_deck(world)
    return world


def _add_deck(world: World) -> None:
    """Add the fore deck of own ship and its mast, in the axes of the lidar."""
    length, keel = world.length_m, -world.height_m
    top = min(world.height_m - 0.5, 1.0)
    world.deck = [
        box((0.8, -1.0, keel + 0.2), (length * 0.55, 1.0, keel + top), 0.4),
        pillar(length * 0.5, 0.0, 0.05, (keel + top, keel + top + 0.8), 0.4),
    ]
    world.deck_box = np.array([0.8, -1, keel + 0.2]), np.array([length * 0.55, 1, max(keel + top + 0.8, 0)])
