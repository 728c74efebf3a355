"""Suspects of a recording: bodies that a filter removed, and clusters that it kept and that are hardly bodies."""

import heapq
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from seaclutter_cli.arrays import Bytes, Floats, Ints, Mask
from seaclutter_cli.clustering import ClusterFinder
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.suspects.bodies import Bodies, BodyFinder
from seaclutter_cli.suspects.indications import Indications
from seaclutter_cli.tracking.clock import Clock
from seaclutter_cli.tracking.detections import Detections
from seaclutter_cli.tracking.tracker import Track, Tracker
from seaclutter_cli.water import Mounting

Moment = tuple[int, int, float]
"""Number of a frame, its stamp, and its time in seconds."""

CHOSEN = (Reason.NEAR, Reason.FAR, Reason.EXCLUDED, Reason.INVALID)
"""Reasons that follow from the configuration or the log, not from a judgement."""
_JUDGED = [reason for reason in Reason if reason not in (Reason.KEPT, *CHOSEN)]

_TOLERANCE_M, _LEAST_POINTS, _FEW_POINTS = 1.5, 5, 3
_PART_M = 2.5
_LEAST_LOOKS = 3
_RISES, _ALONE_WEIGHT = 1.5, 0.7
_LEAST_SOLID, _SOLID_SPAN = 0.6, 0.3
_STAY_S, _STEADY_M, _STEADY_SHARE = 1.0, 0.4, 0.1
_GONE_S = 5.0
_MAX_STEPS = 256
_MAX_LISTED = 500
LIKELY, UNLIKELY = 0.15, 0.05
"""Score from which what was removed is listed, and up to which what was kept is."""


@dataclass(frozen=True)
class Suspect:
    """A body that was ``removed``, or something ``kept`` that is hardly one.

    ``frame`` and ``stamp_ns`` are those of the frame with most of its points, where its centre is ``x_m``, ``y_m`` and
    ``z_m`` and the points are ``points``; ``frames`` is the number of frames in which it was removed or kept, from
    ``first_frame`` to ``last_frame``. ``reasons`` are the points removed by each rule, but those that follow from the
    configuration. ``top_m`` is the greatest height above the water, None if it is not known; ``speed_ms`` that against
    the lidar; ``range_m`` the horizontal distance from it.
    """

    kind: Literal["removed", "kept"]
    score: float
    frames: int
    first_frame: int
    last_frame: int
    first_ns: int
    last_ns: int
    frame: int
    stamp_ns: int
    x_m: float
    y_m: float
    z_m: float
    points: int
    total_points: int
    top_m: float | None
    speed_ms: float
    reasons: dict[str, int]
    range_m: float

    @property
    def weight(self) -> float:
        """Rank among suspects of its kind: how probable an error is, and over how many points of all frames."""
        return (self.score if self.kind == "removed" else 1 - self.score) * math.log1p(self.total_points)


@dataclass
class Body:
    """What is known of a body, by its track, under M methods: sums over the ``looks``, the frames in which it was seen.

    In a look, a method ``lost`` it, shape (M,), if fewer than five of its points are left, three or more were removed
    by judgement, and no body of which more is left is near; it ``kept`` it if five or more are left. ``points_lost``
    and ``reasons``, of the first method, are sums over the looks in which it was lost. What is ``flat`` is no body, but
    something near the water that the first method kept.
    """

    first: Moment
    last: Moment
    was_kept: Mask
    lost: Ints
    kept: Ints
    changes: Ints
    looks: int = 0
    looked: Floats = field(default_factory=lambda: np.zeros(5))
    """Sums of `Bodies.looks`."""
    is_flat: bool = False
    top_m: float = -math.inf
    reasons: Ints = field(default_factory=lambda: np.zeros(len(_JUDGED), np.int64))
    points_kept: int = 0
    best: dict[str, tuple[int, int, int, Floats]] = field(default_factory=dict)
    """Of the looks in which it was removed or kept, the most points, frame, stamp, and centre, shape (3,)."""
    speed_ms: float = 0.0
    _steps: deque[float] = field(default_factory=lambda: deque(maxlen=_MAX_STEPS))
    _before: deque[tuple[float, Floats]] = field(default_factory=lambda: deque(maxlen=2))

    @property
    def score(self) -> float:
        """How much it is like a body, from 0 to 1."""
        return self._likeness(_STEADY_M)

    @property
    def is_unlikely(self) -> bool:
        """Whether it is hardly a body, although the centre of a large one, such as a quay, may jump."""
        return self._likeness(_STEADY_M + _STEADY_SHARE * self.looked[4] / self.looks) < UNLIKELY

    def _likeness(self, steady_m: float) -> float:
        """Return how much it is like a body: it stands out or is alone, is solid, stays, and moves steadily.

        The product of four shares, each 1 for a body. What is met by one beam lies alone on the water at most.
        """
        rise, alone, linked, loose, _ = map(float, self.looked)
        stands = min(max((rise / self.looks - 1) / _RISES, 0), 1)
        alone = _ALONE_WEIGHT * alone / self.looks
        linked = (linked + 1) / (linked + loose + 1)
        solid = min(max((linked - _LEAST_SOLID) / _SOLID_SPAN, 0), 1)
        seen = self.looks / (self.last[0] - self.first[0] + 1)
        stays = seen * (1 - math.exp(-(self.last[2] - self.first[2]) / _STAY_S))
        if len(self._steps) == 0:
            return 0.0
        return max(stands, alone) * solid * stays * math.exp(-((float(np.median(self._steps)) / steady_m) ** 2))

    def suspect(self, kind: Literal["removed", "kept"], score: float, frames: int) -> Suspect:
        """Return the body as a suspect of a kind, of which it has a ``best`` look."""
        points, frame, stamp_ns, (x, y, z) = self.best[kind]
        removed = {
            one.name.lower(): points for one, points in zip(_JUDGED, self.reasons.tolist(), strict=True) if points
        }
        return Suspect(
            kind=kind,
            score=score,
            frames=frames,
            first_frame=self.first[0],
            last_frame=self.last[0],
            first_ns=self.first[1],
            last_ns=self.last[1],
            frame=frame,
            stamp_ns=stamp_ns,
            x_m=float(x),
            y_m=float(y),
            z_m=float(z),
            points=points,
            total_points=sum(removed.values()) if kind == "removed" else self.points_kept,
            top_m=self.top_m if math.isfinite(self.top_m) else None,
            speed_ms=self.speed_ms,
            reasons=removed if kind == "removed" else {},
            range_m=math.hypot(x, y),
        )

    def looked_at(self, kind: str, points: int, moment: Moment, center: Floats) -> None:
        """Note where most of its points were removed or kept."""
        if kind not in self.best or points > self.best[kind][0]:
            self.best[kind] = points, *moment[:2], center

    def moved(self, time_s: float, place: Floats) -> None:
        """Add a place: a body is where the places before and after it say, clutter jumps."""
        if len(self._before) == 2:
            (early_s, early), (middle_s, middle) = self._before
            share = (middle_s - early_s) / max(time_s - early_s, 1e-6)
            self._steps.append(float(np.hypot(*(middle - early - share * (place - early)))))
        self._before.append((time_s, place))


class SuspectFinder:
    """Bodies of the frames of a recording under M methods; suspects are those of the first method.

    What came within a second of the end and is hardly a body may be one: it is ``unjudged``, and counts nowhere. At
    most 500 suspects of each kind are kept, and the bodies of the last five seconds.
    """

    def __init__(self, methods: int = 1, mounting: Mounting | None = None) -> None:
        self._mounting = mounting or Mounting()
        self._bodies: dict[Track, Body] = {}
        self._listed: dict[str, list[tuple[float, int, Suspect]]] = {"removed": [], "kept": []}
        self._clock, self._time_s = Clock(), 0.0
        self._number = 0
        self.tally = Indications(methods)
        self.unjudged = 0
        self._begin()

    def add(self, frame: Frame, results: Sequence[FilterResult | None]) -> Bodies:
        """Add a frame with its results, None for a method that could not use it; return its bodies."""
        time_ns, is_apart = self._clock.next(frame)
        if is_apart:
            self._end(list(self._bodies))
            self._begin()
        self._time_s = time_s = time_ns / 1e9
        reasons = [np.full(frame.size, Reason.INVALID, np.uint8) if one is None else one.reason for one in results]
        excluded = np.any(np.equal(reasons, Reason.EXCLUDED), axis=0)
        bodies = self._finder.find(frame, excluded, time_s)
        tracks = self._tracker.step(bodies.found, time_s)
        self._count(frame, bodies, tracks, reasons)
        self._end([track for track, body in self._bodies.items() if time_s - body.last[2] > _GONE_S])
        return bodies

    def indicate(self, frame: Frame, results: Sequence[FilterResult | None]) -> None:
        """Add a frame to all indications; one that a method could not use, which has None, counts for none."""
        used = [one for one in results if one is not None]
        if len(used) == len(results):
            self.tally.add(frame, used, self.add(frame, results))

    def finish(self) -> dict[str, list[Suspect]]:
        """Return the suspects of each kind, the most probable first."""
        self._end(list(self._bodies))
        return {kind: [one for *_, one in sorted(found, reverse=True)] for kind, found in self._listed.items()}

    def _begin(self) -> None:
        self._finder, self._tracker, self._flat_tracker = BodyFinder(self._mounting), Tracker(), Tracker()

    def _count(self, frame: Frame, bodies: Bodies, tracks: Sequence[Track | None], reasons: Sequence[Bytes]) -> None:
        kept = np.array([bodies.sums(one == Reason.KEPT) for one in reasons]).reshape(len(reasons), -1)
        removed = np.array([bodies.sums(np.isin(one, _JUDGED)) for one in reasons]).reshape(kept.shape)
        is_kept = kept >= _LEAST_POINTS
        is_lost = ~is_kept & (removed >= _FEW_POINTS)
        for m, reason in enumerate(reasons):
            is_lost[m] &= ~_is_part(frame, bodies, reason, is_lost[m])
        by_rule = np.array([bodies.sums(reasons[0] == rule) for rule in _JUDGED])
        moment = frame.index, frame.stamp_ns, self._time_s
        ends = np.append(bodies.start, len(bodies.points))
        for k, track in enumerate(tracks):
            if track is None:
                continue
            body = self._seen(track, is_kept[:, k], moment)
            body.looked += bodies.looks[:, k]
            body.top_m = max(body.top_m, float(bodies.top_m[k]))
            body.speed_ms = abs(track.velocity)
            body.moved(moment[2], bodies.found.centers[k])
            body.changes += body.was_kept != is_kept[:, k]
            body.was_kept = is_kept[:, k]
            body.lost += is_lost[:, k]
            body.kept += is_kept[:, k]
            body.points_kept += int(kept[0, k])
            body.reasons += by_rule[:, k] * is_lost[0, k]
            kind, size = ("removed", removed[0, k]) if is_lost[0, k] else ("kept", kept[0, k])
            if is_lost[0, k] or is_kept[0, k]:
                own = bodies.points[bodies.start[k] : ends[k + 1]]
                body.looked_at(kind, int(size), moment, frame.coordinates.take(own, axis=1).mean(axis=1))
        flat = [_flat_clusters(frame, bodies, reason) for reason in reasons]
        self.tally.doubtful += [one.max(initial=-1) + 1 for one in flat]
        self._follow_flat(frame, flat[0], moment)

    def _follow_flat(self, frame: Frame, cluster: Ints, moment: Moment) -> None:
        """Follow clusters of kept points near the water: what stays in one place is one suspect."""
        order = np.argsort(cluster, kind="stable")[np.count_nonzero(cluster < 0) :]
        xyz = frame.coordinates.take(order, axis=1)
        found = Detections.made(xyz, cluster[order], len(order))
        for k, track in enumerate(self._flat_tracker.step(found, moment[2])):
            if track is None:
                continue
            body = self._seen(track, np.ones(1, np.bool_), moment, is_flat=True)
            points, height = int(found.points[k]), found.spans[k].mean()
            body.points_kept += points
            body.looked_at("kept", points, moment, np.append(found.centers[k], height))

    def _seen(self, track: Track, is_kept: Mask, moment: Moment, *, is_flat: bool = False) -> Body:
        """Return the body of a track, which is seen again, or for the first time."""
        if track not in self._bodies:
            lost, kept, changes = np.zeros((3, len(is_kept)), np.int64)
            self._bodies[track] = Body(moment, moment, is_kept, lost, kept, changes, is_flat=is_flat)
        body = self._bodies[track]
        body.last, body.looks = moment, body.looks + 1
        return body

    def _end(self, tracks: Sequence[Track]) -> None:
        """Count bodies that are not seen any more, and list those that are suspects."""
        for track in tracks:
            body = self._bodies.pop(track)
            if body.is_flat:
                self._list(body.suspect("kept", 0.0, body.looks))
                continue
            score = body.score
            if body.is_unlikely and self._time_s - body.first[2] < _STAY_S:
                self.unjudged += bool(body.kept[0] or body.lost[0])
                continue
            self.tally.kept_looks += body.kept
            self.tally.lost_looks += body.lost
            self.tally.kept_score += score * body.kept
            self.tally.lost_score += score * body.lost
            if score >= LIKELY:
                self.tally.seconds += (body.last[2] - body.first[2]) * (body.lost + body.kept > 0)
                self.tally.lost += body.lost
                self.tally.found += body.kept
                self.tally.changes += body.changes
            elif body.is_unlikely:
                self.tally.doubtful += body.kept
            if score >= LIKELY and body.lost[0] >= _LEAST_LOOKS:
                self._list(body.suspect("removed", score, int(body.lost[0])))
            elif body.is_unlikely and body.kept[0]:
                self._list(body.suspect("kept", score, int(body.kept[0])))

    def _list(self, suspect: Suspect) -> None:
        found = self._listed[suspect.kind]
        self._number += 1
        entry = suspect.weight, -self._number, suspect
        (heapq.heappush if len(found) < _MAX_LISTED else heapq.heappushpop)(found, entry)


def _flat_clusters(frame: Frame, bodies: Bodies, reason: Bytes) -> Ints:
    """Return the cluster of kept points near the water that touches no body for each point, shape (N,); -1 if none."""
    among = (reason == Reason.KEPT) & frame.valid
    cluster = ClusterFinder(frame.coordinates, among, _TOLERANCE_M).clusters(among, _LEAST_POINTS)
    touches = np.bincount(cluster + 1, ~bodies.flat, 1) > 0
    touches[cluster[bodies.points] + 1] = True
    touches[0] = True
    return np.where(touches, -1, np.cumsum(~touches) - 1)[cluster + 1]


def _is_part(frame: Frame, bodies: Bodies, reason: Bytes, asked: Mask) -> Mask:
    """Return which of some bodies, shape (K,), have five kept points within 2.5 m: they are parts of what was kept.

    Kept water beside a body is none.
    """
    kept = np.flatnonzero((reason == Reason.KEPT) & frame.valid & ~bodies.flat)
    near = np.zeros(len(bodies), np.bool_)
    if not asked.any() or len(kept) < _LEAST_POINTS:
        return near
    from scipy.spatial import cKDTree  # slow to import

    cells = np.flatnonzero(asked[bodies.found.owner])
    tree = cKDTree(frame.coordinates[:2, kept].T, balanced_tree=False, compact_nodes=False)
    distance, _ = tree.query(bodies.found.cells[cells], k=[_LEAST_POINTS], distance_upper_bound=_PART_M)
    near[bodies.found.owner[cells[np.isfinite(distance[:, 0])]]] = True
    return near
