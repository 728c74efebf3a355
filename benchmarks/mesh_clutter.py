"""Echoes of `mesh_sea` from the water, and from spray, rain and fog, through which others fade."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from mesh_parts import Array, Random
from mesh_scan import Scan, Surface
from mesh_water import Sea
from mesh_waves import GRAVITY, World
from mesh_world import Body, Own

GATES = np.array([1.2, 1.8, 2.6, 4, 6, 9, 13, 18, 25], np.float32)  # ranges of fog in metres


class Jet(NamedTuple):
    """Where spray is thrown from, ahead and to port; its speeds to port, up and ahead; size, optical thickness."""

    ahead: float
    port: float
    aside: float
    up: float
    speed: float
    size: float
    thickness: float


class Spray:
    """Puffs of drops that fly with drag, fall and thin out: place, velocity, age, size, optical thickness."""

    SINK_M = 0.18  # of the bow, at which it throws spray

    def __init__(self, world: World, own: Own, bodies: Sequence[Body], rng: Random) -> None:
        self.world, self.own, self.rng = world, own, rng
        self.fast = [body for body in bodies if body.speed > 5 and body.length < 14 and body.target]
        self.puffs, self.pause_s = np.zeros((0, 9)), 0.0
        self.wind = 0.7 * world["wind"] * np.array([np.cos(world["wind_to"]), np.sin(world["wind_to"]), 0])

    def _throw(self, path: tuple[float, float, float], z: float, number: int, jet: Jet) -> None:
        (x, y, yaw), rng = path, self.rng
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, sin], [-sin, cos]])
        at = [jet.ahead + rng.normal(0, 0.35, number), jet.port + rng.normal(0, 0.15, number)]
        level = [jet.speed * rng.uniform(0.3, 0.8, number), jet.aside * rng.uniform(0.3, 1.2, number)]
        height, up = z + rng.uniform(0, 0.2, number), jet.up * rng.uniform(0.2, 1.1, number)
        size, thickness = jet.size * rng.lognormal(0, 0.4, number), jet.thickness * rng.lognormal(0, 0.5, number)
        place, velocity = np.column_stack(at) @ turn + [x, y], np.column_stack(level) @ turn
        puffs = np.column_stack([place, height, velocity, up, np.zeros(number), size, thickness])
        self.puffs = np.concatenate([self.puffs, puffs])

    def _fly(self, seconds: float) -> None:
        puffs = self.puffs
        puffs[:, 3:6] += (self.wind - puffs[:, 3:6]) * (1 - np.exp(-seconds * 1.6)) * [1, 1, 0.4]
        puffs[:, 5] -= GRAVITY * seconds * 0.8
        puffs[:, :3] += puffs[:, 3:6] * seconds
        puffs[:, 6] += seconds
        puffs[:, 8] *= np.exp(-seconds / 0.8) * (puffs[:, 7] / (puffs[:, 7] + 0.35 * seconds)) ** 2
        puffs[:, 7] += 0.35 * seconds
        self.puffs = puffs[(puffs[:, 2] > -0.15) & (puffs[:, 6] < 3) & (puffs[:, 8] > 0.01)]

    def step(self, time: float, seconds: float) -> None:
        """Go on to a time; bows and sterns of fast craft throw spray all the time, own bow when it slams."""
        rng = self.rng
        self._fly(seconds)
        for body in self.fast:
            path, z, rate = body.path(time), body.pose.at[2] - body.z, min(1.0, (body.speed - 4) / 6)
            for q in (1, -1):
                number = rng.poisson(5 * rate)
                bow = Jet(0.12 * body.length, q * body.beam * 0.45, q * 2.5, 1.3, body.speed, 0.12, 1.2)
                self._throw(path, z, number, bow)
            number = rng.poisson(5 * rate)
            stern = Jet(-0.55 * body.length, 0, 0.2 * rng.normal(), 2.5 * rate, 0.6 * body.speed, 0.2, 1.0)
            self._throw(path, z, number, stern)
        self.pause_s -= seconds
        own, slam, speed = self.own, self.world["slam"], self.world["speed"]
        if slam and speed > 1 and self.pause_s < 0 and self._slams(seconds):
            self.pause_s = rng.uniform(0.5, 1.5)
            for q in rng.choice([1, -1], rng.integers(1, 3), replace=False):
                number = int(rng.uniform(30, 110) * slam)
                bow = Jet(0.35 * own.length, q * own.beam * 0.5, q * 2.2, 4.2 * slam, speed, 0.15, 2.5)
                self._throw((own.pose[0], own.pose[1], own.pose[5]), 0.2, number, bow)

    def _slams(self, seconds: float) -> bool:
        odds = 0.06 * self.world["slam"] * seconds / 0.1
        return bool(self.own.bow_sink > self.SINK_M or self.rng.random() < odds)


class Air:
    """Spray, rain and fog of a frame: its echoes, of which the strongest are the last, and how others fade."""

    def __init__(self, scan: Scan, sea: Sea, puffs: Array, time: float, rng: Random) -> None:
        self.scan, self.sea, self.world, self.rng = scan, sea, sea.world, rng
        self.dim = 0.0 if self.world["sight"] > 5000 else 3.0 / self.world["sight"]
        self.dim += 0.00002 * self.world["rain"]
        number = scan.lidar.number
        self.thickness, self.front = np.zeros(number, np.float32), np.full(number, np.inf, np.float32)
        parts = [self._from_spray(puffs), *self._from_fog(time), *self._from_rain()]
        rays, power, range_m = (np.concatenate(each) for each in zip(*parts, strict=True))
        order = np.argsort(power, kind="stable")
        self.echoes = rays[order], power[order], range_m[order]

    def fade(self, rays: Array, range_m: Array) -> Array:
        behind = np.where(range_m > self.front[rays], np.exp(-0.8 * self.thickness[rays]), 1)
        return np.asarray(np.exp(-2 * self.dim * range_m) * behind)

    def _from_spray(self, puffs: Array) -> tuple[Array, Array, Array]:
        """Return the echoes of puffs, each with Gaussian thickness around it."""
        rng, places = self.rng, puffs[:, :3].astype(np.float32)
        at, _ = self.scan.seen(places, places)
        away = np.linalg.norm(at, axis=1)
        near = (away > 0.6) & (away < 60)
        at, away, size, thickness = at[near], away[near], puffs[near, 7], puffs[near, 8]
        azimuth, elevation = np.arctan2(at[:, 1], at[:, 0]), np.arcsin(at[:, 2] / away)
        half = np.minimum(1.8 * size / away, 0.7)
        wide = half / np.cos(elevation)
        puff, ray = self.scan.lidar.within((azimuth - wide, azimuth + wide), (elevation - half, elevation + half))
        along = np.einsum("ij,ij->i", self.scan.lidar.rays[ray], at[puff])
        missed = np.maximum(away[puff] ** 2 - along**2, 0)
        depth = thickness[puff] * np.exp(-missed / (2 * size[puff] ** 2)) * (0.15 / np.maximum(size[puff], 0.15))
        np.add.at(self.thickness, ray, depth.astype(np.float32))
        np.minimum.at(self.front, ray, along.astype(np.float32))
        opaque = 1 - np.exp(-depth)
        met = rng.random(len(puff)) < 0.55 * opaque
        range_m = along[met] + rng.normal(0, 0.5, met.sum()) * size[puff[met]]
        good = range_m > 0.5
        range_m = range_m[good]
        power = 0.12 * opaque[met][good] * rng.exponential(1, good.sum()) / range_m**2
        return ray[met][good], power.astype(np.float32), range_m.astype(np.float32)

    def _from_fog(self, time: float) -> Iterator[tuple[Array, Array, Array]]:
        """Yield echoes of banks that drift with the wind, from the gate of each ray that is brightest."""
        world, lidar, rng = self.world, self.scan.lidar, self.rng
        if world["sight"] < 2000:
            x, y = (self.scan.place[lidar.column, axis, None] + lidar.rays[:, axis, None] * GATES for axis in (0, 1))
            bank = self.sea.patches(x, y, 0.35, -0.6 * world["wind"] * time)
            power = lidar.least * world["fog_gain"] * self.dim / 0.015 * bank * (2 / GATES) ** 2
            power = power * np.exp(-2 * self.dim * GATES) * rng.gamma(0.4, 1 / 0.4, x.shape)
            rays = np.flatnonzero(power.max(1) > lidar.least * 0.8)
            gate = power.argmax(1)[rays]
            range_m = GATES[gate] * rng.uniform(0.75, 1.25, len(rays))
            yield rays, power[rays, gate].astype(np.float32), range_m.astype(np.float32)

    def _from_rain(self) -> Iterator[tuple[Array, Array, Array]]:
        rain, rng = self.world["rain"], self.rng
        if rain:
            rays = np.flatnonzero(rng.random(self.scan.lidar.number) < 0.0035 * rain / 10)
            range_m = 0.8 + rng.gamma(1.3, 2.6, len(rays))
            power = rng.lognormal(-6.2, 1.0, len(rays)) * 2 / range_m**2
            yield rays, power.astype(np.float32), range_m.astype(np.float32)


def fresnel(cosine: Array) -> Array:
    """Return the reflectance of water."""
    inside = np.sqrt(1 - (1 - cosine**2) / 1.33**2)
    across = (cosine - 1.33 * inside) / (cosine + 1.33 * inside)
    along = (1.33 * cosine - inside) / (1.33 * cosine + inside)
    return np.asarray((across**2 + along**2) / 2)


class Facets(NamedTuple):
    """Water that some rays meet: their numbers, range, place, slopes, cosine of incidence."""

    rays: Array
    range_m: Array
    x: Array
    y: Array
    slope_x: Array
    slope_y: Array
    cosine: Array


def facets(scan: Scan, sea: Sea, water: Surface, rays: Array) -> Facets:
    (range_m, x, y), d = (each[rays] for each in water), scan.rays[rays]
    slope_x, slope_y = sea.slopes(x, y)
    cosine = (d[:, 0] * slope_x + d[:, 1] * slope_y - d[:, 2]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    return Facets(rays, range_m, x, y, slope_x, slope_y, np.clip(cosine, 0.02, 1))


def from_water(air: Air, at: Facets) -> tuple[Array, Array]:
    """Return powers and ranges of echoes of the water itself, of specks on it, of ripples, of foam and of splashes."""
    scan, sea, world, rng, number = air.scan, air.sea, air.world, air.rng, len(at.rays)
    d, wind = scan.rays[at.rays], max(world["wind"], 0.3)
    azimuth = np.arctan2(d[:, 1], d[:, 0]) - world["wind_to"]
    footprint_m = at.range_m * scan.lidar.model.divergence_mrad * 1e-3
    rho = _facets_and_volume(air, at, azimuth, footprint_m)
    film = sea.patches(at.x + 7, at.y - 3, 0.25)
    specks = rng.random(number) < world["specks"] * film**2  # leaves, bubbles, scum
    rho = np.where(specks, rho + rng.lognormal(-5.2, 0.8, number), rho)
    # steep little fronts on the lee faces of waves, seen best when looking up the wind
    lee, rough = -(sea.to[0] * at.slope_x + sea.to[1] * at.slope_y), 0.3 + 0.7 * at.cosine
    odds = 0.0012 * wind * world["ripple"] * (1 - 0.5 * np.cos(azimuth)) * np.clip(1 + 30 * lee, 0.2, 4)
    rho = np.where(rng.random(number) < odds, rho + rng.lognormal(-6.0, 1.0, number) * rough, rho)
    foam = sea.foam(at.x, at.y)
    white = foam > 0
    rho = np.where(white, foam * rough * rng.gamma(2.5, 0.4, number), rho)
    if world["rain"]:
        splashes = rng.random(number) < 0.004 * world["rain"] / 10
        rho = np.where(splashes, rho + rng.lognormal(-4, 0.7, number), rho)
    dip = np.maximum(-d[:, 2], 0.02)
    rise = np.where(white, rng.exponential(0.03, number) * (1 + 0.1 * sea.height_m), 0.0)
    rise = rise + rng.exponential(0.006 + 0.004 * wind / 5, number)
    along = np.minimum(footprint_m / dip, 1.2) * rng.uniform(-0.35, 0.35, number)
    return rho / at.range_m**2, np.maximum(at.range_m + along - np.minimum(rise / dip, 0.6), 0.2)


def _facets_and_volume(air: Air, at: Facets, azimuth: Array, footprint_m: Array) -> Array:
    """Return the reflectivity of facets (Cox, Munk 1954) not resolved by waves, and of what is below the surface."""
    sea, world, cosine = air.sea, air.world, at.cosine
    resolved = (sea.small.sigma * sea.small.k) ** 2
    variance = max(0.003 + 0.00512 * max(world["wind"], 0.3) - resolved, 0.003) * 0.5
    ratio = 1 + 0.25 * np.cos(2 * azimuth) - 0.12 * np.cos(azimuth)  # broader along the wind, steeper faces downwind
    density = np.exp(-((1 - cosine**2) / cosine**2) / (2 * variance * ratio)) / (2 * np.pi * variance)
    mirrored = 0.02 / 4 * np.minimum(density / cosine**4, 40)
    volume = world["turbid"] * sea.patches(at.x, at.y, 0.6) * (1 - fresnel(cosine)) ** 2 * cosine
    few = 0.35 + 8 * (np.pi / 4 * footprint_m**2 / cosine)  # facets in the footprint
    return np.asarray((mirrored + volume) * air.rng.gamma(few, 1 / few))
