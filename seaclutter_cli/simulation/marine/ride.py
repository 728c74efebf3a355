"""Motion of the lidar on its vessel or vehicle."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.marine.motion import Pose, rotations
from seaclutter_cli.simulation.marine.scene import VesselParams
from seaclutter_cli.simulation.marine.terrain import Terrain

Floats = NDArray[np.float64]

_KNOTS = 6


class Ride:
    """Position and attitude of the lidar over time.

    Parameters
    ----------
    vessel : VesselParams
        Own ship or vehicle.
    terrain : Terrain
        The sea or the ground that moves it.
    """

    def __init__(self, vessel: VesselParams, terrain: Terrain) -> None:
        self._track, self._wave_response, self._terrain = vessel.track, vessel.wave_response, terrain
        self._mast = np.array([vessel.lidar_forward_m, 0.0, vessel.lidar_height_m])

    def at(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return position and attitude of the lidar at given times, shapes (T, 3) and (T, 3, 3)."""
        x, y, yaw = self._track.at(times_s)
        waves = self._wave_response * self._terrain.motion(x, y, times_s)
        pitch = -np.arctan(waves[1] * np.cos(yaw) + waves[2] * np.sin(yaw))
        roll = np.arctan(waves[2] * np.cos(yaw) - waves[1] * np.sin(yaw))
        rotation = rotations(yaw, pitch, roll)
        return np.stack((x, y, waves[0]), axis=1) + rotation @ self._mast, rotation

    def interpolate(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return position and attitude at the many times of a frame, in ascending order, by interpolation."""
        knots = np.linspace(times_s[0], times_s[-1] + 1e-9, _KNOTS)
        positions, rotation = self.at(knots)
        # Knots are 20 ms apart, close enough to interpolate linearly: matrices remain orthogonal to 1e-6.
        columns = [
            np.interp(times_s, knots, column) for column in np.concatenate((positions, rotation.reshape(-1, 9)), 1).T
        ]
        out = np.stack(columns, axis=1)
        return out[:, :3], out[:, 3:].reshape(-1, 3, 3)

    def lidar(self, time_s: float) -> Pose:
        """Return the pose of the lidar at a time."""
        positions, rotation = self.interpolate(np.array([time_s]))
        return Pose(positions[0], rotation[0])

    def hull(self, time_s: float) -> Pose:
        """Return the pose of the hull at a time."""
        lidar = self.lidar(time_s)
        return Pose(lidar.position - lidar.rotation @ self._mast, lidar.rotation)
