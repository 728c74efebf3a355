"""Sea or ground of a scene: its effect on vessels, and its echoes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes, Shots
from seaclutter_cli.simulation.marine.ground import Box, Ground, GroundParams
from seaclutter_cli.simulation.marine.motion import Pose
from seaclutter_cli.simulation.marine.sea import Sea, SeaParams, WaveSurface
from seaclutter_cli.simulation.marine.wake import Wake
from seaclutter_cli.simulation.marine.water import MarineWater

Floats = NDArray[np.float64]


class Moment(Protocol):
    """A terrain at one moment."""

    def height_and_slopes(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return height in metres and slopes along x and y at given positions, shape (N,) each."""
        ...

    def add_echoes(self, shots: Shots, echoes: Echoes, rng: np.random.Generator) -> None:
        """Add the echoes of the terrain."""
        ...


class Terrain(Protocol):
    """The sea or the ground of a scene."""

    def motion(self, x: Floats, y: Floats, times_s: Floats) -> Floats:
        """Return the height in metres and the slopes along x and y that move the vessel, shape (3, T)."""
        ...

    def at(self, time_s: float) -> Moment:
        """Return the terrain at a time."""
        ...

    def box(self, lidar: Pose, reach_m: float) -> Box | None:
        """Return the terrain within reach as an area to ignore, in the frame of the lidar; None if it is clutter."""
        ...


@dataclass(frozen=True)
class SeaMoment:
    """The sea at one moment: its surface and its echoes."""

    surface: WaveSurface
    water: MarineWater
    wakes: Sequence[Wake]
    params: SeaParams
    time_s: float

    def height_and_slopes(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return height in metres and slopes along x and y at given positions, shape (N,) each."""
        slope_x, slope_y = self.surface.slope(x, y)
        return self.surface.height(x, y).astype(np.float64), slope_x.astype(np.float64), slope_y.astype(np.float64)

    def add_echoes(self, shots: Shots, echoes: Echoes, rng: np.random.Generator) -> None:
        """Add the echoes of the water and of spray."""
        self.water.add_echoes(shots, echoes, rng)
        for wake in self.wakes:
            wake.add_spray_echoes(shots, echoes, self.time_s, self.params.foam_reflectivity, rng)


class SeaTerrain:
    """The sea of a scene and the wakes on it.

    Parameters
    ----------
    params : SeaParams
        Waves and reflectivity.
    hulls : sequence of (Track, float, float)
        Path, length and width of each hull that leaves a wake; own ship first.
    own_length_m : float
        Length of own ship; waves longer than twice that move it.
    seed : int
        Seed of all random values.
    """

    def __init__(self, params: SeaParams, hulls: Sequence[Any], own_length_m: float, seed: int) -> None:
        self._params, self._seed = params, seed
        self._sea = Sea(params, np.random.default_rng([seed, 0]))
        self._swell = self._sea.swell(2 * own_length_m)
        self._wakes = [Wake(track, length, width, params.foam_lifetime_s) for track, length, width in hulls]

    def motion(self, x: Floats, y: Floats, times_s: Floats) -> Floats:
        """Return height in metres and slopes along x and y of the long waves, shape (3, T)."""
        return self._swell.at(x, y, times_s)

    def at(self, time_s: float) -> SeaMoment:
        """Return the sea at a time."""
        surface = self._sea.at(time_s)
        water = MarineWater(surface, self._params, self._wakes, time_s=time_s, seed=self._seed)
        return SeaMoment(surface, water, self._wakes, self._params, time_s)

    def box(self, lidar: Pose, reach_m: float) -> None:
        """Return None: water is clutter."""
        del lidar, reach_m


TerrainParams = SeaParams | GroundParams

TERRAINS: Mapping[str, tuple[type[Any], type[Any]]] = {
    "sea": (SeaParams, SeaTerrain),
    "ground": (GroundParams, Ground),
}
"""Parameters and maker of each terrain by its section in a scene file; the first is the default."""


def terrain_name(params: TerrainParams) -> str:
    """Return the section of a terrain in a scene file."""
    return next(name for name, (kind, _) in TERRAINS.items() if isinstance(params, kind))
