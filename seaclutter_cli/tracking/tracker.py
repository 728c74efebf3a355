"""Tracks: detections of one object in successive frames."""

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from seaclutter_cli.arrays import Floats, Ints, group_sizes, group_starts
from seaclutter_cli.neighbors import nearest
from seaclutter_cli.tracking.detections import Detections, Pose

_GATE_M, _GATE_SIGMAS, _MAX_GATE_M = 0.8, 2.0, 8.0
_LEAST_OVERLAP = 0.25
_DISTANCE_WEIGHT, _SCORE_WEIGHT = 0.5, 0.5
_SPEED_MS = 4.0
_ACCELERATION = 0.1
_JITTER_M, _JITTER_SHARE, _LEARNED = 0.15, 0.1, 0.2
_STEP_M, _STEP_SPEED_MS, _MAX_STEP_M = 0.4, 7.0, 4.0
_KNOWN_AFTER_S, _NEW_COAST_S, _COAST_S, _VANISHED_S = 0.5, 0.5, 8.0, 3.0
_SLIVER, _WHOLE_S = 0.5, 10.0
_SLACK_S = 1e-6
_TO_COMPLEX = np.array([1, 1j])


V = TypeVar("V", float, Floats)


def ahead(position: V, both: V, velocity: V, dt: V | float, acceleration: float) -> tuple[V, V, V]:
    """Return the variances of position, both, and velocity after a time, for white noise of acceleration."""
    return (
        position + 2 * dt * both + dt**2 * velocity + acceleration * dt**3 / 3,
        both + dt * velocity + acceleration * dt**2 / 2,
        velocity + acceleration * dt,
    )


class Look(NamedTuple):
    """What a frame shows of an object: its center, its cells, shape (m, 2), and by how far the center may be wrong.

    ``ends`` are the outermost points to the left and to the right, seen from the lidar, which are ``hidden`` if more of
    the object may be behind what is nearer.
    """

    center: complex
    cells: Floats
    jitter_m: float
    ends: tuple[complex, complex]
    hidden: tuple[bool, bool]
    lidar: complex

    @property
    def width_m(self) -> float:
        """Distance between the ends."""
        return abs(self.ends[0] - self.ends[1])


@dataclass(eq=False)
class Track:
    """An object over time, as it was when last seen.

    ``center`` and ``velocity``, complex numbers, are filtered; ``variance`` are those of position, both, and velocity.
    ``cells``, shape (m, 2), are its parts, ``jitter_m`` is by how far detections miss the place where they are
    expected. It was seen in ``hits`` of the frames since ``first_s``, missed in others, and not seen in those of the
    ``gap`` since. ``whole`` is its last look with both ends in view, at ``whole_s``, or the last one after ten seconds.
    """

    number: int
    center: complex
    whole: Look
    cells: Floats
    first_s: float
    seen_s: float
    velocity: complex
    variance: tuple[float, float, float]
    jitter_m: float
    hits: int = 1
    misses: int = 0
    gap: int = 0
    whole_s: float = -math.inf

    @property
    def is_new(self) -> bool:
        """Whether its velocity is not yet known."""
        return self.seen_s - self.first_s < _KNOWN_AFTER_S

    @property
    def score(self) -> float:
        """Confidence that it is an object, from 0 to 1: how long and how steadily it was seen.

        Clutter vanishes, but objects go out of sight, too, so three seconds of the gap count at most.
        """
        looks = self.hits + self.misses
        most = looks * _VANISHED_S / max(self.seen_s - self.first_s, _SLACK_S)
        share = self.hits / (looks + min(self.gap, most))
        return share * (1 - math.exp(-(self.seen_s - self.first_s) / _KNOWN_AFTER_S))

    def update(self, look: Look, time_s: float) -> None:
        """Add a look (Kalman filter of constant velocity).

        Of an object that is nearly hidden, other parts may be in view next.
        """
        elapsed_s = time_s - self.seen_s
        position, both, velocity = ahead(*self.variance, elapsed_s, _ACCELERATION)
        expected = self.center + self.velocity * elapsed_s
        if not any(look.hidden):
            self.whole, self.whole_s = look, time_s
        elif time_s - self.whole_s > _WHOLE_S:
            self.whole = look
        center, jitter_m = self._seen_at(look, expected)
        jitter_m = max(jitter_m, self.jitter_m)
        gain = position / (position + jitter_m**2), both / (position + jitter_m**2)
        off = center - expected
        self.center, self.velocity = expected + gain[0] * off, self.velocity + gain[1] * off
        unexplained = max((off.real**2 + off.imag**2) / 2 - position, 0.0)
        self.jitter_m = math.sqrt((1 - _LEARNED) * self.jitter_m**2 + _LEARNED * unexplained)
        self.variance = (1 - gain[0]) * position, (1 - gain[0]) * both, velocity - gain[1] * both
        is_sliver = look.width_m < _SLIVER * self.whole.width_m
        moved = self.center - self.whole.center
        self.cells = self.whole.cells + (moved.real, moved.imag) if is_sliver else look.cells  # noqa: RUF005 - an array
        self.seen_s = time_s
        self.hits, self.misses, self.gap = self.hits + 1, self.misses + self.gap, 0

    def _seen_at(self, look: Look, expected: complex) -> tuple[complex, float]:
        """Return the place that a look shows, and by how far it may be wrong.

        Where something nearer hides an end, the other one may tell it, which agrees better with the motion so far.
        """
        if look is self.whole:
            return look.center, look.jitter_m
        if all(look.hidden):
            return look.center, look.jitter_m + (self.whole.width_m - look.width_m) / 2
        k = int(look.hidden[0])
        view = expected - look.lidar
        aside = (look.ends[k] + self.whole.center - self.whole.ends[k] - expected) / view
        places = look.center, expected + view * 1j * aside.imag
        return min(places, key=lambda place: abs(place - expected)), look.jitter_m


class Tracker:
    """Assignment of detections to tracks, frame by frame, in coordinates that do not turn with the lidar."""

    def __init__(self) -> None:
        self._tracks: list[Track] = []
        self._born = 0
        self._time_s: float | None = None

    def step(self, found: Detections, time_s: float) -> list[Track | None]:
        """Return the track of each detection of a frame; None for doubtful ones that continue no track."""
        interval_s = 0.0 if self._time_s is None else time_s - self._time_s
        self._time_s = time_s
        looks = list(_looks(found))
        result: list[Track | None] = [None] * len(found)
        pairs = self._pairs(found, time_s, interval_s)
        for t, track in enumerate(self._tracks):
            track.gap += t not in pairs
        for t, d in pairs.items():
            result[d] = self._tracks[t]
            self._tracks[t].update(looks[d], time_s)
        new_coast_s = _NEW_COAST_S + interval_s + _SLACK_S
        self._tracks = [one for one in self._tracks if time_s - one.seen_s <= (new_coast_s if one.is_new else _COAST_S)]
        for d in np.flatnonzero(found.kept).tolist():
            if result[d] is None:
                result[d] = self._begin(looks[d], time_s)
        return result

    def _begin(self, look: Look, time_s: float) -> Track:
        self._born += 1
        variance = look.jitter_m**2, 0.0, _SPEED_MS**2
        self._tracks.append(
            Track(self._born, look.center, look, look.cells, time_s, time_s, 0j, variance, look.jitter_m)
        )
        return self._tracks[-1]

    def _pairs(self, found: Detections, time_s: float, interval_s: float) -> dict[int, int]:
        """Return which detection continues each track.

        The pairs with the most common cells and the nearest centres are taken first, kept detections before others. A
        track that was seen for long counts more, so that a boat in two pieces for a moment keeps its own.
        """
        tracks = self._tracks
        if not tracks or not len(found):
            return {}
        elapsed_s = time_s - np.array([one.seen_s for one in tracks])
        moved = np.array([one.velocity for one in tracks]) * elapsed_s
        gate = _gates_m(tracks, elapsed_s, interval_s)
        owner = np.repeat(np.arange(len(tracks)), [len(one.cells) for one in tracks])
        cells = np.concatenate([one.cells for one in tracks]) + np.column_stack((moved.real, moved.imag))[owner]
        shape = len(tracks), len(found)
        index, distance = nearest(found.cells, cells)
        met = distance <= gate[owner]
        forth = _counted(owner[met], found.owner[index[met]], shape)
        index, distance = nearest(cells, found.cells)
        near = distance <= gate[owner[index]]
        back = _counted(owner[index[near]], found.owner[near], shape)
        counts = np.bincount(owner), np.bincount(found.owner)
        overlap = np.maximum(forth / counts[0][:, None], back / counts[1])
        centers = np.array([one.center for one in tracks]) + moved
        apart = np.abs(centers[:, None] - found.centers @ _TO_COMPLEX)
        cost = 1 - overlap + _DISTANCE_WEIGHT * np.minimum(apart / gate[:, None], 2) + 2.0 * ~found.kept
        cost -= _SCORE_WEIGHT * np.array([one.score for one in tracks])[:, None]
        rows, columns = np.nonzero(overlap >= _LEAST_OVERLAP)
        order = np.argsort(cost[rows, columns], kind="stable")
        pairs, taken = dict[int, int](), set[int]()
        for t, d in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
            if t not in pairs and d not in taken:
                pairs[t] = d
                taken.add(d)
        return pairs

    def move(self, old: Pose, new: Pose) -> None:
        """Continue in other coordinates, given the pose of the lidar in both; velocities are hardly known there."""
        turn = cmath.rect(1, new.yaw - old.yaw)
        for one in self._tracks:
            one.center = complex(new.x, new.y) + turn * (one.center - complex(old.x, old.y))
            one.cells = new.applied(old.undone(one.cells))
            one.velocity, one.whole_s = turn * one.velocity, -math.inf
            one.variance = one.variance[0], 0.0, _SPEED_MS**2

    def forget(self) -> None:
        """Forget all tracks; numbers go on."""
        self._tracks, self._time_s = [], None


def _looks(found: Detections) -> Iterator[Look]:
    """Yield what a frame shows of each object."""
    starts = group_starts(found.owner)
    ends = starts + group_sizes(starts, len(found.owner))
    cells = (found.cells[start:end] for start, end in zip(starts.tolist(), ends.tolist(), strict=True))
    centers = (found.centers @ _TO_COMPLEX).tolist()
    jitters_m = (_JITTER_M + _JITTER_SHARE * np.hypot(*np.ptp(found.hulls, axis=1).T)).tolist()
    outermost = map(tuple, (found.ends @ _TO_COMPLEX).tolist())
    each = zip(centers, cells, jitters_m, outermost, map(tuple, found.hidden.tolist()), strict=True)
    return (Look(*one, complex(*found.lidar)) for one in each)


def _counted(rows: Ints, columns: Ints, shape: tuple[int, int]) -> Ints:
    """Return how often each pair of a row and a column occurs."""
    return np.bincount(rows * shape[1] + columns, minlength=shape[0] * shape[1]).reshape(shape)


def _gates_m(tracks: Sequence[Track], elapsed_s: Floats, interval_s: float) -> Floats:
    """Return the distances from the places where parts of tracks are expected within which they may be, shape (T,).

    Slow scans, whose frames are ``interval_s`` apart, see other parts of a body each time.
    """
    position, both, velocity = np.array([one.variance for one in tracks]).T
    position, _, _ = ahead(position, both, velocity, elapsed_s, _ACCELERATION)
    spread = np.sqrt(position + np.square([one.jitter_m for one in tracks]))
    step = min(_STEP_M + _STEP_SPEED_MS * interval_s, _MAX_STEP_M)
    return np.asarray(np.clip(_GATE_M + _GATE_SIGMAS * spread, step, _MAX_GATE_M))
