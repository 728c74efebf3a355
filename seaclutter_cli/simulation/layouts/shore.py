"""Shores: chains of walls or banks along a line."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from seaclutter_cli.simulation.layouts.plan import Place, Plan

_FAR_M = 60.0


@dataclass(frozen=True)
class Line:
    """The edge of the water on one side.

    Parameters
    ----------
    aside_m : float
        How far from the axis the edge is.
    axis_deg : float
        Direction of the axis, counter-clockwise from the world's x.
    side : int
        1 where the land is to the left of the axis, -1 to the right.
    bend_m : float
        Radius of the axis, which bends to the left; negative: to the right; infinite: it is straight.
    wiggle : callable
        How much farther the edge is at some way along the axis, in metres.
    """

    aside_m: float
    axis_deg: float = 0.0
    side: int = 1
    bend_m: float = np.inf
    wiggle: Callable[[float], float] = lambda _: 0.0

    def at(self, along_m: float, beyond_m: float = 0.0) -> Place:
        """Return the place at some way along the axis, and beyond the edge of the water."""
        offset = self.side * (self.aside_m + self.wiggle(along_m) + beyond_m)
        turned = along_m / self.bend_m
        if np.isinf(self.bend_m):
            x, y = along_m, offset
        else:
            x = (self.bend_m - offset) * np.sin(turned)
            y = self.bend_m - (self.bend_m - offset) * np.cos(turned)
        cos, sin = np.cos(np.radians(self.axis_deg)), np.sin(np.radians(self.axis_deg))
        return float(cos * x - sin * y), float(sin * x + cos * y)

    def piece(self, start_m: float, end_m: float, depth_m: float) -> tuple[Place, float, float]:
        """Return middle, length and heading of what stands between two ways along the edge; land is to its left."""
        one, other = np.array(self.at(start_m)), np.array(self.at(end_m))
        ahead = (other - one) * self.side
        length = float(np.hypot(*ahead))
        inland = np.array([-ahead[1], ahead[0]]) / length
        middle = (one + other) / 2 + inland * depth_m / 2
        return (float(middle[0]), float(middle[1])), length, float(np.degrees(np.arctan2(ahead[1], ahead[0])))


def shore(
    plan: Plan, line: Line, extent_m: tuple[float, float], kind: str, height_m: float, *, houses: float = 0.0
) -> None:
    """Add walls or banks along the edge of the water, some with a house behind.

    Parameters
    ----------
    plan : Plan
        Grows by them.
    line : Line
        The edge.
    extent_m : tuple of (float, float)
        From where to where along the axis.
    kind : str
        A shape: ``quay_wall`` or ``bank``.
    height_m : float
        Height above the water.
    houses : float
        Share of the pieces with a house.
    """
    # Dark walls keep the number of points from telling the classes apart; dark and far ones would not be seen.
    bright = plan.log(0.015 if line.aside_m < _FAR_M else 0.12, 0.6)
    step = 12.0 if kind == "bank" or not np.isinf(line.bend_m) else 40.0
    depth = height_m * plan.uniform(1.0, 3.0) + 3 if kind == "bank" else plan.uniform(1.0, 6.0)
    pieces = max(1, round((extent_m[1] - extent_m[0]) / step))
    edges = np.linspace(*extent_m, pieces + 1).tolist()
    for start, end in pairwise(edges):
        middle, length, heading = line.piece(start, end, depth)
        height = height_m * (plan.uniform(0.8, 1.2) if kind == "bank" else 1.0)
        plan.fixed(kind, middle, (length + 0.6, depth, height), heading, reflectivity=bright)
        if plan.chance(houses):
            place, wide, turned = line.piece(start, start + (end - start) * plan.uniform(0.3, 0.9), 2 * depth + 16)
            size = wide, plan.uniform(6, 14), height_m + plan.uniform(3, 10)
            plan.fixed("building", place, size, turned, reflectivity=plan.log(0.1, 0.5))


def moor(plan: Plan, line: Line, extent_m: tuple[float, float], kinds: tuple[str, ...], taken: float) -> None:
    """Add boats that lie along the edge of the water, where ``taken`` is the share of it that they take."""
    along = extent_m[0] + plan.uniform(0, 5)
    while True:
        shape = plan.pick(kinds)
        size = plan.boat(shape, 30.0)
        if along + size[0] > extent_m[1]:
            return
        if plan.chance(taken):
            heading = line.piece(along, along + size[0], 1.0)[2] + 180 * plan.count(0, 1) + plan.uniform(-2, 2)
            place = line.at(along + size[0] / 2, -size[1] / 2 - plan.uniform(0.2, 0.8))
            if np.hypot(*place) > size[0] / 2 + 5:
                plan.add(shape, place, size, heading, reflectivity=plan.log(0.03, 0.8))
        along += size[0] + plan.uniform(0.5, 4.0)
