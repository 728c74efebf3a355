"""A sea that reflects as published physics has it, and what it, the air and own ship add to a frame."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.special import gammaincinv

from seaclutter_cli.arrays import Floats, Mask, Rng
from seaclutter_cli.simulation.lidar import Echoes, Shots, extinction
from seaclutter_cli.simulation.marine import physics as optics
from seaclutter_cli.simulation.marine.bodies import PlacedBody, add_body_echoes
from seaclutter_cli.simulation.marine.motion import Pose, rotations
from seaclutter_cli.simulation.marine.physics import PhysicsParams, Weather
from seaclutter_cli.simulation.marine.scene import Scene
from seaclutter_cli.simulation.marine.sea import GRAVITY, SeaParams, add_droplet_echoes, patches
from seaclutter_cli.simulation.marine.terrain import Hits, MarineWater, SeaTerrain
from seaclutter_cli.truth import CLUTTER

_DRIFT = 0.03
_DEPTHS = np.concatenate((np.geomspace(1e-6, 0.05, 300), np.linspace(0.06, 16.0, 800)))
_WHITECAP_M = 1.2
_CYCLE = 4.0
_SHEET_S = 1.2
_SHEET_DENSITY = 0.4
_CREST_REACH_M = 50.0
_RETRO_REFLECTANCE = 30.0
_RETRO_M = 0.3
_BLOOM = 0.02
_BLOOM_M = 0.05
_WIDTHS = 3.0


class WideSea(SeaTerrain):
    """The sea of a scene with a section ``physics``, with its weather; the wind drives its spray, waves rock own ship.

    ``extinction`` is that of its air; no echo is weaker than one from ``near_m``, however near.
    """

    def __init__(self, scene: Scene, physics: PhysicsParams, params: SeaParams, hulls: Sequence[Any]) -> None:
        super().__init__(params, hulls, scene.vessel.length_m, scene.recording.seed)
        self.physics, self.lidar, self.own = physics, scene.lidar, scene.vessel
        self.foam = params.foam_reflectivity * optics.foam_share(self.lidar.wavelength_nm)
        # A surface of reflectivity 0.1 is detected at this range, so the least reflectivity is from there on.
        self.near_m = self.lidar.detection_m * float(np.sqrt(physics.least_reflectivity / 0.1))
        self.weather = Weather(self.lidar, physics, extinction(params.visibility_km), self.near_m)
        self._phases = np.random.default_rng([self.seed, 3]).uniform(0, 2 * np.pi, 2)

    def rocking(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Return pitch and roll of own ship beyond its response to waves, in radians, shape (T,) each."""
        pitch, roll = np.radians((self.physics.pitch_deg, self.physics.roll_deg))
        angle = 2 * np.pi * times_s / self.physics.roll_s
        return pitch * np.sin(2 * angle + self._phases[0]), roll * np.sin(angle + self._phases[1])

    def at(self, time_s: float) -> "WideWater":
        """Return the sea at a time."""
        return WideWater(self, time_s)


class WideWater(MarineWater):
    r"""The sea at one moment, with the optics of water.

    *Water.* Light comes back from below the surface (`water_reflectance`) and from ripples that face the lidar
    (`facet_reflectance`, with the slopes of Cox and Munk). Bubbles and what floats are uneven: the mean is multiplied
    by texture, gamma-distributed with the sea's ``spikiness`` over patches that drift and are renewed, and by the
    exponential speckle of a shot, which makes a K distribution (Ward, Tough, Watts 2013).

    *Foam.* A patch of whitecap appears, decays to 1/e within `PhysicsParams.whitecap_s` (Monahan 1971: 3.5 s), and
    drifts with 3 % of the wind (Wu 1975); as many appear as cover the published share on average.

    *Turbulent wakes.* A part of the shots into the wake of a vessel meets froth above the water, at heights that are
    distributed exponentially. Its patches remain in place. The wash of own propeller is froth, too.
    """

    def __init__(self, sea: WideSea, time_s: float) -> None:
        super().__init__(sea, time_s)
        self._wide, self._physics, self._wavelength_nm = sea, sea.physics, sea.lidar.wavelength_nm

    def _reflectance(self, hits: Hits, foamy: Mask, peak: Floats, rng: Rng) -> Floats:
        slope_x, slope_y = self._surface.slope(hits.x, hits.y)
        normals = np.stack((-slope_x, -slope_y, np.ones_like(slope_x)), axis=1).astype(np.float64)
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self._cosines = np.clip(-np.einsum("ij,ij->i", hits.rays, self._normals), 0.0, 1.0)
        reflectance = optics.water_reflectance(self._cosines, self._wavelength_nm, self._physics.backscatter)
        reflectance *= self._texture(hits.x, hits.y)
        reflectance += optics.facet_reflectance(self._cosines, self._wavelength_nm, self._physics.ripple_variance)
        reflectance[foamy] = self._foam * patches(hits.x, hits.y, self._seed + 1)[foamy]
        return reflectance * (rng.standard_exponential(len(foamy)) * peak)

    def _texture(self, x: Floats, y: Floats) -> Floats:
        """Return the texture at given positions, whose mean is 1, shape (N,)."""
        shape = self._params.spikiness
        _, drawn = self._renewed(x, y, self._physics.patch_m, self._physics.patch_s, self._seed + 2)
        return np.asarray(np.interp(-np.log1p(-drawn), _DEPTHS, gammaincinv(shape, -np.expm1(-_DEPTHS)) / shape))

    def whitecaps(self, x: Floats, y: Floats) -> Floats:
        """Return the share of the water under whitecaps at given positions, shape (N,)."""
        physics, mean = self._physics, (1 - np.exp(-_CYCLE)) / _CYCLE
        age, drawn = self._renewed(x, y, _WHITECAP_M, _CYCLE * physics.whitecap_s, self._seed + 4)
        breaking = drawn < optics.whitecap_share(physics.wind_ms) * physics.shelter / mean
        return np.asarray(breaking * np.exp(-_CYCLE * age))

    def _renewed(self, x: Floats, y: Floats, size_m: float, life_s: float, seed: int) -> tuple[Floats, Floats]:
        """Return the age of patches that drift with the wind, in lifetimes, and a number that each has throughout."""
        way, angle = _DRIFT * self._physics.wind_ms * self.time_s, np.radians(self._physics.wind_deg)
        scale = 0.4 / size_m  # `patches` are 0.4 m wide
        along, across = (x - way * np.cos(angle)) * scale, (y - way * np.sin(angle)) * scale
        phase = self.time_s / life_s + patches(along, across, seed)
        return phase % 1, patches(along + 1000.0 * np.floor(phase), across, seed + 1)

    def _add_wakes(self, shots: Shots, echoes: Echoes, rng: Rng) -> None:
        physics, hits = self._physics, self._hits
        height = physics.wake_height_m * rng.standard_exponential(len(hits.shots))
        distance = np.maximum(hits.distance_m - height / np.maximum(-hits.rays[:, 2], 1e-6), 0.0)
        x, y = (shots.origins[hits.shots] + distance[:, None] * hits.rays)[:, :2].T
        strength = np.zeros(len(x))
        if physics.wash_m:
            own_x, own_y, heading = self._wide.own.track.at(self.time_s)
            half = self._wide.own.length_m / 2
            bow = own_x + half * float(np.cos(heading)), own_y + half * float(np.sin(heading))
            strength = np.exp(-((np.hypot(x - bow[0], y - bow[1]) / physics.wash_m) ** 2))
        for wake in self._wakes if physics.wake_m else ():
            strength = np.maximum(strength, wake.churned(x, y, self.time_s, physics.wake_m))
        met = np.flatnonzero((physics.wake_cover * strength > patches(x, y, self._seed + 6)) & (distance > 1))
        froth = physics.wake_reflectivity * optics.foam_share(self._wavelength_nm)
        echoes.add(hits.shots[met], distance[met], froth * rng.standard_exponential(len(met)), CLUTTER)
        super()._add_wakes(shots, echoes, rng)

    def add_effects(self, shots: Shots, echoes: Echoes, bodies: Sequence[PlacedBody], rng: Rng) -> None:
        """Add spray, mirrored echoes, blooming and weather to the echoes of water and bodies."""
        self._add_sheets(shots, echoes, rng)
        self._add_mirrored(shots, echoes, bodies, rng)
        for track in self._physics.retro_tracks:
            self._add_blooming(shots, echoes, track, rng)
        self._wide.weather.add_echoes(echoes, rng)

    def _add_mirrored(self, shots: Shots, echoes: Echoes, bodies: Sequence[PlacedBody], rng: Rng) -> None:
        r"""Add the echoes of bodies that shots meet after the water has mirrored them, at the length of the whole way.

        The water mirrors a share :math:`F(\theta)` of the light on its way out and on its way back, and ripples spread
        it (`mirror_share`). The receiver puts the echo where it would be without a mirror: below the water.
        """
        variance, hits = self._physics.ripple_variance, self._hits
        wet = echoes.range_m[hits.shots] >= hits.distance_m
        shot, way, rays = hits.shots[wet], hits.distance_m[wet], hits.rays[wet]
        cosines, normals = self._cosines[wet], self._normals[wet]
        normals[:, :2] += np.sqrt(variance / 2) * rng.standard_normal((len(shot), 2))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        mirrored = Shots(shots.origins.copy(), shots.directions.copy(), shots.azimuths)
        mirrored.origins[shot] += way[:, None] * rays
        mirrored.directions[shot] = rays - 2 * np.einsum("ij,ij->i", rays, normals)[:, None] * normals
        seen = Echoes.empty(len(shots))
        seen.range_m[:] = 0.0
        seen.range_m[shot] = np.inf
        add_body_echoes(mirrored, seen, bodies, before=shots)
        met = np.isfinite(seen.range_m[shot])
        shot, way, cosines = shot[met], way[met], cosines[met]
        mirrored_once = optics.fresnel(cosines, optics.refractive_index(self._wavelength_nm))
        share = mirrored_once**2 * optics.mirror_share(cosines, variance)
        whole_m, reflectance = way + seen.range_m[shot], seen.reflectance[shot] * share
        echoes.add_stronger(shot, whole_m, reflectance, self._wide.weather.loss)

    def _add_blooming(self, shots: Shots, echoes: Echoes, track: int, rng: Rng) -> None:
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
        echoes.add_stronger(near, range_m, halo, self._wide.weather.loss)

    def _add_sheets(self, shots: Shots, echoes: Echoes, rng: Rng) -> None:
        """Add the echoes of sheets of spray from the bow and from crests.

        A sheet flies up and falls as a stone would, grows thinner and wider, and the wind carries it along.
        """
        spray, time_s = self._physics.spray, self.time_s
        if not spray:
            return
        for number in range(int((time_s - _SHEET_S) * spray), int(time_s * spray) + 1):
            draw = np.random.default_rng([self._seed, 2, number + 1000])
            age_s = time_s - (number + draw.random()) / spray
            if 0 <= age_s < _SHEET_S:
                pose, corners = self._sheet(time_s - age_s, age_s, draw)
                density = _SHEET_DENSITY * np.exp(-age_s / 0.5)
                add_droplet_echoes(shots, echoes, pose, corners, (density, self._foam), rng)

    def _sheet(self, start_s: float, age_s: float, draw: Rng) -> tuple[Pose, Floats]:
        """Return the pose and the corners of a sheet that was thrown up at a time."""
        wind, angle = self._physics.wind_ms, np.radians(self._physics.wind_deg)
        own = self._wide.own
        x, y, heading = own.track.at(start_s)
        if draw.random() < 0.5:
            side = draw.choice((-1.0, 1.0))
            ahead, aside, speed = 0.5 * own.length_m, side * own.width_m * draw.uniform(0.4, 1.2), 3.5
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
        return Pose(position, rotations(angle)), np.stack((-half, half))
