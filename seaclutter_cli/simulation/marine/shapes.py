"""Bodies as triangles: shapes of vessels, buoys, walls and trees, and their intersections with rays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from seaclutter_cli.arrays import Floats, Ints

_BLOCK = 1 << 17


def intersect_box(origins: Floats, directions: Floats, lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Return the distances at which rays enter and leave a box between two corners, shape (N,) each.

    A ray misses the box unless it leaves at a larger distance than it enters.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (lower - origins) / directions
        second = (upper - origins) / directions
    near, far = np.fmin(first, second).T, np.fmax(first, second).T
    begin = np.maximum(np.maximum(near[0], near[1]), np.maximum(near[2], 0.0))
    return begin, np.minimum(np.minimum(far[0], far[1]), far[2])


def unit_transforms(triangles: Floats) -> tuple[Floats, Floats]:
    """Return the transforms of triangles (T, 3, 3) to that with corners (0, 0), (1, 0) and (0, 1) in the plane z = 0.

    They are matrices, shape (3, 3, T), and what is subtracted after multiplication with them, shape (3, T).
    """
    corner = triangles[:, 0]
    first, second = triangles[:, 1] - corner, triangles[:, 2] - corner
    to_unit = np.linalg.inv(np.stack((first, second, np.cross(first, second)), axis=2))
    return to_unit.transpose(1, 2, 0), np.einsum("tij,tj->it", to_unit, corner)


def intersect_triangles(origins: Floats, directions: Floats, transforms: tuple[Floats, Floats]) -> tuple[Floats, Ints]:
    """Return the distance along each ray to the nearest triangle, and its index; infinity and -1 for a miss.

    Triangles are given by their `unit_transforms`; both sides of one count. Directions, shape (N, 3), have unit length.

    Each triangle is transformed to the same one, so that the test is the same for all pairs (Woop 2004, "A Ray Tracing
    Hardware Architecture for Dynamic Scenes").
    """
    distance = np.full(len(origins), np.inf)
    which = np.full(len(origins), -1)
    axes, shift = transforms
    size = max(1, _BLOCK // max(shift.shape[1], 1))
    for start in range(0, len(origins), size):
        block = slice(start, start + size)
        found = _pairs(origins[block], directions[block], axes, shift)
        nearest = np.argmin(found, axis=1)
        distance[block] = found[np.arange(len(found)), nearest]
        which[block] = nearest
    which[np.isinf(distance)] = -1
    return distance, which


def _pairs(origins: Floats, directions: Floats, axes: Floats, shift: Floats) -> Floats:
    """Return the distance of each triangle along each ray, shape (N, T)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -(origins @ axes[2] - shift[2]) / (directions @ axes[2])
        u = origins @ axes[0] - shift[0] + distance * (directions @ axes[0])
        v = origins @ axes[1] - shift[1] + distance * (directions @ axes[1])
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    return np.where(hit, distance, np.inf)


Triangles = Floats
Point = tuple[float, float]

_LEAVES = 130
_BLADES = 150


@dataclass(frozen=True)
class Mesh:
    """Triangles in the body's frame (x forward, y left, z up, 0 at the waterline), shape (T, 3, 3).

    ``shades``, shape (T,), are their reflectivities relative to that of the object.
    """

    triangles: Triangles
    shades: Floats

    @cached_property
    def transforms(self) -> tuple[Floats, Floats]:
        """Transforms for the intersection with rays."""
        return unit_transforms(self.triangles)

    @cached_property
    def normals(self) -> Floats:
        """Normals, with a length of twice the area of the triangle, shape (T, 3)."""
        first, second = self.triangles[:, 1] - self.triangles[:, 0], self.triangles[:, 2] - self.triangles[:, 0]
        return np.cross(first, second)

    @cached_property
    def corners(self) -> Floats:
        """Unique corners, shape (V, 3), in metres."""
        return np.unique(self.triangles.reshape(-1, 3), axis=0)

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lowest and highest coordinates, shape (3,) each."""
        return self.corners.min(axis=0), self.corners.max(axis=0)

    def scaled(self, length_m: float, width_m: float, height_m: float) -> "Mesh":
        """Return the mesh, built in a box of unit length, width and height, at true size."""
        return Mesh(self.triangles * np.array([length_m, width_m, height_m]), self.shades)


def _prism(outline: Sequence[Point], bottom: float, top: float, *, taper: float = 1.0) -> Triangles:
    """Return an upright prism whose top is its base scaled by ``taper`` about the centre."""
    low = np.array([(x, y, bottom) for x, y in outline])
    middle = low.mean(axis=0)
    high = middle + (low - middle) * taper
    high[:, 2] = top
    after = np.arange(1, len(low) + 1) % len(low)
    sides = np.concatenate((np.stack((low, low[after], high), 1), np.stack((low[after], high[after], high), 1)))
    fan = np.stack((np.broadcast_to(high.mean(axis=0), high.shape), high, high[after]), 1)
    return np.concatenate((sides, fan))


def _circle(radius: float, corners: int = 12) -> list[Point]:
    angles = 2 * np.pi * np.arange(corners) / corners
    return [(radius * float(np.cos(angle)), radius * float(np.sin(angle))) for angle in angles]


def _hull(start: float = 0.15) -> list[Point]:
    """Return the outline of a hull of unit length and width, with the bow at x = 0.5."""
    return [(-0.5, -0.42), (start, -0.5), (0.38, -0.3), (0.5, 0.0), (0.38, 0.3), (start, 0.5), (-0.5, 0.42)]


def _block(x: Point, y: Point, bottom: float, top: float, *, taper: float = 1.0) -> Triangles:
    return _prism([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])], bottom, top, taper=taper)


def _bank() -> Triangles:
    """Return a slope that rises from the water on the right to a level top on the left."""
    profile = [(-0.5, -0.2), (0.1, 1.0), (0.5, 1.0), (0.5, -0.2)]
    ends = [np.array([(x, y, z) for y, z in profile]) for x in (-0.5, 0.5)]
    after = np.roll(np.arange(4), -1)
    sides = [np.stack((ends[0], ends[0][after], ends[1]), 1), np.stack((ends[0][after], ends[1][after], ends[1]), 1)]
    caps = [end[[[0, 1, 2], [0, 2, 3]]] for end in ends]
    return np.concatenate((*sides, *caps))


def _leaves() -> Triangles:
    """Return leaves from 0.15 of the height of a tree, sparse enough for some shots to pass."""
    rng = np.random.default_rng(5)
    centers = rng.uniform((-0.42, -0.42, 0.2), (0.42, 0.42, 0.95), (_LEAVES, 3))
    across = rng.normal(0, 1, (_LEAVES, 3, 3))
    across *= np.array([0.12, 0.12, 0.055]) / np.linalg.norm(across, axis=2, keepdims=True)
    return np.clip(centers[:, None] + across, (-0.5, -0.5, 0.12), (0.5, 0.5, 1.0))


def _reeds() -> Triangles:
    """Return upright blades, sparse enough for many shots to pass."""
    rng = np.random.default_rng(6)
    foot = np.concatenate((rng.uniform(-0.5, 0.5, (_BLADES, 2)), np.full((_BLADES, 1), -0.2)), axis=1)
    angle = rng.uniform(0, np.pi, _BLADES)
    wide = 0.006 * np.stack((np.cos(angle), 4 * np.sin(angle), np.zeros(_BLADES)), axis=1)
    lean = np.concatenate((rng.normal(0, 0.02, (_BLADES, 2)), rng.uniform(0.7, 1.2, (_BLADES, 1))), axis=1)
    return np.clip(np.stack((foot - wide, foot + wide, foot + lean), 1), -0.5, (0.5, 0.5, 1.0))


_WALL = [(_block((-0.5, 0.5), (-0.5, 0.5), -0.5, 1.0), 1.0)]
_DECK = _block((-0.5, 0.5), (-0.5, 0.5), 0.8, 1.0)
_KAYAK = [(-0.5, 0.0), (-0.1, -0.5), (0.1, -0.5), (0.5, 0.0), (0.1, 0.5), (-0.1, 0.5)]

_PARTS: Mapping[str, Sequence[tuple[Triangles, float]]] = {
    "buoy": [(_prism(_circle(0.5), -0.2, 0.35), 1.0), (_prism(_circle(0.3), 0.35, 1.0, taper=0.2), 1.0)],
    "speedboat": [
        (_prism(_hull(), -0.15, 0.6), 1.0),
        (_block((-0.05, 0.12), (-0.36, 0.36), 0.6, 1.0, taper=0.8), 0.25),  # windscreen
        (_block((-0.2, -0.12), (-0.2, 0.2), 0.55, 1.0, taper=0.7), 0.6),  # crew
        (_block((-0.5, -0.44), (-0.15, 0.15), 0.3, 0.85), 0.2),  # engine
    ],
    "sailing_boat": [
        (_prism(_hull(), -0.03, 0.11), 1.0),
        # Sails are thin sheets at an angle to the hull.
        (np.array([[(0.08, 0.0, 0.15), (-0.42, 0.35, 0.15), (0.08, 0.0, 1.0)]]), 0.8),
        (np.array([[(0.46, 0.0, 0.12), (0.08 + 0.02, 0.2, 0.15), (0.08, 0.0, 0.85)]]), 0.8),
        (_prism([(0.08 + x, y) for x, y in _circle(0.008, 6)], 0.1, 1.0), 0.5),  # mast
    ],
    "cruise_ship": [
        (_prism(_hull(0.3), -0.08, 0.3), 1.0),
        *(
            (_block((-0.44, 0.3 - 0.05 * level), (-0.46, 0.46), 0.3 + 0.14 * level, 0.44 + 0.14 * level), shade)
            for level, shade in enumerate((1.0, 0.55, 1.0, 0.55))  # decks
        ),
        (_block((-0.3, -0.2), (-0.15, 0.15), 0.86, 1.0), 0.8),  # funnel
    ],
    "kayak": [
        (_prism(_KAYAK, -0.1, 0.25), 1.0),
        (_block((-0.1, 0.05), (-0.4, 0.4), 0.25, 0.85, taper=0.8), 0.6),  # paddler
        (_block((-0.03 - 0.02, 0.03 - 0.02), (-0.15, 0.15), 0.85, 1.0), 0.5),
    ],
    "barge": [
        (_block((-0.5, 0.5), (-0.5, 0.5), -0.3, 0.55), 1.0),
        *((_block((start, start + 0.34), (-0.4, 0.4), 0.55, 0.75), 0.7) for start in (-0.28, 0.1)),  # holds
        (_block((-0.48, -0.34), (-0.42, 0.42), 0.55, 1.0), 1.0),  # house astern
    ],
    "cargo_ship": [
        (_prism(_hull(0.34), -0.1, 0.45), 0.8),
        *(
            (_block((-0.2 + 0.15 * k, -0.08 + 0.15 * k), (-0.45, 0.45), 0.45, height), 0.5 + 0.15 * (k % 2))
            for k, height in enumerate((0.72, 0.6, 0.78, 0.66))  # stacks of containers
        ),
        (_block((-0.42, -0.28), (-0.48, 0.48), 0.45, 1.0), 1.0),  # house astern
    ],
    "quay_wall": _WALL,
    "pontoon": _WALL,
    "building": _WALL,
    "pile": [(_prism(_circle(0.5, 8), -0.5, 1.0), 1.0)],
    "bank": [(_bank(), 1.0)],
    "trunk": [(_prism(_circle(0.5, 10), -0.05, 1.0, taper=0.75), 1.0)],
    "crown": [  # from 0.45 of the height of a tree
        (_prism(_circle(0.5, 8), 0.6, 1.0, taper=0.25), 1.0),
        (_prism(_circle(0.15, 8), 0.45, 0.6, taper=1 / 0.3), 1.0),
    ],
    "apple_tree": [(_prism(_circle(0.04, 6), -0.05, 0.9), 0.7), (_leaves(), 1.0)],
    "swimmer": [  # shoulders and head
        (_prism([(0.3 * x, y) for x, y in _circle(0.5, 8)], -0.5, 0.35, taper=0.6), 0.7),
        (_prism(_circle(0.22, 8), 0.2, 1.0, taper=0.8), 1.0),
    ],
    "rhib": [
        (_prism(_hull(0.2), -0.1, 0.38), 0.5),
        (_block((-0.1, 0.05), (-0.2, 0.2), 0.3, 0.75), 0.8),  # console
        (_block((-0.22, -0.14), (-0.25, 0.25), 0.3, 1.0, taper=0.7), 1.0),  # crew
    ],
    "bird": [  # in the highest tenth of its box
        (_prism([(x, 0.3 * y) for x, y in _circle(0.5, 6)], 0.9, 1.0, taper=0.5), 1.0),
        (np.array([[(0.2, 0, 0.95), (-0.2, side, 0.98), (-0.2, 0, 0.95)] for side in (-0.5, 0.5)]), 0.8),  # wings
    ],
    "bridge": [
        (_DECK, 1.0),  # in the highest fifth of its box
        (_DECK[-4:] * np.array([1.0, 1.0, 0.8]), 1.0),  # its underside
        *((_block((-0.4, 0.4), (y - 0.006, y + 0.006), -0.1, 0.8), 1.0) for y in (-0.12, 0.14)),  # piers
    ],
    "reeds": [(_reeds(), 1.0)],
    # Own ship has a low house behind the mast of the lidar.
    "own_vessel": [(_prism(_hull(), -0.2, 0.5), 1.0), (_block((-0.3, 0.0), (-0.3, 0.3), 0.5, 1.0), 1.0)],
}
"""Triangles and shades of the parts of each shape; to add a shape, add an entry here."""

SHAPES: Mapping[str, Mesh] = {
    name: Mesh(
        np.concatenate([triangles for triangles, _ in parts]),
        np.concatenate([np.full(len(triangles), shade) for triangles, shade in parts]),
    )
    for name, parts in _PARTS.items()
}
"""Meshes in a box of unit length, width and height above the waterline."""
