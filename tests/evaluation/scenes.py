"""Synthetic frames: lumps of points at known positions and boxes around them."""

from types import SimpleNamespace

import numpy as np

from seaclutter_cli.cloud import from_array
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.truth import Boxes

POINT = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")]


def lump(x, count=10, y=0.0, spread=0.1):
    """Return points close to each other in a row on the water, shape (count, 3)."""
    points = np.zeros((count, 3))
    points[:, 0], points[:, 1] = x + spread * np.arange(count), y
    return points


def frame_of(*lumps, index=0):
    xyz = np.concatenate(lumps) if lumps else np.empty((0, 3))
    points = np.zeros(len(xyz), POINT)
    for number, axis in enumerate("xyz"):
        points[axis] = xyz[:, number]
    points["intensity"] = 100
    return Frame(from_array(points), index=index)


def result_of(frame, removed=()):
    reason = np.zeros(frame.size, np.uint8)
    reason[list(removed)] = Reason.OUTLIER
    return FilterResult(frame, reason)


def boxes(*rows):
    """Return boxes of width and height 2 m; a row is x with a length of 2 m, or x and length."""
    rows = [row if isinstance(row, tuple) else (row, 2.0) for row in rows]
    centers = np.array([[x, 0, 0] for x, _ in rows], float).reshape(-1, 3)
    sizes = np.array([[length, 2, 2] for _, length in rows], float).reshape(-1, 3)
    names = tuple(str(number) for number in range(len(rows)))
    return Boxes(names, ("boat",) * len(rows), centers, sizes, np.zeros(len(rows)))


def told(counts, rings=None, scene=None, water=None):
    """Return what a result tells apart from the reasons of its points."""
    return SimpleNamespace(counts=counts, rings=rings, scene=scene, water=water)
