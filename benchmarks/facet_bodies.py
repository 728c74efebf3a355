"""Waves and bodies of `facet_sea`. Bodies consist of convex polyhedra and ellipsoids; rays meet these."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[Any]
Random = np.random.Generator
Span = tuple[float, float]

GRAVITY = 9.81


def log_uniform(rng: Random, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def unit(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])


def rotation(yaw: Any, pitch: Any = 0.0, roll: Any = 0.0) -> Array:
    """Return matrices, shape (..., 3, 3), that turn vectors of a body into those of the world."""
    (a, b, c), (d, e, f) = ([of(angle) for angle in (yaw, pitch, roll)] for of in (np.cos, np.sin))
    rows = [[a * b, a * e * f - d * c, a * e * c + d * f], [d * b, d * e * f + a * c, d * e * c - a * f]]
    return np.moveaxis(np.array([*rows, [-e, b * f, b * c]]), (0, 1), (-2, -1))


class Sea:
    """Sum of Gerstner waves of a JONSWAP spectrum, whose directions spread more above its peak."""

    def __init__(self, rng: Random, height_m: float, period_s: float, spread: float, peak: float) -> None:
        number = int(rng.integers(30, 81))
        self.height_m, self.period_s, top = height_m, period_s, 2 * np.pi / period_s
        omega = np.linspace(0.5 * top, 5 * top, 4000)
        width = np.where(omega <= top, 0.07, 0.09)
        density = omega**-5.0 * np.exp(-1.25 * (top / omega) ** 4)
        energy = np.cumsum(density * peak ** np.exp(-((omega - top) ** 2) / (2 * width**2 * top**2)))
        energy /= energy[-1]
        edges = np.interp(np.linspace(0, 0.995, number + 1), energy, omega)
        self.omega = edges[:-1] + rng.random(number) * np.diff(edges)
        self.k = self.omega**2 / GRAVITY
        self.amplitude = height_m / 4 * math.sqrt(2 / number) * rng.rayleigh(1 / math.sqrt(2), number)
        rng.integers(2, size=number)  # not used: keeps the bytes of the logs
        self.amplitude *= height_m / 4 / math.sqrt((self.amplitude**2 / 2).sum())
        self.heading = rng.uniform(-np.pi, np.pi)
        narrow = spread * np.where(self.omega < top, 1, (self.omega / top) ** -1.5) + 0.5
        self.towards = self.heading + rng.standard_normal(number) * np.sqrt(2 / (1 + narrow))
        self.kx, self.ky = self.k * np.cos(self.towards), self.k * np.sin(self.towards)
        self.phase = rng.uniform(0, 2 * np.pi, number)
        self.steep = min(0.9, 0.85 / max(1e-6, (self.amplitude * self.k).sum()) * 3)
        self.along, self.speed = unit(self.heading), GRAVITY / top
        self.length_m = 2 * np.pi / (top**2 / GRAVITY)

    def height(self, x: Any, y: Any, time: float, length_m: float = 0.0) -> Array:
        """Return the heights of the water, or of a body, over whose length waves are averaged."""
        shape = np.shape(x)
        x, y = (np.asarray(a, np.float32).reshape(-1, 1) for a in (x, y))
        kx, ky = self.kx.astype(np.float32), self.ky.astype(np.float32)
        amplitude = self.amplitude * np.exp(-((self.k * length_m / 4) ** 2)) if length_m else self.amplitude
        amplitude = amplitude.astype(np.float32)
        orbit = amplitude * self.steep
        phase = x * kx + y * ky + (self.phase - self.omega * time).astype(np.float32)
        sine = np.sin(phase)
        dx, dy = (sine @ (orbit * k / self.k).astype(np.float32) for k in (self.kx, self.ky))
        phase += dx[:, None] * kx  # one step towards the particle that is now at x, y
        phase += dy[:, None] * ky
        return np.asarray((np.cos(phase) @ amplitude).astype(float).reshape(shape))

    def drift(self, place: Array, time: float) -> Array:
        """Return how far the orbits of the waves have moved the water at a place."""
        phase = self.kx * place[0] + self.ky * place[1] - self.omega * time + self.phase
        moved = self.amplitude * self.steep * np.sin(phase)
        return np.array([(moved * np.cos(self.towards)).sum(), (moved * np.sin(self.towards)).sum()])


def around(rays: Array, towards: Array, sphere: Span, margin: float, moved: float) -> Array:
    """Return the rays that may meet a sphere of a distance and a radius."""
    distance, radius = sphere
    if radius >= distance * 0.95:
        return np.arange(len(rays))
    angle = math.asin(radius / distance) + margin + moved / distance
    return np.flatnonzero(rays @ (towards / np.linalg.norm(towards)).astype(np.float32) > math.cos(min(1.5, angle)))


class Part:
    """Convex part of a body: vertices, reflectivity, share of the rays that pass it."""

    def __init__(self, vertices: Array, rho: float, gaps: float) -> None:
        self.vertices, self.rho, self.gaps = vertices, rho, gaps
        self.middle = (vertices.max(0) + vertices.min(0)) / 2
        self.radius = np.linalg.norm(vertices - self.middle, axis=1).max() * 1.02

    def meet(self, place: Array, rays: Array) -> tuple[Array, Array]:
        """Return ranges at which rays, shape (N, 3), enter, and the cosines of incidence."""
        raise NotImplementedError

    def first(self, place: Array, rays: Array, moved: float) -> tuple[Array, Array, Array]:
        """Return the rays that may meet the part, and what `meet` returns for these."""
        towards = self.middle - place
        distance = np.linalg.norm(towards, axis=-1).min()
        towards = towards if towards.ndim == 1 else towards.mean(0)
        aimed = around(rays, towards, (distance, self.radius), 0.02, moved)
        return aimed, *self.meet(place if place.ndim == 1 else place[aimed], rays[aimed])


class Polyhedron(Part):
    def __init__(self, vertices: Any, rho: float, gaps: float = 0.0) -> None:
        super().__init__(np.asarray(vertices, float), rho, gaps)
        planes = ConvexHull(self.vertices).equations
        self.normals, self.offsets = planes[:, :3], -planes[:, 3]

    def meet(self, place: Array, rays: Array) -> tuple[Array, Array]:
        enter, leave = (np.full(len(rays), far, np.float32) for far in (-np.inf, np.inf))
        cosine = np.ones(len(rays), np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            for normal, offset in zip(self.normals, self.offsets, strict=True):
                speed = rays @ normal.astype(np.float32)
                cross = np.asarray(offset - place @ normal, np.float32) / speed
                later = (speed < 0) & (cross > enter)
                enter[later], cosine[later] = cross[later], -speed[later]
                sooner = ~(speed < 0) & (cross < leave)
                leave[sooner] = cross[sooner]
        return np.where((enter < leave) & (enter > 0.05), enter, np.inf).astype(float), cosine


class Ellipsoid(Part):
    def __init__(self, centre: Any, radii: Any, rho: float) -> None:
        self.centre, self.radii = np.asarray(centre, float), np.asarray(radii, float) * np.ones(3)
        corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        super().__init__(self.centre + corners * self.radii * 0.98, rho, 0.0)

    def meet(self, place: Array, rays: Array) -> tuple[Array, Array]:
        start, rays = (place - self.centre) / self.radii, rays / self.radii
        a, b, c = (rays * rays).sum(1), (start * rays).sum(1), (start * start).sum(-1) - 1
        under = b * b - a * c
        root = np.sqrt(np.maximum(under, 0))
        range_m = (-b - root) / a
        cosine = np.clip(root / np.maximum(np.abs(b), 1e-6) + 0.2, 0.1, 1)
        return np.where((under > 0) & (range_m > 0.05), range_m, np.inf), cosine


def box(x: Span, y: Span, z: Span, rho: float, taper: float = 0.0, *, gaps: float = 0.0) -> Polyhedron:
    t = taper
    foot = [(a, b, z[0]) for b in y for a in x]
    top = [(a, b, z[1]) for b in (y[0] + t * 0.5, y[1] - t * 0.5) for a in (x[0] + t, x[1] - t)]
    return Polyhedron(foot + top, rho, gaps)


def ring(x: float, y: float, radius: float, sides: int) -> list[Span]:
    angles = np.arange(sides) * 2 * np.pi / sides
    return [(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles]


def pillar(at: Span, radius: float | Span, z: Span, rho: float, sides: int = 9) -> Polyhedron:
    """Return a pillar, or one that widens upwards."""
    radii = radius if isinstance(radius, tuple) else (radius, radius)
    return Polyhedron([(*p, up) for r, up in zip(radii, z, strict=True) for p in ring(*at, r, sides)], rho)


def tube(at: Span, radius: float, x: Span, rho: float) -> Polyhedron:
    return Polyhedron([(along, *p) for along in x for p in ring(*at, radius, 9)], rho)


def hull(length: float, beam: float, sides: Span, rho: float, sheer: float = 0.3, transom: float = 0.9) -> Polyhedron:
    """Return a hull with a freeboard and a draught."""
    board, draught = sides
    corners: list[Any] = []
    for x, wide, rise in ((-0.5, transom, 0), (-0.1, 1, 0), (0.2, 0.92, 0.25 * sheer), (0.38, 0.5, 0.6 * sheer)):
        corners += [(x * length, s * wide * beam / 2, board * (1 + rise)) for s in (-1, 1)]
        corners += [(x * length * 0.97, s * wide * beam / 2 * 0.85, 0) for s in (-1, 1)]
        corners += [(x * length * 0.9, s * wide * beam / 2 * 0.4, -draught) for s in (-1, 1)]
    bow = [(0.5 * length, 0, board * (1 + sheer)), (0.44 * length, 0, 0), (0.34 * length, 0, -draught)]
    return Polyhedron(corners + bow, rho)


def person(at: tuple[float, float, float], rho: float, height: float = 0.85) -> list[Part]:
    x, y, z = at
    trunk = Ellipsoid((x, y, z + height * 0.4), (0.17, 0.23, height * 0.42), rho)
    return [trunk, Ellipsoid((x, y, z + height), (0.1, 0.09, 0.13), rho * 0.8)]


class Shape(NamedTuple):
    """Parts, length, beam and range of speeds of a body."""

    parts: list[Part]
    length: float
    beam: float
    speeds: Span


def speedboat(rng: Random, rho: float) -> Shape:
    length = rng.uniform(5, 11)
    beam, board = length * rng.uniform(0.28, 0.36), rng.uniform(0.7, 1.3)
    z, y = (board, board + rng.uniform(0.5, 1.3)), (-beam * 0.32, beam * 0.32)
    cabin = box((-0.1 * length, 0.18 * length), y, z, log_uniform(rng, 0.08, 0.5), 0.25, gaps=0.25)
    parts: list[Part] = [hull(length, beam, (board, 0.4), rho), cabin]
    if rng.random() < 0.5:
        parts += person((-0.2 * length, 0, board * 0.6), 0.3, 1.7)
    return Shape(parts, length, beam, (3, 13))


def fishing(rng: Random, rho: float) -> Shape:
    length = rng.uniform(7, 14)
    beam, board = length * rng.uniform(0.28, 0.34), rng.uniform(0.8, 1.6)
    x = rng.choice([-0.3, 0.1]) * length
    z, y = (board, board + rng.uniform(1.6, 2.4)), (-beam * 0.3, beam * 0.3)
    house = box((x, x + 0.25 * length), y, z, log_uniform(rng, 0.1, 0.7), 0.1, gaps=0.1)
    mast = pillar((x + 0.1 * length, 0), 0.05, (board + 1.5, board + rng.uniform(2.5, 5)), 0.3)
    return Shape([hull(length, beam, (board, 0.7), rho, 0.5), house, mast], length, beam, (0, 5))


def sail(rng: Random, rho: float) -> Shape:
    length = rng.uniform(6, 13)
    beam, board, mast = length * 0.31, rng.uniform(0.7, 1.2), length * rng.uniform(1.1, 1.4)
    x, y = (-0.15 * length, 0.15 * length), (-beam * 0.28, beam * 0.28)
    parts: list[Part] = [
        hull(length, beam, (board, 0.6), rho, 0.25, 0.7),
        box(x, y, (board, board + 0.45), 0.4, 0.2),
        pillar((0.08 * length, 0), (0.08, 0.05), (board, board + mast), 0.35),
        tube((0, board + 1.1), 0.07, (-0.38 * length, 0.06 * length), 0.3),
    ]
    if rng.random() >= 0.5:
        return Shape(parts, length, beam, (0, 3))
    side, z, top = rng.choice([-1, 1]) * rng.uniform(0.05, 0.2) * length, board + 1.2, board + mast * 0.95
    foot = [(0.06 * length, 0.03, z), (0.06 * length, -0.03, z)]
    foot += [(-0.36 * length, side, board + 1.3), (-0.36 * length, side + 0.04, board + 1.3)]
    cloth = [*foot, (0.07 * length, 0, top), (0.03 * length, 0, top)]
    return Shape([*parts, Polyhedron(cloth, rng.uniform(0.4, 0.8))], length, beam, (1, 4))


def rhib(rng: Random, _: float) -> Shape:
    length = rng.uniform(3.5, 7.5)
    beam, radius, rho = length * 0.38, rng.uniform(0.2, 0.28), log_uniform(rng, 0.035, 0.3)
    sides = [(side * beam * 0.4, radius * 0.9) for side in (-1, 1)]
    tip = [(0.5 * length, 0, radius * 2), (0.5 * length, 0, radius)]
    ends = [tube(side, radius, (0.3 * length, 0.3 * length + 0.01), rho).vertices for side in sides]
    parts: list[Part] = [tube(side, radius, (-0.5 * length, 0.3 * length), rho) for side in sides]
    parts += [
        Polyhedron(np.concatenate([*ends, tip]), rho),
        box((-0.12 * length, 0), (-0.3, 0.3), (0.1, rng.uniform(0.9, 1.3)), 0.2),
        box((-0.54 * length, -0.46 * length), (-0.25, 0.25), (0, 0.9), 0.12),
    ]
    parts += person((-0.2 * length, 0.1, 0.3), rng.uniform(0.1, 0.5), 1.7)
    return Shape(parts, length, beam, (0, 12))


def kayak(rng: Random, _: float) -> Shape:
    length, beam, board = rng.uniform(3.2, 5.2), rng.uniform(0.55, 0.75), rng.uniform(0.18, 0.28)
    section = ((board, 1), (0, 0.9), (-0.1, 0.4))
    middle = [(x * length, s * beam / 2 * w, z) for x in (-0.15, 0.15) for s in (-1, 1) for z, w in section]
    ends = [(-0.5 * length, 0, board * 1.2), (0.5 * length, 0, board * 1.2)]
    boat = Polyhedron(ends + middle, log_uniform(rng, 0.1, 0.8))
    return Shape([boat, *person((0, 0, 0.1), rng.uniform(0.1, 0.6))], length, beam, (0, 2))


def swimmer(rng: Random, _: float) -> Shape:
    head = Ellipsoid((0, 0, 0.12), (0.1, 0.09, 0.15), rng.uniform(0.15, 0.6))
    return Shape([head, Ellipsoid((-0.12, 0, -0.02), (0.2, 0.25, 0.1), rng.uniform(0.1, 0.4))], 0.5, 0.5, (0, 0.7))


def buoy(rng: Random, _: float) -> Shape:
    size = log_uniform(rng, 0.3, 2.0)
    if rng.random() < 0.4:
        return Shape([Ellipsoid((0, 0, size * 0.25), size / 2, log_uniform(rng, 0.12, 0.8))], size, size, (0, 0))
    top = size * rng.uniform(0.5, 1.3)
    drum = pillar((0, 0), size / 2, (-0.3 * size, top * 0.5), log_uniform(rng, 0.12, 0.8), 10)
    cone = pillar((0, 0), (size * 0.4, size * 0.12), (top * 0.5, top), log_uniform(rng, 0.12, 0.8))
    return Shape([drum, cone], size, size, (0, 0))


def small_buoy(rng: Random, _: float) -> Shape:
    size = log_uniform(rng, 0.3, 0.65)
    return Shape([Ellipsoid((0, 0, size * 0.22), size / 2, log_uniform(rng, 0.15, 0.9))], size, size, (0, 0))


def marker(rng: Random, rho: float) -> Shape:
    size, top = rng.uniform(1, 2.2), rng.uniform(2.5, 5)
    parts: list[Part] = [
        pillar((0, 0), size / 2, (-0.5, 0.7), rho, 10),
        pillar((0, 0), 0.2, (0.7, top * 0.75), 0.3),
        pillar((0, 0), (0.35, 0.25), (top * 0.75, top), 0.4),
        pillar((0, 0), 0.22, (top * 0.6, top * 0.66), rng.uniform(2, 12)),
    ]
    return Shape(parts, size, size, (0, 0))


def pile(rng: Random, _: float) -> Shape:
    size, top = rng.uniform(0.25, 0.8), rng.uniform(1.0, 4)
    return Shape([pillar((0, 0), size / 2, (-3, top), log_uniform(rng, 0.06, 0.3), 10)], size, size, (0, 0))


def yacht(rng: Random, _: float) -> Shape:
    length = rng.uniform(12, 22)
    beam, board = length * 0.27, rng.uniform(1.3, 2.2)
    house, bridge = (-0.35 * length, 0.15 * length), (-0.25 * length, 0.05 * length)
    parts: list[Part] = [
        hull(length, beam, (board, 1), rng.uniform(0.2, 0.75), 0.35),
        box(house, (-beam * 0.38, beam * 0.38), (board, board + 1.6), rng.uniform(0.2, 0.7), 0.6, gaps=0.3),
        box(bridge, (-beam * 0.3, beam * 0.3), (board + 1.6, board + 2.9), 0.5, 0.4, gaps=0.2),
        pillar((-0.1 * length, 0), 0.1, (board + 2.9, board + 5), 0.4),
    ]
    return Shape(parts, length, beam, (0, 6))


def ship(rng: Random, _: float) -> Shape:
    length = rng.uniform(45, 70)
    beam, board = length * rng.uniform(0.15, 0.19), rng.uniform(2.5, 5)
    body = hull(length, beam, (board, 2), log_uniform(rng, 0.06, 0.5), 0.25)
    house, hold = (-0.42 * length, -0.25 * length), (-0.2 * length, 0.3 * length)
    y, z = (-beam * 0.42, beam * 0.42), (board, board + rng.uniform(5, 9))
    parts: list[Part] = [body, box(house, y, z, rng.uniform(0.3, 0.75), gaps=0.15)]
    y, z = (-beam * 0.35, beam * 0.35), (board, board + rng.uniform(0.8, 2.5))
    parts += [
        box(hold, y, z, rng.uniform(0.1, 0.4)),
        pillar((0.4 * length, 0), 0.2, (board, board + 7), 0.3),
    ]
    return Shape(parts, length, beam, (0, 4))


KINDS: dict[str, Callable[[Random, float], Shape]] = {
    "swimmer": swimmer, "small_buoy": small_buoy, "buoy": buoy, "kayak": kayak, "rhib": rhib, "pile": pile,
    "marker": marker, "speedboat": speedboat, "fishing": fishing, "sail": sail, "yacht": yacht, "ship": ship,
}  # fmt: skip


class Wake:
    """Froth of a turbulent wake, whose height is exponential and which widens with the fifth root of the distance."""

    def __init__(self, rng: Random, beam: float, speed: float, *, strong: bool) -> None:
        self.half_m = beam * (rng.uniform(0.5, 0.9) if strong else rng.uniform(0.35, 0.6))
        self.growth = rng.uniform(1.2, 2.4) if strong else rng.uniform(0.5, 1.1)
        self.life_s = rng.uniform(5, 14) if strong else rng.uniform(2, 8)
        self.cover = rng.uniform(0.5, 1.0) if strong else rng.uniform(0.1, 0.6)
        self.height_m = 0.12 * log_uniform(rng, 0.75, 1.35) if strong else log_uniform(rng, 0.03, 0.14)
        self.rho = log_uniform(rng, 0.025, 0.07) if strong else log_uniform(rng, 0.015, 0.05)
        self.echoes = rng.uniform(500, 1500) if strong else None
        self.arm_m = rng.uniform(0.04, 0.3) * min(1, speed / 6)
        self.arm_length_m = max(2 * np.pi * speed * speed / GRAVITY * 2 / 3, 1.2)
        self.youngest_s = 0.0

    @property
    def ages(self) -> Array:
        return np.arange(0, min(3.2 * self.life_s, 60), 0.25)

    def arms(self, behind: Array, beside: Array) -> Array:
        """Return the heights of the waves on the arms, at 19.5 degrees from the course."""
        off = (beside - behind * 0.3536) * 0.943 / max(1.0, self.arm_length_m * 0.35)
        size = self.arm_m * (1 + np.maximum(behind, 0) * 1.06 / 5.0) ** -0.45 * np.exp(-(off**2))
        phase = 2 * np.pi / self.arm_length_m * (behind * 0.816 + beside * 0.577)
        return np.where(behind > 0, size * np.cos(phase), 0.0)


@dataclass
class Body:
    """Target, or a boat that has passed: its parts and its way, which is a straight line or an arc."""

    kind: str
    shape: Shape
    at: Array
    heading: float
    speed: float
    turn: float
    start_s: float
    moored: bool = False
    sway: float = 0.0
    sway_s: float = 1.0
    sway_phase: float = 0.0
    trim: float = 0.0
    wake: Wake | None = None
    radius: float = field(init=False)

    def __post_init__(self) -> None:
        self.radius = max((np.linalg.norm(part.vertices, axis=1).max() for part in self.shape.parts), default=0.0)

    def way(self, time: Any) -> Array:
        """Return places, shape (T, 2)."""
        time = np.asarray(time, float) - self.start_s
        if abs(self.turn) < 1e-4 or self.speed == 0:
            return np.asarray(self.at + self.speed * time[:, None] * unit(self.heading))
        heading, radius = self.heading + self.turn * time, self.speed / self.turn
        arc = np.c_[np.sin(heading) - math.sin(self.heading), -np.cos(heading) + math.cos(self.heading)]
        return np.asarray(self.at + radius * arc)

    def stern(self, time: float, ages: Array) -> Array:
        heading = self.heading + self.turn * (time - self.start_s - ages)
        astern = np.c_[np.cos(heading), np.sin(heading)] * (self.shape.length * 0.46)
        return np.asarray(self.way(time - ages) - astern)

    def arms(self, x: Array, y: Array, time: float) -> Array:
        """Return the heights of the Kelvin wake."""
        if not self.wake:
            return np.zeros(x.shape)
        at = self.way(np.array([time]))[0]
        cos, sin = unit(self.heading + self.turn * (time - self.start_s)).tolist()
        behind = -((x - at[0]) * cos + (y - at[1]) * sin) + self.shape.length * 0.45
        return self.wake.arms(behind, np.abs(-(x - at[0]) * sin + (y - at[1]) * cos))

    def pose(self, sea: Sea, time: float) -> tuple[Array, Array]:
        """Return position and rotation."""
        place = self.way(np.array([time]))[0]
        heading = self.heading + self.turn * (time - self.start_s) if self.speed else self.heading
        if self.kind == "pile":
            return np.append(place, 0.0), rotation(heading)
        if self.kind in ("buoy", "marker", "swimmer"):
            place = place - 0.8 * sea.drift(place, time)
        length, beam, (cos, sin) = max(self.shape.length, 0.8), max(self.shape.beam, 0.8), unit(heading).tolist()
        x, y = np.array([(0, 0), (0.35 * length, 0), (-0.35 * length, 0), (0, 0.35 * beam), (0, -0.35 * beam)]).T
        level = sea.height(place[0] + x * cos - y * sin, place[1] + x * sin + y * cos, time, length)
        follow = 0.3 if self.moored else 0.85
        pitch = -math.atan((level[1] - level[2]) / (0.7 * length)) * follow + self.trim
        sway = self.sway * math.sin(2 * np.pi * time / self.sway_s + self.sway_phase)
        roll = math.atan((level[3] - level[4]) / (0.7 * beam)) * follow + sway
        heave = level[0] * (0.5 if self.moored else 0.95)
        return np.append(place, heave), rotation(heading, pitch, np.clip(roll, -0.4, 0.4))


Placed = tuple[Sequence[Part], Array, Array, float]  # parts, position, rotation, radius


def cast(bodies: Iterable[Placed], place: Array, rays: Array, rng: Random) -> tuple[Array, Array, Array]:
    """Return range, reflectivity and number of the body that rays, shape (N, 3), first meet; else inf, 0, -1."""
    range_m, rho, owner = np.full(len(rays), np.inf), np.zeros(len(rays)), np.full(len(rays), -1)
    moved = 0.0 if place.ndim == 1 else float(np.linalg.norm(np.ptp(place, axis=0)) / 2)
    for number, (parts, at, turn, radius) in enumerate(bodies):
        towards = at - (place if place.ndim == 1 else place.mean(0))
        distance = float(np.linalg.norm(towards))
        if distance - radius > 200:
            continue
        near = around(rays, towards, (distance, radius), 0.03, moved)
        if not len(near):
            continue
        local, turned = ((place if place.ndim == 1 else place[near]) - at) @ turn, rays[near] @ turn.astype(np.float32)
        for part in parts:
            aimed, found, cosine = part.first(local, turned, moved)
            closer = found < range_m[near[aimed]]
            if part.gaps:
                closer &= rng.random(len(aimed)) > part.gaps
            hit = near[aimed][closer]
            range_m[hit], owner[hit] = found[closer], number
            rho[hit] = part.rho * np.clip(cosine[closer], 0.05, 1) ** 0.6
    return range_m, rho, owner
