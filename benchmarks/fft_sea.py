"""Labelled logs of a third simulator of a lidar at sea: waves by Fourier transform, convex bodies and clumps of drops.

Run as ``python benchmarks/fft_sea.py FOLDER --seeds 1..3``; each seed, from 0 to 99, gives one log of each family.
The sea is a random field of a JONSWAP spectrum [1]_ with waves of deep water, made by inverse Fourier transform [2]_
and sharpened to second order in height, as by Stokes; spectra of swell and wind sea add. Rays meet this surface, and
convex bodies that float on it. Echoes of bodies and foam are Lambertian; those of water fall with the cosine of
incidence, and those by way of the water's mirror with Fresnel's reflectance in the approximation of Schlick [3]_.
Spray falls, and is slowed by the air. Fog attenuates by the law of Beer and Lambert. The field ``src`` of a point is
what sent it back.

It was written without sight of the method and of the other simulators. Its reflectivities, the numbers of echoes of
rain and fog, and the rates of spray, whitecaps and glint are plausible, not measured. Known weaknesses (84 logs, seeds
10 to 16): foam is 1 % of points; in a quarter of the logs, crests beyond 60 m send more than ten points in a frame;
glint is as bright at grazing incidence as at steeper.

.. [1] Hasselmann et al. (1973). "Measurements of wind-wave growth and swell decay during the Joint North Sea Wave
   Project". Deutsche Hydrographische Zeitschrift A8(12).
.. [2] Tessendorf (2001). "Simulating ocean water". SIGGRAPH course notes.
.. [3] Schlick (1994). "An inexpensive BRDF model for physically-based rendering". Computer Graphics Forum 13(3).
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from fft_bodies import FARTHEST_M, GRAVITY, Array, Body, Sea, Source, fade, rotation, shifted, signal, speckle
from fft_clutter import Clutter, Echoes, Water
from fft_scenes import FAMILIES, Lidar, Own, World, draw
from mcap.writer import Writer
from sea_logs import CLOUD, IMU, channel, cloud_message, imu_message, parser_of, record_all

from seaclutter_cli.labels.csv import COLUMNS
from seaclutter_cli.truth import IGNORED

START_S = 1.76e9
POINT = np.dtype(
    [
        *((name, "f4") for name in ("x", "y", "z", "intensity")),
        *(("ring", "u2"), ("label", "u2"), ("timestamp", "f8"), ("src", "u1")),
    ]
)
LAST_SEED = 99


class Scan(NamedTuple):
    """Times, places and rotations of the columns of a frame, and its rays, shape (beams, columns, 3)."""

    times: Array
    place: Array
    turn: Array
    rays: Array


@dataclass
class Hits:
    """Where rays first meet a body, shape (beams, columns): range, number of the body, incidence, reflectivity."""

    range_m: Array
    body: Array
    cosine: Array
    rho: Array

    def add(self, columns: Any, range_m: Array, body: int, cosine: Array, rho: float) -> None:
        """Keep what is nearer of a part, in some columns."""
        nearer = range_m < self.range_m[:, columns]
        new = range_m, np.full(nearer.shape, body), cosine, np.full(nearer.shape, rho)
        for all_values, values in zip((self.range_m, self.body, self.cosine, self.rho), new, strict=True):
            all_values[:, columns] = np.where(nearer, values, all_values[:, columns])


class Recorder:
    """The lidar in its world: frames of labelled points, and boxes."""

    def __init__(self, world: World) -> None:
        self.world, self.rng = world, np.random.default_rng(world.seed + 77)
        self.lidar = Lidar(world.beams, world.rate_hz, sweeps=world.sweeps)
        self.sea = Sea(world.waves)
        self.own = Own(world, self.sea, self.rng)
        self.clutter = Clutter(world, self.sea, self.own, self.lidar, self.rng)

    def frame(self, number: int) -> Array:
        """Return the points of a frame; frames are made in order."""
        time = self.own.times[number]
        self.sea.update(time)
        for body in self.world.bodies:
            body.settle(self.sea, time)
        times = self.lidar.times(time, self.lidar.azimuths)
        place, turn = self.own.lidar(times)
        scan = Scan(times, place, turn, np.einsum("cij,bcj->bci", turn, self.lidar.rays))
        hits = self._meet(scan, scan.place, scan.rays)
        self._meet_deck(hits)
        origins = np.broadcast_to(scan.place, scan.rays.shape).reshape(-1, 3)
        water_m = self.sea.cast(origins, scan.rays.reshape(-1, 3)).reshape(hits.range_m.shape)
        ends_m = np.minimum(hits.range_m, water_m)
        water_m[water_m >= hits.range_m] = np.inf
        echoes = self._solid(hits, water_m)
        self._water(scan, water_m, time, echoes)
        if self.world.mirror_slope:
            self._mirrored(scan, water_m, echoes)
        self.clutter.advance(number)
        self.clutter.in_air(number, ends_m, echoes)
        self.clutter.adapt_wake(echoes)
        self.clutter.precipitation(ends_m, echoes)
        return self._points(scan, echoes)

    def _meet(self, scan: Scan, place: Array, rays: Array) -> Hits:
        """Return where rays from the places of columns meet bodies."""
        shape = rays.shape[:2]
        hits = Hits(np.full(shape, np.inf), np.full(shape, -1), np.zeros(shape), np.zeros(shape))
        for number, body in enumerate(self.world.bodies):
            xy, yaw = body.way(scan.times)
            turn = rotation(np.full(len(yaw), body.roll), np.full(len(yaw), body.pitch), yaw)
            at = np.column_stack([xy, np.full(len(yaw), body.z)])
            columns = self._towards(body, at - place, rays)
            if not len(columns):
                continue
            o = np.einsum("cij,ci->cj", turn[columns], place[columns] - at[columns])
            d = np.einsum("cij,bci->bcj", turn[columns], rays[:, columns])
            o, d = np.broadcast_to(o, d.shape).reshape(-1, 3), d.reshape(-1, 3)
            for part in body.parts:
                range_m, cosine = (a.reshape(shape[0], -1) for a in part.cast(o, d))
                hits.add(columns, range_m, number, cosine, part.rho)
        return hits

    def _towards(self, body: Body, away: Array, rays: Array) -> Array:
        """Return the columns that may see a body."""
        distance = np.hypot(away[:, 0], away[:, 1])
        level = rays[len(rays) // 2]
        bearing = np.arctan2(level[:, 1], level[:, 0])
        off = np.abs((np.arctan2(away[:, 1], away[:, 0]) - bearing + np.pi) % (2 * np.pi) - np.pi)
        half = np.arcsin(np.minimum(body.radius / np.maximum(distance, body.radius), 1)) + 0.06
        return np.flatnonzero((off < half) & (distance - body.radius < FARTHEST_M))

    def _meet_deck(self, hits: Hits) -> None:
        """Add where rays meet own ship."""
        shape = hits.range_m.shape
        for part in self.world.deck:
            rays = self.lidar.rays.reshape(-1, 3)
            range_m, cosine = (a.reshape(shape) for a in part.cast(np.zeros(rays.shape), rays))
            hits.add(slice(None), range_m, -1, cosine, part.rho)

    def _solid(self, hits: Hits, water_m: Array) -> Echoes:
        """Return the echoes of bodies and of own ship."""
        rng, bodies, range_m, shape = self.rng, self.world.bodies, hits.range_m, hits.range_m.shape
        dim = np.exp(-2 * self.world.extinction * np.where(np.isfinite(range_m), range_m, 0))
        power = signal(hits.rho, hits.cosine, range_m) * dim
        seen = np.isinf(water_m) & (range_m < FARTHEST_M) & (power > speckle(rng, 0.4, shape))
        bright = 255 * hits.rho * np.sqrt(hits.cosine) * fade(range_m) * dim * speckle(rng, 0.2, shape)
        sources = np.array([*(Source.FIXED if body.fixed else Source.TARGET for body in bodies), Source.OWN])
        labels = np.array([*(IGNORED if body.fixed else i for i, body in enumerate(bodies, 1)), IGNORED])
        values = (range_m, np.inf), (bright, 0), (sources[hits.body], 0), (labels[hits.body], 0)
        return Echoes(*(np.where(seen, there, without) for there, without in values))

    def _water(self, scan: Scan, water_m: Array, time: float, echoes: Echoes) -> None:
        """Add the echoes of the water and of what is on it."""
        world, rng = self.world, self.rng
        beam, column = np.argwhere(water_m < FARTHEST_M).T
        r, d = water_m[beam, column], scan.rays[beam, column]
        place = scan.place[column] + r[:, None] * d
        hx, hy = self.sea.slope(place[:, 0], place[:, 1])
        hx, hy = hx + world.ripple * rng.normal(size=len(r)), hy + world.ripple * rng.normal(size=len(r))
        tilt = np.sqrt(1 + hx**2 + hy**2)
        cosine = np.maximum(-(d[:, 2] - hx * d[:, 0] - hy * d[:, 1]) / tilt, 0.002)
        steep = np.sqrt((hx**2 + hy**2).mean())  # waves face the lidar: the reach is that of flat water
        power = cosine / (world.height_m / world.water_reach_m + 0.7 * steep) * (world.water_reach_m / r) ** 2
        power *= np.exp(-2 * world.extinction * r)
        bright = 3 * np.sqrt(power) * speckle(rng, 0.5, len(r))
        bright = np.where(bright > 60, 60 + 0.3 * (bright - 60), bright)
        lift_m = np.abs(world.rough_m * rng.normal(size=len(r)))
        water = Water(place, r, cosine, power, bright, lift_m, np.full(len(r), Source.WATER))
        self.clutter.on_water(water, time)
        seen = water.signal * speckle(rng, 0.7, len(r)) > 1
        seen &= (rng.random(len(r)) < world.water_share) | (water.source > 0)
        shorter = np.where(water.source == Source.WAKE, 6.0, 1.0)
        nearer = r - np.minimum(water.lift_m / np.maximum(-d[:, 2], 0.03), shorter)
        echoes.put((beam[seen], column[seen]), nearer[seen], water.intensity[seen], water.source[seen])

    def _mirrored(self, scan: Scan, water_m: Array, echoes: Echoes) -> None:
        """Add the echoes of bodies by way of the water: those of rays from below it, turned upwards."""
        rng, shape, up = self.rng, water_m.shape, np.array([1, 1, -1])
        rays = scan.rays * up
        rays[..., 2] += 2 * self.world.mirror_slope * rng.normal(size=shape)
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        hits = self._meet(scan, scan.place * up, rays)
        reflectance = 0.02 + 0.98 * (1 - np.abs(scan.rays[..., 2])) ** 5
        power = signal(hits.rho, hits.cosine, hits.range_m) * reflectance**2
        behind = (hits.range_m > water_m + 0.05) & (hits.range_m < FARTHEST_M)
        seen = (power > speckle(rng, 0.4, shape)) & ~np.isfinite(echoes.range_m)
        seen |= (power > 4) & (echoes.source == Source.WATER) & (rng.random(shape) < 0.5)
        seen &= behind
        bright = 255 * hits.rho * np.sqrt(hits.cosine) * reflectance**2 * fade(hits.range_m) * speckle(rng, 0.2, shape)
        echoes.put(seen, hits.range_m[seen], bright[seen], Source.MIRROR)

    def _points(self, scan: Scan, echoes: Echoes) -> Array:
        """Return the points of a frame, by column."""
        rng, range_m = self.rng, echoes.range_m
        beam, column = np.nonzero(np.isfinite(range_m) & (range_m > 0.5) & (rng.random(range_m.shape) > 0.01))
        noisy = range_m[beam, column] + 0.015 * rng.normal(size=len(beam))
        points = np.zeros(len(beam), POINT)
        points["x"], points["y"], points["z"] = (noisy[:, None] * self.lidar.rays[beam, column]).T
        points["intensity"] = np.clip(np.round(echoes.intensity[beam, column]), 1, 255)
        points["ring"], points["label"] = beam, echoes.label[beam, column]
        points["src"], points["timestamp"] = echoes.source[beam, column], START_S + scan.times[column]
        return points[np.lexsort((beam, column))]

    def boxes(self, number: int) -> list[list[Any]]:
        """Return the boxes of the frame that was made last: track, class, centre, size and yaw."""
        rows = [self._box(track, body, self.own.times[number]) for track, body in enumerate(self.world.bodies, 1)]
        if self.world.deck_box:
            low, high = self.world.deck_box
            rows.append([9999, "ignore", *((low + high) / 2), *(high - low), 0.0])
        return rows

    def _box(self, track: int, body: Body, start: float) -> list[Any]:
        """Return the box of a body as seen when the lidar looks at it."""
        time = np.array([start])
        for _ in range(3 if self.lidar.sweeps else 1):
            place, turn = self.own.lidar(time)
            xy, yaw = body.way(time)
            corners = body.vertices @ rotation(body.roll, body.pitch, body.yaw).T + [*xy[0], body.z]
            q = (corners - place[0]) @ turn[0]
            middle = q.mean(0)
            time = self.lidar.times(start, np.arctan2(middle[1], middle[0])[None])
        head = turn[0].T @ np.array([np.cos(yaw[0]), np.sin(yaw[0]), 0])
        facing = np.arctan2(head[1], head[0])
        cos, sin = np.cos(facing), np.sin(facing)
        upright = np.array([q[:, 0] * cos + q[:, 1] * sin, -q[:, 0] * sin + q[:, 1] * cos, q[:, 2]])
        low, high = upright.min(1), upright.max(1)
        (u, v, z), size = (low + high) / 2, np.maximum(high - low, 0.05)
        return [track, "ignore" if body.fixed else body.kind, *shifted((0, 0), facing, u, v), z, *size, facing]


def imu_of(own: Own, time: float, stamp_ns: int) -> bytes:
    """Return the attitude, its rate by differences, and the acceleration of gravity alone."""
    half_s = 0.005
    before, turn, after = own.lidar(time + np.array([-half_s, 0, half_s]))[1]
    spin = turn.T @ (after - before) / (2 * half_s)
    w = np.sqrt(max(0, 1 + turn[0, 0] + turn[1, 1] + turn[2, 2])) / 2
    axis = turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]
    quaternion = (*(a / 4 / w for a in axis), w) if w > 1e-3 else (0.0, 0.0, 1.0, 0.0)
    rates, force = (spin[2, 1], spin[0, 2], spin[1, 0]), turn.T @ np.array([0, 0, GRAVITY])
    return imu_message(quaternion, rates, force, stamp_ns)


def messages(recorder: Recorder, number: int) -> Iterator[tuple[str, int, bytes]]:
    """Yield topic, time and data of the messages of a frame."""
    own, period_s = recorder.own, recorder.lidar.period_s
    stamp_ns = round((START_S + own.times[number]) * 1e9)
    if recorder.world.imu:
        count = max(1, round(period_s * 50))
        for i in range(count):
            later_ns = stamp_ns + int(i * period_s / count * 1e9)
            yield "/imu/data", later_ns, imu_of(own, own.times[number] + i * period_s / count, later_ns)
    yield "/points", stamp_ns, cloud_message(recorder.frame(number), stamp_ns)


def label_rows(number: int, boxes: list[list[Any]]) -> Iterator[list[Any]]:
    if all(kind == "ignore" for _, kind, *_ in boxes):
        yield [number, 0, "none", *[0] * 7]
    for track, kind, *values in boxes:
        yield [number, track, kind, *(f"{value:.4f}" for value in values)]


def record(family: str, seed: int, folder: Path) -> None:
    """Write a log and its labels, unless they are there."""
    log = folder / f"{family}_{seed}.mcap"
    part = log.with_suffix(".part")
    if log.exists():
        return
    recorder = Recorder(draw(family, seed))
    with part.open("wb") as stream, log.with_suffix(".labels.csv").open("w", newline="") as table:
        writer, lines = Writer(stream), csv.writer(table)
        lines.writerow(COLUMNS)
        writer.start(profile="ros2", library="third-sim")
        channels = {"/points": channel(writer, "/points", CLOUD)}
        if recorder.world.imu:
            channels["/imu/data"] = channel(writer, "/imu/data", IMU)
        for number in range(recorder.world.frames):
            for topic, stamp_ns, data in messages(recorder, number):
                writer.add_message(channels[topic], stamp_ns, data, stamp_ns)
            lines.writerows(label_rows(number, recorder.boxes(number)))
        writer.finish()
    part.rename(log)


def main() -> None:
    parser = parser_of("fft_sea.py", __doc__, FAMILIES)
    given = parser.parse_args()
    if max(given.seeds) > LAST_SEED:
        parser.error(f"--seeds: at most {LAST_SEED}; later ones have the random numbers of other families")
    record_all(record, [(family, seed) for seed in given.seeds for family in given.families], given.folder, given.jobs)


if __name__ == "__main__":
    main()
