"""How own vessel carries the lidar along."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.marine.motion import Pose, rotations
from seaclutter_cli.simulation.marine.scene import VesselParams
from seaclutter_cli.simulation.marine.terrain import Terrain

Floats = NDArray[np.float64]

_KNOTS = 6


class Ride:
    """Place and attitude of the lidar over time.

    Parameters
    ----------
    vessel : VesselParams
        Own vessel or vehicle.
    terrain : Terrain
        What moves it.
    """

    def __init__(self, vessel: VesselParams, terrain: Terrain) -> None:
        self._track, self._sway, self._terrain = vessel.track, vessel.wave_response, terrain
        self._mast = np.array([vessel.lidar_forward_m, 0.0, vessel.lidar_height_m])

    def at(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return place and attitude of the lidar at some times, shapes (T, 3) and (T, 3, 3)."""
        x, y, yaw = self._track.at(times_s)
        waves = self._sway * self._terrain.move(x, y, times_s)
        pitch = -np.arctan(waves[1] * np.cos(yaw) + waves[2] * np.sin(yaw))
        roll = np.arctan(waves[2] * np.cos(yaw) - waves[1] * np.sin(yaw))
        turns = rotations(yaw, pitch, roll)
        return np.stack((x, y, waves[0]), axis=1) + turns @ self._mast, turns

    def along(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return the same at the many times of a turn, in order."""
        knots = np.linspace(times_s[0], times_s[-1] + 1e-9, _KNOTS)
        places, turns = self.at(knots)
        # Between knots 20 ms apart all of it is a straight line; matrices stay orthogonal to 1e-6.
        columns = [np.interp(times_s, knots, column) for column in np.concatenate((places, turns.reshape(-1, 9)), 1).T]
        out = np.stack(columns, axis=1)
        return out[:, :3], out[:, 3:].reshape(-1, 3, 3)

    def lidar(self, time_s: float) -> Pose:
        """Return the pose of the lidar at a time."""
        places, turns = self.along(np.array([time_s]))
        return Pose(places[0], turns[0])

    def hull(self, time_s: float) -> Pose:
        """Return the pose of the hull below the lidar at a time."""
        lidar = self.lidar(time_s)
        return Pose(lidar.place - lidar.turn @ self._mast, lidar.turn)
