"""Tracks of the method ``confirmed`` as plain loops, for `reference_confirmed`."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from seaclutter_cli.filters.confirmation import evidence, tracks
from tests.filters.reference_objects import XY, Echo, Thing, distances, nearest, on_curve, places_of, tables

SLACK_S = 1e-6


@dataclass
class Entry:
    """What a track collected in one frame."""

    time_s: float
    evidence: float
    step_s: float
    memory: float


def missed(echoes: int) -> float:
    """Return the evidence of a look that misses an object of so many echoes."""
    share = min((tracks._MISSED_ECHOES / echoes) ** tracks._MISSED_POWER, 1.0)
    return max(math.log(share), evidence.LEAST)


@dataclass(eq=False)
class Track:
    """An object over time, with all that it ever collected."""

    cells: list[XY]
    center: XY
    born_s: float
    seen_s: float
    velocity: XY = (0.0, 0.0)
    top: float = 0.0
    echoes: int = 1
    first: float = 0.0
    is_part: bool = False
    kind: dict[str, float] = field(default_factory=dict)
    outside: bool = False
    from_outside: bool = False
    whole: "Track | None" = None
    history: list[Entry] = field(default_factory=list)
    error: float | None = None

    @property
    def memory(self) -> float:
        return self.history[-1].memory if self.history else self.first

    @property
    def is_new(self) -> bool:
        return self.seen_s - self.born_s <= tracks._KNOWN_AFTER_S

    def expected(self, time_s: float) -> list[XY]:
        elapsed = time_s - self.seen_s
        return [(x + self.velocity[0] * elapsed, y + self.velocity[1] * elapsed) for x, y in self.cells]

    def gate(self, time_s: float, interval_s: float) -> float:
        unseen_s = time_s - self.seen_s
        if self.is_new:
            return tracks._NEW_GATE_M + tracks._MAX_SPEED_MS * unseen_s
        jitter = min(tracks._JITTER_M + tracks._JITTER_SPEED_MS * interval_s, tracks._MAX_JITTER_M)
        return max(tracks._GATE_M + tracks._GATE_SPEED_MS * unseen_s, jitter)

    def may_return(self, time_s: float, interval_s: float) -> bool:
        patience_s = tracks._NEW_COAST_S + interval_s + SLACK_S if self.is_new else tracks._COAST_S
        return time_s - self.seen_s <= patience_s

    def follow(self, thing: Thing, time_s: float) -> None:
        elapsed = time_s - self.seen_s
        x, y = (old + speed * elapsed for old, speed in zip(self.center, self.velocity, strict=True))
        self.error = math.dist(thing.center, (x, y))
        if elapsed > 0:
            seen = [(new - old) / elapsed for new, old in zip(thing.center, self.center, strict=True)]
            if math.hypot(*seen) < tracks._MAX_SPEED_MS:
                gain = tracks._NEW_GAIN if self.is_new else tracks._GAIN
                vx, vy = (old + gain * (new - old) for new, old in zip(seen, self.velocity, strict=True))
                self.velocity = vx, vy
        self.cells, self.center, self.seen_s = thing.cells, thing.center, time_s
        self.top, self.echoes = thing.top, len(thing.echoes)
        self.outside |= not thing.near

    def collect(self, evidence: float, time_s: float, params: Any) -> None:
        step = tracks._FIRST_STEP_S
        if self.history:
            step = min(time_s - self.history[-1].time_s, tracks._MAX_STEP_S)
        memory = remembered(self.memory, evidence, step, params)
        self.history.append(Entry(time_s, evidence, step, memory))

    def score(self, time_s: float, params: Any) -> float:
        looks = [number for number, one in enumerate(self.history) if one.time_s <= time_s]
        now = looks[-1]
        before = self.history[now - 1].memory if now else self.first
        after = 0.0
        for one in sorted(self.history[now + 1 :], key=lambda one: -one.time_s):
            if one.time_s <= time_s + 1.1 * ahead_s(params):
                after = remembered(after, one.evidence, one.step_s, params)
        return before + 0.35 * (self.history[now].evidence - 1) + after


def ahead_s(params: Any) -> float:
    return 0.0 if params.causal else params.look_ahead_s


def least(params: Any) -> float:
    """Return the least evidence that is remembered."""
    return -1.0 if ahead_s(params) else -0.35


def with_track(shape: float, error_m: float | None, rate_hz: float, params: Any) -> float:
    """Return the evidence of an object that was so far from where its track expected it, and of which many appear."""
    curves = tables()["all" if params.use_intensity else "shape"]["curves"]
    total = shape + on_curve(curves["arrivals"], math.log2(rate_hz + 0.1))
    if error_m is not None:
        total += on_curve(curves["error"], math.log2(error_m + 0.05))
    return min(max(total, evidence.LEAST), evidence.MOST)


def kind_of(thing: Thing) -> dict[str, float]:
    """Return the features by which an object is like others."""
    return thing.features | {"octave": math.log2(max(math.hypot(*thing.center), 1))}


def likeness(kind: dict[str, float], other: dict[str, float]) -> float:
    """Return how much an object is like another, from 0 to 1."""
    height = 0.1 + 0.25 * abs(kind["height_m"])
    widths = {"height_m": height, "density": 1.5, "brightness": 0.7, "octave": 1.0}
    return math.exp(-sum(((kind[name] - other[name]) / widths[name]) ** 2 for name in widths if name in kind) / 2)


def remembered(memory: float, evidence: float, step_s: float, params: Any) -> float:
    total = memory * math.exp(-step_s / params.memory_s) + evidence * step_s
    return min(max(total, least(params)), tracks._MOST_MEMORY)


class Tracks:
    """The tracks of a log."""

    def __init__(self, params: Any) -> None:
        self.params = params
        self.tracks: list[Track] = []
        self.time_s: float | None = None
        self.times: list[float] = []
        self.yaw_rate = 0.0
        self.arrivals: list[Track] = []

    def arrivals_hz(self, track: Track, kind: dict[str, float], time_s: float) -> float:
        """Return how many objects like one appeared in a second of the last three, without the object itself."""
        others = [one for one in self.arrivals if one.born_s >= time_s - 3 and one is not track]
        lasts_s = min(max(time_s - min([time_s, *self.times]), 0.5), 3.0)
        return sum(likeness(kind, one.kind) for one in others) / lasts_s

    def turn(self, things: Sequence[Thing], time_s: float) -> None:
        """Turn all tracks by the angle that the well-known ones have in common."""
        elapsed = 0.0 if self.time_s is None else time_s - self.time_s
        known = [(track.memory, track.expected(time_s)) for track in self.tracks if track.memory > 0]
        cells = [cell for thing in things for cell in thing.cells]
        if not known or elapsed <= 0:
            return
        angle = self.yaw_rate * elapsed
        if cells:
            angle = common_turn(known, cells, angle)
            self.yaw_rate = angle / elapsed
        for track in self.tracks:
            track.cells = [turned(cell, angle) for cell in track.cells]
            track.center, track.velocity = turned(track.center, angle), turned(track.velocity, angle)

    def matches(self, things: Sequence[Thing], time_s: float) -> tuple[list[list[int]], list[bool]]:
        """Return how many cells of each object each track expects, and which tracks are covered by objects."""
        votes = [[0] * len(self.tracks) for _ in things]
        interval_s = 0.0 if self.time_s is None else time_s - self.time_s
        expected = [(number, place) for number, one in enumerate(self.tracks) for place in one.expected(time_s)]
        places = places_of(place for _, place in expected)
        for own, thing in zip(votes, things, strict=True):
            for cell in thing.cells:
                if expected:
                    gaps = distances(cell, places)
                    chosen = expected[gaps.argmin()][0]
                    own[chosen] += gaps.min() <= self.tracks[chosen].gate(time_s, interval_s)
        cells = places_of(cell for thing in things for cell in thing.cells)
        covered = []
        for track in self.tracks:
            gaps = [nearest(place, cells) for place in track.expected(time_s)]
            reached = sum(gap <= track.gate(time_s, interval_s) for gap in gaps)
            covered.append(reached >= tracks._COVERED * len(gaps))
        return votes, covered

    def approach(self, start_m: float, time_s: float) -> bool:
        """Return whether a probable target from outside can have parts nearer than ``start_m``."""
        coming = [track for track in self.tracks if track.outside and track.memory > 0]
        places = [place for track in coming for place in track.expected(time_s)]
        return any(math.hypot(*place) < start_m + tracks._CONTACT_M for place in places)

    def step(self, things: Sequence[Thing], time_s: float, meets: Callable[[XY, float], bool]) -> list[Track]:
        """Return the track of each object; ``meets`` says whether a beam meets a place up to a height."""
        votes, covered = self.matches(things, time_s)
        interval_s = 0.0 if self.time_s is None else time_s - self.time_s
        self.time_s = time_s
        followed: list[Track | None] = [None] * len(things)
        known = [1 + max(track.memory, 0.0) for track in self.tracks]
        chosen = [best_known(own, known) for own in votes]
        for number, track in enumerate(self.tracks):
            heirs = [k for k, own in enumerate(chosen) if own == number]
            for k, heir in self.inherit(track, heirs, things, [own[number] for own in votes], time_s):
                followed[k] = heir
        result = [
            self.appeared(begun(thing, time_s), time_s) if track is None else track
            for track, thing in zip(followed, things, strict=True)
        ]
        rates = [self.arrivals_hz(track, kind_of(thing), time_s) for track, thing in zip(result, things, strict=True)]
        for track, thing, rate_hz in zip(result, things, rates, strict=True):
            track.collect(with_track(thing.evidence, track.error, rate_hz, self.params), time_s, self.params)
            if self.times and track not in self.tracks and not track.is_part:
                track.kind = kind_of(thing)
                self.arrivals.append(track)
        recognise(things, result, votes)
        lost = [(track, hidden) for track, hidden in zip(self.tracks, covered, strict=True) if track not in result]
        for track, hidden in lost:
            places = track.expected(time_s)
            met = sum(meets(place, max(track.top, self.params.min_rise_m)) for place in places)
            if not hidden and met >= tracks._IN_SIGHT * len(places):
                track.collect(missed(track.echoes), time_s, self.params)
        self.tracks = [track for track, _ in lost if track.may_return(time_s, interval_s)] + result
        self.times.append(time_s)
        return result

    def awaited(self, rows: Sequence[Echo], time_s: float) -> list[tuple[Track, list[Echo]]]:
        """Return the probable targets that are not seen, with those of some echoes that are where one is expected."""
        lost = [track for track in self.tracks if track.seen_s < time_s and track.memory > 0]
        found: list[tuple[Track, list[Echo]]] = [(track, []) for track in lost]
        places = [(number, place) for number, track in enumerate(lost) for place in track.expected(time_s)]
        for echo in rows if places else ():
            gaps = [math.dist(echo.xy, place) for _, place in places]
            if min(gaps) < tracks._GATE_M:
                found[places[gaps.index(min(gaps))][0]][1].append(echo)
        return found

    def appeared(self, track: Track, time_s: float) -> Track:
        """Return a track that was not there until now, which is evidence against it."""
        if self.times:
            track.first = max(self.times[0] - time_s, least(self.params))
        return track

    def inherit(
        self, track: Track, heirs: Sequence[int], things: Sequence[Thing], votes: Sequence[int], time_s: float
    ) -> list[tuple[int, Track]]:
        """Return the tracks of the objects that continue a track: the first goes on with it, the others begin."""
        if not heirs:
            return []
        most = max(votes[k] for k in heirs)
        able = [k for k in heirs if votes[k] >= tracks._CONTINUED_SHARE * most]
        first = max(able, key=lambda k: (round(things[k].evidence / 2), votes[k]))
        memory = track.memory
        track.follow(things[first], time_s)
        found = [(first, track)]
        for k in heirs:
            if k != first:
                part = begun(things[k], time_s)
                part.velocity, part.from_outside = track.velocity, track.from_outside
                part.outside |= track.outside
                part.whole = track.whole or track
                part.is_part, part.first = True, min(memory, 0.0)
                found.append((k, part))
        return found


def best_known(votes: Sequence[int], known: Sequence[float]) -> int | None:
    """Return the best known track that expects at least a quarter as many cells as any; None if none expects any."""
    enough = [t for t, count in enumerate(votes) if count and count >= tracks._CONTINUED_SHARE * max(votes)]
    return max(enough, key=lambda t: known[t], default=None)


def turned(place: XY, angle: float) -> XY:
    x, y = place
    return x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)


def common_turn(known: Sequence[tuple[float, Sequence[XY]]], cells: Sequence[XY], guess: float) -> float:
    """Return the angle for which most tracks vote if more of them meet objects at it than at the guess, or without one.

    Every cell that a track expects votes with every cell seen at about its range; a track has votes by its memory.
    """
    seen = places_of(cells)
    places = [(memory / len(own), place) for memory, own in known for place in own]
    places = places[:: len(places) // tracks._MAX_CELLS + 1]
    cells = cells[:: len(cells) // tracks._MAX_CELLS + 1]
    most = tracks._TURN_BINS
    votes = dict.fromkeys(range(-most - 1, most + 2), 0.0)
    for weight, (x, y) in places:
        for cell_x, cell_y in cells:
            if abs(math.hypot(x, y) - math.hypot(cell_x, cell_y)) < tracks._SAME_RANGE_M:
                angle = math.atan2(cell_y, cell_x) - math.atan2(y, x) - guess
                vote = round(((angle + math.pi) % (2 * math.pi) - math.pi) / tracks._TURN_BIN_RAD)
                if abs(vote) <= most:
                    votes[vote] += weight
    smooth = {one: votes[one - 1] + 2 * votes[one] + votes[one + 1] for one in range(-most, most + 1)}
    best = max(smooth, key=lambda one: smooth[one])

    def met(angle: float) -> float:
        reached = [weight for weight, place in places if distances(turned(place, angle), seen).min() <= tracks._MET_M]
        return sum(reached) / sum(weight for weight, _ in places)

    likely = guess if met(guess) >= met(0.0) else 0.0
    other = guess + best * tracks._TURN_BIN_RAD
    return other if met(other) > met(likely) + tracks._TURN_GAIN else likely


def begun(thing: Thing, time_s: float) -> Track:
    """Return a new track."""
    track = Track(thing.cells, thing.center, time_s, time_s)
    track.top, track.echoes, track.outside = thing.top, len(thing.echoes), not thing.near
    return track


def recognise(things: Sequence[Thing], result: Sequence[Track], votes: Sequence[Sequence[int]]) -> None:
    """Note of what near objects are parts that appear in contact with one from outside: of the best known."""
    for thing, track, own in zip(things, result, votes, strict=True):
        if not thing.near or any(own):
            continue
        best: Track | None = None
        for other, body in zip(things, result, strict=True):
            if other.near or min(nearest(cell, places_of(other.cells)) for cell in thing.cells) >= tracks._CONTACT_M:
                continue
            if best is None or (body.from_outside, body.memory) > (best.from_outside, best.memory):
                best = body
        if best is not None:
            track.whole = best.whole or best
