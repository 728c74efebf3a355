"""The table of objects: rows of frames that are complete many seconds later."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.records import Channel, Message, Schema
from seaclutter_cli.runs.objects import RecordedObjects
from seaclutter_cli.runs.outputs import PackedRows
from seaclutter_cli.sinks.objects import ObjectTable, rows_as_mappings
from seaclutter_cli.tracking.follow import Follower

STORE = get_typestore(Stores.ROS2_HUMBLE)
BOAT = np.array([(x, y, z) for x in np.arange(20, 26, 0.2) for y in (0.0, 1.0) for z in (-1.0, 0.5)])


def message(kind, stamp_ns, *values):
    types = STORE.types
    head = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9)), "")
    data = bytes(STORE.serialize_cdr(types[kind](head, *values), kind))
    return Message(Channel(2, "/own_ship", "cdr", Schema(kind, "", b"")), stamp_ns, stamp_ns, 0, data)


def fix_and_heading(stamp_ns, latitude_deg):
    types, zero = STORE.types, np.zeros(9)
    level = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 1e-3, 1.0)  # without any turn, it would be unset
    still = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    status = types["sensor_msgs/msg/NavSatStatus"](0, 1)
    yield message("sensor_msgs/msg/NavSatFix", stamp_ns, status, latitude_deg, 0.0, 0.0, zero, 0)
    yield message("sensor_msgs/msg/Imu", stamp_ns, level, zero, still, zero, still, zero)


def odometry(stamp_ns, x_m):
    types, zero = STORE.types, np.zeros(36)
    still = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    level = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    at = types["geometry_msgs/msg/Pose"](types["geometry_msgs/msg/Point"](x_m, 0.0, 0.0), level)
    pose = types["geometry_msgs/msg/PoseWithCovariance"](at, zero)
    twist = types["geometry_msgs/msg/TwistWithCovariance"](types["geometry_msgs/msg/Twist"](still, still), zero)
    return message("nav_msgs/msg/Odometry", stamp_ns, "lidar", pose, twist)


def test_the_greatest_speed_is_that_over_ground_if_it_was_measured_so():
    table, warnings = ObjectTable(PackedRows().write, lambda: Follower(1.5, 5)), []
    table.begin(SimpleNamespace(name="trial", warn=warnings.append), [SimpleNamespace(topic="/points")])
    for k in range(60):
        stamp_ns = 10**9 + k * 10**8
        if k < 30:
            table.copy(odometry(stamp_ns, 0.3 * k))
        frame = Frame.of_arrays(BOAT, np.full(len(BOAT), 50.0), stamp_ns=stamp_ns, index=k)
        table.write(FilterResult(frame, np.zeros(len(BOAT), np.uint8)))
    table.end()
    (warning,) = warnings
    assert warning.startswith(
        "speeds are relative to own ship, whose motion is not known, for 20 of 60 frames: no transf"
    )
    (track,) = table.tracks.values()
    assert (round(track.speed_ms), track.over_ground) == (3, True)
    other = replace(track, track_id=2, over_ground=False)
    for tracks, text in (([track], "; speeds are over"), ([track, other], "; some speeds are relative to own ship")):
        found = RecordedObjects(recording="trial", tracks={("/points", one.track_id): one for one in tracks})
        assert text in found.as_text()


def test_frames_wait_for_the_pose_that_follows_them():
    """Own ship goes back and forth at 3 m/s beside a boat that lies still; its pose is known where it turns back."""
    lines = PackedRows()
    table = ObjectTable(lines.write, lambda: Follower(1.5, 5))
    table.begin(SimpleNamespace(name="trial"), [SimpleNamespace(topic="/points")])
    for k in range(61):
        stamp_ns, x_m = 10**9 + k * 10**8, 0.3 * abs((k + 10) % 20 - 10)
        if k % 10 == 0:
            table.copy(odometry(stamp_ns, x_m))
        frame = Frame.of_arrays(BOAT - (x_m, 0, 0), np.full(len(BOAT), 50.0), stamp_ns=stamp_ns, index=k)
        table.write(FilterResult(frame, np.zeros(len(BOAT), np.uint8)))
    table.end()
    rows = list(rows_as_mappings(lines))
    assert [row["frame"] for row in rows] == list(range(61))
    assert {row["velocity"] for row in rows[1:]} == {"ground"}
    assert max(row["speed_ms"] for row in rows[1:]) < 0.3


def on_x(stamp_ns, moved_m):
    """Own ship moves along x, which is its pose."""
    yield odometry(stamp_ns, moved_m)


def north(stamp_ns, moved_m):
    """Own ship moves north, and heads east."""
    yield from fix_and_heading(stamp_ns, 10 + moved_m / 110_600)


@pytest.mark.parametrize(("says", "right", "what"), [(on_x, 0, "speeds over ground"), (north, 1, "places on earth")])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sails", [False, True])
def test_objects_that_all_move_alike_show_that_pose_or_heading_is_wrong(says, right, what, axis, sails):
    """Own ship moves along one of its axes, x or y; a further boat may sail."""
    table, warnings = ObjectTable(PackedRows().write, lambda: Follower(1.5, 5)), []
    table.begin(SimpleNamespace(name="trial", warn=warnings.append), [SimpleNamespace(topic="/points")])
    boats = np.concatenate([BOAT + offset for offset in ((0, 0, 0), (0, 20, 0), (-50, 10, 0), (0, -30, 0))])
    for k in range(80):
        stamp_ns = 10**9 + k * 10**8
        for record in says(stamp_ns, 0.3 * k):
            table.copy(record)
        xyz = boats.copy()
        if sails:
            xyz = np.concatenate((xyz, BOAT + np.array((-60 - 0.4 * k, 40 + 0.4 * k, 0))))
        xyz[:, axis] -= 0.3 * k
        frame = Frame.of_arrays(xyz, np.full(len(xyz), 50.0), stamp_ns=stamp_ns, index=k)
        table.write(FilterResult(frame, np.zeros(len(xyz), np.uint8)))
    table.end()
    assert [text.partition(" are")[0] for text in warnings] == [what] * (axis != right)


def test_one_place_shows_no_velocity():
    lines = PackedRows()
    table = ObjectTable(lines.write, lambda: Follower(1.5, 5))
    table.begin(SimpleNamespace(name="trial"), [SimpleNamespace(topic="/points")])
    for k in range(30):
        stamp_ns = 10**9 + k * 10**8
        if k:  # the first frame is the only one without a pose
            table.copy(odometry(stamp_ns, 0.3 * k))
        frame = Frame.of_arrays(BOAT, np.full(len(BOAT), 50.0), stamp_ns=stamp_ns, index=k)
        table.write(FilterResult(frame, np.zeros(len(BOAT), np.uint8)))
    table.end()
    first, *others = [(row["velocity"], row["speed_ms"], row["course_rad"]) for row in rows_as_mappings(lines)]
    assert first == ("own_ship", None, None)
    assert {(velocity, round(speed)) for velocity, speed, _ in others} == {("ground", 3)}


def test_places_on_earth_are_those_of_their_frames():
    lines = PackedRows()
    table = ObjectTable(lines.write, lambda: Follower(1.5, 5))
    table.begin(SimpleNamespace(name="trial"), [SimpleNamespace(topic="/points")])
    for k in range(100):
        stamp_ns = 10**9 + k * 5 * 10**8
        for record in fix_and_heading(stamp_ns, 10 + k / 10_000):
            table.copy(record)
        frame = Frame.of_arrays(BOAT, np.full(len(BOAT), 50.0), stamp_ns=stamp_ns, index=k)
        table.write(FilterResult(frame, np.zeros(len(BOAT), np.uint8)))
    table.end()
    rows = list(rows_as_mappings(lines))
    assert [row["frame"] for row in rows] == list(range(100))
    assert np.allclose([row["latitude_deg"] for row in rows], 10 + np.arange(100) / 10_000, atol=1e-6)
