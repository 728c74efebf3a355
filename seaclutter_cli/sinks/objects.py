"""Table of the objects of a recording, with a row for each frame and object."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from seaclutter_cli.frame import FilterResult
from seaclutter_cli.interfaces import Sink, Source
from seaclutter_cli.messages.navigation import Fix, Navigation, on_earth
from seaclutter_cli.records import Channel, Message, Record
from seaclutter_cli.sinks.csv import csv_lines
from seaclutter_cli.tracking.detections import Pose
from seaclutter_cli.tracking.follow import CONFIRMED, LOST, Follower, FrameObjects

COLUMNS = {
    "recording": str,
    "topic": str,
    "frame": int,
    "stamp_ns": int,
    "track_id": int,
    "state": str,
    **dict.fromkeys(("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad"), float),
    **dict.fromkeys(("speed_ms", "course_rad"), float),
    "velocity": str,
    "points": int,
    "score": float,
    "top_m": float,
    "sides": int,
    "class": str,
    "first_ns": int,
    "last_ns": int,
    **dict.fromkeys(("latitude_deg", "longitude_deg"), float),
}
"""Columns of the table and the types of their values; numbers with a fraction may be empty."""

OVER_GROUND, RELATIVE = "ground", "own_ship"


@dataclass
class TrackSummary:
    """A track as a whole: its class, the frames in which it was seen, size, greatest speed, and least distance."""

    topic: str
    track_id: int
    kind: str = ""
    frames: int = 0
    is_confirmed: bool = False
    length_m: float = 0.0
    width_m: float = 0.0
    height_m: float = 0.0
    nearest_m: float = math.inf
    speed_ms: float = 0.0
    score: float = 0.0
    over_ground: bool = False


class ObjectTable(Sink):
    """Sink that passes the lines of each frame, one for each object, to a function."""

    def __init__(self, write: Callable[[bytes], object], new: Callable[[], Follower]) -> None:
        self._write, self._new = write, new
        self._followers: dict[str, Follower] = {}
        self._recording, self._navigation = "", Navigation()
        self._fixes: dict[str, deque[Fix | None]] = {}
        self.indices: list[int] = []
        self.tracks: dict[tuple[str, int], TrackSummary] = {}

    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:
        """Start a recording."""
        self._recording, self._navigation = source.name, Navigation()
        self._followers = {channel.topic: self._new() for channel in clouds}
        self._fixes = {channel.topic: deque() for channel in clouds}

    def copy(self, record: Record) -> None:
        """Receive messages about own ship's motion."""
        if isinstance(record, Message):
            self._navigation.see(record)

    def write(self, result: FilterResult) -> None:
        """Follow the objects of a frame; write the rows of frames that are complete."""
        frame = result.frame
        self.indices.append(frame.index)
        # Objects are complete many seconds later; own ship is elsewhere then.
        fix = self._navigation.fix(frame.cloud.frame_id.lstrip("/"), frame.stamp_ns)
        self._fixes[frame.topic].append(fix)
        self._write_all(frame.topic, self._followers[frame.topic].add(result, pose_of(self._navigation, result)))

    def end(self) -> None:
        """Write the rows of all frames that are left."""
        for topic, follower in self._followers.items():
            self._write_all(topic, follower.finish())

    def _write_all(self, topic: str, frames: Iterable[FrameObjects]) -> None:
        for frame in frames:
            rows = rows_of(frame, self._fixes[topic].popleft())
            self._write(csv_lines((self._recording, topic, *row) for row in rows))
            self._sum_up(topic, frame)

    def _sum_up(self, topic: str, frame: FrameObjects) -> None:
        distances, speeds = (np.hypot(*each.T).tolist() for each in (frame.centers[:, :2], frame.velocities))
        columns = frame.sizes.round(2).tolist(), distances, speeds, frame.scores.tolist()
        objects = zip(frame.tracks, frame.states, frame.kinds, *columns, strict=True)
        for track, state, kind, size, distance_m, speed_ms, score in objects:
            one = self.tracks.setdefault((topic, track), TrackSummary(topic, track))
            one.frames += state != LOST
            one.is_confirmed |= state == CONFIRMED
            one.length_m, one.width_m, one.height_m = size
            one.nearest_m = min(one.nearest_m, round(distance_m, 1))
            one.speed_ms = max(one.speed_ms, round(speed_ms, 2))
            one.kind, one.score, one.over_ground = kind, round(score, 3), frame.over_ground


def pose_of(navigation: Navigation, result: FilterResult) -> Pose | None:
    """Return the pose of the lidar in a frame; None if it is not known."""
    frame = result.frame
    pose = navigation.pose(frame.cloud.frame_id.lstrip("/"), frame.stamp_ns)
    return Pose(*pose) if pose else None


def rows_of(frame: FrameObjects, fix: Fix | None) -> Iterable[Sequence[object]]:
    """Return the rows of the objects of a frame, from the column ``frame`` on; to a millimetre or a thousandth.

    The place of the lidar on earth is given if it is known.
    """
    speed, course = np.hypot(*frame.velocities.T), np.arctan2(frame.velocities[:, 1], frame.velocities[:, 0])
    numbers = np.column_stack((frame.centers, frame.sizes, frame.yaws, speed, course)).round(3) + 0.0
    tops = [round(top, 3) if np.isfinite(top) else "" for top in frame.tops_m.tolist()]
    places = on_earth(fix, frame.centers[:, :2]).round(8).tolist() if fix else [("", "")] * len(tops)
    velocity = OVER_GROUND if frame.over_ground else RELATIVE
    each = zip(
        frame.tracks,
        frame.states,
        numbers.tolist(),
        frame.points.tolist(),
        frame.scores.round(3).tolist(),
        tops,
        (1 + frame.measured).tolist(),
        frame.kinds,
        frame.spans_ns.tolist(),
        places,
        strict=True,
    )
    for track, state, values, points, score, top, sides, kind, span, place in each:
        yield (
            *(frame.index, frame.stamp_ns, track, state, *values, velocity),
            *(points, score, top, sides, kind, *span, *place),
        )
