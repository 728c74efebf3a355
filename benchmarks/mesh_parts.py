"""Triangle meshes of `mesh_sea`, and what its bodies are made of: x forward, y to port, z up from the water line."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Random = np.random.Generator
Mesh = tuple[Array, Array]  # triangles, shape (N, 3, 3); reflectivities, shape (N,), negative ones of glass

GLASS, SKIN, HAIR, RUBBER, WETSUIT, STEEL, WOOD = -0.06, 0.45, 0.2, 0.05, 0.06, 0.25, 0.35


class Shape(NamedTuple):
    """Mesh of a floating body, its length and beam, and what moves of it, by time."""

    mesh: Mesh
    length: float
    beam: float
    moving: Callable[[float], Mesh] | None = None

    def at(self, time: float) -> Mesh:
        triangles, rho = join(self.mesh, self.moving(time)) if self.moving else self.mesh
        return triangles.astype(np.float32), rho.astype(np.float32)


def turn(roll: Any, pitch: Any, yaw: Any) -> Array:
    """Return matrices, shape (3, 3, ...); a positive pitch puts the bow down, a positive roll the port side up."""
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip


def join(*meshes: Mesh) -> Mesh:
    return np.concatenate([mesh[0] for mesh in meshes]), np.concatenate([mesh[1] for mesh in meshes])


def moved(mesh: Mesh, offset: Any, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Mesh:
    return mesh[0] @ turn(roll, pitch, yaw).T + np.asarray(offset, float), mesh[1]


def tris(points: Any, rho: float) -> Mesh:
    points = np.asarray(points, float).reshape(-1, 3, 3)
    return points, np.full(len(points), float(rho))


def quad(corners: Any, rho: float) -> Mesh:
    a, b, c, d = corners
    return tris([[a, b, c], [a, c, d]], rho)


def split(mesh: Mesh, longest: float) -> Mesh:
    """Halve the longest edges until none is longer than so much."""
    triangles, rho = mesh
    for _ in range(14):
        edges = np.linalg.norm(triangles - np.roll(triangles, -1, 1), axis=2)
        big = edges.max(1) > longest
        if not big.any():
            break
        first, halved = edges[big].argmax(1), triangles[big]
        rows = np.arange(len(halved))
        p, q, r = (halved[rows, (first + step) % 3] for step in range(3))
        m = (p + q) / 2
        triangles = np.concatenate([triangles[~big], np.stack([p, m, r], 1), np.stack([m, q, r], 1)])
        rho = np.concatenate([rho[~big], rho[big], rho[big]])
    return triangles, rho


def skin(sections: Any, rho: float, *, close: bool = False) -> Mesh:
    """Join sections, shape (S, M, 3), with triangles."""
    s = np.asarray(sections, float)
    if close:
        s = np.concatenate([s, s[:, :1]], 1)
    a, b, c, d = s[:-1, :-1], s[1:, :-1], s[1:, 1:], s[:-1, 1:]
    triangles = np.concatenate([np.stack(each, -2).reshape(-1, 3, 3) for each in ([a, b, c], [a, c, d])])
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    return tris(triangles[area > 1e-7], rho)


def crate(low: Sequence[float], high: Sequence[float], rho: float, top: float = 1.0, rake: float = 0.0) -> Mesh:
    """Return a box of which the top is narrower (share) and moved aft (rake)."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    ring = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    upper = (ring - [x, y]) * top + [x - rake, y]
    ends = [np.column_stack([ring, np.full(4, z0)]), np.column_stack([upper, np.full(4, z1)])]
    return join(skin(ends, rho, close=True), quad(ends[1], rho), quad(ends[0], rho))


def rod(start: Any, end: Any, radius: Any, sides: int, rho: float, *, caps: bool = True) -> Mesh:
    """Return a rod of a radius, or of those of its ends."""
    a, b, radii = np.asarray(start, float), np.asarray(end, float), np.broadcast_to(radius, 2)
    axis = (b - a) / max(np.linalg.norm(b - a), 1e-9)
    u = np.cross(axis, [1, 0, 0] if abs(axis[0]) < 0.8 else [0, 1, 0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    parts = [a + ring * radii[0], b + ring * radii[1]]
    if caps:
        parts = [a + ring * 1e-4, *parts, b + ring * 1e-4]
    return skin(parts, rho, close=True)


def chain(points: Any, radius: float, sides: int, rho: float) -> list[Mesh]:
    """Return open rods from point to point."""
    return [rod(a, b, radius, sides, rho, caps=False) for a, b in pairwise(points)]


def ball(centre: Any, radii: Any, rho: float, around: int = 8, up: int = 5) -> Mesh:
    turns = np.arange(around) * 2 * np.pi / around
    heights = np.linspace(-np.pi / 2 + 1e-3, np.pi / 2 - 1e-3, up)[:, None]
    level = np.cos(heights)
    sections = np.stack([level * np.cos(turns), level * np.sin(turns), np.sin(heights) + 0 * turns], -1)
    return skin(sections * np.broadcast_to(radii, 3) + np.asarray(centre, float), rho, close=True)


def person(rng: Random, at: Any, *, seated: bool = True, facing: float = 0.0) -> Mesh:
    """Return a person of 1.75 m; the seat or the feet are at the height given."""
    cloth, trousers = rng.choice([0.08, 0.2, 0.35, 0.6]), rng.choice([0.06, 0.15, 0.3])
    hip = 0.0 if seated else 0.85
    parts = [
        rod([0, 0, hip], [0.02, 0, hip + 0.55], (0.15, 0.19), 7, cloth),
        ball([0.03, 0, hip + 0.74], [0.1, 0.09, 0.13], SKIN, 7, 5),
    ]
    for side in (-1, 1):
        if seated:
            parts.append(rod([0, side * 0.1, 0.05], [0.42, side * 0.12, 0.08], (0.07, 0.06), 5, trousers))
        else:
            parts.append(rod([0, side * 0.1, 0], [0, side * 0.08, hip], (0.06, 0.08), 5, trousers))
        parts.append(rod([0.02, side * 0.2, hip + 0.5], [0.22, side * 0.24, hip + 0.2], (0.045, 0.04), 5, cloth))
    return moved(join(*parts), at, facing)


def plank(x: Array, half: Array, z: Any, rho: float) -> Mesh:
    """Return a deck of some half beams at stations x."""
    z = np.broadcast_to(z, x.shape)
    return skin([np.column_stack([x, y, z]) for y in (half, 0 * x, -half)], rho)


@dataclass(frozen=True)
class Hull:
    """Hull with a transom; the beam is full up to a share of the length, the sheer lifts the bow."""

    length: float
    beam: float
    free: float  # height of the deck above the water line
    draft: float
    rho: float
    fine: float = 2.2
    full: float = 0.55
    flare: float = 0.2
    sheer: float = 0.3
    stern: float = 0.9
    stations: int = 9

    def _share(self, x: Any) -> Array:
        return np.clip((np.asarray(x, float) + self.length / 2) / self.length, 0, 1)

    def half(self, x: Any) -> Array:
        s, full = self._share(x), self.full
        aft = self.stern + (1 - self.stern) * np.minimum(1, s / 0.35)
        bow = 1 - np.clip((s - full) / (1 - full), 0, 1) ** self.fine
        return np.asarray(self.beam / 2 * aft * np.where(s < full, 1, bow))

    def deck(self, x: Any) -> Array:
        return np.asarray(self.free * (1 - self.sheer / 2 + self.sheer * self._share(x) ** 2))

    def rail(self, x: Any, side: float, height: float) -> list[list[float]]:
        """Return places above the deck, near its edge."""
        return [[at, side * self.half(at), self.deck(at) + height] for at in x]

    def mesh(self) -> Mesh:
        s = np.linspace(0, 1, self.stations) ** 0.85
        x = -self.length / 2 + self.length * s
        wide, high = self.half(x), self.deck(x)
        low = wide * (1 - self.flare * (0.3 + 0.7 * s))
        rake = 0.06 * self.length * s**6  # the stem at the water line lies aft of the deck's end
        sides = [
            np.stack([
                np.column_stack([x - rake * 1.3, 0 * x, 0 * x - self.draft]),
                np.column_stack([x - rake, q * low, 0 * x - 0.02]),
                np.column_stack([x - rake / 2, q * (0.45 * low + 0.55 * wide), high * 0.55]),
                np.column_stack([x, q * wide, high]),
            ], 1)
            for q in (1, -1)
        ]  # fmt: skip
        return join(*(skin(side, self.rho) for side in sides), skin([side[0] for side in sides], self.rho))

    def fender(self, rho: float) -> Mesh:
        """Return a strip along the edge of the deck."""
        x = -self.length / 2 + self.length * np.linspace(0, 1, self.stations) ** 0.85
        lines = [np.column_stack([x, q * (self.half(x) + 0.02), self.deck(x)]) for q in (1, -1)]
        return join(*(skin([line, line - [0, 0, 0.07]], rho) for line in lines))

    def plank(self, x: Array, z: Any, rho: float) -> Mesh:
        return plank(x, self.half(x), z, rho)

    def tub(self, x: Array, floor: float, rho: float) -> Mesh:
        """Return inner walls and floor of an open cockpit between the first and the last station."""
        wide, high = self.half(x) * 0.9, self.deck(x)
        edges = [np.column_stack([x, q * wide, high]) for q in (1, -1)]
        walls = [skin([edge, np.column_stack([edge[:, :2], 0 * x + floor])], rho) for edge in edges]
        outer = [np.column_stack([x, q * self.half(x), high]) for q in (1, -1)]
        rims = [skin(each, rho) for each in zip(edges, outer, strict=True)]
        ends = [
            quad([[x[k], q * wide[k], z] for q, z in ((-1, floor), (1, floor), (1, high[k]), (-1, high[k]))], rho)
            for k in (0, -1)
        ]
        return join(*walls, *rims, *ends, plank(x, wide, floor, rho))
