"""Labelled logs of a statistical simulator of a lidar at sea.

Run as ``python benchmarks/facet_sea.py FOLDER --seeds 1..3 --families wake glint`` (default: all families); logs that
are there are left as they are. The sea is a sum of 30 to 80 Gerstner waves [1]_ of a JONSWAP spectrum [2]_, whose
directions spread more above the peak [3]_. A polar grid of azimuth and range around the lidar has its heights, its
slopes, and what crests hide. Echoes of the water are drawn: those of facets with slopes of Cox and Munk [4]_ have
K-distributed reflectivity [5]_, which is gamma speckle on a gamma texture that moves with the waves; foam comes and
goes in patches, as often as the power law of whitecaps [6]_ says; crests break in groups; wakes have froth and Kelvin
arms; spray, rain and fog [7]_ come first. Only bodies, convex polyhedra and ellipsoids, are met by rays.

The simulator was written without sight of the method that it tests and of the other simulators. Its reflectivities are
plausible, not measured: water is as bright as it takes to be seen up to a range that is drawn. Weaknesses: wakes have
fewer echoes on lidars of few beams; the polar grid is coarse beyond 30 m; there are no far shores, reeds or bridges.

.. [1] Tessendorf (2001). "Simulating ocean water". SIGGRAPH course notes.
.. [2] Hasselmann et al. (1973). "Measurements of wind-wave growth and swell decay during JONSWAP". DHZ A8(12).
.. [3] Mitsuyasu et al. (1975). "Observations of the directional spectrum of ocean waves". JPO 5(4).
.. [4] Cox, Munk (1954). "Measurement of the roughness of the sea surface". JOSA 44(11).
.. [5] Ward, Tough, Watts (2013). "Sea clutter: scattering, the K distribution and radar performance". IET.
.. [6] Monahan, O'Muircheartaigh (1980). "Optimal power-law description of oceanic whitecap coverage". JPO 10(12).
.. [7] Rasshofer, Spies, Spies (2011). "Influences of weather phenomena on automotive laser radar systems". ARS 9.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from facet_bodies import GRAVITY, Array, Body, Ellipsoid, Placed, cast, rotation
from facet_clutter import Clutter, Facets, Scan, Surface, Water, meet_water
from facet_world import FAMILIES, Quay, World, across
from mcap.writer import Writer
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from sea_logs import CLOUD, IMU, channel, cloud_message, imu_message, parser_of, record_all

from seaclutter_cli.labels.csv import COLUMNS
from seaclutter_cli.truth import IGNORED

POINT = np.dtype([*((name, "f4") for name in ("x", "y", "z", "intensity")), ("ring", "u2")])
CLUTTER = -1
BIRD = Ellipsoid((0, 0, 0), (0.3, 0.45, 0.12), 0.2)

Row = tuple[int, str, Any]  # track, class, box: x, y, z, length, width, height, yaw
Points = dict[str, Array]
Message = tuple[int, int, int, bytes]  # times of recording and of measurement, channel, data


class Sight(NamedTuple):
    """Target; time at which it is scanned, its position and rotation then."""

    body: Body
    time: float
    at: Array
    turn: Array


class Echoes:
    """Range, reflectivity and target of the first echo of every ray, and second echoes behind it."""

    def __init__(self, number: int, *, dual: bool) -> None:
        self.range_m, self.rho, self.target = np.full(number, np.inf), np.zeros(number), np.full(number, CLUTTER)
        self.dual, self.second = dual, [(np.zeros(0, int), np.zeros(0), np.zeros(0), np.zeros(0, int))]

    def put(self, rays: Array, range_m: Array, rho: Array) -> None:
        """Set echoes of clutter."""
        self.range_m[rays], self.rho[rays], self.target[rays] = range_m, rho, CLUTTER

    def put_before(self, rays: Array, range_m: Array, rho: Array) -> None:
        """Set echoes of the air; a lidar of two echoes keeps what is behind them."""
        kept = rays[np.isfinite(self.range_m[rays])]
        if self.dual:
            self.second.append((kept, self.range_m[kept], self.rho[kept] * 0.6, self.target[kept]))
        self.put(rays, range_m, rho)

    def all(self) -> tuple[Array, Array, Array, Array]:
        """Return rays, ranges, reflectivities and targets; second echoes only 0.6 m behind the first."""
        rays = np.flatnonzero(np.isfinite(self.range_m) & (self.range_m > 0.5) & (self.range_m < 240))
        second = [np.concatenate(each) for each in zip(*self.second, strict=True)]
        second = [each[np.isin(second[0], rays)] for each in second]
        once = np.unique(second[0], return_index=True)[1]
        second = [each[once] for each in second]
        far = second[1] > self.range_m[second[0]] + 0.6
        first = rays, self.range_m[rays], self.rho[rays], self.target[rays]
        rays, range_m, rho, target = (np.concatenate([a, b[far]]) for a, b in zip(first, second, strict=True))
        return rays, range_m, rho, target


class Recorder:
    """The lidar in its world: frames of points and rows of labels."""

    def __init__(self, family: str, seed: int) -> None:
        self.world = World(family, seed)
        self.rng, self.lidar, self.period = self.world.rng, self.world.lidar, 1 / self.world.lidar.rate_hz
        self.clutter = Clutter(self.world)
        self.surface = Surface(self.world, self.clutter)
        place, self.deck_box = np.zeros(3), [0, 0, -0.4, 1.6, 1.2, 1.0, 0.0]
        own = (self.world.deck, place, rotation(-self.world.own.mount), 99.0)
        self.deck_m, self.deck_rho, _ = cast([own], place, self.lidar.rays, self.rng)
        self.deck = np.flatnonzero(np.isfinite(self.deck_m))
        if len(self.deck):
            corners = self.lidar.rays[self.deck] * self.deck_m[self.deck][:, None]
            self.deck_box = fit(corners, -self.world.own.mount, 0.15)

    def gloss(self, number: int) -> Array:
        return self.rng.lognormal(0, 0.18, number)

    def frame(self, number: int) -> tuple[float, Points, list[Row]]:
        """Return the time, the points and the labels of a frame."""
        start = number / self.lidar.rate_hz
        self.clutter.step(start, self.period, self.world.own.way([start])[0])
        scan = self._scan(start)
        water = meet_water(self.world, scan)
        sights = [self._sight(scan, body) for body in self.world.bodies]
        placed = [*self._placed(scan, sights)]
        solid_m, echoes = self._solid(scan, water, placed)
        facets = self.surface.facets(scan, water, np.flatnonzero((solid_m >= water.range_m) & (water.range_m < 120)))
        mirroring = ~facets.seen & (facets.far < 75) & (facets.sine < 0.5)
        near = facets.seen & (facets.range_m > 0.4)
        echoes.put(facets.ray[near], facets.range_m[near], facets.rho[near])
        if placed and self.world.weather.mirror > 0:
            self._mirrored(scan, facets, np.flatnonzero(mirroring), placed, echoes)
        ceiling = np.minimum(np.minimum(water.range_m, 150.0), solid_m)
        self._from_spray(scan, ceiling, echoes)
        self._from_rain(ceiling, echoes)
        self._from_fog(scan, ceiling, echoes)
        self._sunlight(scan, echoes)
        echoes.put(self.deck, self.deck_m[self.deck], self.deck_rho[self.deck] * self.gloss(len(self.deck)))
        points = self._points(echoes)
        return start, points, [*self._rows(scan, sights, points)]

    def _scan(self, start: float) -> Scan:
        """Return the rays of a frame; without skew, all are at its start."""
        lidar, own = self.lidar, self.world.own
        time, times = start, np.full(lidar.columns, start)
        if self.world.skewed:
            time = start + 0.5 / lidar.rate_hz
            times = start + np.arange(lidar.columns) / lidar.columns / lidar.rate_hz
        places, turns = own.pose(times)
        (place,), (turn,) = own.pose(time)
        rays = lidar.rays.reshape(lidar.beams, lidar.columns, 3)
        rays = np.einsum("cij,rcj->rci", turns.astype(np.float32), rays, optimize=True).reshape(-1, 3)
        return Scan(rays, places[lidar.column] if self.world.skewed else place, times, time, place, turn)

    def _sight(self, scan: Scan, body: Body) -> Sight:
        time = scan.time
        if self.world.skewed:
            towards = body.way(np.array([time]))[0] - scan.place[:2]
            level = scan.rays.reshape(self.lidar.beams, -1, 3)[self.lidar.beams // 2, :, :2]
            time = scan.times[int((level @ towards).argmax())]
        return Sight(body, time, *body.pose(self.world.sea, time))

    def _placed(self, scan: Scan, sights: list[Sight]) -> Iterator[Placed]:
        for body, _, at, turn in sights:
            yield body.shape.parts, at, turn, body.radius
        for quay in self.world.quays:
            yield quay.parts, quay.at, quay.turn, quay.half + 8
        for bird in self.world.birds:
            yield [BIRD], bird.place(scan.time - self.lidar.seconds / 2), np.eye(3), 0.6

    def _solid(self, scan: Scan, water: Water, placed: list[Placed]) -> tuple[Array, Echoes]:
        """Return the ranges of bodies and their echoes; beams are blurred by their divergence."""
        rays = scan.rays + self.rng.normal(0, self.lidar.divergence / 3.5, scan.rays.shape).astype(np.float32)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        range_m, rho, owner = cast(placed, scan.start, rays, self.rng)
        hit = np.flatnonzero(range_m < water.range_m)
        rho = rho[hit] * self.gloss(len(hit))
        bright = rho > self.world.least(range_m[hit])
        hit, rho = hit[bright], rho[bright]
        echoes = Echoes(len(rays), dual=self.world.dual)
        echoes.put(hit, range_m[hit], rho)
        echoes.target[hit] = np.where(owner[hit] < len(self.world.bodies), owner[hit], CLUTTER)
        return range_m, echoes

    def _mirrored(self, scan: Scan, facets: Facets, rows: Array, placed: list[Placed], echoes: Echoes) -> None:
        """Add the echoes of bodies by way of the water: those of rays from below it, turned upwards."""
        rng, mirror = self.rng, self.world.weather.mirror
        if not len(rows):
            return
        rows = rows[rng.random(len(rows)) < np.minimum(1, mirror * 1.3)]
        rays, far, up = facets.ray[rows], facets.far[rows], facets.towards[rows]
        fresnel = 0.02 + 0.98 * (1 - facets.sine[rows]) ** 5
        level = scan.place[2] + up[:, 2] * far
        start = np.broadcast_to(scan.start, scan.rays.shape)[rays]
        start[:, 2] = 2 * level - start[:, 2]
        up[:, 2] *= -1
        up += rng.normal(0, math.sqrt(self.world.water.slopes) * 0.12 + 0.002, up.shape).astype(np.float32)
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        range_m, rho, _ = cast(placed, start, up, rng)
        rho = rho * fresnel * fresnel * mirror * self.gloss(len(rays)) * 0.8
        seen = np.isfinite(range_m) & (range_m > far) & (rho > self.world.least(range_m))
        echoes.put(rays[seen], range_m[seen], rho[seen])

    def _from_spray(self, scan: Scan, ceiling: Array, echoes: Echoes) -> None:
        """Add the echoes of the 90 nearest clouds of spray."""
        rng, spray = self.rng, self.clutter.spray
        away = spray[:, :3] - scan.place
        distances = np.linalg.norm(away, axis=1)
        for number in np.argsort(distances)[:90]:
            distance, size, density = distances[number], *spray[number, 6:]
            if distance < 1.0 or distance > 60:
                continue
            cosine = scan.rays @ (away[number] / distance).astype(np.float32)
            rays = np.flatnonzero(cosine > math.cos(min(1.2, 2.5 * size / distance)))
            cosine = cosine[rays]
            missed = distance * np.sqrt(np.maximum(1 - cosine**2, 0))
            odds = 1 - np.exp(-density * np.exp(-(missed**2) / 2 / size**2))
            range_m = distance * cosine + rng.normal(0, size * 0.8, len(rays))
            rho = rng.gamma(1.5, 0.02, len(rays)) + 0.004
            seen = (rng.random(len(rays)) < odds) & (range_m > 0.8) & (rho > 0.5 * self.world.least(range_m))
            seen &= range_m < np.minimum(ceiling, echoes.range_m)[rays]
            echoes.put_before(rays[seen], range_m[seen], rho[seen])

    def _from_rain(self, ceiling: Array, echoes: Echoes) -> None:
        if self.world.weather.rain:
            rays = np.flatnonzero(self.rng.random(len(ceiling)) < self.world.weather.rain)
            range_m = 1 / (1 / 0.9 - self.rng.random(len(rays)) * (1 / 0.9 - 1 / 18))
            seen = range_m < np.minimum(ceiling, echoes.range_m)[rays]
            echoes.put_before(rays[seen], range_m[seen], self.rng.gamma(1.3, 0.01, seen.sum()))

    def _from_fog(self, scan: Scan, ceiling: Array, echoes: Echoes) -> None:
        rng, weather = self.rng, self.world.weather
        if not weather.fog:
            return
        rays = np.flatnonzero(rng.random(len(ceiling)) < weather.fog)
        rng.random(len(rays))  # not used: keeps the bytes of the logs
        range_m = rng.gamma(2.2, weather.fog_m / 2.2, len(rays)) + 0.8
        x, y = (scan.place[axis] + scan.rays[rays, axis] * range_m for axis in (0, 1))
        clumps = self.world.water.clumps.normal(x, y, scan.time)
        seen = rng.random(len(rays)) < np.clip(0.55 + 0.4 * clumps, 0.05, 1)
        seen &= range_m < np.minimum(ceiling, echoes.range_m)[rays]
        echoes.put_before(rays[seen], range_m[seen], rng.gamma(1.3, 0.008, seen.sum()))

    def _sunlight(self, scan: Scan, echoes: Echoes) -> None:
        """Add what the sun is taken for, at random ranges."""
        rng, weather = self.rng, self.world.weather
        if not weather.sun:
            return
        number, bearing = rng.poisson(weather.sun), np.arctan2(scan.rays[:, 1], scan.rays[:, 0]) - weather.sun_rad
        rays = np.flatnonzero((np.abs(wrapped(bearing)) < 0.12) & ~np.isfinite(echoes.range_m))
        if len(rays):
            rays = rng.choice(rays, min(number, len(rays)), replace=False)
            echoes.put(rays, rng.uniform(2, 90, len(rays)), rng.gamma(1.5, 0.02, len(rays)))

    def _points(self, echoes: Echoes) -> Points:
        """Return points, column by column; diffuse echoes are up to the gain, those of reflectors above it."""
        lidar = self.lidar
        rays, range_m, rho, target = echoes.all()
        range_m = np.round((range_m + self.rng.normal(0, lidar.noise_m, len(rays))) / 0.002) * 0.002
        bright = lidar.gain + (255 - lidar.gain) * np.minimum(1, 0.35 + (rho - 1) / 8)
        points = {
            "xyz": (lidar.rays[rays] * range_m[:, None]).astype(np.float32),
            "intensity": np.clip(np.round(np.where(rho <= 1, rho * lidar.gain, bright)), 0, 255).astype(np.float32),
            "ring": lidar.ring[rays],
            "target": target,
        }
        order = np.lexsort((lidar.ring[rays], lidar.column[rays]))
        return {name: values[order] for name, values in points.items()}

    def _rows(self, scan: Scan, sights: list[Sight], points: Points) -> Iterator[Row]:
        """Yield the labels, in the axes of the lidar at the time of each."""
        yield IGNORED, "ignore", self.deck_box
        targets = [self._row(number, sight, points) for number, sight in enumerate(sights)]
        targets = [row for row in targets if np.linalg.norm(row[2][:2]) <= 150]
        yield from targets
        for quay in self.world.quays:
            yield from self._quay_rows(scan, quay)
        for bird in self.world.birds:
            corners = np.array([(x, y, z) for x in (-1.2, 1.2) for y in (-1.2, 1.2) for z in (-0.7, 0.7)])
            corners += bird.place(scan.time - self.lidar.seconds / 2)
            yield IGNORED, "ignore", fit((corners - scan.place) @ scan.turn, 0.0, 0.1)
        if all(kind == "ignore" for _, kind, _ in targets):
            yield 0, "none", None

    def _row(self, number: int, sight: Sight, points: Points) -> Row:
        """Return the label of a target; with fewer than five points within 1.45 m of each other, it is ignored."""
        body, time, at, turn = sight
        corners = np.concatenate([above_water(part.vertices) for part in body.shape.parts])
        (place,), (own_turn,) = self.world.own.pose(time)
        corners = (corners @ turn.T + at - place) @ own_turn
        own = points["xyz"][points["target"] == number]
        ahead = own_turn.T @ turn[:, 0]
        box = fit(np.concatenate([corners, own]), math.atan2(ahead[1], ahead[0]), 0.06)
        return (number + 1, body.kind, box) if clustered(own) else (IGNORED, "ignore", box)

    def _quay_rows(self, scan: Scan, quay: Quay) -> Iterator[Row]:
        """Yield boxes of a quay, of at most 8 m."""
        ends = np.linspace(-quay.half, quay.half, math.ceil(2 * quay.half / 8) + 1)
        ahead = scan.turn.T @ quay.turn[:, 0]
        yaw, margin = math.atan2(ahead[1], ahead[0]), 0.1 + (0.15 if self.world.skewed else 0)
        for low, high in pairwise(ends):
            y, z = across(quay.side, -0.25), (-0.05, quay.height_m + 3)
            corners = np.array([(a, b, c) for a in (low - 0.3, high + 0.3) for b in y for c in z])
            corners = (corners @ quay.turn.T + quay.at - scan.place) @ scan.turn
            if np.linalg.norm(corners.mean(0)) <= 130:
                yield IGNORED, "ignore", fit(corners, yaw, margin)


def wrapped(angle: Any) -> Any:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def above_water(vertices: Array) -> Array:
    """Return vertices of a part cut off 0.1 m below the water."""
    if vertices[:, 2].max() <= -0.1:
        return np.zeros((0, 3))
    cut = np.c_[vertices[:, :2], np.maximum(vertices[:, 2], -0.1)]
    return np.concatenate([vertices[vertices[:, 2] > -0.1], cut])


def clustered(points: Array) -> bool:
    """Return whether five points or more are linked by gaps of up to 1.45 m; 60 are always."""
    count = len(points)
    if count < 5 or count >= 60:
        return count >= 60
    pairs = cKDTree(points).query_pairs(1.45, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return bool(np.bincount(connected_components(links, directed=False)[1]).max() >= 5)


def fit(places: Array, yaw: float, margin: float) -> list[float]:
    """Return the upright box around places: x, y, z, length, width, height, yaw."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    local = np.array([places[:, 0] * cos + places[:, 1] * sin, -places[:, 0] * sin + places[:, 1] * cos, places[:, 2]])
    low, high = local.min(1) - margin, local.max(1) + margin
    middle = (low + high) / 2
    x, y = middle[0] * cos - middle[1] * sin, middle[0] * sin + middle[1] * cos
    return [x, y, middle[2], *(high - low), float(wrapped(yaw))]


def structured(points: Points) -> Array:
    values = np.empty(len(points["ring"]), POINT)
    values["x"], values["y"], values["z"] = points["xyz"].T
    values["intensity"], values["ring"] = points["intensity"], points["ring"]
    return values


def imu_messages(world: World, rng: np.random.Generator, start_ns: int) -> Iterator[Message]:
    """Yield the messages of an IMU at 50 or 100 Hz, with noise and bias; some have no attitude."""
    times = np.arange(0, world.lidar.seconds + 0.2, 1 / float(rng.choice([50, 100])))
    (place, turn), soon = world.own.pose(times), world.own.pose(times + 1e-3)[1]
    after, before = (world.own.pose(times + step)[0] for step in (0.01, -0.01))
    spin = np.einsum("nji,njk->nik", turn, soon - turn) / 1e-3
    rate = np.c_[spin[:, 2, 1] - spin[:, 1, 2], spin[:, 0, 2] - spin[:, 2, 0], spin[:, 1, 0] - spin[:, 0, 1]] / 2
    force = (after - 2 * place + before) / 1e-4 + np.array([0, 0, GRAVITY])
    force = np.einsum("nji,nj->ni", turn, force)
    rate = rate + rng.normal(0, 0.01, rate.shape) + rng.normal(0, 0.004, 3)
    force = force + rng.normal(0, 0.1, force.shape)
    known = rng.random() < 0.7
    errors = [rng.normal(0, 0.002, len(times)) + rng.normal(0, 0.004) for _ in range(3)]
    attitudes = Rotation.from_matrix(turn @ rotation(*errors)).as_quat()
    for time, attitude, spun, pushed in zip(times, attitudes, rate, force, strict=True):
        time_ns = start_ns + round(time * 1e9)
        yield time_ns + 1_000_000, time_ns, 1, imu_message(attitude if known else None, spun, pushed, time_ns)


def record(family: str, seed: int, folder: Path) -> None:
    """Write a log and its labels, unless they are there."""
    log = folder / f"{family}_{seed}.mcap"
    if log.exists():
        return
    recorder, rng = Recorder(family, seed), np.random.default_rng(5)
    start_ns, messages = 1_750_000_000_000_000_000 + int(rng.integers(10**9)), []
    with log.with_suffix(".labels.csv").open("w", newline="") as table:
        table.write(f"{','.join(COLUMNS)}\n")
        for number in range(recorder.lidar.frames):
            start, points, rows = recorder.frame(number)
            time_ns = start_ns + round(start * 1e9)
            later = time_ns + int(1e9 / recorder.lidar.rate_hz) + 2_000_000
            messages.append((later, time_ns, 0, cloud_message(structured(points), time_ns)))
            table.writelines(f"{number},{line(row)}\n" for row in rows)
    if recorder.world.imu:
        messages += imu_messages(recorder.world, rng, start_ns)
    part = log.with_suffix(".part")
    write(part, sorted(messages, key=lambda message: message[0]), imu=recorder.world.imu)
    part.rename(log)


def line(row: Row) -> str:
    track, kind, box = row
    values = [f"{value:.3f}" for value in box[:6]] + [f"{box[6]:.4f}"] if box else ["0"] * 7
    return ",".join([str(track), kind, *values])


def write(path: Path, messages: list[Message], *, imu: bool) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="fourth")
        channels = [
            channel(writer, topic, kind) for topic, kind in [("/lidar/points", CLOUD), ("/imu/data", IMU)][: 1 + imu]
        ]
        for number, (recorded_ns, time_ns, kind, data) in enumerate(messages):
            writer.add_message(channels[kind], recorded_ns, data, time_ns, number)
        writer.finish()


def main() -> None:
    given = parser_of("facet_sea.py", __doc__, FAMILIES).parse_args()
    record_all(record, [(family, seed) for seed in given.seeds for family in given.families], given.folder, given.jobs)


if __name__ == "__main__":
    main()
