"""Wakes: the foam and waves that a vessel leaves on the sea, and the spray around it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.simulation.lidar.echoes import Echoes, Shots
from seaclutter_cli.simulation.marine.motion import Leg, Pose, Track
from seaclutter_cli.simulation.marine.sea import GRAVITY
from seaclutter_cli.simulation.marine.shapes import intersect_box
from seaclutter_cli.truth import CLUTTER

Floats = NDArray[np.float64]

KELVIN = np.arcsin(1 / 3)
"""Half the angle of a wake in deep water, 19.47°, at any speed."""

_LONGEST_S = 60.0
_FOAM_SPEED_MS = 8.0
_FOAM_COVER = 0.15
_PATCH_M = 0.4
_SPRAY_SPEED_MS = 4.0
_MIN_WAVE_M = 0.05
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
        for leg in self.track.legs:
            inside, behind, aside, age = self._behind(leg, x, y, time_s)
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
        for leg in self.track.legs:
            steep = 0.1 * min(leg.speed_ms**2 / (2 * GRAVITY), 1.5)
            if steep < _MIN_WAVE_M:
                continue
            inside, behind, aside, _ = self._behind(leg, x, y, time_s)
            wavelength = 2 / 3 * 2 * np.pi * leg.speed_ms**2 / GRAVITY
            arm = np.exp(-(((aside - self._arm(behind)) / (0.5 + 0.1 * behind)) ** 2))
            decay = np.maximum(1.0, behind / self.length_m) ** (-1 / 3)
            rise[inside] += steep * decay * arm * np.cos(2 * np.pi * behind / wavelength)
        return rise

    def _arm(self, behind: Floats) -> Floats:
        """Return the lateral distance of the wake's arms."""
        return np.asarray(self.width_m / 2 + behind * np.tan(KELVIN))

    def _behind(
        self, leg: Leg, x: Floats, y: Floats, time_s: float
    ) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
        """Return the positions that the wake of a leg reaches, their offsets from the bow, and their age.

        The offsets are the distances astern and to the side.
        """
        nothing = np.empty(0, np.int64), np.empty(0), np.empty(0), np.empty(0)
        if leg.speed_ms <= 0 or time_s <= leg.start_s - _LONGEST_S:
            return nothing
        cos, sin = np.cos(leg.heading_rad), np.sin(leg.heading_rad)
        bow = leg.speed_ms * (time_s - leg.start_s) + self.length_m / 2
        # Water that the leg has passed recently, between its start and its end; the first leg extends backwards.
        first = bow - leg.speed_ms * _LONGEST_S
        if leg is not self.track.legs[0]:
            first = max(first, 0.0)
        last = min(bow, leg.speed_ms * (leg.end_s - leg.start_s) + self.length_m / 2)
        if last <= first:  # not there yet
            return nothing
        along = cos * x + (sin * y - (leg.x_m * cos + leg.y_m * sin))
        passed = np.flatnonzero((along > first) & (along < last))
        behind = bow - along[passed]
        aside = np.abs(cos * (y[passed] - leg.y_m) - sin * (x[passed] - leg.x_m))
        near = np.flatnonzero(aside < self._arm(behind) + 1 + 0.3 * behind)
        behind = behind[near]
        return passed[near], behind, aside[near], np.maximum(0.0, behind - self.length_m) / leg.speed_ms

    def spray(self, time_s: float) -> tuple[Floats, Floats, float] | None:
        """Return the box in which droplets fly; None if the vessel is too slow to throw up spray.

        These are its lower and upper corner in the vessel's frame, x, y and heading of the vessel, and droplets hit per
        metre.
        """
        x, y, heading = self.track.at(np.array([time_s]))
        speed = next((leg.speed_ms for leg in reversed(self.track.legs) if leg.start_s <= time_s), 0.0)
        if speed < _SPRAY_SPEED_MS:
            return None
        back = -self.length_m / 2 - 0.4 * speed
        corners = np.array([[back, -self.width_m, 0.0], [self.length_m / 2, self.width_m, 0.08 * speed + 0.2]])
        return corners, np.array([x[0], y[0], heading[0]]), _DROPLETS_S_M2 * speed

    def add_spray_echoes(
        self, shots: Shots, echoes: Echoes, time_s: float, reflectivity: float, rng: np.random.Generator
    ) -> None:
        """Add the echoes of droplets; the probability of a hit grows with the path of the shot through spray."""
        spray = self.spray(time_s)
        if spray is None:
            return
        corners, (x, y, heading), density = spray
        pose = Pose.of(np.array([x, y, 0.0]), yaw=heading)
        add_droplet_echoes(shots, echoes, pose, corners, (density, reflectivity), rng)

    def churned(self, x: Floats, y: Floats, time_s: float, reach_m: float) -> Floats:
        """Return the share of its first strength that the turbulent wake has at given positions, shape (N,).

        It is twice as wide as the hull (Trevorrow et al. 1994: two to four times), widens as the foam does, and ends
        ``reach_m`` behind the stern.
        """
        strength = np.zeros(len(x))
        for leg in self.track.legs:
            inside, behind, aside, _ = self._behind(leg, x, y, time_s)
            half = self.width_m * np.maximum(1.0, behind / self.length_m) ** 0.2
            astern = np.clip(1 - (behind - self.length_m) / reach_m, 0.0, 1.0) * (behind > 0.6 * self.length_m)
            strength[inside] = np.maximum(strength[inside], astern * np.exp(-((aside / half) ** 4)))
        return strength


def add_droplet_echoes(
    shots: Shots, echoes: Echoes, pose: Pose, corners: Floats, droplets: tuple[float, float], rng: np.random.Generator
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
