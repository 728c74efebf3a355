"""The sea or the ground of a scene: its effect on vessels, and its echoes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from seaclutter_cli.arrays import Floats, Ints, Mask, Rng
from seaclutter_cli.params import NotNegative, Positive, Share, key
from seaclutter_cli.simulation.lidar import Echoes, Shots
from seaclutter_cli.simulation.marine.motion import Motion, Pose
from seaclutter_cli.simulation.marine.physics import DIVERGENCE_RAD, PULSE_M, whitecap_share
from seaclutter_cli.simulation.marine.sea import Sea, SeaParams, Wake, patches
from seaclutter_cli.truth import CLUTTER, IGNORED

_RADII_M = np.geomspace(1.5, 130.0, 220)
_ROWS = 1800
_ROW_GAP = 16.0
_MAX_TANGENT = 7.0


class Hits(NamedTuple):
    """Shots that meet the water, W of them: their indices, distances, directions, and positions on the water."""

    shots: Ints
    distance_m: Floats
    rays: Floats
    x: Floats
    y: Floats


class MarineWater:
    r"""The sea at one moment, as a lidar sees it: waves, wakes, and foam in patches that depend on a seed.

    *Position.* Heights are sampled along radii around the lidar. From the lidar, at height h, a point of the surface at
    distance r and height :math:`\eta` is at the tangent :math:`(\eta - h)/r`. The running maximum of the tangent along
    a radius is the horizon of the waves up to there, and a shot hits the first wave whose horizon reaches the tangent
    of the shot. Crests therefore hide troughs.

    *Strength.* A smooth sea reflects a shot away from the lidar. The echo at a grazing angle comes from the few facets,
    droplets and bubbles in the beam that happen to face the lidar. As in radar (Ward, Tough, Watts 2013, Sea Clutter),
    the mean falls with the grazing angle (constant-gamma model: :math:`\rho \cos\theta` with :math:`\theta` the
    incidence on the local slope of the wave), and the distribution around the mean is compound: exponential speckle
    whose mean is modulated by gamma-distributed texture (K distribution). Foam is diffuse, with an effective
    reflectivity of 0.22 (Koepke 1984, Applied Optics 23(11)) on facets of any direction. If the beam, 3 mrad wide,
    lights water over a depth greater than the pulse length, the echo is spread in time and its peak is lower. The mean
    and the texture of water were set from [Li2023]: as many points of clutter as in Table 3, most of them weak and in
    concentric rings around own ship (section 2.2).
    """

    def __init__(self, sea: "SeaTerrain", time_s: float) -> None:
        self._params, self._wakes, self._seed, self.time_s = sea.params, sea.wakes, sea.seed, time_s
        self._surface, self._foam = sea.waves.at(time_s), sea.foam

    def height_and_slopes(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return height in metres and slopes along x and y at given positions, shape (N,) each."""
        slope_x, slope_y = self._surface.slope(x, y)
        return self._surface.height(x, y).astype(np.float64), slope_x.astype(np.float64), slope_y.astype(np.float64)

    def add_echoes(self, shots: Shots, echoes: Echoes, rng: Rng) -> None:
        """Add the echoes of the water and of spray."""
        self._hits = hits = self._intersect(shots)
        cover = self.whitecaps(hits.x, hits.y)
        for wake in self._wakes:
            cover = np.maximum(cover, wake.foam(hits.x, hits.y, self.time_s))
        foamy = cover > patches(hits.x, hits.y, self._seed)
        depth = DIVERGENCE_RAD * hits.distance_m / np.maximum(-hits.rays[:, 2], 1e-6)  # of the water that a beam lights
        reflectance = self._reflectance(hits, foamy, np.minimum(1.0, PULSE_M / depth), rng)
        echoes.add(hits.shots, hits.distance_m, reflectance, CLUTTER)
        self._add_wakes(shots, echoes, rng)

    def whitecaps(self, x: Floats, y: Floats) -> Floats:
        """Return the share of the water under whitecaps, shape (N,): they cover the crests, where waves break."""
        share, spread = whitecap_share(self._params.wind_ms), self._surface.heights[::4, ::4].astype(np.float64)
        crest = float(np.quantile(spread, 1 - share)) if share else np.inf
        return (self._surface.height(x, y) >= crest).astype(np.float64)

    def _reflectance(self, hits: Hits, foamy: Mask, peak: Floats, rng: Rng) -> Floats:
        """Return the reflectance of water and foam, given the peaks of echoes that are spread in time."""
        slope_x, slope_y = self._surface.slope(hits.x, hits.y)
        rays, shape, count = hits.rays, self._params.spikiness, len(hits.shots)
        facing = (rays[:, 0] * slope_x + rays[:, 1] * slope_y - rays[:, 2]) / np.sqrt(slope_x**2 + slope_y**2 + 1)
        speckle = rng.gamma(shape, 1 / shape, count) * rng.standard_exponential(count)
        water = self._params.reflectivity * np.clip(facing, 0.0, 1.0) * speckle
        foam = self._foam * rng.random(count) * rng.standard_exponential(count)
        return np.where(foamy, foam, water) * peak

    def _add_wakes(self, shots: Shots, echoes: Echoes, rng: Rng) -> None:
        for wake in self._wakes:
            wake.add_spray_echoes(shots, echoes, self.time_s, self._foam, rng)

    def _intersect(self, shots: Shots) -> Hits:
        origin = shots.origins.mean(axis=0)
        angles = 2 * np.pi / _ROWS * np.arange(_ROWS)
        x = origin[0] + np.outer(np.cos(angles), _RADII_M)
        y = origin[1] + np.outer(np.sin(angles), _RADII_M)
        heights = self._surface.height(x, y).astype(np.float64)
        for wake in self._wakes:
            heights += wake.height(x.reshape(-1), y.reshape(-1), self.time_s).reshape(x.shape)
        row = np.floor(shots.azimuths / (2 * np.pi) * _ROWS + 0.5).astype(np.int64) % _ROWS
        mast = np.full(_ROWS, origin[2])
        mast[row] = shots.origins[:, 2]
        horizon = np.maximum.accumulate((heights - mast[:, None]) / _RADII_M, axis=1)

        flat = np.hypot(shots.directions[:, 0], shots.directions[:, 1])
        tangent = np.clip(shots.directions[:, 2] / flat, -_MAX_TANGENT, _MAX_TANGENT)
        hit = np.flatnonzero(tangent < horizon[row, -1])
        row, tangent = row[hit], tangent[hit]
        # One search for all rows: each row has its own interval of keys.
        keys = (np.clip(horizon, -_MAX_TANGENT, _MAX_TANGENT) + _ROW_GAP * np.arange(_ROWS)[:, None]).reshape(-1)
        first = np.searchsorted(keys, tangent + _ROW_GAP * row) - row * len(_RADII_M)
        first = np.clip(first, 1, len(_RADII_M) - 1)
        above = tangent * _RADII_M[first - 1] + mast[row] - heights[row, first - 1]
        below = tangent * _RADII_M[first] + mast[row] - heights[row, first]
        share = np.clip(above / np.where(above > below, above - below, 1.0), 0.0, 1.0)
        radius = _RADII_M[first - 1] + share * (_RADII_M[first] - _RADII_M[first - 1])
        distance, rays = radius / flat[hit], shots.directions[hit]
        return Hits(hit, distance, rays, *(shots.origins[hit] + distance[:, None] * rays)[:, :2].T)


class SeaTerrain:
    """The sea of a scene and the wakes on it.

    ``hulls`` are the path, length and width of each hull that leaves a wake. Waves longer than twice the length of own
    ship move it.
    """

    def __init__(self, params: SeaParams, hulls: Sequence[Any], own_length_m: float, seed: int) -> None:
        self.params, self.seed, self.foam = params, seed, params.foam_reflectivity
        self.waves = Sea(params, np.random.default_rng([seed, 0]))
        self.motion = self.waves.swell(2 * own_length_m)
        self.wakes = [Wake(track, length, width, params.foam_lifetime_s) for track, length, width in hulls]

    def at(self, time_s: float) -> MarineWater:
        """Return the sea at a time."""
        return MarineWater(self, time_s)


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
        self.motion: Motion = lambda x, y, _: np.stack(self.height_and_slopes(x, y))

    def height_and_slopes(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return height in metres and slopes along x and y at given positions, shape (N,) each."""
        angle = np.outer(x, self._kx) + np.outer(y, self._ky) + self._phase
        steep = self._amplitude * np.cos(angle)
        return self._amplitude * np.sin(angle).sum(axis=1), steep @ self._kx, steep @ self._ky

    def at(self, _time_s: float) -> "Ground":
        """Return the ground, which does not change over time."""
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

    def add_echoes(self, shots: Shots, echoes: Echoes, _rng: Rng) -> None:
        """Add the echoes of the ground: the intersection with a plane, corrected for the height there."""
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
