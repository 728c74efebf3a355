"""Overlap of upright boxes, seen from above."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.truth import Boxes

Floats = NDArray[np.float64]

_CORNERS = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])


def overlaps(first: Boxes, second: Boxes) -> Floats:
    """Return intersection over union of each box of the first with each of the second, shape (M, K).

    Examples
    --------
    >>> box = Boxes(("1",), ("buoy",), np.zeros((1, 3)), np.array([[2.0, 2, 1]]), np.array([np.pi / 4]))
    >>> moved = Boxes(("1",), ("buoy",), np.array([[np.sqrt(2), 0, 0]]), box.sizes, box.yaws)
    >>> overlaps(box, moved).round(3), overlaps(box, box)
    (array([[0.143]]), array([[1.]]))
    """
    found = np.zeros((len(first), len(second)))
    reach = [np.hypot(*boxes.sizes[:, :2].T) / 2 for boxes in (first, second)]
    apart = np.linalg.norm(first.centers[:, None, :2] - second.centers[:, :2], axis=2)
    areas = [boxes.sizes[:, 0] * boxes.sizes[:, 1] for boxes in (first, second)]
    corners = [_corners(boxes) for boxes in (first, second)]
    for m, k in np.argwhere(apart < reach[0][:, None] + reach[1]).tolist():
        common = _area(_clipped(corners[0][m], corners[1][k]))
        found[m, k] = common / max(areas[0][m] + areas[1][k] - common, 1e-12)
    return found


def _corners(boxes: Boxes) -> Floats:
    """Return the corners of boxes in order, shape (M, 4, 2)."""
    cos, sin = np.cos(boxes.yaws), np.sin(boxes.yaws)
    axes = np.stack((np.stack((cos, sin), axis=1), np.stack((-sin, cos), axis=1)), axis=1)
    return np.asarray((_CORNERS * boxes.sizes[:, None, :2]) @ axes + boxes.centers[:, None, :2])


def _clipped(shape: Floats, by: Floats) -> Floats:
    """Return the part of a convex polygon inside another, both anticlockwise (Sutherland and Hodgman)."""
    for start, end in zip(by, np.roll(by, -1, axis=0), strict=True):
        if not len(shape):
            break
        (dx, dy), following = end - start, np.roll(shape, -1, axis=0)
        here, there = ((points - start) @ (-dy, dx) for points in (shape, following))
        crossing = (here >= 0) != (there >= 0)
        share = np.divide(here, here - there, out=np.zeros(len(here)), where=crossing)
        met = shape + share[:, None] * (following - shape)
        corners = np.stack((shape, met), axis=1).reshape(-1, 2)
        shape = corners[np.stack((here >= 0, crossing), axis=1).ravel()]
    return shape


def _area(shape: Floats) -> float:
    x, y = shape.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2) if len(shape) > 2 else 0.0
