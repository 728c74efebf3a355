"""What a scene lies on: what it does to vessels, and what a lidar sees of it."""

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

    def lie(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return height in metres and slopes along x and y at places, shape (N,) each."""
        ...

    def meet(self, shots: Shots, echoes: Echoes, rng: np.random.Generator) -> None:
        """Add what comes back from it to the echoes."""
        ...


class Terrain(Protocol):
    """What a scene lies on."""

    def move(self, x: Floats, y: Floats, times_s: Floats) -> Floats:
        """Return height in metres and slopes along x and y that move own vessel, shape (3, T)."""
        ...

    def at(self, time_s: float) -> Moment:
        """Return it at a time."""
        ...

    def box(self, lidar: Pose, reach_m: float) -> Box | None:
        """Return the area to ignore that it is within reach, in the frame of the lidar; None if it is clutter."""
        ...


@dataclass(frozen=True)
class SeaMoment:
    """The sea at one moment: its surface, and what a lidar sees of it."""

    surface: WaveSurface
    water: MarineWater
    wakes: Sequence[Wake]
    params: SeaParams
    time_s: float

    def lie(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return height in metres and slopes along x and y at places, shape (N,) each."""
        slope_x, slope_y = self.surface.slope(x, y)
        return self.surface.height(x, y).astype(np.float64), slope_x.astype(np.float64), slope_y.astype(np.float64)

    def meet(self, shots: Shots, echoes: Echoes, rng: np.random.Generator) -> None:
        """Add what comes back from the water and from spray to the echoes."""
        self.water.meet(shots, echoes, rng)
        for wake in self.wakes:
            wake.meet_spray(shots, echoes, self.time_s, self.params.foam_reflectivity, rng)


class SeaTerrain:
    """The sea of a scene with the wakes on it.

    Parameters
    ----------
    params : SeaParams
        Waves, and how they reflect.
    hulls : sequence of (Track, float, float)
        Path, length and width of what leaves a wake; own vessel first.
    own_length_m : float
        Waves longer than twice that move own vessel.
    seed : int
        What all chance comes from.
    """

    def __init__(self, params: SeaParams, hulls: Sequence[Any], own_length_m: float, seed: int) -> None:
        self._params, self._seed = params, seed
        self._sea = Sea(params, np.random.default_rng([seed, 0]))
        self._swell = self._sea.swell(2 * own_length_m)
        self._wakes = [Wake(track, length, width, params.foam_lifetime_s) for track, length, width in hulls]

    def move(self, x: Floats, y: Floats, times_s: Floats) -> Floats:
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
"""What scenes can lie on, by the section of the scene file: parameters and maker; the first is the default."""


def terrain_name(params: TerrainParams) -> str:
    """Return the section of a terrain in a scene file."""
    return next(name for name, (kind, _) in TERRAINS.items() if isinstance(params, kind))
