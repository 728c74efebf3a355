"""Waves, own ship and bodies of `second_sea`. Bodies consist of convex parts; rays meet these."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
World = dict[str, Any]
Random = np.random.Generator

GRAVITY = 9.81
NEVER = 1e6
KINDS = ("quay", "pontoon", "bridge", "reeds", "bird", "moored", "ship", "sail", "speedboat", "rhib")
KINDS += ("kayak", "pile", "buoy", "swimmer")
FIXED = KINDS[:5]
BOATS: World = {  # length, beam by length, freeboard, height of the house, its share of the length, mast, speed
    "ship": ((18, 60), (0.16, 0.25), (1.2, 4.0), (2.5, 7.0), (0.15, 0.25), 4.0, (1, 7)),
    "speedboat": ((5, 11), (0.3, 0.4), (0.6, 1.2), (0.5, 1.2), (0.15, 0.25), 0.0, (3, 12)),
    "rhib": ((4, 8), (0.35, 0.45), (0.45, 0.7), (0.7, 1.2), (0.15, 0.25), 0.0, (2, 9)),
    "kayak": ((3.5, 5.5), (0.13, 0.17), (0.18, 0.3), (0.6, 0.75), (0.05, 0.08), 0.0, (0, 1.5)),
    "sail": ((7, 14), (0.28, 0.35), (0.7, 1.3), (0.3, 0.6), (0.15, 0.25), 12.0, (0, 4)),
    "moored": ((5, 14), (0.28, 0.36), (0.6, 1.6), (0.5, 2.0), (0.15, 0.25), 6.0, (0, 0)),
}


def unit(angle: Any) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


def wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)


def rotation(yaw: Any, pitch: Any = 0.0, roll: Any = 0.0) -> Array:
    """Return matrices, shape (..., 3, 3), that turn vectors of a body into those of the world."""
    (a, b, c), (d, e, f) = unit(np.array(np.broadcast_arrays(yaw, pitch, roll)))
    rows = [[a * b, a * e * f - d * c, a * e * c + d * f], [d * b, d * e * f + a * c, d * e * c - a * f]]
    return np.moveaxis(np.array([*rows, [-e, b * f, b * c]]), (0, 1), (-2, -1))


class Waves:
    """Sum of waves in deep water, with crests sharpened as in waves of second order by Stokes."""

    def __init__(self, world: World, rng: Random) -> None:
        parts = []
        for name, spread, number in (("wave", 0.6, 16), ("swell", 0.15, 5)):
            ratio = np.exp(rng.uniform(-1.0, 0.25, number))
            share = ratio**2 * np.exp(-1.25 * ratio**2)
            height = world[f"{name}_m"] / 4 * np.sqrt(2 * share / share.sum())
            heading = world["wind_rad"] + rng.normal(0, spread, number)
            parts.append([2 * np.pi / ratio / world[f"{name}_length_m"], height, *unit(heading)])
        k, self.amplitude, x, y = np.concatenate(parts, axis=1)
        self.waves = np.stack([k, k * x, k * y, np.sqrt(GRAVITY * k), rng.uniform(0, 2 * np.pi, len(k))], axis=1)

    def height(self, x: Array, y: Array, time: Any, longer_m: float = 0.0) -> Array:
        """Return the height of the waves that are longer than a body."""
        total = np.zeros(np.shape(x), np.float32)
        for (k, kx, ky, omega, phase), a in zip(self.waves, self.amplitude.astype(np.float32), strict=True):
            if 2 * np.pi / k > longer_m:
                cos = np.cos(np.asarray(kx * x + ky * y + (phase - omega * time), np.float32))
                total += a * (cos + np.float32(k) * a * (cos * cos - np.float32(0.5)))
        return total


class Part(NamedTuple):
    """Convex part in the axes of its body: planes, extents, reflectivity, mean free path inside (0: solid)."""

    normals: Array
    offsets: Array
    low: Array
    high: Array
    rho: float
    free_m: float = 0.0


def block(low: Sequence[float], high: Sequence[float], rho: float, *, taper: float = 0.0, free_m: float = 0.0) -> Part:
    """Return a box, with a bow that begins at a share of the length from the front."""
    normals, offsets = np.concatenate([np.eye(3), -np.eye(3)]), np.append(high, -np.array(low))
    if taper:  # bows are symmetric
        bow = np.array([high[1], taper * (high[0] - low[0]), 0]) / np.hypot(high[1], taper * (high[0] - low[0]))
        normals, offsets = (
            np.concatenate([normals, [bow, bow * [1, -1, 1]]]),
            np.append(offsets, [bow[0] * high[0]] * 2),
        )
    return Part(normals, offsets, np.array(low), np.array(high), rho, free_m)


def pillar(radius: float, z0: float, z1: float, rho: float, *, lean: float = 0.0, x: float = 0.0) -> Part:
    """Return a pillar of ten sides, or a cone."""
    sides = np.column_stack([*unit(np.arange(10) * np.pi / 5), np.full(10, lean)])
    offsets = np.append(radius + sides[:, 0] * x + lean * z0, [z1, -z0])
    low, high = np.array([x - radius, -radius, z0]), np.array([x + radius, radius, z1])
    return Part(np.concatenate([sides, [[0, 0, 1], [0, 0, -1]]]), offsets, low, high, rho)


@dataclass
class Body:
    """Parts that move together; the extents are those of its box."""

    kind: str
    low: Array
    high: Array
    parts: list[Part]
    speed: float = 0.0
    turn: float = 0.0
    sway: float = 0.0
    at: Any = 0.0
    heading: float = 0.0

    def way(self, time: Any) -> Array:
        """Return x, y and heading at times from the middle of the log."""
        x, y = np.reshape(self.at, (2, 1)) + self.speed * time * unit(self.heading + self.turn * time / 2)
        return np.stack([x, y, self.heading + self.turn * time])

    def distance(self, points: Array, time: Any) -> Array:
        """Return the distances of points, shape (2, T), from the outline at times."""
        x, y, heading = self.way(time)
        dx, dy = points[0] - x, points[1] - y
        cos, sin = unit(heading)
        outside = [
            np.maximum(self.low[axis] - a, a - self.high[axis])
            for axis, a in enumerate((cos * dx + sin * dy, cos * dy - sin * dx))
        ]
        return np.asarray(np.hypot(*np.maximum(outside, 0)))

    def place(self, time: float, waves: Waves) -> tuple[Array, Array]:
        """Return position and rotation."""
        x, y, heading = self.way(np.array([time]))[:, 0]
        length = self.high[0] - self.low[0]
        z = waves.height(x, y, time, length) if self.kind not in (*FIXED, "pile") else 0.0
        lean = self.sway * np.sin(2 * np.pi * time / (2 + length / 5) + self.at)
        return np.array([x, y, z]), rotation(heading, lean[0] / 2, lean[1])


def boat(rng: Random, kind: str) -> Body:
    length, beam, board, house, share, mast, speed = (
        rng.uniform(*a) if isinstance(a, tuple) else a for a in BOATS[kind]
    )
    x, y, aft = length / 2, length * beam / 2, rng.uniform(-0.6, 0.1) * length / 2
    roof = board + house
    parts = [block([-x, -y, -0.5], [x, y, board], rng.choice([0.06, 0.2, 0.5, 0.8]), taper=rng.uniform(0.2, 0.45))]
    parts += [block([aft, -0.75 * y, 0], [aft + share * length, 0.75 * y, roof], rng.uniform(0.1, 0.7))]
    top = roof + mast * rng.uniform(0.5, 1.0) * (kind != "moored" or rng.random() < 0.4)
    if top > roof:
        parts.append(pillar(0.05 + mast / 150, 0, top, 0.4, x=0.15 * x))
    sway = 0.01 if kind == "ship" else 0.07
    return Body(kind, np.array([-x, -y, -0.2]), np.array([x, y, top]), parts, speed, rng.normal(0, 0.01), sway)


def works(rng: Random, kind: str, lidar_m: float) -> Body:
    """Return a quay, with or without a building, a pontoon, a bridge or reeds."""
    deck = max(rng.uniform(5, 7), lidar_m + 2)
    length, width, z0, z1, rho = {
        "quay": (rng.uniform(40, 120), rng.uniform(8, 20), -2.0, rng.uniform(1, 3), 0.25),
        "pontoon": (rng.uniform(8, 30), rng.uniform(2, 3), -0.3, rng.uniform(0.3, 0.7), 0.4),
        "bridge": (rng.uniform(50, 110), rng.uniform(6, 14), deck, deck + 1.5, 0.3),
        "reeds": (rng.uniform(8, 30), rng.uniform(2, 6), -0.5, rng.uniform(1, 2.2), 0.3),
    }[kind]
    low, high = np.array([-length / 2, -width / 2, z0]), np.array([length / 2, width / 2, z1])
    parts = [block(low, high, rho, free_m=rng.uniform(0.4, 1.5) if kind == "reeds" else 0.0)]
    if kind in ("bridge", "pontoon"):
        posts = (1.0, -2.0, deck) if kind == "bridge" else (0.15, -2.0, 2.2)
        parts += [pillar(*posts, 0.3, x=share * length) for share in (-0.3, 0.3)]
    if kind == "quay" and rng.random() < 0.6:
        parts.append(block([low[0] / 2, 0, z1], [high[0] / 2, high[1], z1 + rng.uniform(3, 9)], 0.35))
    return Body(kind, low, np.maximum(high, [0, 0, max(part.high[2] for part in parts)]), parts)


def small(rng: Random, kind: str, buoy_m: float) -> Body:
    radius, z0, z1, rho, speed = {
        "swimmer": (0.11, -0.2, 0.25, 0.35, 0.8),
        "buoy": (buoy_m * rng.uniform(0.25, 0.5), -0.2, buoy_m, rng.uniform(0.15, 0.6), 0.0),
        "pile": (rng.uniform(0.12, 0.3), -2.0, rng.uniform(1, 4), 0.2, 0.0),
        "bird": (0.15, 3.7, 4.1, 0.4, rng.uniform(3, 12)),
    }[kind]
    part = pillar(radius, z0, z1, rho, lean=rng.choice([0, 0, 0.5 * radius / z1]) if kind == "buoy" else 0)
    return Body(kind, part.low, part.high, [part], speed, sway=0.1 if kind == "buoy" else 0.0)


def make(rng: Random, kind: str, world: World) -> Body:
    """Return a body of a kind; bridges are above the lidar."""
    if kind in BOATS:
        return boat(rng, kind)
    return works(rng, kind, world["height_m"]) if kind in FIXED[:-1] else small(rng, kind, world["buoy_m"])


def cast(parts: Sequence[Part], place: Array, rays: Array, rng: Random) -> tuple[Array, Array]:
    """Return where rays, shape (3, N), first meet parts, and reflectivity times the cosine of incidence there."""
    count = rays.shape[1]
    range_m, bright = np.full(count, NEVER), np.zeros(count)
    for part in parts:
        normals = part.normals.astype(np.float32)
        speed = normals @ rays
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = (part.offsets.astype(np.float32)[:, None] - normals @ place) / speed
        face = np.where(speed < 0, cross, -np.inf).argmax(axis=0), np.arange(count)
        leave, enter = np.where(speed > 0, cross, np.inf).min(axis=0), cross[face]
        met = enter + rng.exponential(part.free_m, count) if part.free_m else enter
        hit = (met < leave) & (enter > 0.05) & (met < range_m)
        range_m[hit], bright[hit] = met[hit], part.rho * np.clip(-speed[face][hit], 0.05, 1)
    return range_m, bright


class Own:
    """Own ship, whose lidar is above the origin at time 0."""

    def __init__(self, world: World, waves: Waves, rng: Random) -> None:
        self.world, self.waves = world, waves
        self.rate = np.radians(world["yaw_deg_s"]) * rng.choice([-1, 1])
        self.slow, self.phase = 2 * np.pi / rng.uniform(8, 30), rng.uniform(-0.7, 0.7)
        self.beat, self.phases = 2 * np.pi / rng.uniform(3, 8, (2, 1)), rng.uniform(0, 2 * np.pi, (2, 1))
        self.time = np.arange(-60, 60, 0.02)
        track = np.cumsum(world["speed_ms"] * 0.02 * unit(self.yaw(self.time)), axis=1)
        self.track = track - track[:, [len(self.time) // 2]]

    def yaw(self, time: Any) -> Any:
        return self.rate / self.slow * np.sin(self.slow * time + self.phase)

    def way(self, time: Any) -> Array:
        """Return x, y and heading."""
        return np.stack([*(np.interp(time, self.time, along) for along in self.track), self.yaw(time)])

    def pose(self, time: Array) -> tuple[Array, Array]:
        """Return positions, shape (3, C), and rotations, shape (C, 3, 3), of the lidar."""
        x, y, yaw = self.way(time)
        lean = np.radians([[self.world["pitch_deg"]], [self.world["roll_deg"]]])
        z = self.world["height_m"] + self.waves.height(x, y, time, 6.0)
        return np.stack([x, y, z]), rotation(yaw, *(lean * np.sin(self.beat * time + self.phases)))


def spot(world: World, rng: Random, body: Body, side: int) -> tuple[Array, float]:
    """Return where a body is at the middle of the log: quays beside own ship, bridges ahead, others around."""
    along, across = rng.uniform(-25, 45), rng.normal(0, 0.03)
    if body.kind in ("quay", "reeds"):
        return np.array([along, side * (world["beside_m"] + body.high[1])]), across + np.pi * (side < 0)
    if body.kind in ("moored", "pontoon"):
        return np.array([along, side * (world["beside_m"] - body.high[1] - 1)]), across + np.pi * rng.integers(2)
    if body.kind == "bridge":
        return np.array([rng.uniform(10, 40), rng.uniform(-5, 5)]), np.pi / 2 + across
    far = rng.uniform(world["near_m"], world["far_m"]) + body.high[0] * (world["near_m"] > 5)
    return far * unit(rng.uniform(0, 2 * np.pi)), rng.uniform(0, 2 * np.pi)


def populate(world: World, own: Own, rng: Random, times: Array) -> list[Body]:
    """Return all bodies, which keep clear of each other and of own ship."""
    bodies: list[Body] = []
    side, own_way, room = rng.choice([-1, 1]), own.way(times), 1.5 if world["near_m"] < 5 else 4.0
    for kind, number in [(each, number) for each in KINDS for number in range(world[each])]:
        body = make(rng, kind, world)
        around = [other for other in bodies if other.kind != "bird" and (kind not in FIXED or other.kind == kind)]
        for _ in range(40):
            body.at, body.heading = spot(world, rng, body, side * (-1) ** (number if kind in FIXED else 0))
            way, length = body.way(times), body.high[0]
            wide = body.high[1] if kind == "moored" else length
            gaps = [other.distance(way, times).min() - (wide if other.kind in FIXED else length) for other in around]
            clear = kind in ("bridge", "bird") or body.distance(own_way, times).min() > room
            if clear and min(gaps, default=1) > 0:
                bodies.append(body)
                break
    return bodies
