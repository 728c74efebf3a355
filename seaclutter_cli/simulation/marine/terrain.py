"""The ground or the sea of a scene: its effect on vessels, and its echoes."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes, Shots
from seaclutter_cli.simulation.marine.motion import Pose
from seaclutter_cli.simulation.marine.sea import SeaParams
from seaclutter_cli.simulation.marine.water import MarineWater, SeaTerrain
from seaclutter_cli.truth import IGNORED
from seaclutter_cli.validation import NotNegative, Positive, Share, key

Floats = NDArray[np.float64]
_WAVES = 24
_SHORTEST_M, _LONGEST_M = 2.0, 20.0
_BOX_M = 0.05


@dataclass(frozen=True, kw_only=True)
class GroundParams:
    """The ground of a scene on land."""

    roughness_m: NotNegative = key(0.015, "Standard deviation of the height.")
    reflectivity: Share = key(0.3, "Reflectivity of grass or earth at normal incidence.")
    visibility_km: Positive = key(10.0, "Meteorological visibility, which determines the extinction in air.")


class Ground:
    """Uneven ground: a sum of bumps 2 to 20 m long in random directions; an area to ignore, not clutter.

    There are no wakes on land, and bumps of any length tilt the vehicle, scaled by its `wave_response`.
    """

    def __init__(self, params: GroundParams, seed: int) -> None:
        self._params = params
        rng = np.random.default_rng([seed, 0])
        wave = 2 * np.pi / np.exp(rng.uniform(np.log(_SHORTEST_M), np.log(_LONGEST_M), _WAVES))
        bearing = rng.uniform(0, 2 * np.pi, _WAVES)
        self._kx, self._ky = wave * np.cos(bearing), wave * np.sin(bearing)
        self._phase = rng.uniform(0, 2 * np.pi, _WAVES)
        self._amplitude = params.roughness_m * np.sqrt(2 / _WAVES)

    def height_and_slopes(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return height in metres and slopes along x and y at given positions, shape (N,) each."""
        angle = np.outer(x, self._kx) + np.outer(y, self._ky) + self._phase
        steep = self._amplitude * np.cos(angle)
        return self._amplitude * np.sin(angle).sum(axis=1), steep @ self._kx, steep @ self._ky

    def motion(self, x: Floats, y: Floats, times_s: Floats) -> Floats:
        """Return the height in metres and the slopes along x and y that move the vehicle, shape (3, T)."""
        del times_s
        return np.stack(self.height_and_slopes(x, y))

    def at(self, time_s: float) -> "Ground":
        """Return the ground, which does not change over time."""
        del time_s
        return self

    def box(self, lidar: Pose, reach_m: float) -> tuple[Floats, Floats, float]:
        """Return the ground within reach as an area to ignore: an upright box in the frame of the lidar.

        These are its centre and size in metres, and its yaw in radians.
        """
        angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        rim = reach_m * np.stack((np.cos(angles), np.sin(angles), np.zeros(16)), axis=1)
        rim[:, 2] -= lidar.position[2]
        heights = (rim @ lidar.rotation)[:, 2]
        margin = 3 * self._params.roughness_m + _BOX_M
        lower, upper = heights.min() - margin, heights.max() + margin
        size = np.array([2 * reach_m, 2 * reach_m, upper - lower])
        return np.array([0.0, 0.0, (lower + upper) / 2]), size, 0.0

    def add_echoes(self, shots: Shots, echoes: Echoes, rng: np.random.Generator) -> None:
        """Add the echoes of the ground: the intersection with a plane, corrected for the height there."""
        del rng
        down = np.flatnonzero(shots.directions[:, 2] < 0)
        rays, origins = shots.directions[down], shots.origins[down]
        height = np.zeros(len(down))
        for _ in range(2):
            distance = (height - origins[:, 2]) / rays[:, 2]
            positions = origins + distance[:, None] * rays
            height, slope_x, slope_y = self.height_and_slopes(positions[:, 0], positions[:, 1])
        facing = (rays[:, 0] * slope_x + rays[:, 1] * slope_y - rays[:, 2]) / np.sqrt(slope_x**2 + slope_y**2 + 1)
        echoes.add(down, distance, self._params.reflectivity * np.clip(facing, 0.0, 1.0), IGNORED)


Terrain = SeaTerrain | Ground
Moment = MarineWater | Ground
"""A terrain at one moment."""

TerrainParams = SeaParams | GroundParams

TERRAINS: Mapping[str, type[TerrainParams]] = {"sea": SeaParams, "ground": GroundParams}
"""Parameters of each terrain by its section in a scene file; the first is the default."""


def terrain_name(params: TerrainParams) -> str:
    """Return the section of a terrain in a scene file."""
    return next(name for name, kind in TERRAINS.items() if isinstance(params, kind))
