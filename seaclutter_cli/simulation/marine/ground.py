"""Ground: what plantations stand on."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Interval
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes, Shots
from seaclutter_cli.simulation.marine.air import extinction
from seaclutter_cli.simulation.marine.motion import Pose
from seaclutter_cli.truth import IGNORED

Floats = NDArray[np.float64]
Box = tuple[Floats, Floats, float]
"""Centre and size in metres, yaw in radians."""

_WAVES = 24
_SHORTEST_M, _LONGEST_M = 2.0, 20.0
_BOX_M = 0.05


@dataclass(frozen=True, kw_only=True)
class GroundParams:
    """The ground of a scene on land.

    Parameters
    ----------
    roughness_m : float
        Standard deviation of its height.
    reflectivity : float
        Of grass or earth, met head on.
    visibility_km : float
        Meteorological visibility, from which the extinction in air follows.
    """

    roughness_m: Annotated[float, Ge(0)] = 0.015
    reflectivity: Annotated[float, Interval(ge=0, le=1)] = 0.3
    visibility_km: Annotated[float, Gt(0)] = 10.0

    @property
    def extinction(self) -> float:
        """Extinction coefficient in 1/m."""
        return extinction(self.visibility_km)


class Ground:
    """Uneven ground: a sum of bumps 2 to 20 m long, of random direction. It is an area to ignore, not clutter.

    Parameters
    ----------
    params : GroundParams
        How uneven and how bright.
    hulls : sequence
        Leave no wake here.
    own_length_m : float
        Bumps of any length tilt the vehicle, as far as its `wave_response` lets them.
    seed : int
        What all chance comes from.
    """

    def __init__(self, params: GroundParams, hulls: Sequence[Any], own_length_m: float, seed: int) -> None:
        del hulls, own_length_m
        self._params = params
        rng = np.random.default_rng([seed, 0])
        wave = 2 * np.pi / np.exp(rng.uniform(np.log(_SHORTEST_M), np.log(_LONGEST_M), _WAVES))
        bearing = rng.uniform(0, 2 * np.pi, _WAVES)
        self._kx, self._ky = wave * np.cos(bearing), wave * np.sin(bearing)
        self._phase = rng.uniform(0, 2 * np.pi, _WAVES)
        self._amplitude = params.roughness_m * np.sqrt(2 / _WAVES)

    def lie(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return height in metres and slopes along x and y at places, shape (N,) each."""
        angle = np.outer(x, self._kx) + np.outer(y, self._ky) + self._phase
        steep = self._amplitude * np.cos(angle)
        return self._amplitude * np.sin(angle).sum(axis=1), steep @ self._kx, steep @ self._ky

    def move(self, x: Floats, y: Floats, times_s: Floats) -> Floats:
        """Return height in metres and slopes along x and y that tilt the vehicle, shape (3, T)."""
        del times_s
        return np.stack(self.lie(x, y))

    def at(self, time_s: float) -> "Ground":
        """Return the ground, which is the same at any time."""
        del time_s
        return self

    def box(self, lidar: Pose, reach_m: float) -> Box:
        """Return the area to ignore that it is within reach, as an upright box in the frame of the lidar."""
        angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        rim = reach_m * np.stack((np.cos(angles), np.sin(angles), np.zeros(16)), axis=1)
        rim[:, 2] -= lidar.place[2]
        heights = (rim @ lidar.turn)[:, 2]
        margin = 3 * self._params.roughness_m + _BOX_M
        lower, upper = heights.min() - margin, heights.max() + margin
        size = np.array([2 * reach_m, 2 * reach_m, upper - lower])
        return np.array([0.0, 0.0, (lower + upper) / 2]), size, 0.0

    def meet(self, shots: Shots, echoes: Echoes, rng: np.random.Generator) -> None:
        """Add what comes back from the ground to the echoes: where the plane is met, corrected for its height there."""
        del rng
        down = np.flatnonzero(shots.directions[:, 2] < 0)
        rays, origins = shots.directions[down], shots.origins[down]
        height = np.zeros(len(down))
        for _ in range(2):
            distance = (height - origins[:, 2]) / rays[:, 2]
            places = origins + distance[:, None] * rays
            height, slope_x, slope_y = self.lie(places[:, 0], places[:, 1])
        facing = (rays[:, 0] * slope_x + rays[:, 1] * slope_y - rays[:, 2]) / np.sqrt(slope_x**2 + slope_y**2 + 1)
        echoes.add(down, distance, self._params.reflectivity * np.clip(facing, 0.0, 1.0), IGNORED)
