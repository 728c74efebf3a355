"""A builder of random scenes; lines of walls, banks and moored boats along shores."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Rng
from seaclutter_cli.simulation.marine.scene import RecordingParams, Scene, SceneObjectParams, VesselParams
from seaclutter_cli.simulation.marine.sea import SeaParams

Position = tuple[float, float]
Extent = tuple[float, float]
"""Start and end along the axis of a line."""

FRAMES = 50
_TRIES = 40
_FAR_M = 60.0
_LIDARS = ("RS-LiDAR-32", "RS-LiDAR-16", "VLP-16", "OS1-64", "OS1-128")  # one more would change the scenes of all seeds
_BOATS = {
    # shape: range of lengths, width and height per metre of length, top speed
    "speedboat": ((4.5, 12.0), 0.31, 0.27, 9.0),
    "sailing_boat": ((5.0, 16.0), 0.33, 1.3, 4.0),
    "kayak": ((3.0, 5.5), 0.15, 0.23, 1.6),
    "rhib": ((4.5, 9.0), 0.36, 0.25, 12.0),
    "cruise_ship": ((12.0, 60.0), 0.24, 0.28, 6.0),
    "barge": ((15.0, 60.0), 0.18, 0.1, 3.0),
    "cargo_ship": ((40.0, 120.0), 0.16, 0.2, 5.0),
}


def rotated(x: float, y: float, angle_deg: float) -> Position:
    """Return a position turned counter-clockwise around the origin."""
    cos, sin = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return float(cos * x - sin * y), float(sin * x + cos * y)


class Plan:
    """Builder of a random scene; own ship starts at the origin, and boats and buoys keep clear of it."""

    def __init__(self, rng: Rng) -> None:
        self.rng = rng
        self.objects: list[SceneObjectParams] = []
        self._reserved: list[tuple[float, float, float]] = []

    def uniform(self, low: float, high: float) -> float:
        """Return a random number from a uniform distribution, rounded to three decimals."""
        return round(float(self.rng.uniform(low, high)), 3)

    def log_uniform(self, low: float, high: float) -> float:
        """Return a random number from a log-uniform distribution, rounded to four decimals."""
        return round(float(np.exp(self.rng.uniform(np.log(low), np.log(high)))), 4)

    def integer(self, low: int, high: int) -> int:
        """Return a random whole number from ``low`` to ``high``, both included."""
        return int(self.rng.integers(low, high + 1))

    def bernoulli(self, probability: float) -> bool:
        """Return True with a given probability."""
        return bool(self.rng.random() < probability)

    def choice(self, names: Sequence[str]) -> str:
        """Return one of several names at random."""
        return names[int(self.rng.integers(len(names)))]

    def position_around(self, nearest_m: float, farthest_m: float, *, even: bool = False) -> Position:
        """Return a random position around own ship; its range is uniform if ``even``, log-uniform otherwise."""
        distance = self.uniform(nearest_m, farthest_m) if even else self.log_uniform(nearest_m, farthest_m)
        bearing = self.uniform(-np.pi, np.pi)
        return distance * float(np.cos(bearing)), distance * float(np.sin(bearing))

    def add(
        self, shape: str, position: Position, size_m: Sequence[float], heading_deg: float = 0.0, **more: Any
    ) -> None:
        """Add an object; with a ``speed_ms``, it moves straight ahead."""
        x, y = (round(float(value), 3) for value in position)
        path, angle = [(x, y)], np.radians(heading_deg)
        if more.get("speed_ms"):
            path.append((round(x + 1000 * float(np.cos(angle)), 3), round(y + 1000 * float(np.sin(angle)), 3)))
        size, number = tuple(round(float(side), 3) for side in size_m), len(self.objects) + 1
        more.setdefault("class_name", shape.replace("_", " "))
        more["heading_deg"] = round(float(heading_deg), 2)
        self.objects.append(SceneObjectParams(track_id=number, shape=shape, size_m=size, path=tuple(path), **more))

    def add_fixed(
        self, shape: str, position: Position, size_m: Sequence[float], heading_deg: float = 0.0, **more: Any
    ) -> None:
        """Add a part of the shore as an area to ignore."""
        self.add(shape, position, size_m, heading_deg, wave_response=0.0, ignore=True, **more)

    def boat_size(self, shape: str, longest_m: float = np.inf) -> tuple[float, float, float]:
        """Return a random length, width and height of a kind of boat, in metres."""
        (low, high), beam, height, _ = _BOATS[shape]
        length = self.log_uniform(low, max(low, min(high, longest_m)))
        return length, length * beam * self.uniform(0.85, 1.15), length * height * self.uniform(0.8, 1.2)

    def add_boat(self, shapes: Sequence[str], position: Position, heading_deg: float, **more: Any) -> bool:
        """Add a boat of a random kind if there is room for it, and return whether there was."""
        shape = self.choice(shapes)
        size = self.boat_size(shape, more.pop("longest_m", np.inf))
        has_room = self.reserve(position, size[0] / 2 + 2 * more.get("speed_ms", 0.0))
        if has_room:
            self.add(shape, position, size, heading_deg, reflectivity=self.log_uniform(0.06, 0.8), **more)
        return has_room

    def reserve(self, position: Position, radius_m: float) -> bool:
        """Reserve a circle of water; return False if it overlaps a reserved one or is too close to own ship."""
        circles = (*self._reserved, (0.0, 0.0, max(7.0, 1.1 * radius_m + 4.0)))  # the last one is own ship's
        is_free = all(np.hypot(position[0] - x, position[1] - y) >= radius_m + other for x, y, other in circles)
        if is_free:
            self._reserved.append((*position, radius_m))
        return is_free

    def extend(self, objects: Sequence[SceneObjectParams]) -> None:
        """Add the objects of another scene, and reserve the water around them."""
        self.objects += objects
        for item in objects:
            length, width, _ = item.size_m
            leg, pieces = item.track.legs[0], max(1, round(length / width))
            for along in (length / 2 * (np.arange(1, 2 * pieces, 2) / pieces - 1)).tolist():
                x, y = leg.x_m + along * np.cos(leg.heading_rad), leg.y_m + along * np.sin(leg.heading_rad)
                self._reserved.append((float(x), float(y), width))

    def scatter(self, shapes: Sequence[str], count: int, nearest_m: float, farthest_m: float, **more: Any) -> None:
        """Add boats at random positions and headings, each at rest or under way; fewer if room runs out."""
        for _ in range(count):
            shape = self.choice(shapes)
            speed = self.uniform(0.1, 1.0) * _BOATS[shape][3] if self.bernoulli(more.get("moving", 0.5)) else 0.0
            for _ in range(_TRIES):
                position, heading = self.position_around(nearest_m, farthest_m), self.uniform(-180, 180)
                if self.add_boat([shape], position, heading, speed_ms=speed):
                    break

    def add_buoy(self, position: Position) -> None:
        """Add a buoy if there is room."""
        wide = self.log_uniform(0.4, 2.5)
        if self.reserve(position, wide):
            size = wide, wide, wide * self.uniform(0.9, 2.2)
            self.add("buoy", position, size, reflectivity=self.log_uniform(0.08, 0.8))

    def scene(self, description: str, *, heading_deg: float = 0.0, speed_ms: float = 0.0, **sea: float) -> Scene:
        """Return the objects added so far as a scene, with a random lidar on a random vessel on a random sea."""
        lidar, seed = self.choice(_LIDARS), int(self.rng.integers(2**31))
        recording = RecordingParams(description=description, lidar=lidar, frames=FRAMES, seed=seed)
        # The distribution of seas does not depend on the class of the scene.
        values: dict[str, Any] = {
            "sea_state": self.uniform(0.0, 3.0) if self.bernoulli(0.8) else self.uniform(3.0, 5.0),
            "direction_deg": self.uniform(-180, 180),
            "reflectivity": self.log_uniform(0.0004, 0.01),
            "spikiness": self.log_uniform(0.1, 1.0),
            "foam_reflectivity": self.uniform(0.1, 0.4),
            "visibility_km": self.log_uniform(1.0, 20.0),
        }
        return Scene(recording, SeaParams(**(values | sea)), self._vessel(heading_deg, speed_ms), tuple(self.objects))

    def _vessel(self, heading_deg: float, speed_ms: float) -> VesselParams:
        length, angle = self.log_uniform(3.0, 14.0), np.radians(heading_deg)
        ahead = round(1000 * float(np.cos(angle)), 3), round(1000 * float(np.sin(angle)), 3)
        return VesselParams(
            path=((0.0, 0.0), ahead) if speed_ms else ((0.0, 0.0),),
            speed_ms=round(speed_ms, 2),
            heading_deg=round(heading_deg, 2),
            length_m=round(length, 2),
            width_m=round(length * self.uniform(0.28, 0.42), 2),
            lidar_height_m=round(1.2 + 0.25 * length * self.uniform(0.3, 1.3), 2),
            lidar_forward_m=round(length * self.uniform(-0.1, 0.42), 2),
            wave_response=self.uniform(0.2, 0.9),
        )


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
        return rotated(x, y, self.axis_deg)

    def segment(self, start_m: float, end_m: float, depth_m: float) -> tuple[Position, float, float]:
        """Return centre, length and heading of an object between two distances along the axis; land is to its left."""
        first, second = np.array(self.at(start_m)), np.array(self.at(end_m))
        ahead = (second - first) * self.side
        length = float(np.hypot(*ahead))
        inland = np.array([-ahead[1], ahead[0]]) / length
        middle = (first + second) / 2 + inland * depth_m / 2
        return (float(middle[0]), float(middle[1])), length, float(np.degrees(np.arctan2(ahead[1], ahead[0])))


def shore(plan: Plan, line: Line, extent_m: Extent, kind: str, height_m: float, *, houses: float = 0.0) -> None:
    """Add walls or banks, by their shape, along the edge of the water; a share of segments has a house behind it."""
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
            corner = start + (end - start) * plan.uniform(0.3, 0.9)
            position, wide, rotation = line.segment(start, corner, 2 * depth + 16)
            size = wide, plan.uniform(6, 14), height_m + plan.uniform(3, 10)
            plan.add_fixed("building", position, size, rotation, reflectivity=plan.log_uniform(0.1, 0.5))


def moor(plan: Plan, line: Line, extent_m: Extent, kinds: tuple[str, ...], occupancy: float) -> None:
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
