"""Labelled logs of a simulator of lidars on unmanned vessels, with triangle meshes for all bodies.

Run as ``python benchmarks/mesh_sea.py FOLDER --seeds 1..3 --families lock fog`` (default: all families); logs that are
there are left as they are. The sea is a TMA spectrum (JONSWAP in water of some depth [1]_) with directions that spread
as measured [2]_, made by inverse Fourier transform, with crests of second order [3]_; swell; Kelvin's wakes by
Havelock's integral [4]_; surf as bores that are 0.7 as high as the water is deep. Foam is where fronts are steep, as
much as the power law of whitecaps [5]_ says, in turbulent wakes and in windrows. Echoes of the water come from facets
of ripples [6]_ that the waves do not resolve, from below its surface, and from splashes of rain. Each vertex of a mesh
is where it is when the beam passes it; three rays in the footprint of a beam may meet different bodies. Mirror images
are drawn from below the water and blurred by its slopes.

It shares no physics with the other simulators, only `sea_logs` and `ideal`. Its reflectivities, and the rates of spray,
rain and fog, are plausible, not measured. Targets that a filter without faults would miss are ignored in that frame.

.. [1] Bouws et al. (1985). "Similarity of the wind wave spectrum in finite depth water". JGR 90(C1).
.. [2] Donelan, Hamilton, Hui (1985). "Directional spectra of wind-generated waves". Phil. Trans. R. Soc. A 315.
.. [3] Tayfun (1980). "Narrow-band nonlinear sea waves". JGR 85(C3).
.. [4] Havelock (1908). "The propagation of groups of waves in dispersive media". Proc. R. Soc. A 81.
.. [5] Monahan, O'Muircheartaigh (1980). "Optimal power-law description of oceanic whitecap coverage". JPO 10(12).
.. [6] Cox, Munk (1954). "Measurement of the roughness of the sea surface". JOSA 44(11).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mesh_clutter import Air, Facets, Spray, facets, fresnel, from_water
from mesh_lidars import Lidar, wrapped
from mesh_parts import Array, Hull, Mesh, chain, join, rod, split
from mesh_scan import Echoes, Scan, Surface, surface
from mesh_scenes import SCENES
from mesh_water import Sea
from mesh_waves import Wake
from mesh_world import FAMILIES, Body, Land, Own, Placer, draw, float_all
from sea_logs import POINT, parser_of, record_all, write_labelled

from seaclutter_cli.truth import CLUTTER, IGNORED, Boxes

START_NS = 1_720_000_000_000_000_000
OPEN = ("motorboat", "yacht", "sailboat", "rhib", "rowboat")
UPWARDS = np.array([1, 1, -1], np.float32)

Row = tuple[str, str, Array, Array, float]  # track, class, centre, size, yaw


class Part(NamedTuple):
    """Body and its number; the rows of its vertices."""

    number: int
    body: Body | Land
    rows: slice


class Solids(NamedTuple):
    """Vertices at the start and the end of a frame, as seen, and shares then; triangles' reflectivities and labels."""

    start: Array
    end: Array
    seen: Array
    share: Array
    rho: Array
    label: Array
    parts: list[Part]

    @property
    def triangles(self) -> Array:
        return self.seen.reshape(-1, 3, 3)


def normals(triangles: Array) -> Array:
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9))


def solids_of(bodies: Sequence[Body | Land], scan: Scan, time: float) -> Solids:
    """Return the bodies that are near."""
    meshes, labels, parts, count = [(np.zeros((0, 3), np.float32),) * 2 + (np.zeros(0, np.float32),)], [], [], 0
    for number, body in enumerate(bodies, 1):
        if body.near(scan.centre):
            meshes.append(body.vertices(time))
            size = len(meshes[-1][0])
            labels += [number if body.target else IGNORED] * (size // 3)
            parts.append(Part(number, body, slice(count, count + size)))
            count += size
    start, end, rho = (np.concatenate(each) for each in zip(*meshes, strict=True))
    return Solids(start, end, *scan.seen(start, end), rho, np.array(labels, np.int32), parts)


class Recorder:
    """The lidar in its world: frames of labelled points and boxes."""

    def __init__(self, family: str, seed: int) -> None:
        self.rng = rng = np.random.default_rng([seed, 9, *family.encode()])
        self.world = draw(family, rng)
        self.period, self.lidar = 1 / self.world["hz"], Lidar(self.world["lidar"], rng)
        self.own = Own(self.world, rng)
        placer = Placer(self.world, self.own, rng)
        SCENES[family](placer)
        self.bodies = placer.bodies
        self.afloat = [body for body in self.bodies if isinstance(body, Body)]
        self.sea = Sea(self.world, rng, self._wakes())
        float_all(self.afloat, self.sea, 0.0, np.inf)
        self.own.settle(self.sea)
        self.spray = Spray(self.world, self.own, self.afloat, rng)
        self._set_deck()
        self._wet()

    def _wakes(self) -> list[Wake]:
        world, own, wakes = self.world, self.own, []
        for body in self.afloat:
            if body.speed > 1.2 and body.target and body.length > 2.5:
                height = min(0.05 + 0.018 * body.speed * np.sqrt(body.length), 0.55)
                height = (height if body.length < 20 else 0.25 + 0.06 * body.speed) * world["wake"]
                froth = min(0.85, 0.13 * body.speed), 3 + 0.5 * body.beam
                wakes.append(Wake(body, body.speed, body.rate, height, froth))
        if world["speed"] > 0.8:
            height, froth = min(0.03 * world["speed"], 0.2), (min(0.8, 0.14 * world["speed"]), 4)
            wakes.append(Wake(own, world["speed"], np.radians(world["turn"]), height, froth))
        return wakes

    def _set_deck(self) -> None:
        """Set the echoes of own deck and rails: range, reflectivity; echoes of a deck that is cropped are left out."""
        number, kind, own = self.lidar.number, self.world["deck"], self.own
        self.deck_m, self.deck_rho = np.full(number, np.inf, np.float32), np.zeros(number, np.float32)
        self.deck_rows: list[Row] = []
        if kind == "none":
            return
        meshes = [((mesh[0] - own.arm) @ own.mount, mesh[1]) for mesh in self._deck()]
        triangles, rho = join(*meshes)
        range_m, met = self.lidar.meet(triangles.astype(np.float32), self.lidar.footprints[0])
        self.deck_m = range_m.min(0)
        if kind == "cropped":
            return
        nearest = np.take_along_axis(met, range_m.argmin(0)[None], 0)[0]
        cosine = abs((normals(triangles)[nearest] * self.lidar.rays).sum(1))
        hit = np.isfinite(self.deck_m)
        self.deck_rho[hit] = (abs(rho[nearest]) * (0.1 + 0.9 * cosine))[hit]
        for places in (mesh[0].reshape(-1, 3) for mesh in meshes):
            low, high = places.min(0), places.max(0)
            self.deck_rows.append(("deck", "ignore", (low + high) / 2, high - low + 0.1, 0.0))

    def _deck(self) -> list[Mesh]:
        length, free = self.own.length, min(0.3 + 0.09 * self.own.length, self.world["height"] - 0.5)
        hull, x = Hull(length, self.own.beam, free, 0.3, 0.5), np.linspace(-length / 2, length / 2, 9)
        meshes = [join(hull.mesh(), hull.plank(x, hull.deck(x), 0.4))]
        for q in (1, -1) if self.world["deck"] == "rails" else ():
            rail = hull.rail(x[1:], q * 0.95, 0.55)
            posts = [rod([a, b, c - 0.55], [a, b, c], 0.015, 4, 0.5, caps=False) for a, b, c in rail[::2]]
            meshes.append(join(*chain(rail, 0.015, 4, 0.5), *posts))
        return [split(mesh, 0.5) for mesh in meshes]

    def _wet(self) -> None:
        """Set how drops on the lens dim the rays."""
        rays, rng = self.lidar.rays, self.rng
        self.gain = np.ones(self.lidar.number, np.float32)
        azimuth, elevation = np.arctan2(rays[:, 1], rays[:, 0]), np.arcsin(rays[:, 2])
        for _ in range(self.world["drops"]):
            at, up, size = rng.uniform(-np.pi, np.pi), rng.uniform(-0.25, 0.15), rng.uniform(0.01, 0.05)
            away = wrapped(azimuth - at) ** 2 + (elevation - up) ** 2
            self.gain *= (1 - 0.85 * np.exp(-away / size**2)).astype(np.float32)

    def frame(self, number: int) -> tuple[Array, Boxes]:
        """Return the points and the boxes of a frame. The strongest echo of a ray is its point."""
        start = number * self.period
        self._step(number)
        scan = Scan(self.lidar, self.own)
        footprints = self.lidar.footprints[self.rng.integers(2)]
        solids = solids_of(self.bodies, scan, start)
        water = self._bail(surface(scan, self.sea))
        air = Air(scan, self.sea, self.spray.puffs, start, self.rng)
        echoes = Echoes(self.lidar.number)
        hit, share = self._from_solids(solids, footprints, water, air, echoes)
        rays = np.flatnonzero((water.range_m < 95) & (share > 0.1) & (water.range_m < self.deck_m))
        if len(rays):
            power, range_m = from_water(air, facets(scan, self.sea, water, rays))
            power = power * share[rays] * air.fade(rays, water.range_m[rays])
            echoes.offer(rays, power, range_m, CLUTTER)
        if self.world["mirror"] and len(solids.rho):
            rays = np.flatnonzero((water.range_m < 70) & (water.range_m < self.deck_m))
            self._mirrored(solids, facets(scan, self.sea, water, rays), hit, air, echoes)
        self._from_deck(air, echoes)
        return self._points(echoes), self._boxes(scan, solids)

    def _step(self, number: int) -> None:
        end = (number + 1) * self.period
        for wake in self.sea.wakes:
            wake.go((number * self.period + end) / 2)
        self.sea.step(end, self.period)
        self.own.step(number + 1, self.sea)
        float_all(self.afloat, self.sea, end, self.period)
        self.spray.step(end, self.period)

    def _bail(self, water: Surface) -> Surface:
        """Take the water out of open craft."""
        for body in self.afloat:
            if body.kind in OPEN and body.length < 16:
                (x, y, _), half = body.middle(), body.length / 2
                cos, sin = np.cos(body.pose.yaw), np.sin(body.pose.yaw)
                near = np.flatnonzero((abs(water.x - x) < half) & (abs(water.y - y) < half))
                dx, dy = water.x[near] - x, water.y[near] - y
                ahead, port = (cos * dx + sin * dy) / half, (cos * dy - sin * dx) / (body.beam / 2)
                inside = (abs(ahead) < 0.97) & (abs(port) < 0.85 * np.minimum(1, 1.75 * (1 - ahead)))
                water.range_m[near[inside]] = np.inf
        return water

    def _from_solids(
        self, solids: Solids, footprints: list[Array], water: Surface, air: Air, echoes: Echoes
    ) -> tuple[Array, Array]:
        """Add the echoes of bodies; return whether rays have any, and the share of each that meets the water."""
        near, met = self.lidar.meet(solids.triangles, footprints)
        hidden = (met >= 0) & (near >= np.minimum(water.range_m, self.deck_m))
        share = np.minimum(hidden.mean(0) + (near == np.inf).mean(0), 1)
        hit, met = (met >= 0) & ~hidden, np.maximum(met, 0)
        if len(solids.rho):
            glass = (solids.rho[met] < 0) & np.isfinite(near)
            hit &= ~(glass & (self.rng.random(hit.shape) < 0.7))
        rays = np.flatnonzero(hit.any(0))
        if len(rays):
            hits, met = hit[:, rays], met[:, rays]
            range_m = np.where(hits, near[:, rays], np.inf)
            together = hits & (range_m - range_m.min(0) < 0.35)
            cosine = abs(np.einsum("kni,ni->kn", normals(solids.triangles)[met], self.lidar.rays[rays]))
            rho = abs(solids.rho[met])
            rho = np.where(rho > 2, rho, rho * (0.15 + 0.85 * cosine))
            for group in (together, hits & ~together):
                some = np.flatnonzero(group.any(0))
                chosen, value = group[:, some], np.where(group, rho, 0)[:, some].sum(0) / len(footprints)
                mean = np.where(chosen, range_m[:, some], 0).sum(0) / chosen.sum(0)
                first = np.where(chosen, range_m[:, some], np.inf).argmin(0)
                power = value / mean**2 * self.rng.gamma(7, 1 / 7, len(some)) * air.fade(rays[some], mean)
                echoes.offer(rays[some], power, mean, solids.label[met[:, some][first, np.arange(len(some))]])
        return np.any(hit, axis=0), np.asarray(share)

    def _mirrored(self, solids: Solids, at: Facets, hit: Array, air: Air, echoes: Echoes) -> None:
        """Add the echoes of bodies by way of the water: a bent ray meets what the image shows in its direction."""
        rng, scan, lidar, rays = self.rng, air.scan, self.lidar, at.rays
        images, _ = scan.seen(solids.start * UPWARDS, solids.end * UPWARDS)
        (image,), (met,) = lidar.meet(images.reshape(-1, 3, 3), lidar.footprints[0][:1])
        if not np.isfinite(image).any():
            return
        rough, d = np.sqrt(0.0005 + 0.0022 * self.world["wind"]), scan.rays[rays]
        ranges, values = [], []
        for _ in range(2):
            a, b = (slope + rough * rng.normal(size=len(rays)) * 0.7 for slope in (at.slope_x, at.slope_y))
            bend = np.stack([2 * d[:, 2] * a, 2 * d[:, 2] * b, -2 * (a * d[:, 0] + b * d[:, 1])], -1)
            bend = np.einsum("nji,nj->ni", scan.turn[lidar.column[rays]], bend)
            far = np.full(len(rays), 2.0, np.float32) * at.range_m
            for _again in range(2):
                seen = lidar.nearest(lidar.rays[rays] + bend * np.maximum(0, 1 - at.range_m / far)[:, None])
                far = np.where(np.isfinite(image[seen]), image[seen], far)
            good = (image[seen] > at.range_m + 0.05) & np.isfinite(image[seen])
            rho = solids.rho[np.where(good, met[seen], 0)]
            ranges.append(np.where(good, image[seen], np.inf))
            values.append(np.where(good & (rho > 0), rho, 0))
        first = np.min(ranges, axis=0)
        some = np.isfinite(first) & ~hit[rays]
        range_m, value, rays = np.array(ranges)[:, some], np.array(values)[:, some], rays[some]
        together = range_m < first[some] + 0.5
        mean = np.where(together, range_m, 0).sum(0) / together.sum(0)
        smear = 1 + (rough * 2 * (mean - at.range_m[some]) / 0.5) ** 2
        power = np.where(together, value, 0).sum(0) / 2 * 0.6 * fresnel(at.cosine[some]) ** 2 / mean**2 / smear
        echoes.offer(rays, power * rng.gamma(1.5, 1 / 1.5, len(rays)) * air.fade(rays, mean), mean, CLUTTER)

    def _from_deck(self, air: Air, echoes: Echoes) -> None:
        """Put own deck in place of what is behind it, then add the echoes of the air before it."""
        deck = np.flatnonzero(np.isfinite(self.deck_m))
        bright = deck[self.deck_rho[deck] > 0]
        echoes.power[deck], echoes.label[deck] = 0, CLUTTER
        echoes.offer(bright, self.deck_rho[bright] / self.deck_m[bright] ** 2, self.deck_m[bright], IGNORED)
        rays, power, range_m = air.echoes
        before = range_m < self.deck_m[rays]
        echoes.offer(rays[before], power[before], range_m[before], CLUTTER)
        echoes.power[deck] *= self.deck_rho[deck] > 0

    def _points(self, echoes: Echoes) -> Array:
        """Return the points of the echoes that are strong enough, and of strays, in the order of time."""
        rng, lidar, model, number = self.rng, self.lidar, self.lidar.model, self.lidar.number
        noise = 1 + 0.12 * rng.normal(size=number)
        overlap = 1 - np.exp(-((echoes.range_m / (1.5 * model.blind_m)) ** 2))
        signal, range_m = echoes.power * self.gain * overlap, echoes.range_m
        got = (signal > lidar.least * noise) & (rng.random(number) > self.world["dropout"]) & (range_m > model.blind_m)
        faint = np.minimum(1, 2 * lidar.least / np.maximum(signal, 1e-12))
        range_m = range_m + model.noise_m * rng.normal(size=number) * (1 + 0.8 * faint)
        if strays := rng.poisson(self.world["stray"]):
            rays = rng.integers(0, number, strays)
            rays = rays[~got[rays] & ~np.isfinite(self.deck_m[rays])]
            got[rays], range_m[rays], signal[rays] = True, rng.uniform(2, 90, len(rays)), 1.05 * lidar.least
            echoes.label[rays] = CLUTTER
        rays = np.flatnonzero(got)
        rays = rays[np.argsort(lidar.column[rays], kind="stable")]
        points, range_m = np.zeros(len(rays), POINT), np.round(range_m[rays] / 0.002) * 0.002
        points["x"], points["y"], points["z"] = (lidar.rays[rays] * range_m[:, None].astype(np.float32)).T
        value = self._intensity(signal[rays], range_m) * rng.normal(1, 0.04, len(rays))
        points["intensity"] = np.round(np.clip(value, 0, 65535 if model.scale == "signal" else 255))
        points["ring"], points["t"] = lidar.beam[rays], lidar.column[rays] / lidar.columns * self.period
        points["label"] = echoes.label[rays]
        return points

    def _intensity(self, signal: Array, range_m: Array) -> Array:
        """Return intensities on the scale of the model; reflectors are above 100 of those that are calibrated."""
        rho = signal * range_m**2
        if self.lidar.model.scale == "calibrated":
            diffuse = 100 * np.sqrt(rho) if self.world["root"] else 100 * rho
            return np.asarray(np.where(rho < 1, diffuse, 100 + 30 * np.log(np.maximum(rho, 1)) / np.log(2)))
        if self.lidar.model.scale == "reflectivity":
            return np.asarray(255 * rho**0.7)
        return np.minimum(signal / self.lidar.least * 6, 4000)

    def _boxes(self, scan: Scan, solids: Solids) -> Boxes:
        rows = [*self.deck_rows]
        for part in solids.parts:
            (x, y, yaw), places = part.body.middle(), self._dry(solids, part)
            if np.hypot(x - scan.centre[0], y - scan.centre[1]) > 150 or len(places) < 3:
                continue
            column = min(int(np.median(solids.share[part.rows]) * self.lidar.columns), self.lidar.columns - 1)
            ahead = scan.turn[column].T @ np.array([np.cos(yaw), np.sin(yaw), 0], np.float32)
            kind = part.body.kind if part.body.target else "ignore"
            rows.append((str(part.number), kind, *fit(places, float(np.arctan2(ahead[1], ahead[0])))))
        if not rows:
            return Boxes()
        tracks, kinds, *numbers = zip(*rows, strict=True)
        return Boxes(tracks, kinds, *(np.array(each, float) for each in numbers))

    def _dry(self, solids: Solids, part: Part) -> Array:
        """Return the vertices of a body above the water, and where its edges meet that, as seen."""
        rows = part.rows
        start, end, share = solids.start[rows], solids.end[rows], solids.share[rows]
        if isinstance(part.body, Land):
            height = start[:, 2] + 0.1
        else:
            at = start + (end - start) * share[:, None].astype(np.float32)
            height = (at[:, 2] - self.sea.height(at[:, 0], at[:, 1], share)).astype(np.float32)
        places, height = solids.seen[rows].reshape(-1, 3, 3), height.reshape(-1, 3)
        dry = [places[height > -0.02]]
        for a, b in ((0, 1), (1, 2), (2, 0)):
            wet = (height[:, a] > 0) != (height[:, b] > 0)
            along = height[wet, a] / (height[wet, a] - height[wet, b])
            dry.append(places[wet, a] + along[:, None] * (places[wet, b] - places[wet, a]))
        return np.concatenate(dry)


def fit(places: Array, yaw: float) -> tuple[Array, Array, float]:
    """Return centre, size and yaw of the upright box around some places, with a margin."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    local = [cos * places[:, 0] + sin * places[:, 1], cos * places[:, 1] - sin * places[:, 0], places[:, 2]]
    low, high = np.min(local, axis=1) - [0.04, 0.04, 0.01], np.max(local, axis=1) + 0.04
    x, y, z = (low + high) / 2
    return np.array([cos * x - sin * y, sin * x + cos * y, z]), high - low, yaw


def record(family: str, seed: int, folder: Path) -> None:
    """Write a log and its labels, unless they are there."""
    log = folder / f"{family}_{seed}.mcap"
    if log.exists():
        return
    recorder = Recorder(family, seed)
    frames = (recorder.frame(number) for number in range(recorder.world["frames"]))
    world = {"family": family, "seed": str(seed)} | {name: str(value) for name, value in recorder.world.items()}
    write_labelled(log, frames, world, START_NS, recorder.period)


def main() -> None:
    given = parser_of("mesh_sea.py", __doc__, FAMILIES).parse_args()
    record_all(record, [(family, seed) for seed in given.seeds for family in given.families], given.folder, given.jobs)


if __name__ == "__main__":
    main()
