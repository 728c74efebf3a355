"""Rendering of lidar frames at sea or on land."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes, Receiver, Shots, extinction
from seaclutter_cli.simulation.marine.bodies import Bodies, PlacedBody, add_body_echoes, box_of
from seaclutter_cli.simulation.marine.motion import Pose, Ride
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.simulation.marine.shapes import SHAPES
from seaclutter_cli.simulation.marine.terrain import Ground, GroundParams, SeaTerrain, Terrain
from seaclutter_cli.simulation.marine.wide import WideSea, WideWater
from seaclutter_cli.truth import IGNORED, Boxes

Floats = NDArray[np.float64]

_DARK_REFLECTIVITY = 0.3


@dataclass(frozen=True)
class SimulatedFrame:
    """One frame of a simulated recording.

    ``points``, shape (N,), are `POINT` in firing order, in the frame of the lidar, with times in seconds from the start
    of the recording. ``shots`` are the column times the number of beams, plus the beam of each, ``distances_m`` its
    measured distance from the lens. ``boxes`` are own ship and every object within range of the lidar; of class
    ``ignore`` if it is not a target.
    """

    index: int
    points: NDArray[np.void]
    shots: NDArray[np.int64]
    distances_m: Floats
    boxes: Boxes


class Renderer:
    """Renderer of the frames of a scene, which are independent and can be rendered in any order."""

    def __init__(self, scene: Scene) -> None:
        recording, vessel = scene.recording, scene.vessel
        self.scene, self.lidar, self._seed = scene, scene.lidar, recording.seed
        self._bodies = Bodies(scene.objects)
        self._own = SHAPES["own_vessel"].scaled(vessel.length_m, vessel.width_m, vessel.lidar_height_m * 0.7)
        hulls = [(vessel.track, vessel.length_m, vessel.width_m)] if vessel.speed_ms else []
        moving = [item for item in scene.objects if item.speed_ms and item.shape != "bird"]
        hulls += [(item.track, float(item.size_m[0]), float(item.size_m[1])) for item in moving]
        self._terrain = _terrain(scene, hulls)
        mast = np.array([vessel.lidar_forward_m, 0.0, vessel.lidar_height_m])
        track, rocking = vessel.track, None
        noise, near_m, response = scene.noise or self.lidar.noise, 0.0, (0.0, 1.0)
        loss = extinction(scene.terrain.visibility_km)
        if isinstance(self._terrain, WideSea):
            physics, track, rocking = self._terrain.physics, vessel.smooth_track, self._terrain.rocking
            loss, near_m = self._terrain.weather.extinction, self._terrain.near_m
            response = physics.intensity_offset, physics.intensity_exponent
        self._ride = Ride(track, self._terrain.motion, vessel.wave_response, mast, rocking)
        self._receiver = Receiver(self.lidar, noise, loss, recording.dropout, near_m, response)

    def frame(self, index: int) -> SimulatedFrame:
        """Return a frame by its number."""
        rng = np.random.default_rng([self._seed, 1, index])
        start_s = index / self.lidar.rate_hz
        moment = self._terrain.at(start_s + 0.5 / self.lidar.rate_hz)
        times_s = start_s + self.lidar.times_s
        shots = self._shots(*self._ride.interpolate(times_s[:, 0]))
        placed = self._bodies.locate(moment, self._ride, self.lidar, start_s)

        echoes = Echoes.empty(len(shots))
        moment.add_echoes(shots, echoes, rng)
        hull = self._ride.hull(start_s)
        add_body_echoes(shots, echoes, np.arange(len(shots)), self._own, hull, (_DARK_REFLECTIVITY, IGNORED))
        self._bodies.add_echoes(shots, echoes, placed)
        if isinstance(moment, WideWater):
            moment.add_effects(shots, echoes, (self._bodies, placed), rng)
        return SimulatedFrame(index, *self._receiver.receive(echoes, times_s, rng), self._boxes(placed, hull, start_s))

    def _shots(self, positions: Floats, rotation: Floats) -> Shots:
        beams = len(self.lidar.elevations_deg)
        directions = (self.lidar.directions @ rotation.transpose(0, 2, 1)).reshape(-1, 3)
        azimuths = np.arctan2(directions[:, 1], directions[:, 0])
        origins = (self.lidar.lenses @ rotation.transpose(0, 2, 1)).reshape(-1, 3) + np.repeat(positions, beams, axis=0)
        return Shots(origins, directions, azimuths)

    def _boxes(self, placed: list[PlacedBody], hull: Pose, start_s: float) -> Boxes:
        """Return the boxes of all objects within range; own ship and the ground are areas to ignore."""
        lidar, reach_m = self._ride.lidar(start_s), self.lidar.max_range_m
        rows = [(IGNORED, "ignore", *box_of(self._own, hull, lidar, -np.inf))]
        if isinstance(self._terrain, Ground):
            rows.append((IGNORED, "ignore", *self._terrain.box(lidar, reach_m)))
        for item, mesh, one in zip(self.scene.objects, self._bodies.meshes, placed, strict=True):
            center, size, yaw = box_of(mesh, one.pose, one.lidar, one.base_m)
            if np.hypot(center[0], center[1]) - np.hypot(size[0], size[1]) / 2 <= reach_m:
                kind = "ignore" if item.ignore else item.class_name or item.shape
                rows.append((item.track_id, kind, center, size, yaw))
        tracks, kinds, centers, sizes, yaws = zip(*rows, strict=True)
        return Boxes(tuple(str(track) for track in tracks), kinds, np.array(centers), np.array(sizes), np.array(yaws))


def _terrain(scene: Scene, hulls: Sequence[Any]) -> Terrain:
    """Return the sea or the ground of a scene; hulls that leave a wake come with their path, length and width."""
    params, seed = scene.terrain, scene.recording.seed
    if isinstance(params, GroundParams):
        return Ground(params, seed)
    if scene.physics:
        return WideSea(scene, scene.physics, params, hulls)
    return SeaTerrain(params, hulls, scene.vessel.length_m, seed)
