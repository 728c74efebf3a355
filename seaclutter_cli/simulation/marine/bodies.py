"""Vessels, buoys and walls: their poses, their echoes and their boxes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.simulation.lidar import Echoes, Lidar, Shots
from seaclutter_cli.simulation.marine.motion import Pose, Ride, rotations
from seaclutter_cli.simulation.marine.scene import SceneObjectParams
from seaclutter_cli.simulation.marine.shapes import SHAPES, Mesh, intersect_box, intersect_triangles
from seaclutter_cli.simulation.marine.terrain import Moment
from seaclutter_cli.truth import IGNORED

_MARGIN_M = 0.05
_CORNERS = np.array(list(np.ndindex(2, 2, 2)))
_FOLLOW_LENGTH_M = 6.0


@dataclass(frozen=True)
class PlacedBody:
    """A body when the lidar points at it: its pose, that of the lidar, and the height of the sea or the ground there.

    ``reflectivity`` is that of its brightest parts, ``label`` its number in the labels.
    """

    mesh: Mesh
    reflectivity: float
    label: int
    pose: Pose
    lidar: Pose
    base_m: float

    def add_echoes(self, shots: Shots, echoes: Echoes, near: Ints) -> None:
        """Add the echoes of the body from the shots in its direction, ``near``, shape (M,)."""
        mesh, pose = self.mesh, self.pose
        origins = (shots.origins[near] - pose.position) @ pose.rotation
        rays = shots.directions[near] @ pose.rotation
        lower, upper = mesh.bounds
        begin, end = intersect_box(origins, rays, lower - 1e-6, upper + 1e-6)
        close = begin <= np.minimum(end, echoes.range_m[near])
        if not close.any():
            return
        near, origins, rays = near[close], origins[close], rays[close]
        distance, which = intersect_triangles(origins, rays, mesh.transforms)
        hit = np.flatnonzero(which >= 0)
        normals = mesh.normals[which[hit]]
        facing = np.abs(np.einsum("ij,ij->i", normals, rays[hit])) / np.linalg.norm(normals, axis=1)
        echoes.add(near[hit], distance[hit], self.reflectivity * mesh.shades[which[hit]] * facing, self.label)

    def box(self) -> tuple[Floats, Floats, float]:
        """Return the upright box, in the frame of the lidar, around the part above the water or the ground.

        The box, its centre, its size (length, width, height) and its yaw in radians, contains all of that part, so it
        is wider if the body is tilted.
        """
        world = self.mesh.corners @ self.pose.rotation.T + self.pose.position
        world[:, 2] = np.maximum(world[:, 2], min(self.base_m, float(world[:, 2].max())))
        in_lidar = (world - self.lidar.position) @ self.lidar.rotation
        ahead = self.pose.rotation[:, 0] @ self.lidar.rotation
        yaw = float(np.arctan2(ahead[1], ahead[0]))
        cos, sin = np.cos(yaw), np.sin(yaw)
        aligned = in_lidar @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        lower, upper = aligned.min(axis=0), aligned.max(axis=0)
        middle = (lower + upper) / 2
        center = np.array([cos * middle[0] - sin * middle[1], sin * middle[0] + cos * middle[1], middle[2]])
        return center, upper - lower, yaw


class Bodies:
    """The bodies of a scene, O of them."""

    def __init__(self, objects: Sequence[SceneObjectParams]) -> None:
        meshes = (SHAPES[item.shape].scaled(*item.size_m) for item in objects)
        labels = (IGNORED if item.ignore else item.track_id for item in objects)
        self._surfaces = list(zip(meshes, (item.reflectivity for item in objects), labels, strict=True))
        self._tracks = [item.track for item in objects]
        # Bodies longer than a wave follow it less.
        self._follow = np.array([item.wave_response * min(1.0, _FOLLOW_LENGTH_M / item.size_m[0]) for item in objects])

    def locate(self, moment: Moment, ride: Ride, lidar: Lidar, start_s: float) -> list[PlacedBody]:
        """Return the pose of each body in the frame that starts at a time."""
        times_s = np.full(len(self._surfaces), start_s)
        for _ in range(2):
            positions, rotation = ride.at(times_s)
            places = [track.at(times_s[k : k + 1]) for k, track in enumerate(self._tracks)]
            x, y, heading = np.concatenate(places, axis=1) if places else np.empty((3, 0))
            offset = np.stack((x, y, np.zeros_like(x)), axis=1) - positions
            in_lidar = np.einsum("oi,oij->oj", offset, rotation)
            times_s = start_s + lidar.firing_times_s(np.arctan2(in_lidar[:, 1], in_lidar[:, 0]))
        height, slope_x, slope_y = moment.height_and_slopes(x, y)
        pitch = -self._follow * np.arctan(slope_x * np.cos(heading) + slope_y * np.sin(heading))
        roll = self._follow * np.arctan(slope_y * np.cos(heading) - slope_x * np.sin(heading))
        attitudes = rotations(heading, pitch, roll)
        position = np.stack((x, y, self._follow * height), axis=1)
        return [
            PlacedBody(*surface, Pose(position[k], attitudes[k]), Pose(positions[k], rotation[k]), float(height[k]))
            for k, surface in enumerate(self._surfaces)
        ]


def add_body_echoes(shots: Shots, echoes: Echoes, placed: Sequence[PlacedBody], before: Shots | None = None) -> None:
    """Add the echoes of bodies, nearest body first, since it hides others.

    Shots that the water has mirrored have the bearings that they had ``before``.
    """
    if not placed:
        return
    aimed = before or shots
    first, last = bearings(aimed, placed)
    distances = [float(np.hypot(*(one.pose.position - aimed.origins[0])[:2])) for one in placed]
    for number in np.argsort(distances, kind="stable").tolist():
        near = aimed.between(float(first[number]), float(last[number]))
        if before:
            near = near[echoes.range_m[near] > 0]
        if len(near):
            placed[number].add_echoes(shots, echoes, near)


def bearings(shots: Shots, placed: Sequence[PlacedBody]) -> tuple[Floats, Floats]:
    """Return the range of azimuths in which each of O bodies is visible from any origin of the shots.

    First and last azimuth, shape (O,), are counter-clockwise, in radians; a full circle if the lidar is within the
    body's box.
    """
    bounds = np.array([one.mesh.bounds for one in placed])
    margin = float(np.linalg.norm(shots.origins - shots.origins[0], axis=1).max()) + _MARGIN_M
    bounds += margin * np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]])
    corners = np.stack([bounds[:, _CORNERS[:, axis], axis] for axis in range(3)], axis=2)
    rotation, positions = (np.array([getattr(one.pose, name) for one in placed]) for name in ("rotation", "position"))
    offsets = np.einsum("oki,oji->okj", corners, rotation) + (positions - shots.origins[0])[:, None]
    middle = offsets.mean(axis=1)
    ahead = np.arctan2(middle[:, 1], middle[:, 0])
    angles = (np.arctan2(offsets[..., 1], offsets[..., 0]) - ahead[:, None] + np.pi) % (2 * np.pi) - np.pi
    first, last = angles.min(axis=1), angles.max(axis=1)
    within = last - first >= np.pi
    first[within], last[within] = -np.pi, np.pi
    return ahead + first, ahead + last
