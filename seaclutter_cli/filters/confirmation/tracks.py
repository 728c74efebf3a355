"""Tracks: objects followed from frame to frame, and the evidence that they collect."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from seaclutter_cli.arrays import Floats, Indices, Ints, Mask
from seaclutter_cli.filters.confirmation import ConfirmedParams
from seaclutter_cli.filters.confirmation.evidence import LEAST, Arrivals, track_features, with_tracks
from seaclutter_cli.filters.confirmation.objects import DetectedObject
from seaclutter_cli.neighbors import nearest

_DECORRELATION_S = 1.0
_MOST_MEMORY = 3.0
_LEAST_MEMORY, _LEAST_MEMORY_AT_ONCE = -1.0, -0.35
_LOOK, _DOUBT = 0.35, 1.0
_MISSED_ECHOES, _MISSED_POWER = 2.3, 1.65
_MAX_STEP_S, _FIRST_STEP_S = 0.5, 0.1
_KNOWN_AFTER_S = 0.5
_GATE_M, _GATE_SPEED_MS = 0.8, 1.0
_NEW_GATE_M = 1.0
_JITTER_M, _JITTER_SPEED_MS, _MAX_JITTER_M = 0.4, 5.0, 4.0
_GAIN, _NEW_GAIN = 0.15, 0.3
_MAX_SPEED_MS = 20.0
_COVERED = 0.5
_IN_SIGHT = 0.5
_CONTACT_M = 2.0
_COAST_S, _NEW_COAST_S = 2.0, 0.5
_SLACK_S, _SLACK = 1e-6, 1.1
_CONTINUED_SHARE = 0.25
_MAX_CELLS, _SAME_RANGE_M = 256, 1.0
_TURN_BIN_RAD, _TURN_BINS, _TURN_GAIN = math.radians(0.25), 24, 0.2
_MET_M = 0.5

Meets = Callable[[Floats, Floats], Mask]
"""Whether any beam meets bodies at horizontal positions, shape (K, 2), of heights above the water, shape (K,)."""


class Evidence(NamedTuple):
    """Evidence of one frame: its time, the evidence, the time that it stands for, and the memory before it."""

    time_s: float
    evidence: float
    step_s: float
    before: float


@dataclass(eq=False)
class Track:
    """An object followed over time.

    When it was last seen, its parts were at the horizontal positions ``cells``, shape (m, 2), its centre at ``center``,
    its top ``top_m`` above the water, and it had so many ``echoes``. ``error_m`` is how far it was from where it was
    expected; NaN if it was new. ``velocity``, shape (2,), is relative to the lidar, so own ship's motion is
    part of it. It was ever seen, and confirmed, beyond ``start_m`` if ``seen_outside`` and ``from_outside``; in the
    latter case, it is not own ship when it comes nearer, nor is what is ``part_of`` it. ``arrival`` is its number among
    the `Arrivals`, or -1, and ``rate_hz`` the number of similar objects that appeared per second. ``memory`` is its
    evidence, and ``history`` that of the frames that decisions still need.
    """

    cells: Floats
    center: Floats
    born_s: float
    seen_s: float
    top_m: float
    echoes: int
    seen_outside: bool
    velocity: Floats = field(default_factory=lambda: np.zeros(2))
    error_m: float = math.nan
    arrival: int = -1
    rate_hz: float = 0.0
    from_outside: bool = False
    part_of: "Track | None" = None
    memory: float = 0.0
    history: deque[Evidence] = field(default_factory=deque)

    @property
    def is_new(self) -> bool:
        """Whether its velocity is not yet known."""
        return self.seen_s - self.born_s <= _KNOWN_AFTER_S

    @property
    def missed(self) -> float:
        """Evidence of a look that misses it: the logarithm of the share of looks that miss targets of as many echoes.

        In simulated logs that is a half with 3, 15 % with 8 and 5 % with 14.
        """
        return max(-_MISSED_POWER * math.log(max(self.echoes / _MISSED_ECHOES, 1)), LEAST)

    def coasts(self, time_s: float, interval_s: float) -> bool:
        """Return whether it may be seen again; ``interval_s`` as for `gate_m`. It is given up after some time."""
        coast_s = _NEW_COAST_S + interval_s + _SLACK_S if self.is_new else _COAST_S
        return time_s - self.seen_s <= coast_s

    def gate_m(self, time_s: float, interval_s: float) -> float:
        """Return how far its parts may be from where they are expected; ``interval_s`` is the time between frames."""
        unseen_s = time_s - self.seen_s
        if self.is_new:
            return _NEW_GATE_M + _MAX_SPEED_MS * unseen_s
        # Slow scans see other parts of a body each time, and its course changes in between.
        jitter = min(_JITTER_M + _JITTER_SPEED_MS * interval_s, _MAX_JITTER_M)
        return max(_GATE_M + _GATE_SPEED_MS * unseen_s, jitter)

    def move(self, found: DetectedObject, time_s: float) -> None:
        """Update position and velocity."""
        elapsed = time_s - self.seen_s
        self.error_m = math.hypot(*(found.center - self.center - self.velocity * elapsed))
        if elapsed > 0:
            velocity = (found.center - self.center) / elapsed
            if math.hypot(*velocity) < _MAX_SPEED_MS:
                gain = _NEW_GAIN if self.is_new else _GAIN
                self.velocity = self.velocity + gain * (velocity - self.velocity)
        self.cells, self.center, self.seen_s = found.cells, found.center, time_s
        self.top_m, self.echoes = found.top_m, len(found.points)
        self.seen_outside |= not found.near


class Tracker:
    """The tracks of a recording."""

    def __init__(self, params: ConfirmedParams) -> None:
        self._params = params
        self._ahead_s = 0.0 if params.causal else params.look_ahead_s
        self._least = _LEAST_MEMORY if self._ahead_s else _LEAST_MEMORY_AT_ONCE
        self._tracks: list[Track] = []
        self._arrivals = Arrivals()
        self._since_s = -np.inf
        self._time_s: float | None = None
        self._start_s = math.inf
        self._yaw_rate = 0.0

    def approached(self, start_m: float, time_s: float) -> bool:
        """Return whether a probable target seen beyond ``start_m`` can have parts nearer than that."""
        coming = [track for track in self._tracks if track.seen_outside and track.memory > 0]
        if not coming:
            return False
        cells, _ = _expected_cells(coming, time_s)
        return bool(np.hypot(*cells.T).min() < start_m + _CONTACT_M)

    def _turn(self, objects: Sequence[DetectedObject], time_s: float, elapsed_s: float) -> None:
        """Turn the tracks with the lidar: own ship's yaw is what most objects have in common.

        Without objects, own ship turns on as before.
        """
        known = [track for track in self._tracks if track.memory > 0]
        if not known or elapsed_s <= 0:
            return
        angle = self._yaw_rate * elapsed_s
        if objects:
            expected, track_of = _expected_cells(known, time_s)
            votes = np.array([track.memory for track in known])[track_of] / np.bincount(track_of)[track_of]
            angle = _turn_rad(expected, votes, np.concatenate([one.cells for one in objects]), angle)
            self._yaw_rate = angle / elapsed_s
        turned = _rotation(angle)
        for track in self._tracks:
            track.cells, track.center = track.cells @ turned, track.center @ turned
            track.velocity = track.velocity @ turned

    def _associate(self, objects: Sequence[DetectedObject], time_s: float, interval_s: float) -> tuple[Ints, Mask]:
        """Return how many cells of each of K objects each of T tracks expects, shape (K, T), and which are covered.

        A track is covered, shape (T,), if most of the cells that it expects are in any objects.
        """
        votes = np.zeros((len(objects), len(self._tracks)), np.int64)
        if not votes.size:
            return votes, np.zeros(len(self._tracks), np.bool_)
        expected, track_of = _expected_cells(self._tracks, time_s)
        cells = np.concatenate([one.cells for one in objects])
        object_of = np.repeat(np.arange(len(objects)), [len(one.cells) for one in objects])
        gate = np.array([track.gate_m(time_s, interval_s) for track in self._tracks])
        index, distance = nearest(expected, cells)
        reached = np.flatnonzero(distance <= gate[track_of[index]])
        np.add.at(votes, (object_of[reached], track_of[index[reached]]), 1)
        _, back = nearest(cells, expected)
        return votes, _share(back <= gate[track_of], track_of) >= _COVERED

    def step(
        self, objects: Sequence[DetectedObject], time_s: float, since_s: float, meets: Meets | None = None
    ) -> list[Track]:
        """Return the track of each object of a frame; a new one where an object continues none.

        ``since_s`` is the time of the first frame for which `score` will still be asked. Everything is in sight if
        ``meets`` is None.

        Notes
        -----
        An object continues the track that expects most of its cells. If several objects continue a track, the one with
        the most evidence does, of those with at least a quarter of the most cells, and the others start tracks of their
        own. A track is neither found nor missed if most of its cells lie in an object of another track, such as a boat
        alongside another, or between the beams.

        That an object was not there before is evidence against it, as if it had been missed: -1 for each second since
        the first frame, until that is the least memory.
        """
        interval_s = 0.0 if self._time_s is None else time_s - self._time_s
        self._since_s, self._time_s, self._start_s = since_s, time_s, min(self._start_s, time_s)
        self._turn(objects, time_s, interval_s)
        votes, covered = self._associate(objects, time_s, interval_s)
        tracks: list[Track | None] = [None] * len(objects)
        known = np.array([1 + max(track.memory, 0.0) for track in self._tracks])
        for t, candidates in _by_track(votes, known).items():
            least = _CONTINUED_SHARE * max(votes[k, t] for k in candidates)
            enough = [k for k in candidates if votes[k, t] >= least]
            first = max(enough, key=lambda k: (round(objects[k].evidence / 2), votes[k, t]))
            self._tracks[t].move(objects[first], time_s)
            for k in candidates:
                tracks[k] = self._tracks[t] if k == first else self._begun(objects[k], time_s, self._tracks[t])
        result = [track or self._begun(one, time_s) for track, one in zip(tracks, objects, strict=True)]
        self._look(objects, result, time_s)
        self._recognise(objects, result, votes)
        seen = {id(track) for track in result}
        missing = [one for one, hidden in zip(self._tracks, covered, strict=True) if id(one) not in seen and not hidden]
        for track in missing if meets is None else self._in_sight(missing, meets, time_s):
            self._collect(track, time_s, track.missed)
        unseen = [one for one in self._tracks if id(one) not in seen and one.coasts(time_s, interval_s)]
        self._tracks = unseen + result
        return result

    def awaited(self, xy: Floats, time_s: float) -> list[tuple[Track, Indices]]:
        """Return the probable targets that the last frame does not show, and which positions, (2, N), are at each.

        If the filter does not look ahead, the list is empty, because only later frames can show them again.
        """
        lost = [track for track in self._tracks if track.seen_s < time_s and track.memory > 0]
        if not self._ahead_s or not lost or not xy.size:
            return []
        expected, track_of = _expected_cells(lost, time_s)
        index, distance = nearest(expected, xy.T)
        owner = np.where(distance < _GATE_M, track_of[index], -1)
        return [(track, np.flatnonzero(owner == k)) for k, track in enumerate(lost)]

    def score(self, track: Track, time_s: float) -> float:
        """Return the score of a track at a time: its evidence before and after, and some of that at the time."""
        now = next(one for one in reversed(track.history) if one.time_s <= time_s)
        until_s, after = time_s + _SLACK * self._ahead_s, 0.0
        for one in reversed(track.history):
            if time_s < one.time_s <= until_s:
                after = self._remembered(after, one.evidence, one.step_s)
        return now.before + _LOOK * (now.evidence - _DOUBT) + after

    def _begun(self, found: DetectedObject, time_s: float, parent: Track | None = None) -> Track:
        track = Track(found.cells, found.center, time_s, time_s, found.top_m, len(found.points), not found.near)
        if parent is not None:
            track.velocity = parent.velocity
            track.seen_outside |= parent.seen_outside
            track.from_outside, track.part_of = parent.from_outside, parent.part_of or parent
            track.memory = min(parent.memory, 0.0)
        else:
            track.memory = max((self._start_s - time_s) / _DECORRELATION_S, self._least)
        return track

    def _look(self, objects: Sequence[DetectedObject], tracks: Sequence[Track], time_s: float) -> None:
        """Collect the evidence of the objects of a frame, and note which appear in it."""
        kinds = np.array([(*one.features, math.log2(max(math.hypot(*one.center), 1))) for one in objects])
        own = np.array([track.arrival for track in tracks], np.int64)
        rates_hz = self._arrivals.rates_hz(kinds, own, time_s, self._start_s)
        of_tracks = track_features(np.array([track.error_m for track in tracks]), rates_hz)
        shapes = np.array([one.evidence for one in objects])
        evidence = with_tracks(shapes, of_tracks, intensities=self._params.use_intensity)
        for track, kind, rate_hz, odds in zip(tracks, kinds, rates_hz.tolist(), evidence.tolist(), strict=True):
            track.rate_hz = rate_hz
            if not track.history and time_s > self._start_s and track.part_of is None:
                track.arrival = self._arrivals.add(kind, time_s)
            self._collect(track, time_s, odds)

    def _in_sight(self, tracks: Sequence[Track], meets: Meets, time_s: float) -> list[Track]:
        """Return the tracks of which beams would meet at least half of the cells."""
        if not tracks:
            return []
        cells, track_of = _expected_cells(tracks, time_s)
        tops_m = np.array([max(track.top_m, self._params.min_rise_m) for track in tracks])
        share = _share(meets(cells, tops_m[track_of]), track_of)
        return [track for track, met in zip(tracks, share >= _IN_SIGHT, strict=True) if met]

    def _recognise(self, objects: Sequence[DetectedObject], tracks: Sequence[Track], votes: Ints) -> None:
        """Mark what appears near own ship in contact with objects from outside: it is part of the best known."""
        outside = [k for k, one in enumerate(objects) if not one.near]
        appeared = [k for k, one in enumerate(objects) if one.near and not votes[k].any()]
        if not outside or not appeared:
            return
        parts = np.concatenate([objects[k].cells for k in outside])
        owners = np.repeat(outside, [len(objects[k].cells) for k in outside])
        for k in appeared:
            _, distance = nearest(objects[k].cells, parts)
            touched = [tracks[owner] for owner in np.unique(owners[distance < _CONTACT_M]).tolist()]
            if touched:
                owner = max(touched, key=lambda track: (track.from_outside, track.memory))
                tracks[k].part_of = owner.part_of or owner

    def _collect(self, track: Track, time_s: float, evidence: float) -> None:
        """Add the evidence of a frame."""
        step = min(time_s - track.history[-1].time_s, _MAX_STEP_S) if track.history else _FIRST_STEP_S
        track.history.append(Evidence(time_s, evidence, step, track.memory))
        track.memory = self._remembered(track.memory, evidence, step)
        while len(track.history) > 1 and track.history[1].time_s <= self._since_s:
            track.history.popleft()

    def _remembered(self, memory: float, evidence: float, step_s: float) -> float:
        """Return the memory after a step with some evidence."""
        remembered = memory * math.exp(-step_s / self._params.memory_s)
        return min(max(remembered + evidence * step_s / _DECORRELATION_S, self._least), _MOST_MEMORY)


def _expected_cells(tracks: Sequence[Track], time_s: float) -> tuple[Floats, Ints]:
    """Return where the cells of tracks are expected, shape (m, 2), and the number of the track of each, shape (m,)."""
    track_of = np.repeat(np.arange(len(tracks)), [len(track.cells) for track in tracks])
    moved = np.array([track.velocity * (time_s - track.seen_s) for track in tracks])
    return np.concatenate([track.cells for track in tracks]) + moved[track_of], track_of


def _share(mask: Mask, track_of: Ints) -> Floats:
    """Return the share of the cells of each track for which a mask is true; every track has cells."""
    return np.bincount(track_of, weights=mask) / np.bincount(track_of)


def _by_track(votes: Ints, known: Floats) -> dict[int, list[int]]:
    """Return the objects that continue each track, by the number of the track.

    Of the tracks that expect at least a quarter of the cells of the first, the best known counts.
    """
    chosen: dict[int, list[int]] = {}
    for k in np.flatnonzero(votes.any(axis=1)).tolist():
        enough = votes[k] >= max(_CONTINUED_SHARE * votes[k].max(), 1)
        chosen.setdefault(int(np.where(enough, known, 0.0).argmax()), []).append(k)
    return chosen


def _turn_rad(expected: Floats, weight: Floats, cells: Floats, guess_rad: float) -> float:
    """Return the angle by which tracks, of expected cells of shape (m, 2), turned to cells seen, shape (n, 2).

    Pairs of nearly one range vote for the angle between them, with the ``weight`` of the expected cell, shape (m,).
    Walls vote for many angles, and spray for any, so the first is taken only if, turned by it, more weight is where
    objects are than turned by the guess, and that only if it meets no less than no turn.
    """
    step = len(expected) // _MAX_CELLS + 1
    expected, weight, some = expected[::step], weight[::step], cells[:: len(cells) // _MAX_CELLS + 1]
    apart = np.abs(np.hypot(*expected.T)[:, None] - np.hypot(*some.T)) < _SAME_RANGE_M
    angles = np.arctan2(some[:, 1], some[:, 0]) - np.arctan2(expected[:, 1], expected[:, 0])[:, None]
    angles = (angles[apart] - guess_rad + np.pi) % (2 * np.pi) - np.pi
    bins = np.rint(angles / _TURN_BIN_RAD).astype(np.int64) + _TURN_BINS
    inside = (bins >= 0) & (bins <= 2 * _TURN_BINS)
    share = np.broadcast_to(weight[:, None], apart.shape)[apart][inside]
    votes = np.bincount(bins[inside], weights=share, minlength=2 * _TURN_BINS + 1)
    votes = np.convolve(votes, (1, 2, 1), mode="same")
    best_rad = guess_rad + (int(np.argmax(votes)) - _TURN_BINS) * _TURN_BIN_RAD

    def met(angle_rad: float) -> float:
        _, distance = nearest(cells, expected @ _rotation(angle_rad))
        return float(weight[distance <= _MET_M].sum() / weight.sum())

    likely_rad = max(guess_rad, 0.0, key=met)
    return best_rad if met(best_rad) > met(likely_rad) + _TURN_GAIN else likely_rad


def _rotation(angle_rad: float) -> Floats:
    """Return the matrix that turns rows of coordinates by an angle."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, sin], [-sin, cos]])
