"""A random scene in the making."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from seaclutter_cli.simulation.lidar.models import LIDARS
from seaclutter_cli.simulation.marine.scene import RecordingParams, Scene, SceneObjectParams, VesselParams
from seaclutter_cli.simulation.marine.sea import SeaParams

Place = tuple[float, float]

FRAMES = 50
_TRIES = 40
_BOATS = {
    # shape: length, width and height for each metre of length, highest speed
    "speedboat": ((4.5, 12.0), 0.31, 0.27, 9.0),
    "sailing_boat": ((5.0, 16.0), 0.33, 1.3, 4.0),
    "kayak": ((3.0, 5.5), 0.15, 0.23, 1.6),
    "cruise_ship": ((12.0, 60.0), 0.24, 0.28, 6.0),
    "barge": ((15.0, 60.0), 0.18, 0.1, 3.0),
    "cargo_ship": ((40.0, 120.0), 0.16, 0.2, 5.0),
}


class Plan:
    """Gathers the things of a scene; own vessel starts at the origin, and whatever is placed keeps clear of it.

    Parameters
    ----------
    rng : numpy.random.Generator
        What all chance comes from.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.objects: list[SceneObjectParams] = []
        self._taken: list[tuple[float, float, float]] = []

    def uniform(self, low: float, high: float) -> float:
        """Return a number between two, to the millimetre."""
        return round(float(self.rng.uniform(low, high)), 3)

    def log(self, low: float, high: float) -> float:
        """Return a number between two whose logarithm is uniform."""
        return round(float(np.exp(self.rng.uniform(np.log(low), np.log(high)))), 4)

    def count(self, low: int, high: int) -> int:
        """Return a whole number from one to another, both included."""
        return int(self.rng.integers(low, high + 1))

    def chance(self, share: float) -> bool:
        """Return whether something happens."""
        return bool(self.rng.random() < share)

    def pick(self, names: Sequence[str]) -> str:
        """Return one of several names."""
        return names[int(self.rng.integers(len(names)))]

    def around(self, nearest_m: float, farthest_m: float, *, even: bool = False) -> Place:
        """Return a place about the vessel; its range is uniform if even, else its logarithm is."""
        away = self.uniform(nearest_m, farthest_m) if even else self.log(nearest_m, farthest_m)
        bearing = self.uniform(-np.pi, np.pi)
        return away * float(np.cos(bearing)), away * float(np.sin(bearing))

    def add(self, shape: str, place: Place, size_m: Sequence[float], heading_deg: float = 0.0, **more: Any) -> None:
        """Add an object; a ``speed_ms`` leads it straight ahead."""
        x, y = (round(float(value), 3) for value in place)
        path, angle = [(x, y)], np.radians(heading_deg)
        if more.get("speed_ms"):
            path.append((round(x + 1000 * float(np.cos(angle)), 3), round(y + 1000 * float(np.sin(angle)), 3)))
        self.objects.append(
            SceneObjectParams(
                track_id=len(self.objects) + 1,
                shape=shape,
                size_m=tuple(round(float(size), 3) for size in size_m),
                path=tuple(path),
                heading_deg=round(float(heading_deg), 2),
                **({"class_name": shape.replace("_", " ")} | more),
            )
        )

    def fixed(self, shape: str, place: Place, size_m: Sequence[float], heading_deg: float = 0.0, **more: Any) -> None:
        """Add a part of the shore, an area to ignore."""
        self.add(shape, place, size_m, heading_deg, wave_response=0.0, ignore=True, **more)

    def boat(self, shape: str, longest_m: float = np.inf) -> tuple[float, float, float]:
        """Return a random length, width and height of a kind of boat, in metres."""
        (low, high), beam, height, _ = _BOATS[shape]
        length = self.log(low, max(low, min(high, longest_m)))
        return length, length * beam * self.uniform(0.85, 1.15), length * height * self.uniform(0.8, 1.2)

    def speed(self, shape: str) -> float:
        """Return a random speed of a kind of boat under way, in m/s."""
        return self.uniform(0.1, 1.0) * _BOATS[shape][3]

    def afloat(self, shapes: Sequence[str], place: Place, heading_deg: float, **more: Any) -> bool:
        """Add a boat of one of several kinds where there is room for it, and tell whether there was."""
        shape = self.pick(shapes)
        size = self.boat(shape, more.pop("longest_m", np.inf))
        if not self.claim(place, size[0] / 2 + 2 * more.get("speed_ms", 0.0)):
            return False
        self.add(shape, place, size, heading_deg, reflectivity=self.log(0.06, 0.8), **more)
        return True

    def claim(self, place: Place, radius_m: float) -> bool:
        """Take a circle of water, unless some of it is taken or too close to own vessel."""
        clear = max(7.0, 1.1 * radius_m + 4.0)
        if np.hypot(*place) < radius_m + clear:
            return False
        if any(np.hypot(place[0] - x, place[1] - y) < radius_m + radius for x, y, radius in self._taken):
            return False
        self._taken.append((place[0], place[1], radius_m))
        return True

    def scatter(self, shapes: Sequence[str], number: int, nearest_m: float, farthest_m: float, **more: Any) -> None:
        """Add boats at random places and headings, each at rest or under way; fewer where there is no room."""
        for _ in range(number):
            shape = self.pick(shapes)
            speed = self.speed(shape) if self.chance(more.get("moving", 0.5)) else 0.0
            for _ in range(_TRIES):
                if self.afloat([shape], self.around(nearest_m, farthest_m), self.uniform(-180, 180), speed_ms=speed):
                    break

    def buoy(self, place: Place) -> None:
        """Add a buoy, if there is room."""
        wide = self.log(0.4, 2.5)
        if self.claim(place, wide):
            self.add("buoy", place, (wide, wide, wide * self.uniform(0.9, 2.2)), reflectivity=self.log(0.08, 0.8))

    def scene(self, about: str, *, heading_deg: float = 0.0, speed_ms: float = 0.0, **sea: float) -> Scene:
        """Return the scene: what was gathered, with a random lidar on a random vessel on a random sea."""
        rotating = [name for name, lidar in LIDARS.items() if lidar.rotates]
        recording = RecordingParams(
            description=about, lidar=self.pick(rotating), frames=FRAMES, seed=int(self.rng.integers(2**31))
        )
        return Scene(recording, self._sea(**sea), self._vessel(heading_deg, speed_ms), tuple(self.objects))

    def _sea(self, **given: float) -> SeaParams:
        """Return a random sea, of the same kind in every class of scenes."""
        values: dict[str, Any] = {
            "sea_state": self.uniform(0.0, 3.0) if self.chance(0.8) else self.uniform(3.0, 5.0),
            "direction_deg": self.uniform(-180, 180),
            "reflectivity": self.log(0.0004, 0.01),
            "spikiness": self.log(0.1, 1.0),
            "foam_reflectivity": self.uniform(0.1, 0.4),
            "visibility_km": self.log(1.0, 20.0),
        }
        return SeaParams(**(values | given))

    def _vessel(self, heading_deg: float, speed_ms: float) -> VesselParams:
        length, angle = self.log(3.0, 14.0), np.radians(heading_deg)
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
