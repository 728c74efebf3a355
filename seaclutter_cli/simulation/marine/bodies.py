"""Vessels, buoys and walls: where they are, what shots meet of them, and their boxes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes, Shots
from seaclutter_cli.simulation.lidar.models import Lidar
from seaclutter_cli.simulation.marine.motion import Pose, Tracks, rotations
from seaclutter_cli.simulation.marine.rays import meet_box, meet_triangles
from seaclutter_cli.simulation.marine.ride import Ride
from seaclutter_cli.simulation.marine.scene import SceneObjectParams
from seaclutter_cli.simulation.marine.shapes import SHAPES, Mesh
from seaclutter_cli.simulation.marine.terrain import Moment
from seaclutter_cli.truth import IGNORED

Floats = NDArray[np.float64]

_MARGIN_M = 0.05
_CORNERS = np.array(list(np.ndindex(2, 2, 2)))
_STEEP_M = 6.0


@dataclass(frozen=True)
class Placed:
    """A body in one turn.

    Parameters
    ----------
    pose, lidar : Pose
        Where it is when the lidar looks at it, and where the lidar is then.
    base_m : float
        Height of the sea or the ground there.
    """

    pose: Pose
    lidar: Pose
    base_m: float


class Bodies:
    """What there is in a scene, O things.

    Parameters
    ----------
    objects : sequence of SceneObjectParams
        The things.
    """

    def __init__(self, objects: Sequence[SceneObjectParams]) -> None:
        self.objects = objects
        self.meshes = [SHAPES[item.shape]().scaled(*(float(size) for size in item.size_m)) for item in objects]
        self._tracks = Tracks([item.track for item in objects])
        # What is longer than a wave follows it less.
        self._follow = np.array([item.wave_response * min(1.0, _STEEP_M / float(item.size_m[0])) for item in objects])

    def placed(self, moment: Moment, ride: Ride, lidar: Lidar, start_s: float) -> list[Placed]:
        """Return where each is in the turn that starts at a time."""
        if not self.objects:
            return []
        times_s = np.full(len(self.objects), start_s)
        for _ in range(2):
            places, turns = ride.at(times_s)
            x, y, heading = self._tracks.at(times_s)
            offset = np.stack((x, y, np.zeros_like(x)), axis=1) - places
            seen = np.einsum("oi,oij->oj", offset, turns)
            times_s = start_s + lidar.looks_s(np.arctan2(seen[:, 1], seen[:, 0]))
        height, slope_x, slope_y = moment.lie(x, y)
        pitch = -self._follow * np.arctan(slope_x * np.cos(heading) + slope_y * np.sin(heading))
        roll = self._follow * np.arctan(slope_y * np.cos(heading) - slope_x * np.sin(heading))
        tilted = rotations(heading, pitch, roll)
        where = np.stack((x, y, self._follow * height), axis=1)
        return [
            Placed(Pose(where[k], tilted[k]), Pose(places[k], turns[k]), float(height[k]))
            for k in range(len(self.objects))
        ]

    def meet(self, shots: Shots, echoes: Echoes, placed: Sequence[Placed]) -> None:
        """Add what comes back from all of them to the echoes, the nearest first, since it hides others."""
        if not placed:
            return
        first, last = bearings(shots, self.meshes, [one.pose for one in placed])
        away = [float(np.hypot(*(one.pose.place - shots.origins[0])[:2])) for one in placed]
        for number in np.argsort(away, kind="stable").tolist():
            near = shots.between(float(first[number]), float(last[number]))
            if len(near):
                item = self.objects[number]
                surface = item.reflectivity, IGNORED if item.ignore else item.track_id
                meet_body(shots, echoes, near, self.meshes[number], placed[number].pose, surface)


def meet_body(
    shots: Shots, echoes: Echoes, near: NDArray[np.int64], mesh: Mesh, pose: Pose, surface: tuple[float, int]
) -> None:
    """Add what comes back from a body to the echoes.

    Parameters
    ----------
    shots, echoes : Shots, Echoes
        Of one turn.
    near : ndarray, shape (M,), int64
        The shots in whose direction it lies.
    mesh : Mesh
        The body in its own frame.
    pose : Pose
        Where it is.
    surface : tuple of (float, int)
        Reflectivity of its brightest parts, and its number in the labels.
    """
    reflectivity, label = surface
    origins = (shots.origins[near] - pose.place) @ pose.turn
    rays = shots.directions[near] @ pose.turn
    lower, upper = mesh.bounds
    begin, end = meet_box(origins, rays, lower - 1e-6, upper + 1e-6)
    close = begin <= np.minimum(end, echoes.range_m[near])
    if not close.any():
        return
    near, origins, rays = near[close], origins[close], rays[close]
    distance, which = meet_triangles(origins, rays, mesh.units)
    met = np.flatnonzero(which >= 0)
    normals = mesh.normals[which[met]]
    facing = np.abs(np.einsum("ij,ij->i", normals, rays[met])) / np.linalg.norm(normals, axis=1)
    echoes.add(near[met], distance[met], reflectivity * mesh.shades[which[met]] * facing, label)


def bearings(shots: Shots, meshes: Sequence[Mesh], poses: Sequence[Pose]) -> tuple[Floats, Floats]:
    """Return between which azimuths bodies lie, seen from any place that shots of the turn come from.

    Parameters
    ----------
    shots : Shots
        Of one turn.
    meshes, poses : sequence of Mesh, sequence of Pose
        O bodies and where they are.

    Returns
    -------
    (ndarray, shape (O,), float64), (ndarray, shape (O,), float64)
        First and last azimuth, counter-clockwise, in radians; a whole turn where the lidar is within the body's box.
    """
    bounds = np.array([mesh.bounds for mesh in meshes])
    margin = shots.spread_m + _MARGIN_M
    bounds += margin * np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]])
    corners = np.stack([bounds[:, _CORNERS[:, axis], axis] for axis in range(3)], axis=2)
    turns, places = np.array([pose.turn for pose in poses]), np.array([pose.place for pose in poses])
    offsets = np.einsum("oki,oji->okj", corners, turns) + (places - shots.origins[0])[:, None]
    middle = offsets.mean(axis=1)
    ahead = np.arctan2(middle[:, 1], middle[:, 0])
    turned = (np.arctan2(offsets[..., 1], offsets[..., 0]) - ahead[:, None] + np.pi) % (2 * np.pi) - np.pi
    first, last = turned.min(axis=1), turned.max(axis=1)
    within = last - first >= np.pi
    first[within], last[within] = -np.pi, np.pi
    return ahead + first, ahead + last


def box_of(mesh: Mesh, pose: Pose, lidar: Pose, base_m: float) -> tuple[Floats, Floats, float]:
    """Return the upright box about what stands out of the water or the ground of a body, in the frame of the lidar.

    Parameters
    ----------
    mesh, pose : Mesh, Pose
        The body.
    lidar : Pose
        The lidar when it looks at it.
    base_m : float
        Height of the sea or the ground there.

    Returns
    -------
    (ndarray, shape (3,)), (ndarray, shape (3,)), float
        Centre, size (length, width, height) in metres and yaw in radians; it holds all of the body, so that a tilted
        one has a wider box.
    """
    world = mesh.corners @ pose.turn.T + pose.place
    world[:, 2] = np.maximum(world[:, 2], min(base_m, float(world[:, 2].max())))
    seen = (world - lidar.place) @ lidar.turn
    ahead = pose.turn[:, 0] @ lidar.turn
    yaw = float(np.arctan2(ahead[1], ahead[0]))
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned = seen @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    lower, upper = turned.min(axis=0), turned.max(axis=0)
    middle = (lower + upper) / 2
    center = np.array([cos * middle[0] - sin * middle[1], sin * middle[0] + cos * middle[1], middle[2]])
    return center, upper - lower, yaw
