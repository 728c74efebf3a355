"""Own ship's motion from the topics of a log: transforms, odometry and poses; positions on earth from fixes."""

import math
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from seaclutter_cli.arrays import Floats
from seaclutter_cli.cloud import rotation
from seaclutter_cli.errors import CloudError
from seaclutter_cli.frame import Attitude
from seaclutter_cli.messages.definitions import full_name
from seaclutter_cli.messages.serialisation import Reader, reader_of
from seaclutter_cli.messages.transforms import CONTINUOUS, STALE_NS, Edge, Sample, best, last_name, product
from seaclutter_cli.records import Channel, Message, Record

_MAX_TRANSFORMS = 1000
_MAX_EDGES, _MAX_DEPTH, _MAX_TOPICS = 256, 32, 16
_KEPT_TURNS, _GAP_NS = 2048, 500_000_000
_DIFFERENT_M, _DIFFERENT_RAD, _DIFFERENT_TIMES = 0.3, math.radians(2), 10
_UNSET = (0.0, 0.0, 0.0, 1.0)
_POSITION = "position in sensor_msgs/NavSatFix"
_HEADING = "heading, which is the orientation in sensor_msgs/Imu (0, 0, 0, 1 counts as unset)"
_UPRIGHT = 0.5
_BODY = ""
"""Frame of poses that name none: the lidar, or own ship where transforms lead from the lidar to no other frame."""
_EARTH = "earth"
_EQUATOR_M, _SQUARED_ECCENTRICITY = 6_378_137.0, 6.69437999014e-3


class _Gyro:
    """Orientations of an IMU, measured, or integrated from angular velocities if the first message has none."""

    def __init__(self, topic: str, frame_id: str, *, is_measured: bool) -> None:
        self.topic, self.frame_id, self._is_measured = topic, frame_id, is_measured
        self.breaks = 0
        self.edge = Edge("", topic, deque(maxlen=_KEPT_TURNS), moves=True)
        self._rate = np.zeros(3)

    def add(self, stamp_ns: int, turn: Floats | None, rate: Floats) -> None:
        """Add an orientation, None if it is not set, and an angular velocity; after a gap, it begins again."""
        known = self.edge.samples
        elapsed_ns = stamp_ns - known[-1].stamp_ns if known else 0
        if abs(elapsed_ns) > _GAP_NS:
            known.clear()
            self.breaks += 1
        elif known and elapsed_ns <= 0:
            return
        if not self._is_measured:
            if not np.isfinite(rate).all():
                return
            turn = known[-1].turn if known else np.array(_UNSET)
            vector = (rate + self._rate) / 2 * (elapsed_ns / 1e9)
            angle, self._rate = float(np.linalg.norm(vector)), rate
            if known and angle:
                turn = product(turn, np.array([*(math.sin(angle / 2) / angle * vector), math.cos(angle / 2)]))
        if turn is not None:
            known.append(Sample(stamp_ns, np.zeros(3), turn))


class _Chain(NamedTuple):
    """Position and orientation of a frame in a fixed one, whether transforms tell that it is elsewhere, and by which.

    ``path`` are those, as pairs of a topic and a number of corrections.
    """

    at: Floats
    turn: Floats
    fixed: str
    travels: bool
    path: tuple[tuple[str, int], ...]


class Fix(NamedTuple):
    """Position on earth in degrees, and heading as the yaw of the x axis from east to north, in radians."""

    latitude_deg: float
    longitude_deg: float
    yaw: float


class Navigation:
    """Own ship's motion, as far as the messages so far tell.

    Transforms come from ``tf2_msgs/TFMessage`` and ``nav_msgs/Odometry``, a pose of own ship from
    ``geometry_msgs/PoseStamped``, a position on earth from ``sensor_msgs/NavSatFix`` with the orientation of a
    ``sensor_msgs/Imu``, or from transforms to the frame ``earth``. Where several topics tell the transform of a frame,
    one that moves it counts, of these one of ``/tf``, then one to the frame ``odom``, then the first; of fixes and
    orientations, the topic that begins first.
    """

    def __init__(self) -> None:
        self._edges: dict[str, list[Edge]] = {}
        self._lacking, self._has_fixes, self._unmoved, self._refused = "", False, "", ""
        self._places, self._antenna = Edge(_EARTH), ""
        self._imu: tuple[int, Floats, str, str] | None = None
        self._gyro: _Gyro | None = None
        self._fixes_on: list[str] = []
        self._turns_on: list[str] = []
        self._differ: Counter[tuple[str, str]] = Counter()
        self._children: dict[str, str] = {}
        self._strangers: dict[str, str] = {}
        self.path: tuple[tuple[str, int], ...] = ()
        """Topics of the transforms of the last pose, and how often each was corrected; if they change, it steps."""

    @staticmethod
    def tells_attitude(channel: Channel) -> bool:
        """Return whether messages of a channel tell own ship's attitude."""
        name = full_name(channel.schema.name) if channel.schema else ""
        return name in _READERS and _READERS[name] is not Navigation._satellites

    def see(self, record: Record) -> None:
        """Receive a record of any topic; messages that cannot be read are left out."""
        if not isinstance(record, Message) or record.channel.message_encoding not in ("cdr", "ros1"):
            return
        read = _READERS.get(full_name(record.channel.schema.name)) if record.channel.schema else None
        if read is not None:
            with suppress(CloudError):
                read(self, reader_of(record), record)

    def pose(self, frame_id: str, stamp_ns: int, late_ns: int = STALE_NS) -> tuple[float, float, float] | None:
        """Return position and yaw of a frame in one that is fixed, in metres and radians; None if it is not known.

        It is known between two messages, and for some time before the first and behind the last.
        """
        found = self._in_fixed(frame_id, stamp_ns, CONTINUOUS, late_ns)
        if isinstance(found, str):
            self._unmoved = found
            return None
        axes = rotation(*found.turn)
        if not found.travels or axes[2, 2] < _UPRIGHT:  # positions seen from above would be mirrored
            why = "is not upright" if found.travels else "turns, but does not move,"
            self._unmoved = f"the lidar {why} in '{found.fixed}'"
            return None
        self.path = found.path
        return float(found.at[0]), float(found.at[1]), math.atan2(axes[1, 0], axes[0, 0])

    def attitude(self, frame_id: str, stamp_ns: int) -> Attitude | None:
        """Return the attitude of a frame, from an IMU if there is one, else from transforms; None if it is not known.

        The axes of an IMU are those of the frame, or y and z are opposite ones if it is upside down, unless transforms
        between them tell others.
        """
        name, gyro = _plain(frame_id), self._gyro
        if gyro is not None and gyro.edge.samples and stamp_ns - gyro.edge.samples[-1].stamp_ns < _GAP_NS:
            sample = gyro.edge.at(stamp_ns, 0)
            if sample is None or len(gyro.edge.samples) == 1:
                return None
            return Attitude(self._axes(name, gyro.frame_id, sample.turn), (gyro.topic, gyro.frame_id, gyro.breaks))
        found = self._in_fixed(name, stamp_ns, CONTINUOUS, late_ns=0)
        if isinstance(found, str):
            return None
        return Attitude(rotation(*found.turn), ("transforms", found.fixed, sum(breaks for _, breaks in found.path)))

    def _axes(self, name: str, imu: str, turn: Floats) -> Floats:
        """Return the axes of a frame, given the orientation of an IMU."""
        (root, _, to_root), (other, _, from_imu) = self._mounted(name), self._mounted(imu)
        axes = rotation(*turn)
        if root == other:
            return np.asarray(axes @ from_imu.T @ to_root)
        return axes @ np.diag((1.0, -1.0, -1.0)) if axes[2, 2] < 0 else axes  # its z axis is down

    def _mounted(self, name: str) -> tuple[str, Floats, Floats]:
        """Return the topmost frame to which fixed transforms lead from a frame, and the position and axes in it."""
        at, axes = np.zeros(3), np.eye(3)
        for _ in range(_MAX_DEPTH):
            fixed = next((edge for edge in self._edges.get(name, ()) if not edge.moves), None)
            if fixed is None:
                break
            turn = rotation(*fixed.samples[-1].turn)
            name, at, axes = fixed.parent, turn @ at + fixed.samples[-1].at, turn @ axes
        return name, at, axes

    def fix(self, frame_id: str, stamp_ns: int) -> Fix | None:
        """Return where on earth a frame is; None if it is not known.

        The antenna is at its origin, unless fixed transforms tell where it is.
        """
        found = self._in_fixed(frame_id, stamp_ns, _EARTH)
        if not isinstance(found, str) and found.fixed == _EARTH:
            return _from_earth(found.at, rotation(*found.turn))
        places = self._places.samples
        lacks = self._lacks(stamp_ns, places[-1] if places else None)
        self._lacking = lacks or self._lacking
        place = None if lacks else self._places.at(min(max(stamp_ns, places[0].stamp_ns), places[-1].stamp_ns))
        if place is None or self._imu is None:
            return None
        axes, (x, y, z) = self._axes(_plain(frame_id), self._imu[3], self._imu[1]), place.at.tolist()
        north, east = math.atan2(z, math.hypot(x, y)), math.atan2(y, x)
        fix = Fix(math.degrees(north), math.degrees(east), math.atan2(axes[1, 0], axes[0, 0]))
        (root, at, to_root), (other, antenna, _) = self._mounted(_plain(frame_id)), self._mounted(self._antenna)
        if root != other or (at == antenna).all():
            return fix
        lever = axes @ to_root.T @ (at - antenna)
        north, east = on_earth(fix._replace(yaw=0.0), lever[None, :2])[0].tolist()
        return fix._replace(latitude_deg=north, longitude_deg=east)

    def awaits_fix(self, stamp_ns: int) -> bool:
        """Return whether a fix is known shortly before a time, and none after it."""
        return bool(self._places.samples) and 0 < stamp_ns - self._places.samples[-1].stamp_ns < STALE_NS

    @property
    def unmoved(self) -> str:
        """Why a pose was not known last; empty if all were, or if nothing in the log moves."""
        return self._unmoved if any(edge.moves for edges in self._edges.values() for edge in edges) else self._refused

    @property
    def ambiguities(self) -> list[str]:
        """Warnings about topics that may not be own ship's, or that differ."""
        found = [
            f"{used} and {other} tell different poses of own ship; that of {used} is used"
            for (used, other), times in self._differ.items()
            if times >= _DIFFERENT_TIMES
        ]
        found += [
            f"poses of '{child}' on {topic} are taken for own ship's, but no transform leads there from the lidar"
            for topic, child in self._strangers.items()
        ]
        for what, topics in ("fixes", self._fixes_on), ("headings", self._turns_on if self._fixes_on else []):
            if len(topics) > 1:
                used, *others = topics
                found.append(f"{what} on {used} are taken for own ship's, not those on {', '.join(others)}")
        return found

    @property
    def unplaced(self) -> str:
        """What a place on earth lacked last; empty if nothing, or if the log has no fixes."""
        return self._lacking if self._has_fixes else ""

    def _lacks(self, stamp_ns: int, place: Sample | None) -> str:
        """Return what a place on earth lacks at a time; empty if nothing."""
        for known, name in (place, _POSITION), (self._imu, _HEADING):
            if known is None:
                return f"no {name}"
            if abs(stamp_ns - known[0]) > 2 * STALE_NS:
                return f"no {name}, within two seconds"
        return ""

    def _in_fixed(self, frame_id: str, stamp_ns: int, preferred: str, late_ns: int = STALE_NS) -> _Chain | str:
        """Return position and orientation in the fixed frame; or why they are not known."""
        at, turn, name, moves, travels = np.zeros(3), np.array(_UNSET), frame_id, False, False
        path: tuple[tuple[str, int], ...] = ()
        of_body = self._edges.get(_BODY, [])
        for _ in range(_MAX_DEPTH):
            edges = self._edges.get(name) or of_body
            edge = best(edges, stamp_ns)
            if edge is None or (moves and last_name(name).startswith(preferred)):
                found = _Chain(at, turn, name, travels, path)
                return found if moves else f"no transform leads from '{name}' to a fixed frame"
            if edge.parent == name:  # own ship's pose is in this frame, so it is fixed, as after registration
                return _Chain(at, turn, name, True, path)
            if (sample := edge.at(stamp_ns, late_ns)) is None:
                return f"no transform from '{name}' to '{edge.parent}' within a second of the cloud"
            self._compare(edge, edges, sample)
            if edges is of_body and path and edge.topic in self._children:
                self._strangers[edge.topic] = self._children[edge.topic]
            at, turn = rotation(*sample.turn) @ at + sample.at, product(sample.turn, turn)
            moves, travels = moves or edge.moves, travels or edge.travels
            name, path = edge.parent, (*path, (edge.topic, edge.breaks))
            of_body = [] if travels or edges is of_body else of_body
        return f"transforms lead from '{frame_id}' in a circle"

    def _compare(self, used: Edge, edges: Sequence[Edge], sample: Sample) -> None:
        """Count how often other topics tell a different pose in the same frame."""
        for other in edges:
            told = other.at(sample.stamp_ns, 0) if other.travels and other.parent == used.parent else None
            if told is not None and not told.is_at(sample, _DIFFERENT_M, _DIFFERENT_RAD):
                self._differ[used.topic, other.topic] += 1

    def _add(self, parent: str, child: str, sample: Sample, topic: str, *, is_motion: bool = False) -> None:
        size = np.linalg.norm(sample.turn)
        if not (np.isfinite(sample.at).all() and np.isfinite(size) and size > 0):
            self._refused = f"a position or orientation on {topic} is not valid"
            return
        edges = self._edges.get(child, [])
        edge = next((one for one in edges if (one.parent, one.topic) == (parent, topic)), None)
        if edge is None:
            if child == parent or len(self._edges) >= _MAX_EDGES or len(edges) >= _MAX_TOPICS:
                return
            edge = Edge(parent, topic)
            self._edges[child] = [*edges, edge]
        sample = sample._replace(turn=sample.turn / size)
        if last_name(topic) == "tf_static":
            edge.put(sample)
        else:
            edge.add(sample, is_motion=is_motion)

    def _transforms(self, read: Reader, message: Message) -> None:
        for _ in range(read.length(_MAX_TRANSFORMS, "transform")):
            head, child = read.header(), read.text()
            sample = _sample(read, head.stamp_ns or message.log_time_ns)
            self._add(_plain(head.frame_id), _plain(child), sample, message.channel.topic)

    def _odometry(self, read: Reader, message: Message) -> None:
        head, child, topic = read.header(), _plain(read.text()), message.channel.topic
        sample = _sample(read, head.stamp_ns or message.log_time_ns)
        self._add(_plain(head.frame_id), child, sample, topic, is_motion=True)
        if any(edge.parent == child for edges in self._edges.values() for edge in edges):
            self._edges[_BODY] = [edge for edge in self._edges.get(_BODY, []) if edge.topic != topic]
            return
        self._children[topic] = child
        # No transform leads there from the lidar, whose axes are taken for these.
        self._add(_plain(head.frame_id), _BODY, sample, topic, is_motion=True)

    def _pose(self, read: Reader, message: Message) -> None:
        head = read.header()
        sample = _sample(read, head.stamp_ns or message.log_time_ns)
        self._add(_plain(head.frame_id), _BODY, sample, message.channel.topic)

    def _satellites(self, read: Reader, message: Message) -> None:
        head, (status, _), (north, east, _) = read.header(), (read.number("b"), read.number("H")), read.numbers("ddd")
        self._has_fixes = True
        is_set = status >= 0 and abs(north) <= 90 and abs(east) <= 180 and (north or east)  # 0, 0 is unset
        if is_set and _note(self._fixes_on, message)[0] == message.channel.topic:
            stamp_ns, turn = head.stamp_ns or message.log_time_ns, np.array(_UNSET)
            self._antenna = _plain(head.frame_id)
            # On a sphere, whose distances are those on earth to a percent.
            self._places.add(Sample(stamp_ns, _EQUATOR_M * _up(math.radians(north), math.radians(east)), turn))

    def _orientation(self, read: Reader, message: Message) -> None:
        head, turn = read.header(), np.array(read.numbers("dddd"))
        unknown, rate = read.numbers("d" * 9)[0] == -1, np.array(read.numbers("ddd"))
        stamp_ns, topic = head.stamp_ns or message.log_time_ns, message.channel.topic
        size = np.linalg.norm(turn)
        is_known = bool(not unknown and np.isfinite(size) and size > 0)
        is_set = is_known and tuple(turn) != _UNSET  # drivers leave it as it is
        if is_set and _note(self._turns_on, message)[0] == topic:
            self._imu = stamp_ns, turn / size, topic, _plain(head.frame_id)
        if self._gyro is None and (is_set or np.isfinite(rate).all()):
            self._gyro = _Gyro(topic, _plain(head.frame_id), is_measured=is_set)
        if self._gyro is not None and self._gyro.topic == topic:
            self._gyro.add(stamp_ns, turn / size if is_set else None, rate)


def _note(topics: list[str], message: Message) -> list[str]:
    """Return topics, with that of a message if there are few."""
    if message.channel.topic not in topics and len(topics) < _MAX_TOPICS:
        topics.append(message.channel.topic)
    return topics


_READERS: dict[str, Callable[[Navigation, Reader, Message], None]] = {
    "tf2_msgs/msg/TFMessage": Navigation._transforms,  # noqa: SLF001 - a table of its own methods
    "nav_msgs/msg/Odometry": Navigation._odometry,  # noqa: SLF001
    "geometry_msgs/msg/PoseStamped": Navigation._pose,  # noqa: SLF001
    "sensor_msgs/msg/NavSatFix": Navigation._satellites,  # noqa: SLF001
    "sensor_msgs/msg/Imu": Navigation._orientation,  # noqa: SLF001
}


def on_earth(fix: Fix, xy: Floats) -> Floats:
    """Return latitudes and longitudes in degrees, shape (N, 2), of positions in the axes of a fix, shape (N, 2)."""
    cos, sin = math.cos(fix.yaw), math.sin(fix.yaw)
    east, north = xy[:, 0] * cos - xy[:, 1] * sin, xy[:, 0] * sin + xy[:, 1] * cos
    latitude = math.radians(fix.latitude_deg)
    shrunk = 1 - _SQUARED_ECCENTRICITY * math.sin(latitude) ** 2
    meridian = _EQUATOR_M * (1 - _SQUARED_ECCENTRICITY) / shrunk**1.5
    parallel = max(_EQUATOR_M / math.sqrt(shrunk) * math.cos(latitude), 1.0)
    longitudes = (fix.longitude_deg + np.degrees(east / parallel) + 180) % 360 - 180
    return np.stack((fix.latitude_deg + np.degrees(north / meridian), longitudes), axis=1)


def _up(north: float, east: float) -> Floats:
    """Return the vertical at a latitude and longitude, a unit vector."""
    around = math.cos(north)
    return np.array([around * math.cos(east), around * math.sin(east), math.sin(north)])


def _from_earth(at: Floats, axes: Floats) -> Fix:
    """Return the fix of a position and axes in the earth-fixed frame (WGS 84), by Bowring's formula."""
    x, y, z = at.tolist()
    flat, e2 = math.sqrt(1 - _SQUARED_ECCENTRICITY), _SQUARED_ECCENTRICITY
    radius, polar_m = math.hypot(x, y), _EQUATOR_M * flat
    reduced = math.atan2(z, flat * radius)
    latitude = math.atan2(
        z + e2 / (1 - e2) * polar_m * math.sin(reduced) ** 3, radius - e2 * _EQUATOR_M * math.cos(reduced) ** 3
    )
    longitude = math.atan2(y, x)
    east = np.array([-math.sin(longitude), math.cos(longitude), 0])
    forward, up = axes[:, 0], _up(latitude, longitude)
    yaw = math.atan2(float(forward @ np.cross(up, east)), float(forward @ east))
    return Fix(math.degrees(latitude), math.degrees(longitude), yaw)


def _plain(frame_id: str) -> str:
    return frame_id.lstrip("/")


def _sample(read: Reader, stamp_ns: int) -> Sample:
    return Sample(stamp_ns, np.array(read.numbers("ddd")), np.array(read.numbers("dddd")))
