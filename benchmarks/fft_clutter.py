"""Echoes of `fft_sea` from foam, wakes, sun glint, spray, rain and fog."""

from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from fft_bodies import GRAVITY, REACH_M, Array, Pair, Random, Sea, Source, fade, shifted, signal, speckle
from fft_scenes import Lidar, Own, Wake, World


@dataclass
class Water:
    """Where N rays meet the water, and what comes back from there, from so much above it."""

    place: Array
    range_m: Array
    cosine: Array
    signal: Array
    intensity: Array
    lift_m: Array
    source: Array


@dataclass
class Echoes:
    """Echo of each ray, shape (beams, columns); the range of rays without one is infinite."""

    range_m: Array
    intensity: Array
    source: Array
    label: Array

    def put(self, rays: Any, range_m: Array, intensity: Array, source: Any) -> None:
        """Replace echoes of some rays by clutter."""
        self.range_m[rays], self.intensity[rays], self.source[rays], self.label[rays] = range_m, intensity, source, 0


class Patch(NamedTuple):
    """Ellipse of glint, or of foam that drifts."""

    x: float
    y: float
    birth: float
    long_m: float
    wide_m: float
    angle: float
    drift: tuple[float, float] = (0.0, 0.0)
    glint: float = 0.0  # brightness; 0: foam

    def near(self, place: Array, age: float) -> tuple[Array, Array]:
        """Return the numbers of places near it, and their squared distances in terms of its axes."""
        u, v = place[:, 0] - self.x - self.drift[0] * age, place[:, 1] - self.y - self.drift[1] * age
        near = np.flatnonzero((np.abs(u) < 2 * self.long_m) & (np.abs(v) < 2 * self.long_m))
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        along, across = (u[near] * cos + v[near] * sin) / self.long_m, (-u[near] * sin + v[near] * cos) / self.wide_m
        return near, along**2 + across**2


@dataclass
class Clumps:
    """Clumps of drops or foam, shape (N, ...); the heights of those that ride on the water are above it."""

    place: Array
    velocity: Array
    death: Array
    size_m: Array
    chance: Array
    rho: Array
    source: Array
    rides: Array

    def picked(self, which: Array) -> "Clumps":
        return Clumps(*(getattr(self, each.name)[which] for each in fields(self)))

    def joined(self, other: "Clumps") -> "Clumps":
        return Clumps(*(np.concatenate([getattr(self, each.name), getattr(other, each.name)]) for each in fields(self)))

    def move(self, step_s: float, wind: Array) -> None:
        """Move; drops in the air fall and are taken along by the wind."""
        self.place += self.velocity * step_s
        air = ~self.rides
        self.velocity[air, 2] -= GRAVITY * step_s
        self.velocity[air, :2] += (wind - self.velocity[air, :2]) * (1 - np.exp(-step_s / 0.7))


class Kind(NamedTuple):
    """Kind of clumps: ranges of their properties; those of spray fly, others ride on the water."""

    source: Source
    life_s: Pair | float
    size_m: Pair
    chance: float
    rho: Pair


WAKE = Kind(Source.WAKE, (0.2, 0.8), (0.06, 0.2), 0.7, (0.05, 0.15))
BOW_SPRAY = Kind(Source.SPRAY, 3, (0.05, 0.15), 0.5, (0.05, 0.2))
CREST_SPRAY = Kind(Source.SPRAY, (0.4, 1.2), (0.05, 0.15), 0.5, (0.05, 0.15))
BREAKER = Kind(Source.FOAM, (0.3, 1.0), (0.08, 0.25), 0.8, (0.15, 0.35))
NO_CLUMPS = Clumps(*np.zeros((2, 0, 3)), *np.zeros((4, 0)), np.zeros(0, int), np.zeros(0, bool))


class Clutter:
    """What is on the water and in the air, from frame to frame."""

    def __init__(self, world: World, sea: Sea, own: Own, lidar: Lidar, rng: Random) -> None:
        self.world, self.sea, self.own, self.lidar, self.rng = world, sea, own, lidar, rng
        self.clumps, self.downwind = NO_CLUMPS, world.wind / np.linalg.norm(world.wind)
        self.patches: list[Patch] = []
        for _ in range(world.glints):
            long_m = rng.uniform(1.5, 5)
            x, y = rng.normal(0, 22, 2)
            wide_m, angle = long_m * rng.uniform(0.4, 0.9), rng.uniform(0, 3)
            self.patches.append(Patch(x, y, -100.0, long_m, wide_m, angle, glint=rng.uniform(0.5, 1.5)))

    def on_water(self, water: Water, time: float) -> None:
        """Change the echoes of the water where there is foam, glint or a wake."""
        for patch in self.patches:
            if patch.glint:
                self._glint(patch, water, time)
            else:
                self._foam(patch, water, time)
        if self.world.wake:
            self._flat_wake(self.world.wake, water, time)

    def _foam(self, patch: Patch, water: Water, time: float) -> None:
        rng, age = self.rng, time - patch.birth
        near, q = patch.near(water.place, age)
        at = near[rng.random(len(near)) < np.exp(-age / 3) * np.exp(-q)]
        range_m, cosine = water.range_m[at], water.cosine[at]
        water.signal[at] = np.maximum(water.signal[at], signal(0.25, cosine, range_m))
        bright = 255 * 0.25 * np.sqrt(cosine) * fade(range_m) * speckle(rng, 0.3, len(at))
        water.intensity[at] = bright * np.exp(-age / 6)
        water.lift_m[at] += rng.exponential(0.03, len(at))
        water.source[at] = Source.FOAM

    def _glint(self, patch: Patch, water: Water, time: float) -> None:
        near, q = patch.near(water.place, time - patch.birth)
        flicker = 0.5 * np.sin(2.1 * time + 7 * patch.x) + 0.3 * np.sin(5.3 * time + 3 * patch.y)
        bright = patch.glint * np.exp(flicker)
        at = near[self.rng.random(len(near)) < np.exp(-q) * min(bright, 1)]
        range_m = water.range_m[at]
        water.signal[at] = water.signal[at] * 8 + 4 * (40 / range_m) ** 2
        water.intensity[at] = np.clip(70 * bright * fade(range_m) * speckle(self.rng, 0.4, len(at)), 5, 200)
        water.source[at] = Source.GLINT

    def _flat_wake(self, wake: Wake, water: Water, time: float) -> None:
        rng, body = self.rng, wake.body
        (x, y), yaw = body.way(time)
        dx, dy = water.place[:, 0] - x, water.place[:, 1] - y
        u = dx * np.cos(yaw) + dy * np.sin(yaw) + body.length / 2
        v = -dx * np.sin(yaw) + dy * np.cos(yaw)
        at = np.flatnonzero((u < 0) & (u > -60) & (np.abs(v) < body.width * 0.5 + 0.05 * -u))
        at = at[rng.random(len(at)) < 0.7 * np.exp(u[at] / 25)]
        range_m, cosine = water.range_m[at], water.cosine[at]
        water.signal[at] = np.maximum(water.signal[at], signal(0.15, np.maximum(cosine, 0.1), range_m))
        water.intensity[at] = 255 * 0.12 * np.sqrt(cosine) * fade(range_m) * speckle(rng, 0.4, len(at))
        water.lift_m[at] = rng.exponential(0.12, len(at))
        water.source[at] = Source.WAKE

    def advance(self, number: int) -> None:
        """Move clumps to the time of a frame, remove old ones and add new ones."""
        time, step_s, world = self.own.times[number], self.lidar.period_s, self.world
        if number > 0:
            self.clumps.move(step_s, world.wind)
            self.clumps = self.clumps.picked((self.clumps.death > time) & (self.clumps.place[:, 2] > -1.5))
        if world.wake:
            self._spawn_wake(world.wake, int(world.wake.clumps * step_s / 0.5 if number else world.wake.clumps), time)
        if world.own_wake:
            self._spawn_own_wake(number, int(world.own_wake * step_s / 0.5))
        if world.bow_spray_hz:
            phase = (time / world.bow_s) % 1
            if phase < step_s / world.bow_s or phase < 0.25:
                self._spawn_bow_spray(number, int(world.bow_spray_hz * step_s * self.rng.uniform(0.5, 1.5)))
        for _ in range(self.rng.poisson(world.crest_spray_hz * step_s)):
            self._spawn_crest_spray(time, *self._crest(number))
        for _ in range(self.rng.poisson(world.whitecaps_hz * step_s * (1 if number else 10))):
            self._spawn_whitecap(time, *self._crest(number)[:2], old=number == 0)
        self.patches = [patch for patch in self.patches if patch.glint or time - patch.birth < 10]

    def _add(self, kind: Kind, time: float, place: Any, velocity: Any = 0.0) -> None:
        """Add clumps at places, given as x, y and z."""
        rng, place = self.rng, np.column_stack(place)
        n = len(place)
        life_s = rng.uniform(*kind.life_s, n) if isinstance(kind.life_s, tuple) else np.full(n, kind.life_s)
        size_m, rho = rng.uniform(*kind.size_m, n), rng.uniform(*kind.rho, n)
        rides = np.full(n, kind.source != Source.SPRAY)
        moves = np.array(np.broadcast_to(velocity, (n, 3)), float)
        new = Clumps(place, moves, time + life_s, size_m, np.full(n, kind.chance), rho, np.full(n, kind.source), rides)
        self.clumps = self.clumps.joined(new)

    def _spawn_wake(self, wake: Wake, n: int, time: float) -> None:
        """Add foam astern, and bow waves along the hull."""
        rng, body = self.rng, wake.body
        s = rng.exponential(wake.length_m, n)
        half = body.width * 0.45 + 0.06 * s
        u, v = -body.length / 2 - s, half * np.clip(rng.normal(0, 0.6, n), -1.3, 1.3)
        bow = rng.random(n) < 0.15
        u = np.where(bow, body.length * (0.4 - 0.9 * rng.random(n)), u)
        v = np.where(bow, np.sign(rng.normal(size=n)) * (body.width / 2 + rng.exponential(0.4, n)), v)
        self._add(WAKE, time, [*shifted(body.way(time)[0], body.yaw, u, v), rng.exponential(0.12, n)])

    def _spawn_own_wake(self, number: int, n: int) -> None:
        rng, (x, y, *_, yaw) = self.rng, self.own.track[number]
        s = rng.exponential(6, n)
        u, v = -self.world.length_m * 0.6 - s, (0.8 + 0.1 * s) * rng.normal(size=n)
        self._add(WAKE, self.own.times[number], [*shifted((x, y), yaw, u, v), rng.exponential(0.12, n)])

    def _spawn_bow_spray(self, number: int, n: int) -> None:
        rng, (x, y, z, _, _, yaw) = self.rng, self.own.track[number]
        side = np.sign(rng.normal(size=n))
        u, v = self.world.length_m * rng.uniform(0.3, 0.7, n), side * rng.uniform(0.6, 1.4, n)
        outwards, ahead = side * rng.gamma(4, 1.0, n), rng.normal(2, 1, n) + self.world.speed_ms * 0.7
        velocity = np.column_stack([*shifted((0, 0), yaw, ahead, outwards), rng.gamma(5, 0.8, n)])
        self._add(BOW_SPRAY, self.own.times[number], [*shifted((x, y), yaw, u, v), np.full(n, z + 0.2)], velocity)

    def _crest(self, number: int) -> tuple[float, float, float]:
        """Return the highest of some places around own ship."""
        x, y = (self.rng.normal(0, 28, (60, 2)) + self.own.track[number, :2]).T
        height = self.sea.height(x, y)
        top = np.argmax(height)
        return x[top], y[top], height[top]

    def _spawn_crest_spray(self, time: float, x: float, y: float, z: float) -> None:
        rng, wind, (cos, sin) = self.rng, self.world.wind, self.downwind
        n = rng.integers(40, 250)
        across = rng.normal(0, 0.8, n)
        place = [x - sin * across, y + cos * across, z + rng.exponential(0.15, n)]
        velocity = np.column_stack([wind * 0.5 + rng.normal(0, 0.7, (n, 2)), rng.normal(1.5, 0.8, n)])
        self._add(CREST_SPRAY, time, place, velocity)

    def _spawn_whitecap(self, time: float, x: float, y: float, *, old: bool) -> None:
        """Add a patch of foam and, if it is new, clumps that move with the breaking crest."""
        rng, wind, (cos, sin) = self.rng, self.world.wind, self.downwind
        long_m = rng.uniform(0.5, 2.5)
        birth = time - (rng.uniform(0, 8) if old else 0)
        wide_m, angle = long_m * rng.uniform(0.3, 0.7), np.arctan2(sin, cos) + np.pi / 2
        drift = 0.03 * wind[0] + 0.1 * rng.normal(), 0.03 * wind[1] + 0.1 * rng.normal()
        self.patches.append(Patch(x, y, birth, long_m, wide_m, angle, drift))
        if time - birth < 0.5:
            n = rng.integers(20, 70)
            across, along = rng.normal(0, long_m, n), rng.normal(0, 0.3, n)
            place = [x - sin * across + cos * along, y + cos * across + sin * along, rng.exponential(0.1, n)]
            speed = 0.6 * self.sea.waves[-1].speed_ms
            self._add(BREAKER, time, place, np.append(self.downwind * speed, 0))

    def in_air(self, number: int, ends_m: Array, echoes: Echoes) -> None:
        """Replace echoes by those of clumps that are nearer than where rays end."""
        rng, lidar = self.rng, self.lidar
        clumps, range_m, azimuth, elevation = self._from_lidar(self.own.times[number])
        columns, beams = len(lidar.azimuths), lidar.elevations
        column = np.floor((azimuth + np.pi) / (2 * np.pi) * columns).astype(int) % columns
        beam = np.clip(np.searchsorted(beams, elevation), 1, len(beams) - 1)
        beam = np.where(np.abs(beams[beam - 1] - elevation) < np.abs(beams[beam] - elevation), beam - 1, beam)
        half = clumps.size_m / 2 / range_m + 0.001
        dim = np.exp(-2 * self.world.extinction * range_m)
        power = signal(clumps.rho, 1, range_m, REACH_M * 0.7) * dim
        met = np.abs(beams[beam] - elevation) < half
        met &= np.abs(lidar.azimuths[column] - azimuth) < np.maximum(half, np.pi / columns * 0.5)
        met &= (rng.random(len(met)) < clumps.chance) & (range_m < ends_m[beam, column] + 0.3)
        at = np.flatnonzero(met & (power > speckle(rng, 0.4, len(met))) & (range_m > 0.8))
        at = at[np.argsort(-range_m[at])]  # the nearest of a ray is put last
        at = at[range_m[at] < echoes.range_m[beam[at], column[at]] + 0.3]
        bright = 255 * clumps.rho[at] * fade(range_m[at]) * speckle(rng, 0.4, len(at)) * dim[at]
        echoes.put((beam[at], column[at]), range_m[at], bright, clumps.source[at])

    def _from_lidar(self, time: float) -> tuple[Clumps, Array, Array, Array]:
        """Return the clumps above the water, and their ranges, azimuths and elevations when the lidar looks at them."""
        clumps, place = self.clumps, self.clumps.place.copy()
        x, y, _ = place[clumps.rides].T
        place[clumps.rides, 2] += self.sea.height(x, y)
        above = place[:, 2] > self.sea.height(place[:, 0], place[:, 1])
        clumps, place = clumps.picked(above), place[above]
        seen = np.full(len(place), time)
        for _ in range(2 if self.lidar.sweeps else 1):
            origin, turn = self.own.lidar(seen)
            q = np.einsum("nij,ni->nj", turn, place + clumps.velocity * (seen - time)[:, None] - origin)
            azimuth = np.arctan2(q[:, 1], q[:, 0])
            seen = self.lidar.times(time, azimuth)
        range_m = np.linalg.norm(q, axis=1)
        return clumps, range_m, azimuth, np.arcsin(q[:, 2] / range_m)

    def adapt_wake(self, echoes: Echoes) -> None:
        """Add more clumps to the wake from now on if it has too few echoes, at most some 50 in a square metre."""
        wake, count = self.world.wake, int((echoes.source == Source.WAKE).sum())
        if wake and count:
            wake.clumps = min(wake.clumps * np.clip(wake.echoes / count, 0.7, 1.5), 5000)

    def precipitation(self, ends_m: Array, echoes: Echoes) -> None:
        """Replace echoes by those of rain or fog, at ranges of a gamma distribution."""
        if not self.world.rain:
            return
        rng, (beams, columns) = self.rng, ends_m.shape
        n = rng.poisson(self.world.rain)
        beam, column = rng.integers(0, beams, n), rng.integers(0, columns, n)
        range_m = 1.0 + rng.gamma(1.5, self.world.rain_m, n)
        free = (range_m < ends_m[beam, column]) & (range_m < 90)
        beam, column, range_m = beam[free], column[free], range_m[free]
        bright = rng.exponential(self.world.rain_intensity, len(range_m)) * np.minimum(1, np.sqrt(10 / range_m))
        echoes.put((beam, column), range_m, np.clip(bright, 1, 80), Source.RAIN)
