"""Worlds of `mesh_sea`: what is drawn for a family, own vessel, and bodies, which float or are land."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from mesh_bodies import KINDS, NAMES
from mesh_parts import Array, Mesh, Random, Shape, turn
from mesh_water import Sea
from mesh_waves import World

Span = tuple[float, float]


def shore(rng: Random) -> tuple[Array, Array]:
    """Return a place of the shore line, and the direction inland."""
    away, side = rng.uniform(42, 55), rng.choice([-1, 1])
    inland = np.array([rng.uniform(-0.2, 0.2), side])
    inland /= np.linalg.norm(inland)
    return inland * away, inland


ANY: World = {  # a pair is a range, a list a choice; wind in m/s, swell and heights in metres, sight and fetch, too
    "lidar": ["VLP-16", "VLP-32C", "RS-LiDAR-32", "XT32", "XT32", "OS1-64", "OS1-64 gen 1", "Pandar64", "OS1-128"],
    "hz": [5, 10, 10, 10, 10, 20], "frames": 120, "height": (1.5, 3.2),
    "tilt": lambda rng: rng.normal(0, 0.9, 3).clip(-3, 3) * [0, 1, 1][rng.integers(3)], "wind": (2, 5),
    "fetch": lambda rng: 10 ** rng.uniform(3.2, 4.3), "wind_to": (-np.pi, np.pi), "depth": (6, 30),
    "swell": (0, 0.15), "swell_s": (4.5, 7), "swell_to": (-np.pi, np.pi), "caps": 1.0, "speed": (0.5, 4),
    "turn": lambda rng: rng.normal(0, 1), "yaw_wobble": (0.3, 2), "own_length": (3.5, 8), "mount_x": (-0.5, 1.2),
    "idle": (0.2, 0.8), "deck": ["none", "cropped", "cropped", "hull", "rails"], "mirror": False,
    "turbid": lambda rng: 10 ** rng.uniform(-4.3, -3.0), "specks": (0.0008, 0.005), "ripple": (0.4, 1.5), "rain": 0.0,
    "sight": 1e5, "fog_gain": 0.0, "slam": 0.0, "drops": 0, "dropout": (0.002, 0.02), "stray": [0, 0, 1, 3, 8],
    "wake": (0.7, 1.2), "root": lambda rng: rng.random() < 0.4, "shore": None,
}  # fmt: skip
CALM: World = {"wind": (0.4, 2.2), "fetch": (200, 900), "swell": (0, 0.03), "mirror": True, "idle": (0.15, 0.5)}
FAMILIES: dict[str, World] = {
    "calm_harbour": {
        "speed": (0.5, 1.8), "lidar": ["VLP-16", "XT32", "OS1-64", "RS-LiDAR-32"], "height": (1.3, 2.4),
        "turn": lambda rng: rng.normal(0, 0.4),
    },
    "open_swell": {
        "swell": (1.0, 2.2), "swell_s": (6.5, 9.5), "depth": 40, "wind": (3, 7), "fetch": (8e3, 3e4),
        "height": (2, 4.5), "speed": (1, 5), "idle": 1.0,
    },
    "wind_chop": {
        "wind": (7, 11), "fetch": (3e3, 1.2e4), "swell": (0.1, 0.4), "height": (1.6, 3), "speed": (1, 5), "idle": 1.0,
    },
    "breakers": {
        "shore": shore, "wind": (4, 8), "fetch": (3e3, 8e3), "swell": (0.2, 0.4), "depth": 6, "speed": (0.5, 2.5),
        "height": (1.8, 3.5), "turn": 0.0, "caps": 0.7, "shore_slope": (0.035, 0.05), "surf_m": (0.7, 1.2),
        "surf_s": (5, 8),
    },
    "wake_crossing": {"wind": (1, 4), "fetch": (5e2, 3e3), "speed": (2, 5), "wake": 1.4},
    "follow_ship": {
        "speed": (3, 5), "wind": (1.5, 5), "fetch": (5e2, 4e3), "turn": 0.0, "height": (2, 4), "wake": 1.2,
    },
    "head_spray": {
        "wind_to": lambda rng: np.pi + rng.normal(0, 0.25), "wind": (8, 12), "fetch": (4e3, 1.5e4), "speed": (4, 7),
        "slam": (0.8, 1.2), "height": (1.6, 3), "turn": 0.0, "drops": lambda rng: rng.integers(0, 6), "idle": 1.5,
        "deck": ["none", "rails", "hull"],
    },
    "rain": {"rain": (8, 45), "wind": (2, 6), "drops": lambda rng: rng.integers(4, 14), "sight": (1200, 4000)},
    "fog": {"sight": (90, 350), "fog_gain": (0.03, 0.2), "wind": (0.5, 3), "fetch": (3e2, 2e3), "speed": (0.5, 2.5)},
    "night_mirrors": {
        "wind": (0.3, 1.2), "fetch": (150, 400), "swell": 0.0, "speed": (0, 1.2),
        "lidar": ["OS1-64", "OS1-128", "XT32", "Pandar64"], "idle": 0.2, "stray": 0, "height": (1.5, 3.5),
    },
    "turning": {
        "turn": lambda rng: rng.choice([-1, 1]) * rng.uniform(12, 18), "speed": (2, 5), "wind": (2, 6),
        "hz": [5, 10, 10], "yaw_wobble": 1.0,
    },
    "kayaks": {
        "wind": (1, 4), "fetch": (3e2, 2e3), "speed": (0.5, 2), "lidar": ["XT32", "OS1-64", "OS1-128", "VLP-32C"],
    },
    "swimmers": {
        "wind": (0.8, 3.5), "fetch": (3e2, 2e3), "speed": (0.2, 1.5),
        "lidar": ["OS1-64", "OS1-128", "XT32", "Pandar64"], "height": (1.3, 2.6),
    },
    "buoys_chop": {
        "wind": (5.5, 9.5), "fetch": (1.5e3, 8e3), "speed": (1, 4),
        "lidar": ["XT32", "OS1-64", "OS1-128", "Pandar64", "RS-LiDAR-32"],
    },
    "beams16": {"lidar": "VLP-16", "wind": (1.5, 6), "height": (1.3, 2.5)},
    "beams128": {"lidar": "OS1-128", "wind": (1.5, 7), "hz": 10},
    "low": {
        "height": 1.2, "own_length": (2.5, 3.6), "wind": (0.5, 4), "fetch": (3e2, 3e3), "swell": (0, 0.1),
        "speed": (0.5, 2.5), "deck": ["none", "cropped"], "lidar": ["VLP-16", "XT32", "OS1-64", "OS1-64 gen 1"],
    },
    "high": {
        "height": (5.2, 6), "own_length": (9, 12), "wind": (2, 8), "speed": (1, 5),
        "deck": ["hull", "rails", "cropped"], "lidar": ["OS1-64", "OS1-128", "VLP-32C", "Pandar64"], "mount_x": 1.5,
    },
    "river_reeds": {
        "wind": (0.5, 3), "fetch": (150, 500), "swell": 0.0, "speed": (1, 2.5), "turn": 0.0, "depth": 3,
        "mirror": True, "turbid": lambda rng: 10 ** rng.uniform(-3.5, -2.8),
        "lidar": ["VLP-16", "XT32", "OS1-64", "RS-LiDAR-32"], "height": (1.3, 2.5),
    },
    "lock": {
        "wind": 0.4, "fetch": 100, "swell": 0.0, "speed": (0, 0.5), "turn": 0.0,
        "lidar": ["XT32", "OS1-64", "OS1-64 gen 1", "VLP-16"], "height": (1.4, 2.5), "own_length": (3.5, 5),
        "idle": 0.2,
    },
    "bridge": {
        "wind": (1, 4), "fetch": (300, 1200), "swell": 0.02, "speed": (2, 4.5), "turn": 0.0,
        "mirror": lambda rng: rng.random() < 0.5, "yaw_wobble": 0.5,
    },
    "rhib_crossing": {"wind": (2, 6), "speed": (0.5, 4), "wake": 1.2},
    "anchorage": {"wind": (1, 5), "fetch": (3e2, 3e3), "speed": (0.5, 2)},
    "empty_sea": {"wind": (2, 10), "fetch": (2e3, 2e4), "swell": (0.1, 0.9), "speed": (1, 6)},
}  # fmt: skip
SHELTERED = ("calm_harbour", "night_mirrors", "lock")


def drawn(among: World, rng: Random) -> World:
    world: World = {}
    for name, values in among.items():
        if callable(values):
            world[name] = values(rng)
        elif isinstance(values, list):
            world[name] = values[rng.integers(len(values))]
        else:
            world[name] = rng.uniform(*values) if isinstance(values, tuple) else values
    return world


def draw(family: str, rng: Random) -> World:
    world, calm = drawn(ANY, rng), drawn(CALM, rng)
    world |= (calm if family in SHELTERED else {}) | drawn(FAMILIES[family], rng)
    return world | ({"mirror": world["wind"] < 2.5} if family == "low" else {})


class Pose(NamedTuple):
    at: Array
    turn: Array
    yaw: float


ORIGIN = Pose(np.zeros(3), np.eye(3), 0.0)


def raft(across: int, length: float, beam: float) -> Array:
    """Return places below a craft, of so many rows."""
    rows = np.linspace(-1, 1, across)
    return np.array([(x, y) for x in rows for y in (-1, 0, 1)]) * [length, beam]


def tilts(places: Array, heights: Array) -> tuple[float, float]:
    """Return the slopes of the plane through the water along and across a craft."""
    along, across = ((axis @ heights) / (axis @ axis) for axis in places.T)
    return float(along), float(across)


@dataclass(eq=False)
class Body:
    """Floating body on a circular track."""

    kind: str
    shape: Shape
    at: Array
    heading: float
    speed: float
    rate: float
    middle_s: float  # time at which it is there
    z: float
    target: bool
    sway: float
    phase: float
    state: Array = field(default_factory=lambda: np.zeros(3))  # heave, roll, pitch
    pose: Pose = ORIGIN
    last: Pose = ORIGIN

    @property
    def length(self) -> float:
        return self.shape.length

    @property
    def beam(self) -> float:
        return self.shape.beam

    def path(self, time: float) -> tuple[float, float, float]:
        """Return position and yaw; what lies still swings."""
        seconds, heading = time - self.middle_s, self.heading
        yaw = heading + self.rate * seconds
        if abs(self.rate) < 1e-4:
            way = self.speed * seconds * np.array([np.cos(heading), np.sin(heading)])
        else:
            way = self.speed / self.rate * np.array([np.sin(yaw) - np.sin(heading), np.cos(heading) - np.cos(yaw)])
        x, y = self.at + way
        swing = 0.06 * np.sin(0.5 * time + self.phase) if self.speed < 0.5 and self.length < 20 else 0
        return x, y, yaw + swing

    def raft(self) -> Array:
        return raft(3, max(self.length, 0.4) * 0.38, max(self.beam, 0.4) * 0.38)

    def near(self, place: Array) -> bool:
        return bool(np.hypot(*(self.pose.at[:2] - place[:2])) - self.length <= 160)

    def vertices(self, time: float) -> tuple[Array, Array, Array]:
        """Return the vertices at the start and the end of a step that starts then, and triangles' reflectivities."""
        triangles, rho = self.shape.at(time)
        places = triangles.reshape(-1, 3)
        start, end = ((places @ pose.turn.T + pose.at).astype(np.float32) for pose in (self.last, self.pose))
        return start, end, rho

    def middle(self) -> tuple[float, float, float]:
        """Return position and yaw in the middle of a step."""
        (x, y, _), yaw = (self.pose.at + self.last.at) / 2, (self.pose.yaw + self.last.yaw) / 2
        return x, y, yaw

    def follow(self, heights: Array, time: float, seconds: float) -> None:
        """Follow the plane through the water at the places of the raft."""
        along, across = tilts(self.raft(), heights)
        wanted = np.array([heights.mean(), np.arctan(across) * self.sway, -np.arctan(along) * self.sway])
        if self.kind in ("spar", "lateral", "channel mark", "float", "mooring"):
            nod = [0.05 * np.sin(1.7 * time + self.phase), 0.07 * np.sin(1.3 * time + 2 * self.phase)]
            wanted[1:] = 0.8 * wanted[1:] + nod
        if self.kind in ("pile", "withy"):
            wanted[:] = 0
        if self.speed > 5 and self.length < 15:  # planing
            phase = 4 * time + self.phase
            wanted += [0.12 + 0.05 * np.sin(phase), 0, -0.05 + 0.02 * np.sin(phase + 1)]
        slow = 0.12 if self.length < 3 else 0.1 + 0.05 * np.sqrt(self.length)
        self.state += (wanted - self.state) * (1 - np.exp(-seconds / slow))
        x, y, yaw = self.path(time)
        z = self.z + self.state[0] * (self.kind != "bird aloft")
        self.last, self.pose = self.pose, Pose(np.array([x, y, z]), turn(self.state[1], self.state[2], yaw), yaw)


class Land:
    """Part of a shore, and the heading of the smallest box around it."""

    kind, target = "land", False

    def __init__(self, mesh: Mesh) -> None:
        self.places, self.rho = mesh[0].reshape(-1, 3).astype(np.float32), mesh[1].astype(np.float32)
        places = self.places
        self.centre = (places.min(0) + places.max(0)) / 2
        self.radius = float(np.linalg.norm(places - self.centre, axis=1).max())
        turns = np.radians(np.arange(0, 90, 2.5))
        axes = [np.array([[cos, sin], [-sin, cos]]) for cos, sin in zip(np.cos(turns), np.sin(turns), strict=True)]
        self.facing = float(turns[np.argmin([np.ptp(places[:, :2] @ each.T, axis=0).prod() for each in axes])])

    def near(self, place: Array) -> bool:
        return bool(np.linalg.norm(self.centre - place) - self.radius <= 150)

    def vertices(self, _: float) -> tuple[Array, Array, Array]:
        return self.places, self.places, self.rho

    def middle(self) -> tuple[float, float, float]:
        return self.centre[0], self.centre[1], self.facing


def float_all(bodies: Sequence[Body], sea: Sea, time: float, seconds: float) -> None:
    """Move bodies with the water; after a long time, they lie as it does."""
    places = []
    for body in bodies:
        (x, y, yaw), raft = body.path(time), body.raft()
        cos, sin = np.cos(yaw), np.sin(yaw)
        places.append([x + cos * raft[:, 0] - sin * raft[:, 1], y + sin * raft[:, 0] + cos * raft[:, 1]])
    if places:
        for body, heights in zip(bodies, sea.under(bodies, *np.array(places).swapaxes(0, 1)), strict=True):
            body.follow(heights, time, seconds)


class Own:
    """Own vessel: its track, its motions, and the poses of the lidar."""

    MOST = np.radians(11.0)  # of roll and pitch

    def __init__(self, world: World, rng: Random) -> None:
        self.world, self.period = world, 1 / world["hz"]
        self.times = np.arange(world["frames"] + 1) * self.period
        self.middle_s = self.times[-1] / 2
        self.phases = rng.uniform(0, 2 * np.pi, 3)
        since, wobble = self.times - self.middle_s, np.radians(world["yaw_wobble"])
        self.yaw = np.radians(world["turn"]) * since + wobble * np.sin(2 * np.pi * since / rng.uniform(5, 9))
        speed = world["speed"] * (1 + 0.05 * np.sin(0.4 * self.times + self.phases[0]))
        ways = [
            np.concatenate([[0], np.cumsum(speed[:-1] * way(self.yaw[:-1]) * self.period)]) for way in (np.cos, np.sin)
        ]
        self.x, self.y = (way - np.interp(self.middle_s, self.times, way) for way in ways)
        self.length, self.beam = world["own_length"], world["own_length"] * 0.36
        self.mount, self.arm = turn(*np.radians(world["tilt"])), np.array([world["mount_x"], 0, world["height"]])
        self.roll, self.pitch, self.heave = np.zeros(2), np.zeros(2), 0.0  # roll and pitch with their rates
        self.pose = self.last = np.zeros(6)

    def path(self, time: float) -> tuple[float, float, float]:
        x, y, yaw = (np.interp(time, self.times, values) for values in (self.x, self.y, self.yaw))
        return x, y, yaw

    def settle(self, sea: Sea) -> None:
        self.heave = self._water(0, sea).mean()
        for _ in range(31):
            self.step(0, sea)
        self.last = self.pose

    def _water(self, number: int, sea: Sea) -> Array:
        """Return the heights of the water below, from the stern to the bow."""
        raft, cos, sin = self._raft(), np.cos(self.yaw[number]), np.sin(self.yaw[number])
        x = self.x[number] + cos * raft[:, 0] - sin * raft[:, 1]
        y = self.y[number] + sin * raft[:, 0] + cos * raft[:, 1]
        return np.asarray(sea.under([self], x[None], y[None])[0])

    def _raft(self) -> Array:
        return raft(5, self.length * 0.42, self.beam * 0.4)

    def step(self, number: int, sea: Sea) -> None:
        """Go on to the start of a frame: roll and pitch are oscillators that the slopes of the water drive."""
        world, seconds, time, water = self.world, self.period, self.times[number], self._water(number, sea)
        along, across = tilts(self._raft(), water)
        idle = np.radians(world["idle"])
        heel = -np.clip(self.yaw[number] - self.yaw[max(number - 1, 0)], -0.1, 0.1) / seconds * world["speed"] / 25
        roll = 0.65 * np.arctan(across) + heel + idle * np.sin(1.9 * time + self.phases[0])
        pitch = -0.8 * np.arctan(along) - 0.01 * min(world["speed"], 5)
        pitch += 0.6 * idle * np.sin(1.5 * time + self.phases[1])
        for state, wanted, omega, damping in ((self.roll, roll, 2.6, 0.25), (self.pitch, pitch, 3.2, 0.4)):
            for _ in range(6):
                state[1] += (omega * omega * (wanted - state[0]) - 2 * damping * omega * state[1]) * seconds / 6
                state[0] += state[1] * seconds / 6
            if abs(state[0]) > self.MOST:
                state[:] = np.sign(state[0]) * self.MOST, 0
        self.heave += (water.mean() - self.heave) * (1 - np.exp(-seconds / 0.25))
        pose = [self.x[number], self.y[number], self.heave, self.roll[0], self.pitch[0], self.yaw[number]]
        self.last, self.pose = self.pose, np.array(pose)
        self.bow_sink = (water[-3:].mean() - self.heave) - (-np.sin(self.pitch[0]) * self.length * 0.42)

    def poses(self, shares: Array) -> tuple[Array, Array]:
        """Return places, shape (N, 3), and rotations of the lidar at shares of the step."""
        pose = self.last + (self.pose - self.last) * shares[:, None]
        turns = np.moveaxis(turn(pose[:, 3], pose[:, 4], pose[:, 5]), -1, 0)
        return pose[:, :3] + turns @ self.arm, turns @ self.mount


class Wish(NamedTuple):
    """How a body is to be placed; pairs are ranges, functions draw."""

    speed: float | Span = 0.0
    heading: float | Callable[[], float] | None = None
    rate: float | Span = 0.0
    at: Any = None
    bearing: Span = (-np.pi, np.pi)
    target: bool = True
    z: float = 0.0
    clear: float = 2.5
    length: float | None = None


class Placer:
    """Puts bodies where they meet neither own vessel nor each other."""

    def __init__(self, world: World, own: Own, rng: Random) -> None:
        self.world, self.own, self.rng = world, own, rng
        self.bodies: list[Body | Land] = []
        self.tracks: list[tuple[Body, Array]] = []
        self.free: Callable[[float, float], bool] = lambda _x, _y: True
        self.times = np.linspace(0, own.times[-1], 16)
        self.own_track = np.array([own.path(time)[:2] for time in self.times])

    def uniform(self, low: float, high: float) -> float:
        return self.rng.uniform(low, high)

    def pick(self, *among: Any) -> Any:
        return among[self.rng.integers(len(among))]

    def land(self, meshes: Iterable[Mesh]) -> None:
        self.bodies += map(Land, meshes)

    def add(self, kind: str, distance: Span = (12, 45), number: int = 1, **given: Any) -> None:
        """Add bodies at some distance, or where they are wished; after 60 trials, one is left out."""
        rng, wish, (maker, lengths) = self.rng, Wish(**given), KINDS[kind]
        for _ in range(number):
            shape = maker(rng, *([] if lengths is None else [wish.length or rng.uniform(*lengths)]))
            speed = rng.uniform(*wish.speed) if isinstance(wish.speed, tuple) else wish.speed
            rate = rng.uniform(*wish.rate) * rng.choice([-1, 1]) if isinstance(wish.rate, tuple) else wish.rate
            for _try in range(60):
                body = self._body(NAMES.get(kind, kind), shape, distance, wish._replace(speed=speed, rate=rate))
                track = np.array([body.path(time)[:2] for time in self.times])
                if self._fits(body, track, wish.clear):
                    self.bodies.append(body)
                    self.tracks.append((body, track))
                    break

    def _body(self, name: str, shape: Shape, distance: Span, wish: Any) -> Body:
        rng = self.rng
        bearing, away = rng.uniform(*wish.bearing), rng.uniform(*distance)
        at = wish.at() if callable(wish.at) else wish.at
        at = (away * np.cos(bearing), away * np.sin(bearing)) if at is None else at
        heading = wish.heading() if callable(wish.heading) else wish.heading
        heading = rng.uniform(-np.pi, np.pi) if heading is None else heading
        way = np.asarray(at, float), heading, wish.speed, wish.rate, self.own.middle_s
        return Body(name, shape, *way, wish.z, wish.target, rng.uniform(0.3, 1), rng.uniform(0, 2 * np.pi))

    def _fits(self, body: Body, track: Array, clear: float) -> bool:
        """Return whether a body is free at all times, and clear of own vessel and of the others."""
        if not all(self.free(*place) for place in track):
            return False
        away, half = np.hypot(*(track - self.own_track).T), body.length / 2
        if body.length >= 15:
            away, half = self._from_hull(track, body), 0
        if away.min() < clear + half + self.own.length * 0.3:
            return False
        return not any((np.hypot(*(track - other).T) < apart(body, each)).any() for each, other in self.tracks)

    def _from_hull(self, track: Array, body: Body) -> Array:
        """Return the distances between own vessel and the box of a body."""
        dx, dy = (self.own_track - track).T
        yaw = np.array([body.path(time)[2] for time in self.times])
        x, y = np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx
        return np.asarray(np.hypot(np.maximum(abs(x) - body.length / 2, 0), np.maximum(abs(y) - body.beam / 2, 0)))


def apart(body: Body, other: Body) -> float:
    """Return how far the middles of two bodies have to be from each other."""
    short, long = sorted((body.length, other.length))
    return long / 2 + short / 2 + 0.6 if long < 16 else long / 2 + short / 3 + 1
