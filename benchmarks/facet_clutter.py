"""Foam, breakers and spray of `facet_sea`, from frame to frame, and echoes of the water."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from facet_bodies import GRAVITY, Array, Wake, log_uniform, unit
from facet_world import World
from scipy.spatial import cKDTree

RADIUS_M = 75.0  # of foam around own ship
RANGES, SECTORS = np.geomspace(1.2, 140, 104), 288


class Group:
    """Group of waves, whose highest crests break one after the other."""

    def __init__(self, at: Array, time: float, end: float) -> None:
        self.at, self.end, self.next_break = at, end, time


class Breaker(NamedTuple):
    at: Array
    start: float
    life_s: float
    length_m: float
    height_m: float
    rho: float
    heading: float
    depth_m: float

    @property
    def along(self) -> Array:
        return unit(self.heading)


class Clutter:
    """Foam: x, y, length, width, strength, direction; spray: place, velocity, size, density; breakers, groups."""

    def __init__(self, world: World) -> None:
        self.world, self.rng = world, world.rng
        self.foam, self.spray = np.zeros((0, 6)), np.zeros((0, 8))
        self.breakers: list[Breaker] = []
        self.groups: list[Group] = []
        place = world.own.way([0.0])[0]
        for time in np.arange(-8, 0, 0.25):
            self.step(time, 0.25, place)

    def step(self, time: float, step_s: float, own: Array) -> None:
        """Go on by a step to a time, around own ship."""
        foam = self._foam(step_s, own)
        self._group(time, step_s, own)
        for group in self.groups:
            group.at = group.at + self.world.sea.speed / 2 * self.world.sea.along * step_s
            if time >= group.next_break:
                group.next_break = time + self.world.sea.period_s * self.rng.uniform(0.4, 1)
                self.breakers.append(self._breaker(group, time))
        self.groups = [group for group in self.groups if time < group.end]
        self.foam = np.concatenate([foam, self._break(time, step_s)])
        self._fly(step_s)
        self._throw(time, step_s, own)

    def _foam(self, step_s: float, own: Array) -> Array:
        """Return the foam that is left and new patches."""
        world, rng, foam = self.world, self.rng, self.foam
        weather = world.weather
        foam[:, :2] += 0.03 * world.water.wind * step_s + rng.normal(0, 0.03, (len(foam), 2)) * step_s
        foam[:, 4] *= math.exp(-step_s / weather.foam_life_s)
        foam[:, 2:4] *= 1 + 0.05 * step_s
        away = (foam[:, 0] - own[0]) ** 2 + (foam[:, 1] - own[1]) ** 2
        foam = foam[(foam[:, 4] > 0.08) & (away < (RADIUS_M + 30) ** 2)]
        rate = weather.foam_rate * np.pi * RADIUS_M * RADIUS_M / (np.pi * 0.6**2) / weather.foam_life_s * step_s
        number = rng.poisson(min(rate, 250 * step_s))
        distance, angle = RADIUS_M * np.sqrt(rng.random(number)), rng.uniform(0, 2 * np.pi, number)
        x, y = own[0] + distance * np.cos(angle), own[1] + distance * np.sin(angle)
        size = np.exp(rng.normal(-0.7, 0.5, number))
        long, strength = size * rng.uniform(1, 3, number), rng.uniform(0.4, 1, number)
        towards = world.water.heading + rng.normal(0, 0.4, number)
        return np.concatenate([foam, np.c_[x, y, long, size, strength, towards]])

    def _group(self, time: float, step_s: float, own: Array) -> None:
        rng = self.rng
        if rng.random() < 1 - math.exp(-self.world.weather.break_rate * step_s):
            distance = 60 * math.sqrt(rng.random())
            at = own + distance * unit(rng.uniform(0, 2 * np.pi))
            self.groups.append(Group(at, time, time + rng.uniform(1.5, 3.5) * self.world.sea.period_s))

    def _breaker(self, group: Group, time: float) -> Breaker:
        """Return a breaker at the highest of 40 places of a group."""
        rng, sea = self.rng, self.world.sea
        places = group.at + rng.uniform(-0.5, 0.5, (40, 2)) * sea.length_m
        highest = sea.height(places[:, 0], places[:, 1], time).argmax()
        return Breaker(
            at=places[highest].copy(),
            start=time,
            life_s=rng.uniform(0.4, 1) * min(2.5, 0.4 * sea.period_s + 0.5),
            length_m=log_uniform(rng, 2.0, 6 + 4 * sea.height_m),
            height_m=min(0.8, log_uniform(rng, 0.12, 0.5) * (sea.height_m + 0.2)),
            rho=self.world.weather.foam_rho * rng.uniform(0.6, 1.4),
            heading=sea.heading + rng.normal(0, 0.25),
            depth_m=rng.uniform(0.5, 1.8),
        )

    def _break(self, time: float, step_s: float) -> Array:
        """Move the breakers on; return the foam that they leave."""
        rng, weather, speed = self.rng, self.world.weather, self.world.sea.speed
        left, foam = [], []
        for breaker in self.breakers:
            along = breaker.along
            moved = breaker._replace(at=breaker.at + 0.8 * speed * along * step_s)
            if time >= breaker.start + breaker.life_s:
                continue
            left.append(moved)
            if rng.random() < 6 * step_s:
                place = moved.at - along * rng.uniform(0, 1)
                wide, strength = rng.uniform(0.4, 1), rng.uniform(0.5, 1)
                foam.append([*place, moved.length_m * 0.4, wide, strength, moved.heading + np.pi / 2])
            if weather.spray_rate and rng.random() < 2 * weather.spray_rate / 5 * step_s * weather.sheets:
                self._splash(moved.at + rng.normal(0, 0.3, 2), moved.height_m, 0.35 * speed * along, 3, time)
        self.breakers = left
        return np.array(foam).reshape(-1, 6)

    def _fly(self, step_s: float) -> None:
        """Move the spray, which falls, widens, thins out and takes on the speed of the wind."""
        spray = self.spray
        spray[:, :3] += spray[:, 3:6] * step_s
        spray[:, 5] -= GRAVITY * step_s * 0.8
        spray[:, 3:5] += (self.world.water.wind * 0.8 - spray[:, 3:5]) * min(1, step_s * 1.2)
        spray[:, 6] += 0.35 * step_s
        spray[:, 7] *= math.exp(-step_s * 1.2)
        self.spray = spray[(spray[:, 2] > -0.6) & (spray[:, 7] > 0.01)][-160:]

    def _throw(self, time: float, step_s: float, own: Array) -> None:
        """Add spray of own ship's bow and, in its family, of crests."""
        rng, world, weather = self.rng, self.world, self.world.weather
        if weather.bow_spray and rng.random() < 1 - math.exp(-weather.spray_rate * 0.25 * step_s) and time > -3:
            ahead = unit(world.own.heading(time))
            beside, side = np.array([-ahead[1], ahead[0]]), rng.choice([-1, 1])
            at = world.own.way([time])[0] + ahead * rng.uniform(1, 6) + beside * side * rng.uniform(1, 3)
            velocity = ahead * world.own.speed * 0.6 + beside * side * rng.uniform(1, 4)
            number, up = int(rng.integers(5, 16)), world.own.speed * 0.3 + 1.5
            self._splash(at, 0.3 + 0.1 * world.own.speed, velocity, number, time, up)
        if weather.sheets and rng.random() < 1 - math.exp(-weather.spray_rate * 0.3 * step_s):
            distance = 4 + 40 * rng.random()
            at = own + distance * unit(rng.uniform(0, 2 * np.pi))
            number = int(rng.integers(3, 12))
            self._splash(at, 0.2, 0.3 * world.water.wind, number, time, rng.uniform(1, 4))

    def _splash(self, at: Array, height: float, velocity: Array, number: int, time: float, up: float = 1.5) -> None:
        rng = self.rng
        level = float(self.world.sea.height(at[0], at[1], time))
        columns = (
            at + rng.normal(0, 0.5, (number, 2)),
            level + rng.uniform(0, height + 0.1, number),
            velocity + rng.normal(0, 0.6, (number, 2)),
            rng.uniform(0.3, 1.2, number) * up,
            rng.uniform(0.12, 0.4, number),
            self.world.weather.spray_density * rng.uniform(0.5, 1.5, number),
        )
        self.spray = np.concatenate([self.spray, np.column_stack(columns)])


class Scan(NamedTuple):
    """Rays, shape (N, 3), and where they start; times of the columns; time and pose at the middle."""

    rays: Array
    start: Array
    times: Array
    time: float
    place: Array
    turn: Array


class Water(NamedTuple):
    """Range at which rays meet the water, or inf, the slope along them there, and the cosine of their dip."""

    range_m: Array
    slope: Array
    level: Array


class Facets:
    """Rays that meet the water: number, direction, range, sine of the dip, place; range and reflectivity of echoes."""

    def __init__(self, scan: Scan, water: Water, rays: Array) -> None:
        self.ray, self.towards, self.far = rays, scan.rays[rays], water.range_m[rays]
        self.x, self.y = (scan.place[axis] + self.towards[:, axis] * self.far for axis in (0, 1))
        self.sine = np.abs(self.towards[:, 2]) + 1e-4
        self.range_m, self.rho = self.far.copy(), np.zeros(len(rays))
        self.seen = np.zeros(len(rays), bool)

    def put(self, which: Array, range_m: Array, rho: Array) -> None:
        self.range_m[which], self.rho[which], self.seen[which] = range_m, rho, True


def surface(world: World, scan: Scan) -> tuple[Array, Array, Array, Array]:
    """Return heights of the water on the polar grid, their slopes as seen, highest slopes so far, radial slopes."""
    angles = (np.arange(SECTORS) + 0.5) / SECTORS * 2 * np.pi - np.pi
    x = scan.place[0] + np.outer(np.cos(angles), RANGES)
    y = scan.place[1] + np.outer(np.sin(angles), RANGES)
    height = world.sea.height(x, y, scan.time)
    for body in world.bodies:
        height += body.arms(x.astype(np.float32), y.astype(np.float32), scan.time)
    seen = (height - scan.place[2]) / RANGES
    return height, seen, np.maximum.accumulate(seen, 1), np.gradient(height, axis=1) / np.gradient(RANGES)


def meet_water(world: World, scan: Scan) -> Water:
    """Return where rays meet the first crest that is high enough; the borders of sectors are blurred."""
    height, seen, highest, slopes = surface(world, scan)
    rays, count = scan.rays, len(RANGES)
    azimuth, level = np.arctan2(rays[:, 1], rays[:, 0]), np.hypot(rays[:, 0], rays[:, 1])
    up = rays[:, 2] / np.maximum(level, 1e-6)
    sector = (azimuth + np.pi) / (2 * np.pi) * SECTORS + world.rng.random(len(rays)) - 0.5
    sector = np.floor(sector).astype(int) % SECTORS
    shifted = (highest + np.arange(SECTORS)[:, None] * 100.0).ravel()
    cell = np.searchsorted(shifted, np.clip(up, -40, 40) + sector * 100.0) - sector * count
    away, slope = np.full(len(rays), np.inf), np.zeros(len(rays))
    there = (cell > 0) & (cell < count)
    row, far = sector[there], cell[there]
    low, high = seen[row, far - 1], seen[row, far]
    share = np.clip((up[there] - low) / np.maximum(high - low, 1e-9), 0, 1)
    away[there] = RANGES[far - 1] + share * (RANGES[far] - RANGES[far - 1])
    slope[there] = slopes[row, far - 1] * (1 - share) + slopes[row, far] * share
    below = cell == 0
    away[below] = (height[sector[below], 0] - scan.place[2]) / np.minimum(up[below], -0.05)
    away[below] = np.clip(away[below], 0.05, 1.2)
    return Water(away / np.maximum(level, 1e-6), slope, level)


class Surface:
    """Echoes of the water: facets, foam, breakers and wakes."""

    def __init__(self, world: World, clutter: Clutter) -> None:
        self.world, self.clutter, self.rng = world, clutter, world.rng

    def facets(self, scan: Scan, water: Water, rays: Array) -> Facets:
        """Return the echoes of the water, in the order in which they are drawn."""
        facets, rng, sea = Facets(scan, water, rays), self.rng, self.world.water
        number = len(rays)
        slope = water.slope[rays] + rng.normal(0, math.sqrt(sea.slopes / 2), number)
        facing = np.maximum(0, (slope * water.level[rays] - facets.towards[:, 2])) / np.sqrt(1 + slope * slope)
        rho = sea.rho * facing**sea.exponent * sea.texture.at(facets.x, facets.y, scan.time)
        facets.rho = sea.most * (1 - np.exp(-rho / sea.most)) * rng.gamma(sea.looks, 1 / sea.looks, number)
        always = np.zeros(number, bool)
        if self.world.family == "glint":
            always |= self._spikes(facets, slope, scan.time)
        always |= self._foam(facets)
        facets.seen = (facets.rho > self.world.least(facets.far)) & (always | (rng.random(number) < sea.cover))
        rough = 0.006 + 0.004 * sea.wind_ms * (0.4 if sea.sheltered else 1)
        facets.range_m += np.clip(rng.normal(0, rough, number) / np.maximum(facets.sine, 0.06), -1, 1)
        for breaker in self.clutter.breakers:
            self._break(facets, scan, breaker)
        for wake, trail, speed in self._wakes(scan.time):
            self._froth(facets, scan, wake, trail, speed)
        return facets

    def _spikes(self, facets: Facets, slope: Array, time: float) -> Array:
        """Brighten facets that face the lidar; return these."""
        sea = self.world.water
        needed = np.clip((0.35 - slope) / math.sqrt(sea.slopes), 0, 9)
        odds = np.exp(-(needed**2) / 2) * (sea.texture.normal(facets.x, facets.y, time) > 0.6)
        spikes = self.rng.random(len(slope)) < odds
        facets.rho[spikes] = np.maximum(facets.rho[spikes], self.rng.gamma(1.2, 0.07, spikes.sum()))
        return spikes

    def _foam(self, facets: Facets) -> Array:
        """Brighten facets in the three nearest patches of foam, which is a little higher; return these."""
        foam, rng, strength = self.clutter.foam, self.rng, np.zeros(len(facets.x))
        if not len(foam):
            return np.zeros(len(strength), bool)
        ranks = list(range(min(3, len(foam))))
        places, tree = np.c_[facets.x, facets.y], cKDTree(foam[:, :2])
        away, patch = tree.query(places, k=[rank + 1 for rank in ranks], distance_upper_bound=4.0)
        for rank in ranks:
            near = np.isfinite(away[:, rank])
            x, y, long, wide, share, angle = foam[patch[near, rank]].T
            x, y, cos, sin = facets.x[near] - x, facets.y[near] - y, np.cos(angle), np.sin(angle)
            inside = np.exp(-(((x * cos + y * sin) / long) ** 2) - ((-x * sin + y * cos) / wide) ** 2)
            strength[near] = np.maximum(strength[near], share * inside)
        white = rng.random(len(strength)) < strength * 1.1
        rho = self.world.weather.foam_rho * strength[white] * rng.gamma(3, 1 / 3, white.sum())
        rho *= np.minimum(1, 0.35 + 2 * facets.sine[white])
        facets.rho[white] = np.maximum(facets.rho[white], rho)
        facets.range_m[white] -= np.minimum(rng.exponential(0.03, white.sum()) / facets.sine[white], 1.0)
        return white

    def _break(self, facets: Facets, scan: Scan, breaker: Breaker) -> None:
        """Add the echoes of a breaker, a strip that leans back."""
        rng, along, (x, y) = self.rng, breaker.along, breaker.at - scan.place[:2]
        towards, length, height = facets.towards, breaker.length_m, breaker.height_m
        speed = towards[:, :2] @ along
        with np.errstate(divide="ignore", invalid="ignore"):
            met = np.where(np.abs(speed) > 0.05, np.array([x, y]) @ along / speed, -1.0)
        beside = -(met * towards[:, 0] - x) * along[1] + (met * towards[:, 1] - y) * along[0]
        reached = (met > 1) & (met < facets.far + 2 * height / facets.sine) & (np.abs(beside) < length / 2)
        near = np.flatnonzero(reached)
        if not len(near):
            return
        level = self.world.sea.height(breaker.at[0], breaker.at[1], scan.time)
        above = scan.place[2] + met[near] * towards[near, 2] - level
        age = math.sin(np.pi * np.clip((scan.time - breaker.start) / breaker.life_s, 0.05, 1))
        crest = height * (1 - (2 * beside[near] / length) ** 2)
        odds = 0.7 * age * np.exp(-1.5 * np.maximum(above, 0) / np.maximum(crest, 0.02))
        drawn = rng.random(len(near)) < np.where((above > -0.15) & (above < crest), odds, 0)
        near, above = near[drawn], above[drawn]
        range_m = met[near] + np.abs(rng.normal(0, breaker.depth_m * 0.5, len(near))) * 0.5
        range_m += np.maximum(above, 0) * breaker.depth_m
        rho = breaker.rho * rng.gamma(3, 1 / 3, len(near)) * (0.5 + 0.5 * np.minimum(1, 3 * facets.sine[near]))
        seen = (rho > self.world.least(range_m)) & (range_m < facets.far[near] + 0.5)
        facets.put(near[seen], range_m[seen], rho[seen])

    def _wakes(self, time: float) -> Iterator[tuple[Wake, Array, float]]:
        """Yield wakes, where they have been left, and speeds."""
        own, wake = self.world.own, self.world.own_wake
        for body in self.world.bodies + ([self.world.passed] if self.world.passed else []):
            if body.wake:
                yield body.wake, body.stern(time, body.wake.ages), body.speed
        if wake:
            yield wake, own.way(time - wake.ages) - unit(own.heading(time)) * 3.0, own.speed

    def _froth(self, facets: Facets, scan: Scan, wake: Wake, trail: Array, speed: float) -> None:
        """Add the echoes of the froth of a wake, which may have a given number."""
        rng, number = self.rng, len(facets.ray)
        height = rng.exponential(wake.height_m, number) * (rng.random(number) < 0.95)
        range_m = facets.far - np.minimum(height / facets.sine, facets.far * 0.6)
        x, y = (scan.place[axis] + facets.towards[:, axis] * range_m for axis in (0, 1))
        away, nearest = cKDTree(trail).query(np.c_[x, y], distance_upper_bound=wake.half_m + 6)
        near = np.flatnonzero(np.isfinite(away))
        if not len(near):
            return
        away, age, least = away[near], wake.ages[nearest[near]], self.world.least(range_m[near])
        half_m = wake.half_m + wake.growth * (speed * age + 0.1) ** 0.2 * 0.6
        profile = np.exp(-((away / half_m) ** 4)) * np.exp(-age / wake.life_s)
        profile = profile * np.where(nearest[near] == 0, away < wake.half_m, 1)
        profile *= age >= wake.youngest_s
        clumps = self.world.water.clumps.normal(x[near], y[near], scan.time * 0.3)
        odds = np.clip(wake.cover * profile * np.clip(0.55 + 0.45 * clumps, 0.03, 1.6), 0, 0.97)
        odds *= np.clip(1.6 - least / wake.rho * 0.8, 0.05, 1)
        if wake.echoes:
            odds = np.clip(odds * np.clip(wake.echoes / max(1.0, odds.sum()), 0.02, 3), 0, 0.97)
        drawn = rng.random(len(near)) < odds
        near, least = near[drawn], least[drawn]
        rho = np.maximum(wake.rho * rng.gamma(2, 0.5, len(near)), 0.4 * least)
        facets.put(near, range_m[near], rho)
