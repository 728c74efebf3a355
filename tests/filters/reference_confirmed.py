"""Reference of the method ``confirmed`` as plain loops over a log in memory.

It shares with the program the constants, so that tuning them changes both, the codes of `Reason` and the config keys.
A choice that the method leaves open is the same as in the program: objects are numbered by their centres, and the
first of equals wins.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from seaclutter_cli.filters import confirmed
from seaclutter_cli.filters.zones import LEAST_M
from seaclutter_cli.frame import Frame, Reason
from seaclutter_cli.structure.own_ship import OwnShip
from seaclutter_cli.structure.search import MIN_FRAMES
from seaclutter_cli.water import WaterSurface
from seaclutter_cli.water.plane import Plane
from tests.filters.reference_faces import faces_of
from tests.filters.reference_objects import (
    Background,
    Beams,
    Echo,
    Thing,
    bin_of,
    candidates_of,
    clusters_of,
    echoes_of,
    elevation_of,
    evidence_of,
    nearest,
    places_of,
)
from tests.filters.reference_points import Answer, Point, RingCounts, points_of
from tests.filters.reference_tracks import SLACK_S, Track, Tracks
from tests.filters.reference_water import Surface, Water


@dataclass
class Scan:
    """A frame with its objects and their tracks."""

    time_s: float
    reasons: list[int]
    rings: list[int | None]
    echoes: list[Echo]
    things: list[Thing]
    tracks: list[Track]
    awaited: list[tuple[Track, list[Echo]]]
    water: Surface | None
    repeats: dict[int, int]
    decided: bool = False
    memories: list[float] = field(init=False)

    def __post_init__(self) -> None:
        self.memories = [track.memory for track in self.tracks]


class ConfirmedObjects:
    """The method, frame by frame or over a whole log."""

    def __init__(self, params: Any) -> None:
        self.params = params
        self.reset()

    def reset(self) -> None:
        self.origin_ns: int | None = None
        self.scans: list[Scan] = []
        self.tracks = Tracks(self.params)
        self.water = Water()
        self.beams, self.background = Beams(), Background()
        self.own_ship = OwnShip(10.0, LEAST_M) if self.params.start_m == "auto" else None

    def observe(self, frame: Frame) -> None:
        raise AssertionError("one pass is enough")

    def step(self, frame: Frame) -> Answer:
        """Return the answer to a frame at once."""
        self.receive(frame, 0.0)
        return self.answer(self.scans[-1])

    def log(self, frames: Iterable[Frame]) -> list[Answer]:
        """Return the answers to all frames of a log, the first of which show where own ship ends."""
        ahead = 0.0 if self.params.causal else self.params.look_ahead_s
        frames = list(frames)
        if self.own_ship and not self.params.causal:
            for frame in frames[:MIN_FRAMES]:
                self.own_ship.add(frame)
            if not self.own_ship.is_known:
                self.own_ship.reset()
        for frame in frames:
            self.receive(frame, ahead)
        self.decide(math.inf)
        return [self.answer(scan) for scan in self.scans]

    def answer(self, scan: Scan) -> Answer:
        reasons = [int(reason) for reason in scan.reasons]
        if not self.params.use_intensity:
            return Answer(reasons)
        thresholds = list(self.params.initial_thresholds)
        counts = RingCounts(thresholds, [0.0] * len(thresholds), [], [], [])
        for ring in range(len(thresholds)):
            own = [reason for reason, place in zip(reasons, scan.rings, strict=True) if place == ring]
            counts.points.append(len(own))
            counts.low_intensity.append(own.count(Reason.LOW_INTENSITY))
            counts.outliers.append(sum(map(own.count, (Reason.OUTLIER, Reason.UNCONFIRMED, Reason.MIRRORED))))
        return Answer(reasons, counts)

    def receive(self, frame: Frame, ahead_s: float) -> None:
        if self.origin_ns is None:
            self.origin_ns = frame.stamp_ns
        time_s = (frame.stamp_ns - self.origin_ns) / 1e9
        if self.scans and 0 < self.scans[-1].time_s - time_s <= confirmed._MAX_STEP_BACK_S:
            time_s = self.scans[-1].time_s
        if self.scans and not 0 <= time_s - self.scans[-1].time_s <= confirmed._MAX_GAP_S:
            self.decide(math.inf)
            self.tracks = Tracks(self.params)
        self.scans.append(self.scan(frame, time_s))
        self.decide(time_s - ahead_s)

    def decide(self, until_s: float) -> None:
        """Decide all frames up to a time."""
        for scan in self.scans:
            if not scan.decided and scan.time_s <= until_s + SLACK_S:
                self.confirm(scan)
                for number, first in scan.repeats.items():
                    scan.reasons[number] = scan.reasons[first]
                scan.decided = True

    def scan(self, frame: Frame, time_s: float) -> Scan:
        """Find the objects of a frame and their tracks."""
        points = points_of(frame)
        if self.own_ship:
            self.own_ship.add(frame, finds_water=False)
        own = self.own_ship.contains(frame) if self.own_ship else frame.range_m < self.params.start_m
        rings = [self.ring_of(point, is_own) for point, is_own in zip(points, own, strict=True)]
        first: dict[tuple[float, ...], int] = {}
        repeats = {
            number: first.setdefault(tuple(point.xyz), number)
            for number, point in enumerate(points)
            if not point.invalid
        }
        used = [
            number
            for number, point in enumerate(points)
            if self.is_used(point, rings[number]) and repeats[number] == number
        ]
        places = [points[number].xyz for number in used]
        bins = [bin_of(z, (x, y)) for x, y, z in places]
        self.beams.learn(bins)
        elevations = [elevation_of(z, (x, y)) for x, y, z in places]
        above = {one: self.beams.above(one) for one in set(bins)}
        gaps = [above[one] for one in bins]
        faces = faces_of(places, elevations, gaps)
        structure = self.own_ship.is_structure(frame, np.array(used, np.intp)) if self.own_ship else []
        water = self.water.step(places, faces.of_point, time_s, set(np.flatnonzero(structure).tolist()))
        echoes = echoes_of([(number, points[number], rings[number]) for number in used], water, faces, self.params)
        if self.own_ship:
            level = water and Plane(water.plane.a, water.plane.b, water.plane.c)
            upright = np.array([one.number for one in echoes if one.upright], np.intp)
            self.own_ship.see(frame, level and WaterSurface(level, water.sigma, None, 0.0, np.zeros((3, 3))), upright)
        self.background.mark(echoes, time_s)
        candidates = candidates_of(echoes)
        things = self.things([one for one in candidates if not one.near], near=False)
        if self.tracks.approach(self.params.own_ship_m, time_s):
            things += self.things([one for one in candidates if one.near], near=True)
        things.sort(key=lambda thing: thing.center)
        self.tracks.turn(things, time_s)
        reasons = [self.by_zone(point, ring) for point, ring in zip(points, rings, strict=True)]
        mark(reasons, echoes, things, Reason.LOW_INTENSITY if self.params.use_intensity else Reason.UNCONFIRMED)
        tracks = self.tracks.step(things, time_s, lambda place, top: self.beams.meets(place, top, water))
        least = self.params.min_cluster_points
        rows = [one for one in echoes if one.height > -one.rise and one.run >= least and not one.near]
        used = {id(one) for one in candidates}
        awaited = self.tracks.awaited([one for one in rows if id(one) not in used], time_s)
        awaited = [(track, found) for track, found in awaited if len(found) >= least]
        return Scan(time_s, reasons, rings, echoes, things, tracks, awaited, water, repeats)

    def ring_of(self, point: Point, is_own: bool) -> int | None:
        """Return the index of the range ring, -1 for own ship, their number beyond; None without a zone."""
        if point.invalid or any(point.inside(box) for box in self.params.exclude_boxes):
            return None
        if is_own:
            return -1
        count, range_m = len(self.params.initial_thresholds), point.range_m
        if range_m >= self.params.end_m:
            return count
        edges = [self.params.own_ship_m + ring * self.params.ring_width_m for ring in range(count)]
        return max(ring for ring, edge in enumerate(edges) if not ring or range_m >= edge)

    def is_used(self, point: Point, ring: int | None) -> bool:
        """Return whether a point may belong to water or objects."""
        dropped = ring == len(self.params.initial_thresholds) and self.params.far == "drop"
        return ring is not None and not dropped and point.range_m >= min(LEAST_M, self.params.own_ship_m)

    def by_zone(self, point: Point, ring: int | None) -> int:
        """Return the reason that follows from the position of a point alone."""
        if ring is None:
            return Reason.INVALID if point.invalid else Reason.EXCLUDED
        if ring == -1:
            return Reason.NEAR if self.params.near == "drop" else Reason.KEPT
        if ring == len(self.params.initial_thresholds):
            return Reason.FAR if self.params.far == "drop" else Reason.KEPT
        return Reason.KEPT

    def things(self, candidates: Sequence[Echo], *, near: bool) -> list[Thing]:
        clusters = clusters_of(candidates, self.beams, self.params)
        said = evidence_of(clusters, self.beams, self.params)
        return [Thing(own, evidence, near, features) for own, (evidence, features) in zip(clusters, said, strict=True)]

    def confirm(self, scan: Scan) -> None:
        """Keep the objects of a frame that are confirmed, and what belongs to them."""
        kept = []
        for thing, track in zip(scan.things, scan.tracks, strict=True):
            score = track.score(scan.time_s, self.params)
            if score > self.params.score_threshold and thing.evidence > -100:
                track.from_outside |= not thing.near or (track.whole is not None and track.whole.from_outside)
                if track.from_outside:
                    kept += thing.echoes
        for track, expected in scan.awaited:
            is_back = track.seen_s > scan.time_s and track.from_outside
            if is_back and track.score(scan.time_s, self.params) > self.params.score_threshold:
                kept += expected
        for echo in kept:
            scan.reasons[echo.number] = Reason.KEPT
        places = places_of(echo.xyz for echo in kept)
        for echo in scan.echoes:
            if echo.grows and not echo.near and scan.reasons[echo.number] != Reason.KEPT:
                reach = self.params.growth_m + confirmed._GROWTH_RATIO * echo.range_m
                if nearest(echo.xyz, places) <= reach:
                    scan.reasons[echo.number] = Reason.KEPT


def mark(reasons: list[int], echoes: Sequence[Echo], things: Sequence[Thing], low: Reason) -> None:
    """Set the reasons beyond own ship if nothing is confirmed."""
    for echo in echoes:
        if not echo.near:
            reasons[echo.number] = low if echo.low and not echo.high else Reason.OUTLIER
            if echo.mirrored:
                reasons[echo.number] = Reason.MIRRORED
    for thing in things:
        for echo in thing.echoes:
            if not thing.near:
                reasons[echo.number] = Reason.UNCONFIRMED
