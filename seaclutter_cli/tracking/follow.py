"""Objects of the frames of a recording: tracks, smoothed over a limited time."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from seaclutter_cli.arrays import Floats, Ints, Mask
from seaclutter_cli.frame import FilterResult, Frame, WaterState
from seaclutter_cli.tracking.boxes import STRUCTURE, Shape, fit, guessed_class, seen_depth_m, smoothed, with_hull
from seaclutter_cli.tracking.clock import Clock
from seaclutter_cli.tracking.detections import Detections, Pose
from seaclutter_cli.tracking.tracker import Track, Tracker
from seaclutter_cli.water import Mounting
from seaclutter_cli.water.beams import Beams

CONFIRMED, CANDIDATE, LOST = "confirmed", "candidate", "lost"
_CONTEXT_S = 10.0
_MAX_WAITING = 50_000
_SURE, _CLEAR_M, _BEAM_DEG, _BOAT_M, _CREST_M = 0.5, 0.5, 0.2, (2.5, 15.0), 0.3
_MOST_COMPARED, _MOSTLY = 20, 0.8
_PART_SHARE = 0.5
_STEP_M, _FASTEST_MS, _STEP_RAD, _FASTEST_RAD_S = 0.5, 30.0, np.radians(5), np.radians(90)


@dataclass(frozen=True)
class FrameObjects:
    """The N objects of a frame, in the coordinates of its cloud.

    ``tracks`` are their numbers from 1. A state is ``confirmed``; ``candidate`` if an object was seen for a short time,
    only in points that were removed, or not down to the water although a beam passes below it that nothing nearer
    meets, because targets float; or ``lost`` if it was not seen in this frame, but before and after. ``centers``
    and ``sizes``, shape (N, 3), ``yaws`` and ``velocities``, shape (N, 2), describe boxes; velocities are over ground
    if ``over_ground``, and NaN if they are not known, from one place only. ``tops_m`` are heights above the water, NaN
    where it is unknown. ``spans_ns``, shape (N, 2), are the first and the last time of the track, as far as it is known
    ten seconds later. A box is ``measured`` if two of its sides were seen; otherwise its width is at least that of a
    usual vessel. ``kinds`` are guesses of their classes.
    """

    index: int
    stamp_ns: int
    tracks: Sequence[int]
    states: Sequence[str]
    centers: Floats
    sizes: Floats
    yaws: Floats
    velocities: Floats
    points: Ints
    scores: Floats
    tops_m: Floats
    spans_ns: Ints
    measured: Mask
    kinds: Sequence[str]
    over_ground: bool


class _Water(NamedTuple):
    """The plane of the water: its height where the lidar is, and its slope over x and y of the cloud, shape (2,)."""

    level_m: float
    slope: Floats

    @classmethod
    def of(cls, state: WaterState, mounting: Mounting) -> "_Water":
        """Return the plane of a state, which is against the lidar as it is mounted."""
        slope = np.array([np.tan(np.radians(state.pitch_deg)), -np.tan(np.radians(state.roll_deg))])
        return cls(state.level_m, slope @ mounting.rotation[:2, :2])

    def heights(self, xy: Floats, rises_m: Floats) -> Floats:
        """Return the heights above the water at positions, shape (N, 2), of what rises by so much, shape (N,)."""
        return np.asarray(rises_m - self.level_m - xy @ self.slope)


@dataclass(frozen=True)
class _Waiting:
    """A frame whose objects are not final yet: its detections, and the numbers and tracks of those that have one."""

    index: int
    stamp_ns: int
    time_s: float
    pose: Pose
    over_ground: bool
    water: _Water | None
    found: Detections
    misfits: Floats
    clear_m: Floats
    seen: Sequence[tuple[int, Track]]


class Follower:
    """The objects of the frames of one topic.

    They are smoothed with the frames of ``context_s`` before and after, and complete after twice that; with ``live``,
    they are complete at once, without later frames.
    """

    def __init__(
        self,
        tolerance_m: float,
        min_points: int,
        mounting: Mounting = Mounting(),  # noqa: B008 - frozen
        *,
        context_s: float = _CONTEXT_S,
        live: bool = False,
    ) -> None:
        self._clustering, self._mounting = (tolerance_m, min_points), mounting
        self._context_s, self._ahead_s = context_s, 0.0 if live else context_s
        self._tracker, self._beams = Tracker(), Beams(mounting)
        self._frames: deque[_Waiting] = deque()
        self._clock = Clock()
        self._origin_ns: int | None = None
        self._done = 0
        self._shapes: dict[Track, Shape] = {}
        self._records = 0

    def add(self, result: FilterResult, pose: Pose | None) -> Iterator[FrameObjects]:
        """Add a filtered frame with the pose of the lidar, None if it is not known; yield frames that are complete."""
        frame = result.frame
        time_ns, is_apart = self._clock.next(frame)
        if self._origin_ns is None:  # times from there on are exact to a nanosecond
            self._origin_ns = time_ns
        time_s = (time_ns - self._origin_ns) / 1e9
        over_ground, pose = pose is not None, pose or Pose()
        if self._frames and is_apart:
            yield from self.finish()
        elif self._frames and (over_ground != self._frames[-1].over_ground or self._jumps(pose, time_s)):
            yield from self._move(pose)
        found = Detections.of(result, *self._clustering, self._mounting.up)
        water = _Water.of(result.water, self._mounting) if result.water else None
        clear_m = self._clear_m(result.frame, water, found)
        found = found.moved(pose)
        tracks = self._tracker.step(found, time_s) if frame.valid.any() else []  # no echo at all misses nothing
        seen = [(row, track) for row, track in enumerate(tracks) if track is not None]
        moment = frame.index, frame.stamp_ns, time_s
        self._frames.append(_Waiting(*moment, pose, over_ground, water, found, found.misfits(), clear_m, seen))
        self._records += len(seen)
        if time_s - self._frames[self._done].time_s >= 2 * self._ahead_s or self._records > _MAX_WAITING:
            yield from self._complete(time_s - self._ahead_s)

    def _clear_m(self, frame: Frame, water: _Water | None, found: Detections) -> Floats:
        """Return how far above the water beams pass below detections, shape (K,); 0 where it is not known.

        What is nearer may hide the rest of a boat, but small ones are rather parts of something, flat ones crests.
        """
        if water is None or not len(found):
            return np.zeros(len(found))
        self._beams.add(self._mounting.levelled(frame.coordinates.compress(frame.valid, axis=1)))
        upwards = 1 if self._mounting.up[2] >= 0 else -1
        distance, (low, high) = np.hypot(*found.centers.T), np.sort(upwards * found.spans).T
        elevation, top = (np.degrees(np.arctan2(heights, distance)) for heights in (low, high))
        below, _ = self._beams.gaps(elevation, elevation)
        clear_m = water.heights(found.centers, found.rises[:, 0] - np.tan(np.radians(below)) * distance)
        length = np.hypot(*np.ptp(found.hulls, axis=1).T)
        is_boat = (length > _BOAT_M[0]) & (length < _BOAT_M[1]) & (high - low > _CREST_M)
        above = np.flatnonzero((clear_m > _CLEAR_M) & is_boat)
        next_beam = (elevation - below)[above, None]
        meets = (elevation <= next_beam) & (next_beam <= top + _BEAM_DEG) & (distance < distance[above, None])
        clear_m[above[(meets & found.cover(above)).any(axis=1)]] = 0
        return clear_m

    def finish(self) -> Iterator[FrameObjects]:
        """Yield the objects of all frames that wait, and begin anew."""
        yield from self._end()
        self._tracker.forget()

    def _end(self) -> Iterator[FrameObjects]:
        yield from self._complete(np.inf)
        self._frames.clear()
        self._done = self._records = 0
        self._shapes = {}

    def _jumps(self, pose: Pose, time_s: float) -> bool:
        """Return whether the pose of the lidar changed by more than a vessel moves, as after a correction."""
        last = self._frames[-1]
        if pose.path != last.pose.path:
            return True
        elapsed_s = time_s - last.time_s
        turn = (pose.yaw - last.pose.yaw + np.pi) % (2 * np.pi) - np.pi
        moved_m = np.hypot(pose.x - last.pose.x, pose.y - last.pose.y)
        return bool(moved_m > _STEP_M + _FASTEST_MS * elapsed_s or abs(turn) > _STEP_RAD + _FASTEST_RAD_S * elapsed_s)

    def _move(self, pose: Pose) -> Iterator[FrameObjects]:
        """Yield the objects of all frames that wait, and go on in coordinates where the lidar has another pose."""
        last, shapes = self._frames[-1].pose, self._shapes
        yield from self._end()
        self._tracker.move(last, pose)
        turn = pose.yaw - last.yaw
        self._shapes = {track: replace(one, yaw=one.yaw + turn) for track, one in shapes.items() if one.yaw is not None}

    def _complete(self, until_s: float) -> Iterator[FrameObjects]:
        """Yield the objects of frames up to a time, and forget frames that are no context of later ones."""
        frames = list(self._frames)
        end = next((k for k, one in enumerate(frames) if one.time_s > until_s), len(frames))
        if end <= self._done:
            return
        yield from _smoothed(frames, self._done, end, self._shapes, self._origin_ns or 0)
        self._done = end
        while self._done and self._frames[0].time_s < until_s - self._context_s:
            self._records -= len(self._frames.popleft().seen)
            self._done -= 1
        alive = {track for one in self._frames for _, track in one.seen}
        self._shapes = {track: shape for track, shape in self._shapes.items() if track in alive}


@dataclass(frozen=True)
class _Lives:
    """What was measured of N tracks in F frames, as arrays that begin with the shape (F, N).

    ``places`` and their ``deviations`` are NaN where a track was not seen; ``yaws``, ``middles_m`` and ``tops_m``, its
    heights, are interpolated between. It is ``sure`` where it was kept and nothing shows that it hovers. Of each track,
    there are one of the ``sizes``, shape (N, 3), and one of the ``kinds``.
    """

    tracks: Sequence[Track]
    times_s: Floats
    places: Floats
    deviations: Floats
    yaws: Floats
    middles_m: Floats
    tops_m: Floats
    points: Ints
    sure: Mask
    sizes: Floats
    kinds: list[str]

    @classmethod
    def of(cls, frames: Sequence[_Waiting], shapes: dict[Track, Shape]) -> "_Lives":
        """Return the lives of all tracks in frames; what is known of their shapes grows."""
        records = _records(frames)
        shape = len(frames), len(records)
        times_s, sensor = np.array([one.time_s for one in frames]), np.array([one.pose[:2] for one in frames])
        places, sizes = np.full((*shape, 2), np.nan), np.empty((shape[1], 3))
        deviations, yaws, middles_m, tops_m = np.full((4, *shape), np.nan)
        points, sure = np.zeros(shape, np.int64), np.zeros(shape, np.bool_)
        lives = cls(list(records), times_s, places, deviations, yaws, middles_m, tops_m, points, sure, sizes, [])
        for n, (track, own) in enumerate(records.items()):
            seen = np.array([f for f, _ in own])
            found = [(frames[f], row) for f, row in own]
            lives._fill(n, found, seen, sensor[seen], shapes.setdefault(track, Shape()))
        return lives

    def _fill(self, n: int, own: Sequence[tuple[_Waiting, int]], seen: Ints, sensor: Floats, shape: Shape) -> None:
        """Fill in a track, given the frames in which it was seen, and its row in each."""
        names = "hulls", "outlines", "hidden", "spans", "rises", "points", "kept"
        hulls, outlines, hidden, spans, rises, points, kept = (
            np.array([getattr(f.found, name)[row] for f, row in own]) for name in names
        )
        misfits, clear_m = (np.array([getattr(f, name)[row] for f, row in own]) for name in ("misfits", "clear_m"))
        times_s = self.times_s[seen]
        fitted = fit(shape, outlines, hidden, misfits, sensor, times_s)
        yaws, self.places[seen, n], self.deviations[seen, n], size = fitted
        measured = yaws, spans.mean(axis=1), rises[:, 1]
        for values, some in zip((self.yaws, self.middles_m, self.tops_m), measured, strict=True):
            values[:, n] = np.interp(self.times_s, times_s, some)
        self.points[seen, n] = points
        self.sure[seen, n] = kept & (self.tracks[n].score >= _SURE) & (np.median(clear_m) <= _CLEAR_M)
        self.sizes[n] = with_hull(np.array((*size, np.quantile(spans[:, 1] - spans[:, 0], 0.9))))
        self.kinds.append(guessed_class(self.sizes[n], seen_depth_m(hulls, yaws)))


def _smoothed(
    frames: Sequence[_Waiting], start: int, end: int, shapes: dict[Track, Shape], origin_ns: int
) -> Iterator[FrameObjects]:
    """Yield the objects of frames from ``start`` to ``end``; the others are their context."""
    lives = _Lives.of(frames, shapes)
    at, velocity = smoothed(lives.places, lives.deviations, lives.times_s)
    velocity[:, np.isfinite(lives.places[..., 0]).sum(axis=0) < 2] = np.nan  # one place shows no motion
    bodies = np.array([kind != STRUCTURE for kind in lives.kinds], np.bool_)
    at[:, _are_parts(at[start:end], lives.yaws[start:end], lives.sizes, bodies)] = np.nan
    scores = np.array([track.score for track in lives.tracks])
    measured = np.array([shapes[track].oblique for track in lives.tracks], np.bool_)
    stamps = np.array([[round(t * 1e9) for t in (one.first_s, one.seen_s)] for one in lives.tracks], np.int64)
    for f in range(start, end):
        one = frames[f]
        there = np.flatnonzero(np.isfinite(at[f, :, 0]))
        seen = np.isfinite(lives.places[f, there, 0])
        xy = one.pose.undone(at[f, there])
        yield FrameObjects(
            one.index,
            one.stamp_ns,
            [lives.tracks[n].number for n in there.tolist()],
            np.where(~seen, LOST, np.where(lives.sure[f, there], CONFIRMED, CANDIDATE)).tolist(),
            np.column_stack((xy, lives.middles_m[f, there])),
            lives.sizes[there],
            (lives.yaws[f, there] - one.pose.yaw + np.pi) % (2 * np.pi) - np.pi,
            Pose(yaw=-one.pose.yaw).turned(velocity[f, there]),
            lives.points[f, there],
            scores[there],
            np.full(len(xy), np.nan) if one.water is None else one.water.heights(xy, lives.tops_m[f, there]),
            origin_ns + stamps.reshape(-1, 2)[there],
            measured[there],
            [lives.kinds[n] for n in there.tolist()],
            one.over_ground,
        )


def _records(frames: Sequence[_Waiting]) -> dict[Track, list[tuple[int, int]]]:
    """Return the frames in which each track was seen, and its row in each."""
    records: dict[Track, list[tuple[int, int]]] = {}
    for f, one in enumerate(frames):
        for row, track in one.seen:
            records.setdefault(track, []).append((f, row))
    return records


def _are_parts(at: Floats, yaws: Floats, sizes: Floats, bodies: Mask) -> Mask:
    """Return which of N tracks are parts of others, such as a mast: small, and almost always inside a larger box.

    Boxes of quays contain water, so only ``bodies``, shape (N,), have parts.
    """
    inside, together = (np.zeros((len(sizes), len(sizes))) for _ in range(2))
    half = sizes[:, :2] / 2
    for f in range(0, len(at), len(at) // _MOST_COMPARED + 1):
        x, y = (at[f, :, None] - at[f]).transpose(2, 0, 1)
        cos, sin = np.cos(yaws[f]), np.sin(yaws[f])
        inside += (np.abs(x * cos + y * sin) <= half[:, 0]) & (np.abs(y * cos - x * sin) <= half[:, 1])
        together += np.isfinite(x)
    area = sizes[:, 0] * sizes[:, 1]
    smaller = (area[:, None] < _PART_SHARE * area) & bodies
    return np.asarray((smaller & (inside > _MOSTLY * np.maximum(together, 1))).any(axis=1))
