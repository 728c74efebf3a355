"""One turn of a lidar at sea."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.bodies import Pose, box_of, meet_body
from seaclutter_cli.simulation.echoes import Echoes, Shots
from seaclutter_cli.simulation.lidar import LIDARS
from seaclutter_cli.simulation.motion import rotations
from seaclutter_cli.simulation.rays import meet_box
from seaclutter_cli.simulation.scene import MovingParams, ObjectParams, Scene
from seaclutter_cli.simulation.sea import Sea, Surface
from seaclutter_cli.simulation.shapes import SHAPES
from seaclutter_cli.simulation.wake import Wake
from seaclutter_cli.simulation.water import Water
from seaclutter_cli.truth import CLUTTER, IGNORED, Boxes

Floats = NDArray[np.float64]

POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("intensity", "<f4"),
        ("ring", "<u2"),
        ("timestamp", "<f8"),
        ("label", "<u2"),
    ]
)
"""A simulated point: the fields of RoboSense's driver and the truth, as in `seaclutter_cli.truth`."""

_KNOTS = 6
_DARK_REFLECTIVITY = 0.3


@dataclass(frozen=True)
class Turn:
    """One frame of a simulated recording.

    Parameters
    ----------
    index : int
        Its number.
    points : ndarray, shape (N,), `POINT`
        Echoes in the order of firing, in the frame of the lidar; times in seconds from the start of the recording.
    shots : ndarray, shape (N,), int64
        Which shot of the turn each is of: its column times the number of beams, and its beam.
    distances_m : ndarray, shape (N,), float64
        Distance that was measured, from the lens.
    boxes : Boxes
        Own vessel and what else is within the lidar's range; of class ``ignore`` where it is no target.
    """

    index: int
    points: NDArray[np.void]
    shots: NDArray[np.int64]
    distances_m: Floats
    boxes: Boxes


class Renderer:
    r"""Makes the turns of a scene, each by itself, so that they can be made in any order.

    Parameters
    ----------
    scene : Scene
        What there is.

    Notes
    -----
    The intensity is Eq. 2 of S0 with a linear receiver:
    :math:`I = G \, \rho \cos\theta \, e^{-2 \alpha R} / R^2`, rounded to a whole number and cut at 255, with :math:`G`
    such that a surface of reflectivity 0.1 gives 1 at the range that the maker states for it. An echo is lost where,
    with the noise of the receiver, it would be below 1.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.lidar = LIDARS[scene.recording.lidar]
        self._seed = scene.recording.seed
        self._sea = Sea(scene.sea, np.random.default_rng([self._seed, 0]))
        vessel = scene.vessel
        self._swell = self._sea.swell(2 * vessel.length_m)
        self._own = SHAPES["own_vessel"]().scaled(vessel.length_m, vessel.width_m, vessel.lidar_height_m * 0.7)
        self._meshes = [SHAPES[item.shape]().scaled(*(float(size) for size in item.size_m)) for item in scene.objects]
        hulls: list[tuple[MovingParams, float, float]] = [(vessel, vessel.length_m, vessel.width_m)]
        hulls += [(item, float(item.size_m[0]), float(item.size_m[1])) for item in scene.objects]
        self._wakes = [
            Wake(item.track, length, width, scene.sea.foam_life_s) for item, length, width in hulls if item.speed_ms
        ]

    def turn(self, index: int) -> Turn:
        """Return a turn by its number."""
        rng = np.random.default_rng([self._seed, 1, index])
        start_s = index / self.lidar.rate_hz
        middle_s = start_s + 0.5 / self.lidar.rate_hz
        surface = self._sea.at(middle_s)
        times_s = start_s + self.lidar.times_s
        places, turns = self._ride(times_s[:, 0])
        shots = self._shots(places, turns)

        echoes = Echoes.none(len(shots))
        water = Water(surface, self.scene.sea, self._wakes, time_s=middle_s, seed=self._seed)
        water.meet(shots, echoes, rng)
        self._meet_bodies(shots, echoes, surface, start_s)
        self._meet_spray(shots, echoes, middle_s, rng)
        return Turn(index, *self._receive(echoes, times_s, rng), self._boxes(surface, start_s))

    def _ride(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return place and attitude of the lidar at some times, shapes (T, 3) and (T, 3, 3)."""
        vessel = self.scene.vessel
        knots = np.linspace(times_s[0], times_s[-1] + 1e-9, _KNOTS)
        x, y, yaw = vessel.track.at(knots)
        waves = vessel.sway * self._swell.at(x, y, knots)
        pitch = -np.arctan(waves[1] * np.cos(yaw) + waves[2] * np.sin(yaw))
        roll = np.arctan(waves[2] * np.cos(yaw) - waves[1] * np.sin(yaw))
        turns = rotations(yaw, pitch, roll)
        mast = np.array([vessel.lidar_forward_m, 0.0, vessel.lidar_height_m])
        places = np.stack((x, y, waves[0]), axis=1) + turns @ mast
        # Between knots 20 ms apart all of it is a straight line; matrices stay orthogonal to 1e-6.
        columns = [np.interp(times_s, knots, column) for column in np.concatenate((places, turns.reshape(-1, 9)), 1).T]
        out = np.stack(columns, axis=1)
        return out[:, :3], out[:, 3:].reshape(-1, 3, 3)

    def _shots(self, places: Floats, turns: Floats) -> Shots:
        beams = len(self.lidar.elevations_deg)
        directions = (self.lidar.directions @ turns.transpose(0, 2, 1)).reshape(-1, 3)
        azimuths = np.arctan2(directions[:, 1], directions[:, 0])
        origins = (self.lidar.lenses @ turns.transpose(0, 2, 1)).reshape(-1, 3) + np.repeat(places, beams, axis=0)
        return Shots(origins, directions, azimuths)

    def _pose(self, item: ObjectParams, surface: Surface, start_s: float) -> tuple[Pose, Pose, float]:
        """Return the pose of an object when the lidar looks at it, that of the lidar then, and the sea's height."""
        time_s = start_s
        for _ in range(2):
            lidar = self._lidar_pose(time_s)
            x, y, heading = item.track.at(np.array([time_s]))
            offset = (np.array([x[0], y[0], 0.0]) - lidar.place) @ lidar.turn
            turned = np.arctan2(offset[1], offset[0]) / self.lidar.step_rad % self.lidar.columns
            time_s = start_s + turned / (self.lidar.columns * self.lidar.rate_hz)
        sea_m = float(surface.height(x, y)[0])
        slope_x, slope_y = (float(slope[0]) for slope in surface.slope(x, y))
        yaw = float(heading[0])
        small = item.sway * min(1.0, 6.0 / float(item.size_m[0]))
        pitch = -small * np.arctan(slope_x * np.cos(yaw) + slope_y * np.sin(yaw))
        roll = small * np.arctan(slope_y * np.cos(yaw) - slope_x * np.sin(yaw))
        return Pose.of(np.array([x[0], y[0], small * sea_m]), yaw=yaw, pitch=pitch, roll=roll), lidar, sea_m

    def _own_pose(self, start_s: float) -> tuple[Pose, Pose, float]:
        """Return the pose of own hull, that of the lidar, and a height below both."""
        lidar = self._lidar_pose(start_s)
        mast = np.array([self.scene.vessel.lidar_forward_m, 0.0, self.scene.vessel.lidar_height_m])
        return Pose(lidar.place - lidar.turn @ mast, lidar.turn), lidar, -np.inf

    def _lidar_pose(self, time_s: float) -> Pose:
        places, turns = self._ride(np.array([time_s]))
        return Pose(places[0], turns[0])

    def _meet_bodies(self, shots: Shots, echoes: Echoes, surface: Surface, start_s: float) -> None:
        hull, _, _ = self._own_pose(start_s)
        meet_body(shots, echoes, self._own, hull, reflectivity=_DARK_REFLECTIVITY, label=IGNORED)
        for item, mesh in zip(self.scene.objects, self._meshes, strict=True):
            pose, _, _ = self._pose(item, surface, start_s)
            label = IGNORED if item.ignore else item.track_id
            meet_body(shots, echoes, mesh, pose, reflectivity=item.reflectivity, label=label)

    def _meet_spray(self, shots: Shots, echoes: Echoes, time_s: float, rng: np.random.Generator) -> None:
        """Add droplets: along a shot through spray, the chance to meet one grows with the way."""
        for wake in self._wakes:
            spray = wake.spray(time_s)
            if spray is None:
                continue
            corners, (x, y, heading), density = spray
            pose = Pose.of(np.array([x, y, 0.0]), yaw=heading)
            offset = pose.place[:2] - shots.origins[0, :2]
            away, reach = float(np.hypot(*offset)), float(np.abs(corners).max()) + 1
            half = np.pi if away <= reach else float(np.arcsin(reach / away))
            near = shots.towards(float(np.arctan2(offset[1], offset[0])), half)
            origins = (shots.origins[near] - pose.place) @ pose.turn
            begin, end = meet_box(origins, shots.directions[near] @ pose.turn, *corners)
            way = np.clip(end - begin, 0.0, None)
            met = np.flatnonzero(rng.random(len(near)) < 1 - np.exp(-density * way))
            distance = begin[met] + rng.random(len(met)) * way[met]
            bright = self.scene.sea.foam_reflectivity * rng.standard_exponential(len(met))
            echoes.add(near[met], distance, bright, CLUTTER)

    def _receive(
        self, echoes: Echoes, times_s: Floats, rng: np.random.Generator
    ) -> tuple[NDArray[np.void], NDArray[np.int64], Floats]:
        """Return the points that the receiver makes of the echoes, which shots they are of, and their distances."""
        lidar, recording = self.lidar, self.scene.recording
        some = np.flatnonzero(echoes.reflectance > 0)
        range_m = echoes.range_m[some]
        power = lidar.gain * echoes.reflectance[some] / np.maximum(range_m, lidar.min_range_m) ** 2
        power *= np.exp(-2 * self.scene.sea.extinction * range_m)
        power += 0.25 * rng.standard_normal(len(some)) * np.sqrt(1 + 0.05 * power)
        kept = (power >= 1) & (range_m >= lidar.min_range_m) & (range_m <= lidar.max_range_m)
        kept &= rng.random(len(some)) >= recording.dropout
        measured = range_m[kept] + lidar.range_noise_m * rng.standard_normal(int(kept.sum()))
        chosen = some[kept]
        points = np.empty(len(chosen), POINT)
        place = lidar.lenses.reshape(-1, 3)[chosen] + lidar.directions.reshape(-1, 3)[chosen] * measured[:, None]
        points["x"], points["y"], points["z"] = place.T
        points["intensity"] = np.minimum(np.floor(power[kept]), 255.0)
        points["ring"] = lidar.rings[chosen % len(lidar.elevations_deg)]
        points["timestamp"] = times_s.reshape(-1)[chosen]
        points["label"] = echoes.label[chosen]
        return points, chosen, measured

    def _boxes(self, surface: Surface, start_s: float) -> Boxes:
        """Return the boxes of what is within range, own vessel among them as an area to ignore."""
        rows = [(IGNORED, "ignore", *box_of(self._own, *self._own_pose(start_s)))]
        for item, mesh in zip(self.scene.objects, self._meshes, strict=True):
            center, size, yaw = box_of(mesh, *self._pose(item, surface, start_s))
            if np.hypot(center[0], center[1]) - np.hypot(size[0], size[1]) / 2 <= self.lidar.max_range_m:
                kind = "ignore" if item.ignore else item.class_name or item.shape
                rows.append((item.track_id, kind, center, size, yaw))
        tracks, kinds, centers, sizes, yaws = zip(*rows, strict=True)
        return Boxes(tuple(str(track) for track in tracks), kinds, np.array(centers), np.array(sizes), np.array(yaws))
