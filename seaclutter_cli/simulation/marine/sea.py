"""The sea surface: random waves with a published spectrum, and the foam, waves and spray that vessels leave on it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray
from scipy import fft

from seaclutter_cli.arrays import Floats, Ints, Rng
from seaclutter_cli.params import Positive, Share, key
from seaclutter_cli.simulation.lidar import Echoes, Shots
from seaclutter_cli.simulation.marine.motion import Leg, Motion, Pose, Track, rotations
from seaclutter_cli.simulation.marine.shapes import intersect_box
from seaclutter_cli.truth import CLUTTER

GRAVITY = 9.81
_CELLS = 256
_SWELL_WAVES = 256
_TILE_WAVES = 12.0
_MIN_TILE_M, _MAX_TILE_M = 48.0, 160.0
_HEIGHTS_M = (0.0, 0.05, 0.3, 0.875, 1.875, 3.25, 5.0)


@dataclass(frozen=True, kw_only=True)
class SeaParams:
    """The sea of a scene."""

    sea_state: Annotated[float, Interval(ge=0, le=6)] = key(
        2.0, "Sea state on the WMO scale, 0 to 6; between whole numbers the wave height is interpolated."
    )
    peak_enhancement: Annotated[float, Interval(ge=1, le=10)] = key(
        3.3, "Peak enhancement of the JONSWAP spectrum; 1 gives the Pierson-Moskowitz spectrum."
    )
    direction_deg: float = key(0.0, "Direction in which the waves travel, counter-clockwise from the world's x.")
    spreading: Annotated[int, Interval(ge=1, le=50)] = key(
        4, "Exponent s of the directional spread, the cosine of half the angle to the power of 2s."
    )
    reflectivity: Share = key(0.002, "Mean reflectivity of water at normal incidence.")
    spikiness: Positive = key(
        0.2, "Shape of the texture that makes few facets bright and most dark; smaller values are spikier."
    )
    foam_reflectivity: Share = key(0.22, "Reflectivity of foam and spray at normal incidence.")
    foam_lifetime_s: Positive = key(8.0, "Time in which the foam of a wake decays to 1/e.", formerly="foam_life_s")
    visibility_km: Positive = key(10.0, "Meteorological visibility, which determines the extinction in air.")

    @property
    def significant_height_m(self) -> float:
        """Significant wave height of the sea state: the middle of the WMO's bounds."""
        return float(np.interp(self.sea_state, np.arange(len(_HEIGHTS_M)), _HEIGHTS_M))

    @property
    def wind_ms(self) -> float:
        """Wind speed that raises this sea if it is fully developed: :math:`H_s = 0.21 U^2 / g`."""
        return float(np.sqrt(self.significant_height_m * GRAVITY / 0.21))


def jonswap(omega: Floats, height_m: float, peak: float, enhancement: float) -> Floats:
    r"""Return the JONSWAP spectrum of the surface elevation (Hasselmann et al. 1973, Dt. Hydrogr. Z. A8(12)).

    .. math:: S(\omega) = \frac{A}{\omega^5} \exp\!\left(-\tfrac54 \left(\tfrac{\omega_p}{\omega}\right)^4\right)
        \gamma^{\exp(-(\omega-\omega_p)^2 / (2 \sigma^2 \omega_p^2))}

    It is the variance density, in m² s / rad, at angular frequencies :math:`\omega > 0`, shape (N,), for a significant
    wave height in metres, the frequency of the peak, :math:`\omega_p`, and its enhancement :math:`\gamma`; 1 gives the
    Pierson-Moskowitz spectrum (1964, JGR 69(24)). A reproduces the height to within about 1 % (Goda's approximation).
    """
    sigma = np.where(omega <= peak, 0.07, 0.09)
    bump = enhancement ** np.exp(-((omega / peak - 1) ** 2) / (2 * sigma**2))
    scale = 5 / 16 * height_m**2 * peak**4 * (1 - 0.287 * np.log(enhancement))
    return np.asarray(scale / omega**5 * np.exp(-1.25 * (peak / omega) ** 4) * bump)


def directional_variance(
    wave: tuple[Floats, Floats],
    spectrum: tuple[float, float, float],
    direction_deg: float,
    spreading: int,
    norm: float = 1.0,
) -> Floats:
    """Return the density of the variance of each wave vector, with components that broadcast to (M, M); 0 at 0.

    ``spectrum`` is height, peak and enhancement of `jonswap`. The directional spread is divided by ``norm``.
    """
    kx, ky = np.broadcast_arrays(*wave)
    k = np.hypot(kx, ky)
    out: Floats = np.zeros_like(k)
    some = k > 0
    omega = np.sqrt(GRAVITY * k[some])
    spread = np.cos((np.arctan2(ky, kx)[some] - np.radians(direction_deg)) / 2) ** (2 * spreading) / norm
    # S(omega) D(theta) d omega d theta by wave vector: d omega / d k = g / (2 omega), dk k dtheta = dkx dky.
    out[some] = jonswap(omega, *spectrum) * spread * GRAVITY / (2 * omega) / k[some]
    return out


@dataclass(frozen=True)
class WaveSurface:
    """The sea at one moment: a periodic tile of elevations in metres by x and y, shape (M, M), in cells of a width."""

    heights: NDArray[np.float32]
    cell_m: float

    def _cells(self, x: Floats, y: Floats) -> tuple[Ints, Ints]:
        column, row = (np.floor(axis / self.cell_m + 0.5).astype(np.int64) % len(self.heights) for axis in (x, y))
        return column, row

    def height(self, x: Floats, y: Floats) -> NDArray[np.float32]:
        """Return the elevation of the nearest cells in metres."""
        return np.asarray(self.heights[self._cells(x, y)])

    def slope(self, x: Floats, y: Floats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the slopes along x and y of the nearest cells, by central differences."""
        (column, row), heights, size = self._cells(x, y), self.heights, len(self.heights)
        along_x = heights[(column + 1) % size, row] - heights[column - 1, row]
        along_y = heights[column, (row + 1) % size] - heights[column, row - 1]
        return along_x / (2 * self.cell_m), along_y / (2 * self.cell_m)


class Sea:
    r"""Random waves in deep water on a periodic tile.

    Each wave vector of a grid gets a random amplitude with the variance given by spectrum and directional
    spread, and oscillates with :math:`\omega = \sqrt{g k}`; the surface is the inverse Fourier transform, as in
    Tessendorf (2001, Simulating Ocean Water). The tile is twelve peak wavelengths wide, but at most 160 m, so that it
    repeats beyond the part of the sea that a lidar sees.
    """

    def __init__(self, params: SeaParams, rng: Rng) -> None:
        self.params = params
        peak = 0.877 * GRAVITY / params.wind_ms if params.wind_ms else 5.0
        wavelength = 2 * np.pi * GRAVITY / peak**2
        self.tile_m = max(_MIN_TILE_M, min(_TILE_WAVES * wavelength, _MAX_TILE_M))
        self.cell_m = self.tile_m / _CELLS
        wave = 2 * np.pi * fft.fftfreq(_CELLS, self.cell_m)
        self._kx, self._ky = wave[:, None], wave[None, :]
        self._omega = np.sqrt(GRAVITY * np.hypot(self._kx, self._ky))
        noise = rng.standard_normal((2, _CELLS, _CELLS))
        angles = np.linspace(-np.pi, np.pi, 720, endpoint=False)
        norm = np.mean(np.cos(angles / 2) ** (2 * params.spreading)) * 2 * np.pi
        spectrum = params.significant_height_m, peak, params.peak_enhancement
        density = directional_variance((self._kx, self._ky), spectrum, params.direction_deg, params.spreading, norm)
        self._amplitude = np.sqrt(density * (2 * np.pi / self.tile_m) ** 2) * (noise[0] + 1j * noise[1])

    def at(self, time_s: float) -> WaveSurface:
        """Return the surface at a time."""
        modes = self._amplitude * np.exp(-1j * self._omega * time_s)
        heights = fft.ifft2(modes, workers=1, overwrite_x=True).real * _CELLS**2
        return WaveSurface(heights.astype(np.float32), self.cell_m)

    def swell(self, shortest_m: float) -> Motion:
        """Return the motion of the strongest waves longer than ``shortest_m``, which are those that move a hull."""
        kx, ky = (part.reshape(-1) for part in np.broadcast_arrays(self._kx, self._ky))
        long = np.flatnonzero(np.hypot(kx, ky) < 2 * np.pi / shortest_m)
        amplitude = self._amplitude.reshape(-1)
        chosen = long[np.argsort(-np.abs(amplitude[long]), kind="stable")[:_SWELL_WAVES], None]
        kx, ky, omega, amplitude = kx[chosen], ky[chosen], self._omega.reshape(-1)[chosen], amplitude[chosen]

        def motion(x: Floats, y: Floats, times_s: Floats) -> Floats:
            modes = amplitude * np.exp(1j * (kx * x + ky * y - omega * times_s))
            return np.stack([(factor * modes).sum(axis=0).real for factor in (1, 1j * kx, 1j * ky)])

        return motion


KELVIN = np.arcsin(1 / 3)
"""Half the angle of a wake in deep water, 19.47°, at any speed."""

_LONGEST_S = 60.0
_FOAM_SPEED_MS = 8.0
_FOAM_COVER = 0.15
_PATCH_M = 0.4
_SPRAY_SPEED_MS = 4.0
_LEAST_WAVE_SPEED_MS = np.sqrt(GRAVITY)  # their height at the bow is then 5 cm
_DROPLETS_S_M2 = 0.0005


@dataclass(frozen=True)
class Wake:
    r"""The wake of one vessel, along its path, for the size of its waterline; foam decays to 1/e in a lifetime.

    The wake has two parts, each in the frame of the leg that left it, x metres behind the vessel and y to its side.
    Both remain in place after the vessel has gone.

    * Foam churned up behind the stern. Its width grows with :math:`x^{1/5}` (Milgram et al. 1993, JGR 98(C4)); its
      initial cover is proportional to the square of the speed and decays with the age of the water.
    * The bow wave and the arms of the Kelvin wake (Newman 1977, Marine Hydrodynamics, ch. 6), at :math:`\pm
      19.47^\circ`, which break near the vessel. Their height falls with :math:`x^{-1/3}`, and their wavelength along
      the arm is :math:`\tfrac23 \cdot 2 \pi U^2 / g`.

    The literature does not quantify foam and spray as a lidar sees them. The two constants were chosen to match Table 3
    of [Li2023]: a few percent of the clutter in `buoy_speedboat` is brighter than the thresholds of the paper.
    """

    track: Track
    length_m: float
    width_m: float
    foam_lifetime_s: float

    def foam(self, x: Floats, y: Floats, time_s: float) -> Floats:
        """Return the share of the water under foam at given positions, shape (N,), from 0 to 1."""
        cover = np.zeros(len(x))
        for leg, inside, behind, aside, age in self._behind(x, y, time_s):
            fresh = min(1.0, (leg.speed_ms / _FOAM_SPEED_MS) ** 2) * _FOAM_COVER
            half = self.width_m / 2 * np.maximum(1.0, behind / self.length_m) ** 0.2
            churned = np.exp(-((aside / half) ** 4)) * np.exp(-age / self.foam_lifetime_s)
            arm = np.exp(-(((aside - self._arm(behind)) / (0.4 + 0.05 * behind)) ** 2))
            breaking = arm * np.exp(-behind / (2 * self.length_m + leg.speed_ms))
            cover[inside] = np.maximum(cover[inside], fresh * np.maximum(churned, breaking))
        return cover

    def height(self, x: Floats, y: Floats, time_s: float) -> Floats:
        """Return the height of the wake above the undisturbed sea at given positions, shape (N,), in metres."""
        rise = np.zeros(len(x))
        for leg, inside, behind, aside, _ in self._behind(x, y, time_s, _LEAST_WAVE_SPEED_MS):
            steep = 0.1 * min(leg.speed_ms**2 / (2 * GRAVITY), 1.5)
            wavelength = 2 / 3 * 2 * np.pi * leg.speed_ms**2 / GRAVITY
            arm = np.exp(-(((aside - self._arm(behind)) / (0.5 + 0.1 * behind)) ** 2))
            decay = np.maximum(1.0, behind / self.length_m) ** (-1 / 3)
            rise[inside] += steep * decay * arm * np.cos(2 * np.pi * behind / wavelength)
        return rise

    def _arm(self, behind: Floats) -> Floats:
        return np.asarray(self.width_m / 2 + behind * np.tan(KELVIN))

    def _behind(
        self, x: Floats, y: Floats, time_s: float, slowest_ms: float = 0.0
    ) -> Iterator[tuple[Leg, Ints, Floats, Floats, Floats]]:
        """Yield legs, positions in their wakes, their distances astern and to the side of the bow, and their age."""
        for leg in self.track.legs:
            if not leg.speed_ms or leg.speed_ms < slowest_ms or time_s <= leg.start_s - _LONGEST_S:
                continue
            cos, sin = np.cos(leg.heading_rad), np.sin(leg.heading_rad)
            bow = leg.speed_ms * (time_s - leg.start_s) + self.length_m / 2
            # Water that the leg has passed recently, between its start and its end; the first leg extends backwards.
            first = bow - leg.speed_ms * _LONGEST_S
            if leg is not self.track.legs[0]:
                first = max(first, 0.0)
            last = min(bow, leg.speed_ms * (leg.end_s - leg.start_s) + self.length_m / 2)
            if last <= first:  # not there yet
                continue
            along = cos * x + (sin * y - (leg.x_m * cos + leg.y_m * sin))
            passed = np.flatnonzero((along > first) & (along < last))
            behind = bow - along[passed]
            aside = np.abs(cos * (y[passed] - leg.y_m) - sin * (x[passed] - leg.x_m))
            near = np.flatnonzero(aside < self._arm(behind) + 1 + 0.3 * behind)
            behind = behind[near]
            yield leg, passed[near], behind, aside[near], np.maximum(0.0, behind - self.length_m) / leg.speed_ms

    def add_spray_echoes(self, shots: Shots, echoes: Echoes, time_s: float, reflectivity: float, rng: Rng) -> None:
        """Add the echoes of droplets, unless the vessel is too slow to throw up spray.

        The probability of a hit grows with the path of the shot through spray.
        """
        speed = next((leg.speed_ms for leg in reversed(self.track.legs) if leg.start_s <= time_s), 0.0)
        if speed >= _SPRAY_SPEED_MS:
            x, y, heading = self.track.at(time_s)
            back = -self.length_m / 2 - 0.4 * speed
            corners = np.array([[back, -self.width_m, 0.0], [self.length_m / 2, self.width_m, 0.08 * speed + 0.2]])
            pose = Pose(np.array([x, y, 0.0]), rotations(heading))
            add_droplet_echoes(shots, echoes, pose, corners, (_DROPLETS_S_M2 * speed, reflectivity), rng)

    def churned(self, x: Floats, y: Floats, time_s: float, reach_m: float) -> Floats:
        """Return the share of its first strength that the turbulent wake has at given positions, shape (N,).

        It is twice as wide as the hull (Trevorrow et al. 1994: two to four times), widens as the foam does, and ends
        ``reach_m`` behind the stern.
        """
        strength = np.zeros(len(x))
        for _, inside, behind, aside, _ in self._behind(x, y, time_s):
            half = self.width_m * np.maximum(1.0, behind / self.length_m) ** 0.2
            astern = np.clip(1 - (behind - self.length_m) / reach_m, 0.0, 1.0) * (behind > 0.6 * self.length_m)
            strength[inside] = np.maximum(strength[inside], astern * np.exp(-((aside / half) ** 4)))
        return strength


def add_droplet_echoes(
    shots: Shots, echoes: Echoes, pose: Pose, corners: Floats, droplets: tuple[float, float], rng: Rng
) -> None:
    """Add the echoes of a box of droplets, from its lower to its upper corner in the frame of the pose.

    ``droplets`` are their hits per metre of a shot's path, and their reflectivity.
    """
    density, reflectivity = droplets
    offset = pose.position[:2] - shots.origins[0, :2]
    range_m, reach = float(np.hypot(*offset)), float(np.abs(corners).max()) + 1
    half = np.pi if range_m <= reach else float(np.arcsin(reach / range_m))
    ahead = float(np.arctan2(offset[1], offset[0]))
    near = shots.between(ahead - half, ahead + half)
    origins = (shots.origins[near] - pose.position) @ pose.rotation
    begin, end = intersect_box(origins, shots.directions[near] @ pose.rotation, *corners)
    path = np.clip(end - begin, 0.0, None)
    hit = np.flatnonzero(rng.random(len(near)) < 1 - np.exp(-density * path))
    distance = begin[hit] + rng.random(len(hit)) * path[hit]
    reflectance = reflectivity * rng.standard_exponential(len(hit))
    echoes.add(near[hit], distance, reflectance, CLUTTER)


def patches(x: Floats, y: Floats, seed: int) -> Floats:
    """Return a number from 0 to 1 for each patch of water, shape (N,), which is constant over time.

    A patch is foam while its number is below the share of foam, so it remains foam until it fades.
    """
    column = np.floor(x / _PATCH_M).astype(np.int64).view(np.uint64)
    row = np.floor(y / _PATCH_M).astype(np.int64).view(np.uint64)
    mixed = column * np.uint64(0x9E3779B97F4A7C15) ^ row * np.uint64(0xC2B2AE3D27D4EB4F)
    mixed += np.uint64(seed * 0x165667B19E3779F9 % 2**64)
    mixed = (mixed ^ (mixed >> np.uint64(31))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(29))) * np.uint64(0x94D049BB133111EB)
    return np.asarray((mixed >> np.uint64(11)).astype(np.float64) / 2**53)
