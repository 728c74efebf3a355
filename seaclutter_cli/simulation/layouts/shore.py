"""Shores: chains of walls or banks along a line."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from seaclutter_cli.simulation.layouts.plan import Plan, Position

_FAR_M = 60.0


@dataclass(frozen=True)
class Line:
    """The edge of the water on one side of an axis, whose direction is counter-clockwise from the world's x.

    ``side`` is 1 if the land is to the left of the axis, -1 if it is to the right. The radius of the axis, ``bend_m``,
    is positive for a bend to the left, infinite for a straight axis. The offset of the edge from the axis varies by
    ``wiggle`` with the distance along it.
    """

    offset_m: float
    axis_deg: float = 0.0
    side: int = 1
    bend_m: float = np.inf
    wiggle: Callable[[float], float] = lambda _: 0.0

    def at(self, along_m: float, beyond_m: float = 0.0) -> Position:
        """Return the position at a distance along the axis and a distance inland of the edge."""
        offset = self.side * (self.offset_m + self.wiggle(along_m) + beyond_m)
        rotation = along_m / self.bend_m
        if np.isinf(self.bend_m):
            x, y = along_m, offset
        else:
            x = (self.bend_m - offset) * np.sin(rotation)
            y = self.bend_m - (self.bend_m - offset) * np.cos(rotation)
        cos, sin = np.cos(np.radians(self.axis_deg)), np.sin(np.radians(self.axis_deg))
        return float(cos * x - sin * y), float(sin * x + cos * y)

    def segment(self, start_m: float, end_m: float, depth_m: float) -> tuple[Position, float, float]:
        """Return centre, length and heading of an object between two distances along the axis; land is to its left."""
        first, second = np.array(self.at(start_m)), np.array(self.at(end_m))
        ahead = (second - first) * self.side
        length = float(np.hypot(*ahead))
        inland = np.array([-ahead[1], ahead[0]]) / length
        middle = (first + second) / 2 + inland * depth_m / 2
        return (float(middle[0]), float(middle[1])), length, float(np.degrees(np.arctan2(ahead[1], ahead[0])))


def shore(
    plan: Plan, line: Line, extent_m: tuple[float, float], kind: str, height_m: float, *, houses: float = 0.0
) -> None:
    """Add walls or banks, by their shape, along the edge of the water; a share of the segments has a house behind it.

    ``extent_m`` is start and end along the axis.
    """
    # Near walls can be dark; otherwise the number of points would separate the classes. Dark far walls are invisible.
    reflectivity = plan.log_uniform(0.015 if line.offset_m < _FAR_M else 0.12, 0.6)
    step = 12.0 if kind == "bank" or not np.isinf(line.bend_m) else 40.0
    depth = height_m * plan.uniform(1.0, 3.0) + 3 if kind == "bank" else plan.uniform(1.0, 6.0)
    pieces = max(1, round((extent_m[1] - extent_m[0]) / step))
    edges = np.linspace(*extent_m, pieces + 1).tolist()
    for start, end in pairwise(edges):
        middle, length, heading = line.segment(start, end, depth)
        height = height_m * (plan.uniform(0.8, 1.2) if kind == "bank" else 1.0)
        plan.add_fixed(kind, middle, (length + 0.6, depth, height), heading, reflectivity=reflectivity)
        if plan.bernoulli(houses):
            position, wide, rotation = line.segment(
                start, start + (end - start) * plan.uniform(0.3, 0.9), 2 * depth + 16
            )
            size = wide, plan.uniform(6, 14), height_m + plan.uniform(3, 10)
            plan.add_fixed("building", position, size, rotation, reflectivity=plan.log_uniform(0.1, 0.5))


def moor(plan: Plan, line: Line, extent_m: tuple[float, float], kinds: tuple[str, ...], occupancy: float) -> None:
    """Add boats along the edge of the water, one at each berth with probability ``occupancy``."""
    along = extent_m[0] + plan.uniform(0, 5)
    while True:
        shape = plan.choice(kinds)
        size = plan.boat_size(shape, 30.0)
        if along + size[0] > extent_m[1]:
            return
        if plan.bernoulli(occupancy):
            heading = line.segment(along, along + size[0], 1.0)[2] + 180 * plan.integer(0, 1) + plan.uniform(-2, 2)
            position = line.at(along + size[0] / 2, -size[1] / 2 - plan.uniform(0.2, 0.8))
            if np.hypot(*position) > size[0] / 2 + 5:
                plan.add(shape, position, size, heading, reflectivity=plan.log_uniform(0.03, 0.8))
        along += size[0] + plan.uniform(0.5, 4.0)
