"""Transforms of frames to their parents over time, of one topic or several."""

import math
from bisect import bisect, bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from seaclutter_cli.arrays import Floats

STALE_NS = 1_000_000_000
_KEPT = 256
_LASTING_NS, _SLOPE_NS = 500_000_000, 200_000_000
_STEP_M, _FASTEST_MS, _STEP_RAD, _FASTEST_RAD_S = 0.5, 30.0, math.radians(5), math.radians(90)
_SAME_M, _SAME_RAD = 1e-6, 1e-6
CONTINUOUS = "odom"
"""First letters of the name of the frame in which own ship's pose is never corrected."""
_stamp_ns = attrgetter("stamp_ns")


class Sample(NamedTuple):
    """Position and orientation (quaternion, w last) of a frame in its parent at a time."""

    stamp_ns: int
    at: Floats
    turn: Floats

    def is_at(self, other: "Sample", apart_m: float = _SAME_M, turned_rad: float = _SAME_RAD) -> bool:
        """Return whether place and orientation are the same, to some metres and radians."""
        return math.dist(self.at, other.at) <= apart_m and self.turned_rad(other) <= turned_rad

    def turned_rad(self, other: "Sample") -> float:
        """Return the angle between the orientations."""
        return 2 * math.acos(min(abs(float(self.turn @ other.turn)), 1.0))

    def speed_ms(self, later: "Sample") -> float:
        """Return the speed from there to a later sample."""
        return math.dist(self.at, later.at) / max((later.stamp_ns - self.stamp_ns) / 1e9, 1e-9)

    def leads_to(self, later: "Sample") -> bool:
        """Return whether a vessel can move so far in so short a time."""
        elapsed_s = (later.stamp_ns - self.stamp_ns) / 1e9
        if elapsed_s <= 0 or math.dist(self.at, later.at) > _STEP_M + _FASTEST_MS * elapsed_s:
            return False
        return self.turned_rad(later) <= _STEP_RAD + _FASTEST_RAD_S * elapsed_s


@dataclass
class Edge:
    """Samples of the transform of a frame to its parent from one topic, in the order of time; fixed ones are repeated.

    It ``moves`` if they differ, and ``travels`` if the frame is elsewhere, seen from above: what only turns, as against
    the horizon, does not tell where own ship is. ``breaks`` counts corrections.
    """

    parent: str
    topic: str = ""
    samples: deque[Sample] = field(default_factory=lambda: deque(maxlen=_KEPT))
    moves: bool = False
    travels: bool = False
    breaks: int = 0
    _apart: deque[Sample] = field(default_factory=lambda: deque(maxlen=_KEPT))
    _apart_ns: int = 0

    @property
    def rank(self) -> tuple[bool, bool, bool, bool]:
        """What decides between transforms of one frame; the greatest counts, and the first of equal ones."""
        is_tree = last_name(self.topic) == "tf"
        return self.travels, self.moves, is_tree, last_name(self.parent).startswith(CONTINUOUS)

    def put(self, sample: Sample) -> None:
        """Replace the fixed transform."""
        self.breaks += bool(self.samples) and not self.samples[-1].is_at(sample)
        self.samples.clear()
        self.samples.append(sample)

    def add(self, sample: Sample, *, is_motion: bool = True) -> None:
        """Add a sample; one that no vessel can reach counts once others have agreed with it for half a second.

        An estimate that is corrected stays where it is, one that is wrong for a moment comes back. Samples that
        repeat a time, or are late, add nothing. Samples of motion move the frame even where they are equal.
        """
        elapsed_ns = sample.stamp_ns - self.samples[-1].stamp_ns if self.samples else 1
        last = self.samples[-1] if self.samples else sample
        if (len(self.samples) < 2 and elapsed_ns > 0) or (last.leads_to(sample) and not self._leads_apart(sample)):
            self.moves = self.moves or is_motion or not last.is_at(sample)
            self.travels = self.travels or is_motion or math.dist(last.at[:2], sample.at[:2]) > _SAME_M
            self.samples.append(sample)
            self._apart.clear()
            return
        if -STALE_NS < elapsed_ns <= 0:
            return
        if not self._apart or not self._apart[-1].leads_to(sample):
            self._apart.clear()
            self._apart_ns = sample.stamp_ns
        self._apart.append(sample)
        if sample.stamp_ns - self._apart_ns >= _LASTING_NS:
            self.samples, self._apart, self.moves, self.travels = self._apart, self.samples, True, True
            self.breaks += 1
            self._apart.clear()

    def _leads_apart(self, sample: Sample) -> bool:
        """Return whether samples that did not count lead to one at less speed, because more time has gone by."""
        if not self._apart or not self._apart[-1].leads_to(sample):
            return False
        return self._apart[-1].speed_ms(sample) < self.samples[-1].speed_ms(sample)

    def at(self, stamp_ns: int, late_ns: int = STALE_NS) -> Sample | None:
        """Return the transform at a time, between samples or within a time of them, or the fixed one."""
        known = self.samples
        if not self.moves:
            return known[-1]
        first_ns, last_ns = known[0].stamp_ns, known[-1].stamp_ns
        if not first_ns - late_ns <= stamp_ns <= last_ns + late_ns:
            return None
        # Beyond the samples, noise of the last two would grow.
        start_ns = last_ns - _SLOPE_NS if stamp_ns > last_ns else stamp_ns
        end_ns = first_ns + _SLOPE_NS if stamp_ns < first_ns else stamp_ns
        before = known[max(bisect(known, start_ns, key=_stamp_ns) - 1, 0)]
        after = known[min(bisect_left(known, end_ns, key=_stamp_ns), len(known) - 1)]
        share = (stamp_ns - before.stamp_ns) / max(after.stamp_ns - before.stamp_ns, 1)
        sign = 1 if before.turn @ after.turn >= 0 else -1
        turn = before.turn + share * (sign * after.turn - before.turn)
        return Sample(stamp_ns, before.at + share * (after.at - before.at), turn / np.linalg.norm(turn))


def best(edges: Sequence[Edge], stamp_ns: int) -> Edge | None:
    """Return the transform of a frame that counts, of those known at a time if there are any; None without one."""
    known = [edge for edge in edges if edge.at(stamp_ns)] if len(edges) > 1 else edges
    return max(known or edges, key=lambda edge: edge.rank, default=None)


def last_name(path: str) -> str:
    """Return the last part of the name of a topic or frame."""
    return path.rpartition("/")[2]


def product(first: Floats, second: Floats) -> Floats:
    """Return the quaternion that turns by the second, then by the first."""
    (a, p), (b, q) = ((turn[3], turn[:3]) for turn in (first, second))
    return np.array([*(a * q + b * p + np.cross(p, q)), a * b - p @ q])
