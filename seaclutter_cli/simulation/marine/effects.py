"""What the air, the mirror of the water, retro-reflectors and own motion add to a frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes, Shots
from seaclutter_cli.simulation.marine.bodies import Bodies, PlacedBody
from seaclutter_cli.simulation.marine.physics import fresnel, mirror_share, refractive_index
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.simulation.marine.sea import SeaParams
from seaclutter_cli.simulation.marine.weather import Weather
from seaclutter_cli.simulation.marine.wide import Hits, WideSea, WideWater
from seaclutter_cli.truth import CLUTTER

Floats = NDArray[np.float64]

_RETRO_REFLECTANCE = 30.0
_RETRO_M = 0.3
_BLOOM = 0.02
_BLOOM_M = 0.05
_WIDTHS = 3.0


class Effects:
    """Effects in a scene with a section ``physics``."""

    def __init__(self, scene: Scene, hulls: Sequence[Any]) -> None:
        if scene.physics is None or not isinstance(scene.terrain, SeaParams):
            raise AssertionError("a scene without physics has no effects")
        self._physics, self._lidar, seed = scene.physics, scene.lidar, scene.recording.seed
        self.sea = WideSea(scene.terrain, self._physics, self._lidar, hulls, scene.vessel, seed)
        rain = self._physics.rain_mm_h, self._physics.drop_reflectivity
        # A surface of reflectivity 0.1 is detected at this range, so the least reflectivity is from there on.
        self.near_m = self._lidar.detection_m * float(np.sqrt(self._physics.least_reflectivity / 0.1))
        self._weather = Weather(self._lidar, rain, scene.terrain.extinction, self.near_m)
        self._phases = np.random.default_rng([seed, 3]).uniform(0, 2 * np.pi, 2)
        self.extinction = self._weather.extinction

    def rocking(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return pitch and roll of own ship beyond its response to waves, in radians, shape (T,) each."""
        pitch, roll = np.radians((self._physics.pitch_deg, self._physics.roll_deg))
        angle = 2 * np.pi * times_s / self._physics.roll_s
        return pitch * np.sin(2 * angle + self._phases[0]), roll * np.sin(angle + self._phases[1])

    def add_echoes(
        self,
        shots: Shots,
        echoes: Echoes,
        water: WideWater,
        bodies: tuple[Bodies, list[PlacedBody]],
        rng: np.random.Generator,
    ) -> None:
        """Add spray, mirrored echoes, blooming and weather to the echoes of water and bodies."""
        self.sea.add_sheets(shots, echoes, water.time_s, rng)
        self._add_mirrored(shots, echoes, water.last_hits, bodies, rng)
        for track in self._physics.retro_tracks:
            self._add_blooming(shots, echoes, track, rng)
        self._weather.add_echoes(echoes, rng)

    def _add_mirrored(
        self,
        shots: Shots,
        echoes: Echoes,
        hits: Hits,
        bodies: tuple[Bodies, list[PlacedBody]],
        rng: np.random.Generator,
    ) -> None:
        r"""Add the echoes of bodies that shots meet after the water has mirrored them, at the length of the whole way.

        The water mirrors a share :math:`F(\theta)` of the light on its way out and on its way back, and ripples spread
        it (`mirror_share`). The receiver puts the echo where it would be without a mirror: below the water.
        """
        variance = self._physics.ripple_variance
        wet = echoes.range_m[hits.shots] >= hits.distance_m
        shot, way, cosines = hits.shots[wet], hits.distance_m[wet], hits.cosines[wet]
        if not len(shot):
            return
        normals = hits.normals[wet]
        normals[:, :2] += np.sqrt(variance / 2) * rng.standard_normal((len(shot), 2))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        rays = shots.directions[shot]
        mirrored = Shots(shots.origins.copy(), shots.directions.copy(), shots.azimuths)
        mirrored.origins[shot] += way[:, None] * rays
        mirrored.directions[shot] = rays - 2 * np.einsum("ij,ij->i", rays, normals)[:, None] * normals
        seen = Echoes.empty(len(shots))
        seen.range_m[:] = 0.0
        seen.range_m[shot] = np.inf
        bodies[0].add_echoes(mirrored, seen, bodies[1], before=shots)
        met = np.isfinite(seen.range_m[shot])
        shot, way, cosines = shot[met], way[met], cosines[met]
        share = fresnel(cosines, refractive_index(self._lidar.wavelength_nm)) ** 2 * mirror_share(cosines, variance)
        whole = way + seen.range_m[shot], seen.reflectance[shot] * share
        echoes.add_stronger(shot, whole, CLUTTER, self._weather.loss)

    def _add_blooming(self, shots: Shots, echoes: Echoes, track: int, rng: np.random.Generator) -> None:
        """Make the top of an object a retro-reflector, whose light leaks into the shots around it.

        The halo has the range of the reflector, and is clutter.
        """
        own = np.flatnonzero(echoes.label == track)
        if not len(own):
            return
        width = np.radians(self._physics.bloom_deg)
        height = shots.origins[own, 2] + echoes.range_m[own] * shots.directions[own, 2]
        retro = own[height > height.max() - _RETRO_M]
        echoes.reflectance[retro] = _RETRO_REFLECTANCE
        centre = shots.directions[retro].mean(axis=0)
        centre /= np.linalg.norm(centre)
        near = np.flatnonzero(shots.directions @ centre > np.cos(_WIDTHS * width))
        near = near[echoes.label[near] != track]
        angle = np.arccos(np.clip(shots.directions[near] @ centre, -1.0, 1.0))
        range_m = float(np.median(echoes.range_m[retro])) + _BLOOM_M * rng.standard_normal(len(near))
        halo = _RETRO_REFLECTANCE * _BLOOM * np.exp(-angle / width) * rng.standard_exponential(len(near))
        echoes.add_stronger(near, (range_m, halo), CLUTTER, self._weather.loss)
