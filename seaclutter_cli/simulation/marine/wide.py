"""A sea that reflects as published physics has it, and what it, the air and own ship add to a frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from seaclutter_cli.simulation.lidar.echoes import Echoes, Shots
from seaclutter_cli.simulation.lidar.models import Lidar
from seaclutter_cli.simulation.marine.motion import Pose
from seaclutter_cli.simulation.marine.physics import (
    DIVERGENCE_RAD,
    PhysicsParams,
    facet_reflectance,
    foam_share,
    water_reflectance,
    whitecap_share,
)
from seaclutter_cli.simulation.marine.sea import GRAVITY, SeaParams, WaveSurface
from seaclutter_cli.simulation.marine.wake import Wake, add_droplet_echoes, patches
from seaclutter_cli.simulation.marine.water import PULSE_M, MarineWater, SeaTerrain
from seaclutter_cli.truth import CLUTTER

Floats = NDArray[np.float64]

_DRIFT = 0.03
_DEPTHS = np.concatenate((np.geomspace(1e-6, 0.05, 300), np.linspace(0.06, 16.0, 800)))
_WHITECAP_M = 1.2
_CYCLE = 4.0
_SHEET_S = 1.2
_SHEET_DENSITY = 0.4
_CREST_REACH_M = 50.0


@dataclass(frozen=True)
class Hits:
    """Shots that meet the water, W of them: their indices, distances, normals, and cosines of incidence on the wave."""

    shots: NDArray[np.int64]
    distance_m: Floats
    normals: Floats
    cosines: Floats


@dataclass(frozen=True)
class Conditions:
    """Physics, wavelength of the lidar, time, seed of the scene, and position of own bow."""

    physics: PhysicsParams
    wavelength_nm: float
    time_s: float
    seed: int
    bow_m: tuple[float, float]


class WideWater(MarineWater):
    r"""The sea at one moment, with the optics of water.

    Notes
    -----
    *Water.* Light comes back from below the surface (`water_reflectance`) and from ripples that face the lidar
    (`facet_reflectance`, with the slopes of Cox and Munk). Bubbles and what floats are uneven: the mean is multiplied
    by texture, gamma-distributed with the sea's ``spikiness`` over patches that drift and are renewed, and by the
    exponential speckle of a shot, which makes a K distribution (Ward, Tough, Watts 2013).

    *Foam.* A patch of whitecap appears, decays to 1/e within `PhysicsParams.whitecap_s` (Monahan 1971: 3.5 s), and
    drifts with 3 % of the wind (Wu 1975); as many appear as cover the published share on average.

    *Turbulent wakes.* A part of the shots into the wake of a vessel meets froth above the water, at heights that are
    distributed exponentially. Its patches remain in place. The wash of own propeller is froth, too.
    """

    def __init__(self, surface: WaveSurface, params: SeaParams, wakes: Sequence[Wake], conditions: Conditions) -> None:
        super().__init__(surface, params, wakes, time_s=conditions.time_s, seed=conditions.seed)
        self._physics, self._wavelength_nm = conditions.physics, conditions.wavelength_nm
        self._bow_m = conditions.bow_m
        self._foam = params.foam_reflectivity * foam_share(self._wavelength_nm)

    def hits(self, shots: Shots) -> Hits:
        """Return where shots meet the water."""
        hit, distance = self._intersect(shots)
        rays = shots.directions[hit]
        positions = shots.origins[hit] + distance[:, None] * rays
        slope_x, slope_y = self._surface.slope(positions[:, 0], positions[:, 1])
        normals = np.stack((-slope_x, -slope_y, np.ones_like(slope_x)), axis=1).astype(np.float64)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return Hits(hit, distance, normals, np.clip(-np.einsum("ij,ij->i", rays, normals), 0.0, 1.0))

    def add_echoes(self, shots: Shots, echoes: Echoes, rng: np.random.Generator) -> None:
        """Add the echoes of water, foam, wakes and spray."""
        hits, physics = self.hits(shots), self._physics
        self.last_hits = hits
        rays = shots.directions[hits.shots]
        x, y = (shots.origins[hits.shots] + hits.distance_m[:, None] * rays)[:, :2].T
        reflectance = water_reflectance(hits.cosines, self._wavelength_nm, physics.backscatter)
        reflectance *= self._texture(x, y)
        reflectance += facet_reflectance(hits.cosines, self._wavelength_nm, physics.ripple_variance)
        cover = self.whitecaps(x, y)
        for wake in self._wakes:
            cover = np.maximum(cover, wake.foam(x, y, self.time_s))
        foamy = cover > patches(x, y, self._seed)
        reflectance[foamy] = self._foam * patches(x, y, self._seed + 1)[foamy]
        depth = DIVERGENCE_RAD * hits.distance_m / np.maximum(-rays[:, 2], 1e-6)
        reflectance *= rng.standard_exponential(len(x)) * np.minimum(1.0, PULSE_M / depth)
        echoes.add(hits.shots, hits.distance_m, reflectance, CLUTTER)
        self._add_froth(shots, echoes, rng)
        for wake in self._wakes:
            wake.add_spray_echoes(shots, echoes, self.time_s, self._foam, rng)

    def _texture(self, x: Floats, y: Floats) -> Floats:
        """Return the texture at given positions, whose mean is 1, shape (N,)."""
        physics, shape = self._physics, self._params.spikiness
        along, across = self._drifted(x, y)
        scale = 0.4 / physics.patch_m  # `patches` are 0.4 m wide
        renewal = np.floor(self.time_s / physics.patch_s + patches(along * scale, across * scale, self._seed + 2))
        drawn = patches(along * scale + 1000.0 * renewal, across * scale, self._seed + 3)
        return np.asarray(np.interp(-np.log1p(-drawn), _DEPTHS, gammaincinv(shape, -np.expm1(-_DEPTHS)) / shape))

    def whitecaps(self, x: Floats, y: Floats) -> Floats:
        """Return the share of the water under whitecaps at given positions, shape (N,)."""
        physics = self._physics
        along, across = self._drifted(x, y)
        scale = 0.4 / _WHITECAP_M
        phase = self.time_s / (_CYCLE * physics.whitecap_s) + patches(along * scale, across * scale, self._seed + 4)
        drawn = patches(along * scale + 1000.0 * np.floor(phase), across * scale, self._seed + 5)
        mean = (1 - np.exp(-_CYCLE)) / _CYCLE
        breaking = drawn < whitecap_share(physics.wind_ms) * physics.shelter / mean
        return np.asarray(breaking * np.exp(-_CYCLE * (phase % 1)))

    def _drifted(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return positions in the frame of the water, which drifts with the wind."""
        way = _DRIFT * self._physics.wind_ms * self.time_s
        angle = np.radians(self._physics.wind_deg)
        return x - way * np.cos(angle), y - way * np.sin(angle)

    def _add_froth(self, shots: Shots, echoes: Echoes, rng: np.random.Generator) -> None:
        """Add the echoes of turbulent wakes."""
        physics, hits = self._physics, self.last_hits
        rays, origins = shots.directions[hits.shots], shots.origins[hits.shots]
        height = physics.wake_height_m * rng.standard_exponential(len(hits.shots))
        distance = np.maximum(hits.distance_m - height / np.maximum(-rays[:, 2], 1e-6), 0.0)
        x, y = (origins + distance[:, None] * rays)[:, :2].T
        strength = np.zeros(len(x))
        if physics.wash_m:
            strength = np.exp(-((np.hypot(x - self._bow_m[0], y - self._bow_m[1]) / physics.wash_m) ** 2))
        for wake in self._wakes if physics.wake_m else ():
            strength = np.maximum(strength, wake.churned(x, y, self.time_s, physics.wake_m))
        met = np.flatnonzero((physics.wake_cover * strength > patches(x, y, self._seed + 6)) & (distance > 1))
        reflectance = physics.wake_reflectivity * foam_share(self._wavelength_nm) * rng.standard_exponential(len(met))
        echoes.add(hits.shots[met], distance[met], reflectance, CLUTTER)


class WideSea(SeaTerrain):
    """The sea of a scene with the physics of its section."""

    def __init__(
        self, params: SeaParams, physics: PhysicsParams, lidar: Lidar, hulls: Sequence[Any], own: Any, seed: int
    ) -> None:
        super().__init__(params, hulls, own.length_m, seed)
        self._physics, self._lidar, self._own = physics, lidar, own

    def at(self, time_s: float) -> WideWater:
        """Return the sea at a time."""
        x, y, heading = (float(one[0]) for one in self._own.track.at(np.array([time_s])))
        half = self._own.length_m / 2
        bow_m = x + half * float(np.cos(heading)), y + half * float(np.sin(heading))
        conditions = Conditions(self._physics, float(self._lidar.wavelength_nm), time_s, self._seed, bow_m)
        return WideWater(self._sea.at(time_s), self._params, self._wakes, conditions)

    def add_sheets(self, shots: Shots, echoes: Echoes, time_s: float, rng: np.random.Generator) -> None:
        """Add the echoes of sheets of spray from the bow and from crests.

        A sheet flies up and falls as a stone would, grows thinner and wider, and the wind carries it along.
        """
        physics = self._physics
        if not physics.spray:
            return
        foam = self._params.foam_reflectivity * foam_share(self._lidar.wavelength_nm)
        for number in range(int((time_s - _SHEET_S) * physics.spray), int(time_s * physics.spray) + 1):
            draw = np.random.default_rng([self._seed, 2, number + 1000])
            age_s = time_s - (number + draw.random()) / physics.spray
            if 0 <= age_s < _SHEET_S:
                pose, corners = self._sheet(time_s - age_s, age_s, draw)
                density = _SHEET_DENSITY * np.exp(-age_s / 0.5)
                add_droplet_echoes(shots, echoes, pose, corners, (density, foam), rng)

    def _sheet(self, start_s: float, age_s: float, draw: np.random.Generator) -> tuple[Pose, Floats]:
        """Return the pose and the corners of a sheet that was thrown up at a time."""
        wind, angle = self._physics.wind_ms, np.radians(self._physics.wind_deg)
        x, y, heading = (float(one[0]) for one in self._own.track.at(np.array([start_s])))
        if draw.random() < 0.5:
            side = draw.choice((-1.0, 1.0))
            ahead, aside, speed = 0.5 * self._own.length_m, side * self._own.width_m * draw.uniform(0.4, 1.2), 3.5
        else:
            distance, bearing = draw.uniform(5, _CREST_REACH_M), draw.uniform(-np.pi, np.pi)
            ahead, aside, speed = distance * np.cos(bearing), distance * np.sin(bearing), 2.0
        speed *= draw.uniform(0.5, 1.2)
        x += ahead * np.cos(heading) - aside * np.sin(heading) + 0.7 * wind * age_s * np.cos(angle)
        y += ahead * np.sin(heading) + aside * np.cos(heading) + 0.7 * wind * age_s * np.sin(angle)
        height = max(0.0, speed * age_s - GRAVITY * age_s**2 / 2)
        half = np.array([0.5 + 0.25 * wind * age_s, 0.3 + 0.8 * age_s, 0.3 + 0.8 * age_s])
        position = np.array([x, y, height + 0.2])
        half[2] = min(half[2], position[2])
        return Pose.of(position, yaw=float(angle)), np.stack((-half, half))
