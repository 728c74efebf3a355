"""Intersections of rays with triangles and boxes."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_BLOCK = 1 << 17


def intersect_box(origins: Floats, directions: Floats, lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Return the distances at which rays enter and leave a box between two corners, shape (N,) each.

    A ray misses the box unless it leaves at a larger distance than it enters.

    Examples
    --------
    >>> intersect_box(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), np.array([2.0, -1, -1]), np.array([3.0, 1, 1]))
    (array([2.]), array([3.]))
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


def intersect_triangles(
    origins: Floats, directions: Floats, transforms: tuple[Floats, Floats]
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the distance along each ray to the nearest triangle, and its index; infinity and -1 for a miss.

    Triangles are given by their `unit_transforms`; both sides of one count. Directions, shape (N, 3), have unit length.

    Notes
    -----
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
