"""Labelled logs of a second simulator of a lidar at sea, which shares no physics with that of the program.

Run as ``python benchmarks/second_sea.py FOLDER --seeds 1..3 --families wakes fog`` (default: all families), or with
``--random 60`` for worlds in which families are mixed, with numbers from the first seed on. All ranges from which a
world is drawn are in the tables `ANY` and `FAMILIES`. Rays meet convex bodies and a height field of waves around the
sensor [1]_. Power is relative to a white wall at one metre; what is weaker than a dark wall (10 %) at ``reach_m`` is
not seen. Light comes back from facets of ripples [2]_, from below the surface, from whitecaps [3]_, from the froth of
turbulent wakes, from spray, rain and fog [4]_, and by way of the water's mirror. Targets that a filter without faults
would miss are ignored in that frame.

.. [1] Tessendorf (2001). "Simulating ocean water". SIGGRAPH course notes.
.. [2] Cox, Munk (1954). "Measurement of the roughness of the sea surface". JOSA 44(11).
.. [3] Monahan, O'Muircheartaigh (1980). "Optimal power-law description of oceanic whitecap coverage". JPO 10(12).
.. [4] Rasshofer, Spies, Spies (2011). "Influences of weather phenomena on automotive laser radar systems". ARS 9.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from sea_logs import POINT, parser_of, record_all, write_labelled
from second_bodies import (
    FIXED,
    GRAVITY,
    KINDS,
    NEVER,
    Array,
    Body,
    Own,
    Part,
    Random,
    Waves,
    World,
    block,
    cast,
    populate,
    rotation,
    unit,
    wrapped,
)

from seaclutter_cli.truth import CLUTTER, IGNORED, Boxes

START_NS = 1_700_000_000_000_000_000

ANY: World = {  # a pair is a range, a list a choice
    "beams": [16, 32, 64, 128], "uneven": [False, False, True], "top_deg": (3.0, 20.0), "bottom_deg": (-25.0, -13.0),
    "step_deg": (0.1, 0.4), "rate_hz": [10], "height_m": (1.0, 5.0), "reach_m": (40.0, 150.0), "width_mrad": (0.7, 3.5),
    "noise_m": (0.008, 0.04), "dropout": (0.002, 0.04), "blind_m": (0.3, 1.2), "bright": ["range", "power", "root"],
    "gain": (0.7, 2.0), "wind_ms": (1.0, 7.0), "wave_m": (0.05, 0.3), "wave_length_m": (3.0, 9.0),
    "swell_m": (0.0, 0.3), "swell_length_m": (25.0, 80.0), "log_turbidity": (-4.7, -2.4), "steep": (0.3, 1.5),
    "roll_deg": (0.3, 3.0), "pitch_deg": (0.3, 2.0), "yaw_deg_s": (0.0, 3.0), "speed_ms": (0.0, 4.0),
    "rail": [False, False, True], "rain_mm_h": (0.0, 0.0), "sight_m": (3000.0, 20000.0), "bow_spray_hz": (0.0, 0.0),
    "sun": (0.0, 0.0), "mirror": [False], "froth_m": (0.05, 0.14), "wake": (0.2, 0.6), "near_m": (12.0, 15.0),
    "far_m": (45.0, 80.0), "beside_m": (14.0, 35.0), "buoy_m": (0.4, 2.0), "ship": (0, 1), "speedboat": (0, 2),
    "rhib": (0, 1), "kayak": (0, 2), "swimmer": (0, 1), "buoy": (0, 3), "sail": (0, 1), "bird": (0, 2), "pile": (0, 1),
    "moored": (0, 0), "quay": (0, 0), "pontoon": (0, 0), "bridge": (0, 0), "reeds": (0, 0),
}  # fmt: skip
FAMILIES: dict[str, World] = {
    "swell": {"swell_m": (0.5, 2.0), "swell_length_m": (35.0, 120.0), "height_m": (2.0, 6.0), "roll_deg": (2.0, 7.0)},
    "chop": {"wind_ms": (6.0, 11.0), "wave_m": (0.25, 0.6), "wave_length_m": (4.0, 10.0), "roll_deg": (1.0, 4.0)},
    "port": {
        "quay": (1, 2), "moored": (2, 6), "pontoon": (0, 2), "pile": (0, 3), "reeds": (0, 1), "speed_ms": (0.5, 2.5),
        "wave_m": (0.02, 0.1), "wind_ms": (0.5, 4.0), "mirror": [False, True],
    },
    "wakes": {"ship": (1, 2), "speedboat": (2, 3), "wake": (0.6, 1.0), "froth_m": (0.1, 0.14), "speed_ms": (2.0, 5.0)},
    "spray": {
        "bow_spray_hz": (1.0, 4.0), "speedboat": (1, 3), "wind_ms": (5.0, 10.0), "wave_m": (0.3, 0.8),
        "wave_length_m": (7.0, 15.0), "speed_ms": (3.0, 8.0), "pitch_deg": (2.0, 5.0),
    },
    "rain": {"rain_mm_h": (5.0, 50.0)},
    "fog": {"sight_m": (60.0, 400.0)},
    "glint": {"sun": (0.002, 0.02), "wind_ms": (4.0, 9.0), "wave_m": (0.2, 0.5), "steep": (1.5, 4.0)},
    "turns": {"yaw_deg_s": (8.0, 20.0), "roll_deg": (2.0, 8.0), "speed_ms": (2.0, 6.0)},
    "small": {
        "near_m": (8.0, 9.0), "far_m": (25.0, 40.0), "buoy": (2, 5), "buoy_m": (0.4, 0.5), "swimmer": (1, 3),
        "kayak": (1, 3), "ship": (0, 0),
    },
    "mirrors": {
        "mirror": [True], "wind_ms": (0.3, 2.0), "wave_m": (0.01, 0.04), "swell_m": (0.0, 0.03), "quay": (0, 1),
        "moored": (1, 4), "pile": (1, 4), "pontoon": (0, 1), "speed_ms": (0.0, 1.5),
    },
    "beams16": {"beams": [16], "uneven": [False]},
    "passing": {
        "quay": (0, 1), "bridge": (1, 1), "beside_m": (10.0, 20.0), "speed_ms": (3.0, 6.0), "pile": (1, 3),
        "moored": (0, 2),
    },
    "rough": {
        "wind_ms": (9.0, 14.0), "wave_m": (1.0, 2.2), "wave_length_m": (20.0, 45.0), "swell_m": (0.5, 1.5),
        "height_m": (3.0, 6.0), "roll_deg": (3.0, 8.0), "pitch_deg": (2.0, 5.0), "bow_spray_hz": (0.0, 2.0),
        "kayak": (0, 0),
    },
    "slow5hz": {"rate_hz": [5]},
    "near": {"near_m": (3.0, 3.5), "far_m": (8.0, 10.0), "ship": (0, 0), "buoy": (1, 2), "speed_ms": (0.0, 1.0)},
    "high": {"height_m": (6.0, 8.0), "wave_m": (0.1, 0.6)},
    "fast20hz": {"rate_hz": [20]},
}  # fmt: skip


def draw(rng: Random, families: Sequence[str]) -> World:
    """Return a world: of two ranges of families, either is used."""
    ranges = dict(ANY)
    for family in rng.permutation(np.array(families)):
        ranges |= FAMILIES[family]
    world: World = {"wind_rad": rng.uniform(0, 2 * np.pi), "sun_rad": rng.uniform(0, 2 * np.pi)}
    for name, among in ranges.items():
        if isinstance(among, list):
            world[name] = among[rng.integers(len(among))]
        else:
            world[name] = rng.integers(among[0], among[1] + 1) if name in KINDS else rng.uniform(*among)
    world["columns"] = int(min(360 / world["step_deg"], max(900, 60_000 / world["beams"])))
    world["frames"] = int(np.clip(6_000_000 / world["columns"] / world["beams"], 100, 200))
    if not any(world[kind] for kind in KINDS if kind not in FIXED):
        world["buoy"] = 1
    return world


class Froth:
    """Whitecaps and wakes: patches that appear, spread, drift with the wind and fade, on a raster around own ship."""

    CELL, HALF, GRAINS = 0.4, 70.0, 24

    def __init__(self, world: World, own: Own, bodies: Sequence[Body], rng: Random, times: Array) -> None:
        self.drift = 0.03 * world["wind_ms"] * unit(world["wind_rad"])[:, None]
        life_s, radius_m, share = 4.0, 0.7, min(3.84e-6 * world["wind_ms"] ** 3.41, 0.06)
        number = int(share * (2 * self.HALF) ** 2 / np.pi / radius_m**2 * (np.ptp(times) + 10) / life_s)
        when = rng.uniform(times[0] - 10, times[-1], number)
        places = own.way(when)[:2] + rng.uniform(-self.HALF, self.HALF, (3, 2, number))
        crests = np.array([own.waves.height(*place, when) for place in places]).argmax(axis=0)
        sizes, shares = radius_m * rng.lognormal(0, 0.5, number), rng.uniform(0.3, 0.9, number)
        sea = places[crests, :, np.arange(number)].T
        patches = [np.stack([*sea, when, sizes, shares, rng.uniform(0.5, 1.5, number) * life_s, 0 * when])]
        movers = [
            (body.way, body.speed, body.high[1], body.low[0])
            for body in bodies
            if body.speed > 2 and body.kind != "bird"
        ]
        for way, speed, wide, stern in [*movers, (own.way, world["speed_ms"], 1.2, -rng.uniform(3, 7))]:
            when = np.arange(times[0] - 25, times[-1], 0.15) if speed > 1 else np.zeros(0)
            x, y, heading = way(when)
            places = [x, y] + stern * unit(heading) + rng.normal(0, wide / 3, (2, len(when)))
            share = world["wake"] * min(1, speed / 5) * rng.uniform(0.3, 1, len(when))
            patches.append(
                np.stack([*places, when, 0 * x + 0.4 + wide / 3, share, rng.uniform(4, 15, len(when)), 0 * x + 1])
            )
        self.patches = np.concatenate(patches, axis=1)
        self.grains = rng.normal(size=(2, self.patches.shape[1], self.GRAINS))

    def rasters(self, time: float, centre: Array) -> Array:
        """Return the covered shares of the raster for whitecaps and for wakes, shape (2, K, K)."""
        alive = np.flatnonzero((time > self.patches[2]) & (time < self.patches[2] + 3 * self.patches[5]))
        x, y, start, size, share, life, kind = self.patches[:, alive]
        size = size * (1 + 0.25 * np.sqrt(time - start))
        at = np.stack([x, y]) + self.drift * (time - start) - centre[:, None]
        cells = np.floor((at[..., None] + self.grains[:, alive] * size[:, None] + self.HALF) / self.CELL).astype(
            np.int64
        )
        count = int(2 * self.HALF / self.CELL)
        inside = ((cells >= 0) & (cells < count)).all(axis=0)
        weight = share * np.exp((start - time) / life) * np.pi * size**2 / self.GRAINS / self.CELL**2
        key = (kind[:, None].astype(np.int64) * count + cells[0]) * count + cells[1]
        total = np.bincount(key[inside], (weight[:, None] + 0 * key)[inside], 2 * count * count)
        return -0.9 * np.expm1(-total.reshape(2, count, count))

    def at(self, raster: Array, x: Array, y: Array) -> Array:
        """Return the values of a raster at places relative to its centre."""
        row, line = (np.clip((a + self.HALF) / self.CELL, 0, len(raster) - 1).astype(np.int64) for a in (x, y))
        return np.asarray(raster[row, line] * (np.maximum(abs(x), abs(y)) < self.HALF))


class Spray:
    """Drops in clumps, thrown up by bows, that fall, and are slowed by the air until they drift with the wind."""

    def __init__(self, world: World, own: Own, bodies: Sequence[Body], rng: Random, times: Array) -> None:
        self.wind = 0.5 * world["wind_ms"] * np.append(unit(world["wind_rad"]), 0)
        fast = [body for body in bodies if body.kind in ("speedboat", "rhib") and body.speed > 5]
        sources = [(body.way, body.speed, 0.9 * body.high[0], 1.5, 2.0) for body in fast]
        drops = [np.zeros((0, 8))]
        for way, speed, bow, rate, most in [*sources, (own.way, world["speed_ms"], 3.0, world["bow_spray_hz"], 5.5)]:
            for start in rng.uniform(times[0], times[-1], rng.poisson(rate * np.ptp(times))):
                number, side, up = rng.integers(150, 600), rng.choice([-1, 1]), rng.uniform(0.3, 1) * most
                x, y, yaw = np.ravel(way(np.array([start])))
                place = np.column_stack(
                    [bow - rng.uniform(0, 1.5, number), side * rng.uniform(0.3, 1.2, number), np.full(number, 0.2)]
                )
                throw = up * rng.uniform(0.4, 1, number)
                speeds = np.column_stack([speed * rng.uniform(0.6, 1, number), side * throw * 0.6, throw])
                speeds += rng.normal(0, 0.3, speeds.shape)
                turn, when = rotation(yaw).T, start + rng.uniform(0, 0.4, number)
                drops.append(
                    np.column_stack([place @ turn + [x, y, 0], speeds @ turn, when, rng.uniform(0.01, 0.06, number)])
                )
        self.drops = np.concatenate(drops)

    def flying(self, time: float) -> tuple[Array, Array]:
        """Return places, shape (3, D), and sizes of the clumps that are in the air."""
        drops = self.drops[(time > self.drops[:, 6]) & (time < self.drops[:, 6] + 3)]
        age = time - drops[:, 6:7]
        slow = 1 - np.exp(-age)
        place = drops[:, :3] + drops[:, 3:6] * slow + self.wind * (age - slow) - [0, 0, GRAVITY / 2] * age**2
        return place[place[:, 2] > 0].T, drops[place[:, 2] > 0, 7]


Echoes = tuple[Array, Array, Array]  # numbers of rays, ranges, powers


class Sight(NamedTuple):
    """Position of a body at the middle of a frame; time at which it is scanned, position and rotation then."""

    body: Body
    middle: Array
    turn_middle: Array
    time: float
    at: Array
    turn: Array


class Scan(NamedTuple):
    """Rays of a frame and their places, shape (3, N), bearings and slopes; times and rotations of its columns."""

    rays: Array
    place: Array
    angle: Array
    slant: Array
    times: Array
    turn: Array
    middle_s: float
    centre: Array
    sights: list[Sight]


class Water(NamedTuple):
    """Where M rays meet the water: their numbers, range, level distance, bearing, slopes there, dip of the ray."""

    ray: Array
    range_m: Array
    away: Array
    angle: Array
    slope: Array
    across: Array
    dip: Array

    @property
    def sine(self) -> Array:
        return self.dip / np.hypot(1, self.dip)


def fresnel(cosine: Array) -> Array:
    return np.asarray(0.02 + 0.98 * (1 - cosine) ** 5)


class Recorder:
    """The lidar in its world: frames of labelled points and boxes."""

    def __init__(self, world: World, rng: Random, seed: Sequence[int]) -> None:
        self.world, self.seed, self.period = world, seed, 1 / world["rate_hz"]
        times = np.linspace(-0.5, 0.5, 30) * world["frames"] * self.period
        self.waves = Waves(world, rng)
        self.own = Own(world, self.waves, rng)
        self.bodies = populate(world, self.own, rng, times)
        self.froth = Froth(world, self.own, self.bodies, rng, times)
        self.spray = Spray(world, self.own, self.bodies, rng, times)
        share = np.linspace(-1, 1, world["beams"])
        share *= abs(share) ** (0.7 * world["uneven"])
        low, high = np.radians([world["bottom_deg"], world["top_deg"]])
        self.beams, self.columns = low + (high - low) * (share + 1) / 2, world["columns"]
        self.azimuth = np.pi - np.arange(self.columns) * 2 * np.pi / self.columns
        level, up = unit(self.beams)[..., None]
        self.rays = np.stack([*(level * unit(self.azimuth)[:, None]), up + 0 * level * self.azimuth]).astype(np.float32)
        self.least = 0.1 / world["reach_m"] ** 2
        self.deck = self._deck(rng) if world["rail"] else []
        self.deck_m, self.deck_rho = cast(self.deck, np.zeros((3, self.rays[0].size)), self.rays.reshape(3, -1), rng)

    def _deck(self, rng: Random) -> list[Part]:
        """Return own ship's rails and bow, in the axes of the lidar."""
        x, y, z = rng.uniform(1.2, 3), rng.uniform(0.8, 1.6), -min(rng.uniform(0.3, 1.5), 0.7 * self.world["height_m"])
        rails = [block([-4, side * y - 0.02, z], [x, side * y + 0.02, z + 0.05], 0.4) for side in (-1, 1)]
        return [*rails, block([x, -y, z - 0.3], [x + 1, y, z], 0.4, taper=0.6)]

    def frame(self, number: int) -> tuple[Array, Boxes]:
        """Return the points and the boxes of a frame. The strongest echo of a ray is its point."""
        rng, world = np.random.default_rng([*self.seed, number]), self.world
        times = (number - world["frames"] / 2 + np.arange(self.columns) / self.columns) * self.period
        place, turn = self.own.pose(times)
        rays = np.einsum("cij,jbc->ibc", turn.astype(np.float32), self.rays)
        at, rays = (place.astype(np.float32)[:, None] + 0 * rays).reshape(3, -1), rays.reshape(3, -1)
        slant = rays[2] / np.hypot(rays[0], rays[1])
        sights = [self._sight(body, times, turn, place.mean(axis=1)) for body in self.bodies]
        scan = Scan(
            rays, at, np.arctan2(rays[1], rays[0]), slant, times, turn, times.mean(), place.mean(axis=1), sights
        )
        water = self._water(scan)
        range_m, power, label = self._solid(scan, water, rng)
        dim = 6 / world["sight_m"] + 2e-4 * world["rain_mm_h"]
        power *= np.exp(-dim * range_m)
        for way in (self._from_water, self._mirrored, self._from_air, self._sunlight):
            for ray, echo_m, echo in way(scan, water, rng):
                seen_power = echo * np.exp(-dim * echo_m)
                better = seen_power > power[ray]
                met = ray[better]
                range_m[met], power[met], label[met] = echo_m[better], seen_power[better], CLUTTER
        seen = (power > self.least) & (range_m > world["blind_m"]) & (rng.random(len(power)) > world["dropout"])
        return self._points(np.flatnonzero(seen), range_m, power, label, rng), self._boxes(scan)

    def _sight(self, body: Body, times: Array, turn: Array, centre: Array) -> Sight:
        middle = body.place(float(times.mean()), self.waves)
        ahead = turn[self.columns // 2].T @ (middle[0] - centre)
        time = float(times[abs(wrapped(self.azimuth - np.arctan2(ahead[1], ahead[0]))).argmin()])
        return Sight(body, *middle, time, *body.place(time, self.waves))

    def _water(self, scan: Scan) -> Water:
        """Return where rays meet the sea: at the first place that, seen from the lidar, is as high as the ray."""
        turns, ranges = 240, np.geomspace(0.8, 90, 110)
        step = 2 * np.pi / turns
        x, y = unit(np.arange(turns) * step)[..., None] * ranges + scan.centre[:2, None, None]
        height = self.waves.height(x, y, scan.middle_s) + self._kelvin(x, y, scan.middle_s)
        slope, across = np.gradient(height, ranges, axis=1), np.gradient(height, axis=0) / step / ranges
        highest = np.maximum.accumulate((height - scan.centre[2]) / ranges, axis=1)
        down = np.flatnonzero(scan.slant < -0.005)
        row = np.round(scan.angle[down] / step).astype(np.int64) % turns
        shifted = (highest + 100.0 * np.arange(turns)[:, None]).ravel()
        cell = np.maximum(np.searchsorted(shifted, scan.slant[down] + 100.0 * row) - row * len(ranges), 1)
        down, row, cell = (a[cell < len(ranges)] for a in (down, row, cell))
        low, high = highest[row, cell - 1], highest[row, cell]
        share = np.clip((scan.slant[down] - low) / np.maximum(high - low, 1e-9), 0, 1)
        away = ranges[cell - 1] + share * (ranges[cell] - ranges[cell - 1])
        dip = -scan.slant[down]
        return Water(down, away * np.hypot(1, dip), away, scan.angle[down], slope[row, cell], across[row, cell], dip)

    def _kelvin(self, x: Array, y: Array, time: float) -> Array:
        """Return the heights of the arms of the wakes of ships under way, at 19.5 degrees from their course."""
        total = np.zeros(x.shape, np.float32)
        for body in self.bodies:
            if body.speed > 2 and body.kind != "bird":
                at_x, at_y, heading = body.way(np.array([time]))[:, 0]
                dx, dy, (cos, sin) = (x - at_x).astype(np.float32), (y - at_y).astype(np.float32), unit(heading)
                behind, beside = body.high[0] - cos * dx - sin * dy, abs(cos * dy - sin * dx)
                near = np.exp(-(((beside - 0.354 * behind) / (1 + 0.06 * abs(behind))) ** 2)) * (behind > 0)
                size = min(0.02 * body.speed * np.sqrt(body.high[0]), 0.4) / (1 + abs(behind) / 8) ** (1 / 3)
                total += near * size * np.cos(1.5 * GRAVITY / body.speed**2 * (0.82 * behind + 0.58 * beside))
        return total

    def _solid(self, scan: Scan, water: Water, rng: Random) -> tuple[Array, Array, Array]:
        """Return range, power and label of the echoes of bodies; the halves of a beam may meet different ones."""
        surface, halves = np.full(len(scan.slant), NEVER), np.float32(self.world["width_mrad"] / 4000)
        surface[water.ray] = water.range_m
        near, rho = np.tile(self.deck_m, (2, 1)), np.tile(self.deck_rho, (2, 1))
        label = np.full(near.shape, IGNORED)
        for number, sight in enumerate(scan.sights, 1):
            rows, fixed = self._towards(scan, sight), sight.body.kind in FIXED
            for half in (slice(None),) if fixed else (0, 1):
                rays = scan.rays[:, rows] + halves * rng.standard_normal((3, len(rows)), np.float32)
                found, bright = self._meet(sight, scan.place[:, rows], rays, rng)
                closer = found < np.minimum(near[half, rows], surface[rows])
                closer = closer.all(axis=0) if fixed else closer
                there = rows[closer]
                near[half, there], rho[half, there] = found[closer], bright[closer]
                label[half, there] = IGNORED if fixed else number
        range_m, power = np.full(len(surface), NEVER), np.zeros(len(surface))
        met = np.flatnonzero((near < NEVER).any(axis=0))
        near, rho = near[:, met], rho[:, met]
        first = near.argmin(axis=0), np.arange(len(met))
        together = abs(near[0] - near[1]) < 0.4
        range_m[met] = np.where(together, near.mean(axis=0), near[first])
        share = np.where(together, rho.mean(axis=0), rho[first] / 2)
        power[met] = share * rng.gamma(5, 0.2, len(met)) / range_m[met] ** 2
        owner = np.full(len(surface), CLUTTER)
        owner[met] = label[:, met][first]
        return range_m, power, owner

    def _towards(self, scan: Scan, sight: Sight, *, mirrored: bool = False) -> Array:
        """Return the rays that may meet a body."""
        body, (x, y, z), turn = sight[:3]
        away = body.distance(scan.centre[:2, None], np.array([scan.middle_s]))[0]
        if away < 0.3:
            return np.arange(len(scan.slant))
        outline = np.array(np.meshgrid(*zip(body.low[:2], body.high[:2], strict=True))).reshape(2, -1)
        dx, dy = turn[:2, :2] @ outline + np.array([[x], [y]]) - scan.centre[:2, None]
        middle, margin = np.arctan2(dy.mean(), dx.mean()), 0.06 + 0.3 / away
        width = abs(wrapped(np.arctan2(dy, dx) - middle)).max() + margin
        level = scan.angle.reshape(-1, self.columns)[len(self.beams) // 2]
        columns = np.flatnonzero(abs(wrapped(level - middle)) < width + np.radians(self.world["roll_deg"]) / 2)
        rows = (np.arange(len(self.beams))[:, None] * self.columns + columns).ravel()
        ends = np.array([body.low[2], body.high[2]]) + z
        ends = (-ends[::-1] if mirrored else ends) - scan.centre[2]
        low, high = ends / np.where(ends * [-1, 1] > 0, away, away + 2 * np.hypot(*body.high[:2])) + [-margin, margin]
        return rows[(scan.slant[rows] > low) & (scan.slant[rows] < high)]

    def _meet(self, sight: Sight, place: Array, rays: Array, rng: Random) -> tuple[Array, Array]:
        at, turn = sight.at.astype(np.float32), sight.turn.astype(np.float32)
        return cast(sight.body.parts, turn.T @ (place - at[:, None]), turn.T @ rays, rng)

    def _from_water(self, scan: Scan, water: Water, rng: Random) -> Iterator[Echoes]:
        """Yield the echoes from ripples and from below the surface, from whitecaps, and from wakes."""
        world, wind, sine = self.world, self.world["wind_ms"], water.sine
        tilt = np.sqrt(1 + water.slope**2 + water.across**2)
        cosine = np.clip((sine + np.sqrt(1 - sine**2) * water.slope) / tilt, 0.01, 1)
        cos, sin = unit(water.angle - world["wind_rad"])
        needed, upwind, crosswind = 1 / water.dip - water.slope, 0.001 + 0.00316 * wind, 0.003 + 0.00192 * wind
        odds = (needed * cos + water.across * sin) ** 2 / upwind + (needed * sin - water.across * cos) ** 2 / crosswind
        density = np.exp(-odds / 2) + 0.1 * world["steep"] * (1 + odds / 3) ** -2.5  # breaking ripples are steeper
        facets = 0.02 / (8 * np.sqrt(upwind * crosswind)) * density * (1 - 0.3 * cos) / sine**4
        below = 10 ** world["log_turbidity"] * (1 - fresnel(cosine)) ** 2 * cosine
        mean = (np.minimum(facets, 2) + below) / water.range_m**2
        lit = np.flatnonzero(mean > self.least / 40)
        yield water.ray[lit], water.range_m[lit], mean[lit] * rng.gamma(0.3, 1 / 0.3, len(lit))
        rasters = self.froth.rasters(scan.middle_s, scan.centre[:2])
        for raster, tall in zip(rasters, (0.03, world["froth_m"]), strict=True):
            away = water.away - rng.exponential(tall, len(mean)) / water.dip  # a lump ends the ray before the surface
            cover = self.froth.at(raster, *(away * unit(water.angle)))
            hit = np.flatnonzero((rng.random(len(mean)) < cover) & (away > 0.5))
            range_m = away[hit] * np.hypot(1, water.dip[hit])
            rho = 10 ** rng.uniform(-2.3, -0.8, len(hit))
            yield water.ray[hit], range_m, rho * rng.exponential(1, len(hit)) / range_m**2

    def _mirrored(self, scan: Scan, water: Water, rng: Random) -> Iterator[Echoes]:
        """Yield the echoes of bodies by way of the water: those of rays from below it, turned upwards."""
        of_ray, up = np.full(len(scan.slant), -1), np.array([[1], [1], [-1]], np.float32)
        of_ray[water.ray] = np.arange(len(water.ray))
        for sight in scan.sights if self.world["mirror"] else ():
            rows = self._towards(scan, sight, mirrored=True)
            rows = rows[of_ray[rows] >= 0]
            met, rays = of_ray[rows], scan.rays[:, rows] * up
            rays[2] += 2 * (water.slope[met] + rng.normal(0, 0.004 + 0.006 * self.world["wind_ms"], len(rows)))
            range_m, rho = self._meet(sight, scan.place[:, rows] * up, rays, rng)
            seen = (range_m > water.range_m[met] + 0.1) & (range_m < NEVER)
            power = 0.7 * rho * fresnel(water.sine[met]) ** 2 * rng.gamma(2, 0.5, len(rows)) / range_m**2
            yield rows[seen], range_m[seen], power[seen]

    def _from_air(self, scan: Scan, _: Water, rng: Random) -> Iterator[Echoes]:
        """Yield the echoes of spray, of fog, from where laser and receiver begin to overlap, and of rain."""
        place, size = self.spray.flying(scan.middle_s)
        x, y, z = scan.turn[self.columns // 2].T @ (place - scan.centre[:, None])
        away = np.sqrt(x**2 + y**2 + z**2)
        up = np.arcsin(z / away)
        beam = np.searchsorted((self.beams[1:] + self.beams[:-1]) / 2, up)
        spacing = np.gradient(self.beams)[beam]
        met = (abs(up - self.beams[beam]) < spacing) & (rng.random(len(away)) < size / away / spacing)
        turn = ((np.pi - np.arctan2(y, x)) / (2 * np.pi) * self.columns).astype(np.int64) % self.columns
        filled = np.minimum(1, size / away / 0.002)
        power = 0.15 * filled * rng.exponential(1, len(away)) / away**2
        yield (beam * self.columns + turn)[met], away[met], power[met]
        every, sight_m, rain = np.arange(len(scan.slant)), self.world["sight_m"], self.world["rain_mm_h"]
        if sight_m < 2000:
            range_m = self.world["blind_m"] + rng.exponential(1.5 + sight_m / 60, len(every))
            overlap = 1 - np.exp(-((range_m / 2) ** 2))
            yield every, range_m, 0.018 / sight_m * overlap / range_m**2 * rng.exponential(1, len(every))
        if rain:
            range_m = rng.exponential(1 / (1.5e-5 * rain), len(every)) + 0.1
            yield every, range_m, rng.lognormal(-7.6, 1, len(every)) / range_m**2

    def _sunlight(self, scan: Scan, _: Water, rng: Random) -> Iterator[Echoes]:
        """Yield what the sun on the water is taken for, at random ranges."""
        sunny = (abs(wrapped(scan.angle - self.world["sun_rad"])) < 0.4) & (scan.slant < -0.02)
        stray = np.flatnonzero(sunny & (rng.random(len(sunny)) < self.world["sun"]))
        yield stray, rng.uniform(2, 80, len(stray)), np.full(len(stray), 1.1 * self.least)

    def _points(self, rays: Array, range_m: Array, power: Array, label: Array, rng: Random) -> Array:
        """Return the points of some rays, in the order of time."""
        points, range_m, power = np.zeros(len(rays), POINT), range_m[rays], power[rays]
        noisy = range_m + rng.normal(0, self.world["noise_m"], len(rays))
        points["x"], points["y"], points["z"] = self.rays.reshape(3, -1)[:, rays] * noisy
        signal = power / self.least
        bright = {"range": 255 * power * range_m**2, "power": 0.5 * signal, "root": 8 * np.sqrt(signal)}
        points["intensity"] = np.clip(np.round(self.world["gain"] * bright[self.world["bright"]]), 0, 255)
        points["ring"], turn = np.divmod(rays, self.columns)
        points["t"], points["label"] = turn / self.columns * self.period, label[rays]
        return points[np.argsort(turn, kind="stable")]

    def _boxes(self, scan: Scan) -> Boxes:
        """Return the boxes as seen when the lidar looks at them; fixed bodies have one for each part."""
        rows = [("deck", "ignore", (part.low + part.high) / 2, part.high - part.low, 0.0) for part in self.deck]
        for number, (body, _, _, time, place, facing) in enumerate(scan.sights, 1):
            own_at, own_turn = (a[..., 0] if a.ndim == 2 else a[0] for a in self.own.pose(np.array([time])))
            at, turn, fixed = own_turn.T @ (place - own_at), own_turn.T @ facing, body.kind in FIXED
            yaw = np.arctan2(turn[1, 0], turn[0, 0])
            for low, high in [(part.low, part.high) for part in body.parts] if fixed else [(body.low, body.high)]:
                corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1)
                level = rotation(yaw).T @ turn @ corners  # upright, unlike the body
                middle = at + rotation(yaw) @ (level.min(1) + level.max(1)) / 2
                rows.append((str(number), "ignore" if fixed else body.kind, middle, np.ptp(level, axis=1), yaw))
        if not rows:
            return Boxes()
        tracks, kinds, *numbers = zip(*rows, strict=True)
        return Boxes(tracks, kinds, *map(np.array, numbers))


def record(name: str, seed: int, families: Sequence[str], folder: Path) -> None:
    key = [seed, *name.encode()]
    rng = np.random.default_rng(key)
    families = families or rng.choice(list(FAMILIES), rng.integers(1, 4), replace=False).tolist()
    recorder = Recorder(draw(rng, families), rng, key)
    frames = (recorder.frame(number) for number in range(recorder.world["frames"]))
    world = {"families": ", ".join(families)} | {name: str(value) for name, value in recorder.world.items()}
    write_labelled(folder / f"{name}_{seed}.mcap", frames, world, START_NS, recorder.period)


def main() -> None:
    parser = parser_of("second_sea.py", __doc__, FAMILIES)
    parser.add_argument(
        "--random", type=int, default=0, help="instead, so many logs of mixed families, from the first seed on"
    )
    given = parser.parse_args()
    logs: list[Any] = [("random", given.seeds[0] + number, ()) for number in range(given.random)]
    logs = logs or [(family, seed, (family,)) for seed in given.seeds for family in given.families]
    record_all(record, logs, given.folder, given.jobs)


if __name__ == "__main__":
    main()
