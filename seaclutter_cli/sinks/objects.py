"""Objects of recordings: tables of them over time, as CSV, Parquet and GeoJSON, and messages with those of a frame."""

import csv
import json
import math
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from seaclutter_cli.arrays import Floats
from seaclutter_cli.errors import InputError, UsageError, requiring
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.interfaces import Sink, Source
from seaclutter_cli.messages.definitions import Content
from seaclutter_cli.messages.navigation import Fix, Navigation, on_earth
from seaclutter_cli.messages.scene import SceneBox, SceneTrack, detections
from seaclutter_cli.messages.transforms import STALE_NS
from seaclutter_cli.records import Channel, Record
from seaclutter_cli.sinks.csv import csv_line, csv_lines
from seaclutter_cli.tracking.detections import Pose
from seaclutter_cli.tracking.follow import CANDIDATE, CONFIRMED, LOST, Follower, FrameObjects

_CONTEXT_S = 2.0
_COLORS = {CONFIRMED: "#f4a261", CANDIDATE: "#8d99ae", LOST: "#8d99ae"}
_ROWS_AT_ONCE = 20_000
_STEP_NS = 1_000_000_000
_MOST_HELD = 1_000_000
"""Number of points of the frames that wait for a pose."""
_SPAN_NS, _METRES = 5_000_000_000, 111_320.0  # of a degree of latitude
_FEWEST, _FEWEST_FRAMES, _MOVES_MS, _APART = 4, 20, 1.0, 0.3
_ROUNDS, _COMMON = 3, 0.75
_PROPERTIES = ("recording", "topic", "track_id", "class", "length_m", "width_m", "height_m")

COLUMNS = {
    "recording": str,
    "topic": str,
    "frame": int,
    "stamp_ns": int,
    "track_id": int,
    "state": str,
    **dict.fromkeys(
        ("x_m", "y_m", "z_m", "length_m", "width_m", "height_m", "yaw_rad", "speed_ms", "course_rad"), float
    ),
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
    """A track as a whole: its class, the frames in which it was seen, size, least distance, and greatest speed."""

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


class _CommonMotion:
    """In how many frames the objects move alike, as they do where own ship's pose, or heading, is wrong.

    These are frames in which most of at least four objects are faster than 1 m/s, and a rigid motion of the three
    quarters that move most alike leaves less than a third of that.
    """

    def __init__(self) -> None:
        self._frames = self._alike = 0

    @property
    def is_usual(self) -> bool:
        """Whether it is so in most frames."""
        return self._frames >= _FEWEST_FRAMES and 2 * self._alike > self._frames

    def add(self, places: Floats, velocities: Floats) -> None:
        """Add the places and velocities of the objects of a frame, shape (N, 2)."""
        if len(places) < _FEWEST:
            return
        (x, y), velocity = (places - places.mean(axis=0)).T, velocities.T
        one, none = np.ones_like(x), np.zeros_like(x)
        motion = np.array([(one, none), (none, one), (-y, x)])
        common = np.arange(len(places))
        for _ in range(_ROUNDS):
            some = motion[:, :, common].reshape(3, -1).T
            fitted = np.linalg.lstsq(some, velocity[:, common].ravel(), rcond=None)[0]
            left = np.hypot(*(velocity - np.tensordot(fitted, motion, 1)))
            common = np.argsort(left, kind="stable")[: max(_FEWEST, math.ceil(_COMMON * len(places)))]
        speed_ms, left_ms = (float(np.median(each)) for each in (np.hypot(*velocity), left))
        self._frames += 1
        self._alike += speed_ms > _MOVES_MS and left_ms < _APART * speed_ms


class ObjectTable(Sink):
    """Sink that passes the lines of each frame, one for each object, to a function."""

    def __init__(self, write: Callable[[bytes], object], new: Callable[[], Follower]) -> None:
        self._write, self._new = write, new
        self.indices: list[int] = []
        self.tracks: dict[tuple[str, int], TrackSummary] = {}
        self.states: Counter[tuple[str, str]] = Counter()

    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:
        """Start a recording."""
        self._source, self._navigation, self._unplaced, self._unmoved = source, Navigation(), 0, 0
        self._followers = {channel.topic: self._new() for channel in clouds}
        self._fixes: dict[str, deque[Fix | None]] = {channel.topic: deque() for channel in clouds}
        self._why_unmoved, self._held = "", deque[FilterResult]()
        self._past: dict[str, deque[tuple[int, Mapping[int, Floats]]]] = {one: deque() for one in self._followers}
        self._over_ground, self._on_earth = _CommonMotion(), _CommonMotion()

    def copy(self, record: Record) -> None:
        """Receive messages about own ship's motion."""
        self._navigation.see(record)

    def write(self, result: FilterResult) -> None:
        """Follow the objects of a frame; write the rows of frames that are complete."""
        self.indices.append(result.frame.index)
        self._held.append(result)
        while self._held and not self._waits(result.frame.log_time_ns):
            self._follow(self._held.popleft())

    def _waits(self, now_ns: int) -> bool:
        """Return whether the first frame that is held waits for the pose or the fix of own ship that follows it."""
        first = self._held[0]
        is_late = now_ns - first.frame.log_time_ns > STALE_NS
        if is_late or sum(one.frame.size for one in self._held) > _MOST_HELD:
            return False
        if self._navigation.awaits_fix(first.frame.stamp_ns):
            return True
        return pose_of(self._navigation, first, 0) is None and pose_of(self._navigation, first) is not None

    def _follow(self, result: FilterResult) -> None:
        frame, topic = result.frame, result.frame.topic
        # Objects are complete many seconds later; own ship is elsewhere then.
        fix = self._navigation.fix(frame.cloud.frame_id.lstrip("/"), frame.stamp_ns)
        self._fixes[topic].append(fix)
        self._unplaced += fix is None
        pose = pose_of(self._navigation, result)
        if pose is None and self._navigation.unmoved:
            self._unmoved, self._why_unmoved = self._unmoved + 1, self._navigation.unmoved
        self._write_all(topic, self._followers[topic].add(result, pose))

    def end(self) -> None:
        """Write the rows of all frames that are left."""
        for result in self._held:
            self._follow(result)
        for topic, follower in self._followers.items():
            self._write_all(topic, follower.finish())
        for missing, what, why in (
            (self._unplaced, "no place on earth is known", self._navigation.unplaced),
            (self._unmoved, "speeds are relative to own ship, whose motion is not known,", self._why_unmoved),
        ):
            if missing and why:
                self._source.warn(f"{what} for {missing:,} of {len(self.indices):,} frames: {why}")
        for text in self._navigation.ambiguities:
            self._source.warn(text)
        alike, turned = "are doubtful: most objects seem to move alike; check that", "a transform to the lidar"
        if self._over_ground.is_usual:
            axes = "own ship's odometry or /tf has its axes forward, left and up, a heading"
            self._source.warn(f"speeds over ground {alike} {axes}, and {turned}")
        if self._on_earth.is_usual:
            axes = "yaw counts from east, counter-clockwise (REP 145)"
            self._source.warn(f"places on earth {alike} {axes}, and that there is {turned}")

    def _write_all(self, topic: str, frames: Iterable[FrameObjects]) -> None:
        for frame in frames:
            fix = self._fixes[topic].popleft()
            rows = rows_of(frame, fix)
            self._write(csv_lines((self._source.name, topic, *row) for row in rows))
            self._sum_up(topic, frame)
            self._see_motion(topic, frame, fix)

    def _see_motion(self, topic: str, frame: FrameObjects, fix: Fix | None) -> None:
        """Compare the motions of confirmed objects with each other, and their places on earth with earlier ones."""
        seen = np.flatnonzero([state == CONFIRMED for state in frame.states])
        moving = seen[np.isfinite(frame.velocities[seen, 0])] if frame.over_ground else seen[:0]
        self._over_ground.add(frame.centers[moving, :2], frame.velocities[moving])
        if fix is None:
            return
        metres = _METRES * np.array((1, math.cos(math.radians(fix.latitude_deg))))
        places = on_earth(fix, frame.centers[seen, :2]) * metres
        now, past = dict(zip([frame.tracks[n] for n in seen.tolist()], places, strict=True)), self._past[topic]
        if past and frame.stamp_ns < past[-1][0]:
            past.clear()
        past.append((frame.stamp_ns, now))
        while past and (elapsed_ns := frame.stamp_ns - past[0][0]) >= _SPAN_NS:
            _, old = past.popleft()
            both = [track for track in now if track in old]
            at, before = (np.array([one[track] for track in both]).reshape(-1, 2) for one in (now, old))
            self._on_earth.add(at, (at - before) / (elapsed_ns / 1e9))

    def _sum_up(self, topic: str, frame: FrameObjects) -> None:
        self.states.update((topic, state) for state in frame.states)
        distances, speeds = (np.hypot(*each.T).tolist() for each in (frame.centers[:, :2], frame.velocities))
        columns = frame.sizes.round(2).tolist(), distances, speeds, frame.scores.tolist()
        objects = zip(frame.tracks, frame.states, frame.kinds, *columns, strict=True)
        for track, state, kind, size, distance_m, speed_ms, score in objects:
            one = self.tracks.setdefault((topic, track), TrackSummary(topic, track))
            one.frames += state != LOST
            one.is_confirmed |= state == CONFIRMED
            one.length_m, one.width_m, one.height_m = size
            one.nearest_m = min(one.nearest_m, round(distance_m, 1))
            one.kind, one.score = kind, round(score, 3)
            if speed_ms >= one.speed_ms:
                one.speed_ms, one.over_ground = round(speed_ms, 2), frame.over_ground


def pose_of(navigation: Navigation, result: FilterResult, late_ns: int = STALE_NS) -> Pose | None:
    """Return the pose of the lidar in a frame; None if it is not known within a time."""
    frame = result.frame
    pose = navigation.pose(frame.cloud.frame_id.lstrip("/"), frame.stamp_ns, late_ns)
    return Pose(*pose, navigation.path) if pose else None


def rows_of(frame: FrameObjects, fix: Fix | None) -> Iterable[Sequence[object]]:
    """Return the rows of the objects of a frame, from the column ``frame`` on; to a millimetre or a thousandth.

    The place of the lidar on earth is given if it is known.
    """
    speed, course = np.hypot(*frame.velocities.T), np.arctan2(frame.velocities[:, 1], frame.velocities[:, 0])
    numbers = np.column_stack((frame.centers, frame.sizes, frame.yaws, speed, course, frame.tops_m)).round(3) + 0.0
    cells = [["" if math.isnan(value) else value for value in row] for row in numbers.tolist()]
    places = on_earth(fix, frame.centers[:, :2]).round(8).tolist() if fix else [("", "")] * len(cells)
    velocity, scores = OVER_GROUND if frame.over_ground else RELATIVE, frame.scores.round(3).tolist()
    points, sides, spans = frame.points.tolist(), (1 + frame.measured).tolist(), frame.spans_ns.tolist()
    for k, (*values, top) in enumerate(cells):
        yield (
            *(frame.index, frame.stamp_ns, frame.tracks[k], frame.states[k], *values, velocity),
            *(points[k], scores[k], top, sides[k], frame.kinds[k], *spans[k], *places[k]),
        )


class LiveObjects:
    """Objects of each frame, known without later frames.

    Ids are those of `ObjectTable` where own ship's pose is known at once; other values are less exact.
    """

    def __init__(self, new: Callable[..., Follower]) -> None:
        self._new = partial(new, context_s=_CONTEXT_S, live=True)
        self._followers: dict[str, Follower] = {}
        self._navigation = Navigation()
        self._shown: dict[str, set[str]] = {}
        self._last: tuple[FilterResult, FrameObjects] | None = None

    def copy(self, record: Record) -> None:
        """Receive messages about own ship's motion."""
        self._navigation.see(record)

    def of(self, result: FilterResult) -> FrameObjects:
        """Return the objects of a frame; call it for each frame, in order."""
        if self._last is None or self._last[0] is not result:
            follower = self._followers.setdefault(result.frame.topic, self._new())
            *_, found = follower.add(result, pose_of(self._navigation, result))
            self._last = result, found
        return self._last[1]

    def tracks(self, result: FilterResult) -> tuple[Mapping[str, SceneTrack], Sequence[str]]:
        """Return the objects of a frame by the ids of their entities, and the ids of those that are no longer there."""
        topic = result.frame.topic
        found = {f"{topic} object {one.name}": one for one in _tracks(self.of(result))}
        gone = sorted(self._shown.get(topic, set()) - set(found))
        self._shown[topic] = set(found)
        return found, gone

    def detections(self, result: FilterResult) -> Content:
        """Return the objects of a frame as a message."""
        return detections(result.frame.stamp_ns, result.frame.cloud.frame_id, _tracks(self.of(result)))


def _tracks(frame: FrameObjects) -> list[SceneTrack]:
    scores, velocities, tracks = frame.scores.tolist(), np.nan_to_num(frame.velocities).tolist(), []
    boxes = zip(frame.centers.tolist(), frame.sizes.tolist(), frame.yaws.tolist(), strict=True)
    for k, (center, size, yaw) in enumerate(boxes):
        number, state, (vx, vy) = frame.tracks[k], frame.states[k], velocities[k]
        text = f"{number}: {(vx * vx + vy * vy) ** 0.5:.1f} m/s" if state == CONFIRMED else f"{number}: {state}"
        box = SceneBox(center, size, yaw, _COLORS[state], text)
        tracks.append(SceneTrack(str(number), state, scores[k], box, (vx, vy)))
    return tracks


def check_objects_file(path: Path | None) -> None:
    """Raise `UsageError` if no format has the suffix, `MissingExtraError` if a library is missing."""
    if path is None:
        return
    if path.suffix.lower() not in OBJECT_FILES:
        raise UsageError(f"{path}: a table of objects must end in {', '.join(OBJECT_FILES)}")
    if path.suffix.lower() == ".parquet":
        _pyarrow()


def write_objects(path: Path, stream: BinaryIO, lines: Iterable[bytes]) -> None:
    """Write the lines of a table, without its head, to a file in the format of its name."""
    OBJECT_FILES[path.suffix.lower()](stream, lines)


def parsed(lines: Iterable[bytes]) -> Iterator[list[Any]]:
    """Yield the values of the rows of a table, given its lines; None for empty cells of numbers."""
    kinds = list(COLUMNS.values())
    for row in csv.reader(line.decode(errors="surrogateescape") for line in lines):
        yield [kind(cell) if cell or kind is str else None for kind, cell in zip(kinds, row, strict=True)]


def rows_as_mappings(lines: Iterable[bytes]) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table by column, given its lines."""
    return (dict(zip(COLUMNS, values, strict=True)) for values in parsed(lines))


def _pyarrow() -> Any:
    with requiring("Parquet", "parquet"):
        import pyarrow.parquet  # takes 0.3 s, rarely needed
    return pyarrow


def _write_parquet(stream: BinaryIO, lines: Iterable[bytes]) -> None:
    arrow = _pyarrow()
    types = {str: arrow.string(), int: arrow.int64(), float: arrow.float64()}
    schema = arrow.schema([(name, types[kind]) for name, kind in COLUMNS.items()])
    # Text in Parquet is UTF-8.
    rows = rows_as_mappings(line.decode(errors="surrogateescape").encode(errors="replace") for line in lines)
    with arrow.parquet.ParquetWriter(stream, schema) as writer:
        while block := list(islice(rows, _ROWS_AT_ONCE)):
            writer.write_table(arrow.Table.from_pylist(block, schema))


def _write_geojson(stream: BinaryIO, lines: Iterable[bytes]) -> None:
    """Write the tracks that were confirmed and whose positions on earth are known, with a position each second."""
    tracks: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in rows_as_mappings(lines):
        if row["latitude_deg"] is None or row["state"] != CONFIRMED:
            continue
        key = row["recording"], row["topic"], row["track_id"]
        new: dict[str, Any] = {**dict.fromkeys(_PROPERTIES), "stamps_ns": [], "speeds_ms": [], "places": []}
        track = tracks.setdefault(key, new)
        track |= {name: row[name] for name in _PROPERTIES}
        if not track["stamps_ns"] or row["stamp_ns"] - track["stamps_ns"][-1] >= _STEP_NS:
            track["stamps_ns"].append(row["stamp_ns"])
            track["speeds_ms"].append(row["speed_ms"])
            track["places"].append([row["longitude_deg"], row["latitude_deg"]])
    if not tracks:
        raise InputError(
            "GeoJSON: no position on earth is known; the log needs sensor_msgs/NavSatFix and sensor_msgs/Imu with the "
            "heading, or /tf from the lidar to the frame earth"
        )
    features = [_feature(track.pop("places"), track) for track in tracks.values()]
    stream.write(json.dumps({"type": "FeatureCollection", "features": features}).encode() + b"\n")


def _feature(places: Sequence[Any], properties: Mapping[str, Any]) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": places}
    if len(places) == 1:
        geometry = {"type": "Point", "coordinates": places[0]}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


OBJECT_FILES: Mapping[str, Callable[[BinaryIO, Iterable[bytes]], None]] = {
    ".csv": lambda stream, lines: stream.writelines(chain([csv_line(COLUMNS)], lines)),
    ".parquet": _write_parquet,
    ".geojson": _write_geojson,
}
"""Writers by the suffixes of files. To add a format, add a line here."""
