"""Vessels, buoys and walls: where they are, what shots meet of them, and their boxes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.echoes import Echoes, Shots
from seaclutter_cli.simulation.motion import rotations
from seaclutter_cli.simulation.rays import meet_box, meet_triangles
from seaclutter_cli.simulation.shapes import Mesh

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """Place and attitude of a body.

    Parameters
    ----------
    place : ndarray, shape (3,), float64
        Its origin in the world's frame, in metres.
    turn : ndarray, shape (3, 3), float64
        Rotation from its frame to the world's.
    """

    place: Floats
    turn: Floats

    @classmethod
    def of(cls, place: Floats, *, yaw: float, pitch: float = 0.0, roll: float = 0.0) -> "Pose":
        """Return the pose of angles in radians."""
        return cls(place, rotations(np.array([yaw]), np.array([pitch]), np.array([roll]))[0])


def meet_body(shots: Shots, echoes: Echoes, mesh: Mesh, pose: Pose, *, reflectivity: float, label: int) -> None:
    """Add what comes back from a body to the echoes.

    Parameters
    ----------
    shots, echoes : Shots, Echoes
        Of one turn.
    mesh : Mesh
        The body in its own frame.
    pose : Pose
        Where it is.
    reflectivity : float
        Of its brightest parts.
    label : int
        Number in the labels.
    """
    near = _towards(shots, mesh, pose)
    origins = (shots.origins[near] - pose.place) @ pose.turn
    rays = shots.directions[near] @ pose.turn
    corners = mesh.triangles.reshape(-1, 3)
    begin, end = meet_box(origins, rays, corners.min(axis=0) - 1e-6, corners.max(axis=0) + 1e-6)
    close = begin <= np.minimum(end, echoes.range_m[near])
    near, origins, rays = near[close], origins[close], rays[close]
    distance, which = meet_triangles(origins, rays, mesh.triangles)
    met = np.flatnonzero(which >= 0)
    sides = mesh.triangles[which[met]]
    normals = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    facing = np.abs(np.einsum("ij,ij->i", normals, rays[met])) / np.linalg.norm(normals, axis=1)
    echoes.add(near[met], distance[met], reflectivity * mesh.shades[which[met]] * facing, label)


def _towards(shots: Shots, mesh: Mesh, pose: Pose) -> NDArray[np.int64]:
    """Return the shots in whose direction a body lies."""
    offset = pose.place[:2] - shots.origins[0, :2]
    reach, away = float(np.linalg.norm(mesh.triangles, axis=2).max()) + 1.0, float(np.hypot(*offset))
    if away <= reach:
        return np.arange(len(shots))
    return shots.towards(float(np.arctan2(offset[1], offset[0])), float(np.arcsin(reach / away)))


def box_of(mesh: Mesh, pose: Pose, lidar: Pose, sea_m: float) -> tuple[Floats, Floats, float]:
    """Return the upright box about what stands out of the water of a body, in the frame of the lidar.

    Parameters
    ----------
    mesh, pose : Mesh, Pose
        The body.
    lidar : Pose
        The lidar when it looks at it.
    sea_m : float
        Height of the sea there.

    Returns
    -------
    (ndarray, shape (3,)), (ndarray, shape (3,)), float
        Centre, size (length, width, height) in metres and yaw in radians; it holds all of the body, so that a tilted
        one has a wider box.
    """
    world = mesh.triangles.reshape(-1, 3) @ pose.turn.T + pose.place
    world[:, 2] = np.maximum(world[:, 2], min(sea_m, float(world[:, 2].max())))
    seen = (world - lidar.place) @ lidar.turn
    ahead = pose.turn[:, 0] @ lidar.turn
    yaw = float(np.arctan2(ahead[1], ahead[0]))
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned = seen @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    lower, upper = turned.min(axis=0), turned.max(axis=0)
    middle = (lower + upper) / 2
    center = np.array([cos * middle[0] - sin * middle[1], sin * middle[0] + cos * middle[1], middle[2]])
    return center, upper - lower, yaw
