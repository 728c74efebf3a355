"""Frames of a fixed duration: every point once, in the window of its stamp."""

import numpy as np
import pytest

import seaclutter
from seaclutter_cli.errors import InputError
from seaclutter_cli.messages import find_codec
from seaclutter_cli.records import Message
from seaclutter_cli.runs.options import ReadOptions
from seaclutter_cli.runs.recordings import open_recording
from seaclutter_cli.sources.recordings import find_recordings
from tests import logs
from tests.messages import wrapped
from tests.running import execute

MS = 10**6


def livox_log(path, stamps_ms, encoding="cdr", change=None, late_ms=None):
    """Write Livox messages of ten points with these stamps, and another topic after each."""
    entries = []
    for number, stamp_ms in enumerate(stamps_ms):
        log_ms = stamp_ms + (late_ms or {}).get(number, 1)
        points = wrapped.livox_points(logs.sea_points(60, (number,))[-10:])
        points["tag"] = number
        data = wrapped.livox(encoding, points, stamp_ns=logs.START_NS + stamp_ms * MS)
        data = change(number, data) if change else data
        entries.append(logs.Entry("/livox/lidar", logs.START_NS + log_ms * MS, data))
        scan = wrapped.scan(encoding, [1.0] * 121, [1.0] * 121, stamp_ns=logs.START_NS + stamp_ms * MS)
        entries.append(logs.Entry("/scan", logs.START_NS + (stamp_ms + 2) * MS, scan))
    topics = [wrapped.topic("/livox/lidar", wrapped.LIVOX, encoding), wrapped.topic("/scan", wrapped.SCAN, encoding)]
    return logs.write_log(path, topics, entries)


def opened(path, integrate_ms):
    (recording,) = find_recordings([str(path)])
    return open_recording(recording, ReadOptions(integrate_ms=integrate_ms))


def clouds(source, topic="/livox/lidar"):
    return [
        (record.log_time_ns, find_codec(record.channel).decode(record.data))
        for record in source.records()
        if isinstance(record, Message) and record.channel.topic == topic
    ]


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
def test_windows_begin_with_the_first_cloud(tmp_path, encoding):
    path = livox_log(tmp_path / "log.mcap", [0, 20, 40, 60, 99, 100, 130, 350, 360], encoding)
    found = clouds(opened(path, 100))
    assert [sorted(set(cloud.points["tag"].tolist())) for _, cloud in found] == [[0, 1, 2, 3, 4], [5, 6], [7, 8]]
    assert [(cloud.stamp_ns - logs.START_NS) // MS for _, cloud in found] == [0, 100, 350]
    # A cloud comes with the message that begins the next window, the last one at the end.
    assert [(time_ns - logs.START_NS) // MS for time_ns, _ in found] == [101, 351, 362]


def test_points_keep_their_values_and_times(tmp_path):
    path = livox_log(tmp_path / "log.mcap", [0, 20, 150])
    parts = [cloud for _, cloud in clouds(opened(path, None))]
    (_, first), (_, second) = clouds(opened(path, 100))
    assert [field.name for field in first.fields] == [field.name for field in parts[0].fields]
    for name in ("x", "y", "z", "reflectivity", "tag", "line"):
        expected = np.concatenate([parts[0].points[name], parts[1].points[name]])
        np.testing.assert_array_equal(first.points[name], expected)
    times = [*parts[0].points["offset_time"], *(parts[1].points["offset_time"] + 20 * MS)]
    np.testing.assert_array_equal(first.points["offset_time"], times)
    np.testing.assert_array_equal(second.points["offset_time"], parts[2].points["offset_time"])


def test_channels_and_order(tmp_path):
    source = opened(livox_log(tmp_path / "log.mcap", range(0, 200, 20)), 60)
    kinds = {channel.topic: channel.schema.name for channel in source.channels}
    assert kinds["/livox/lidar"] == "sensor_msgs/msg/PointCloud2"
    times = [record.log_time_ns for record in source.records() if isinstance(record, Message)]
    assert times == sorted(times)
    assert kinds["/scan"] == "sensor_msgs/msg/LaserScan"
    (scans,) = source.counts.values()
    assert scans == 10
    ends = [r for r in source.records(end_ns=logs.START_NS + 65 * MS) if isinstance(r, Message)]
    assert max(message.log_time_ns for message in ends) < logs.START_NS + 65 * MS


def test_other_topics_are_joined_if_they_are_named(tmp_path):
    path = livox_log(tmp_path / "log.mcap", [0, 20, 40])
    (recording,) = find_recordings([str(path)])
    source = open_recording(recording, ReadOptions(integrate_ms=100, topics=("/scan",)))
    assert [cloud.size for _, cloud in clouds(source, "/scan")] == [363]
    assert len(clouds(source)) == 3


def test_late_clouds_stay_in_the_window_that_is_open(tmp_path):
    path = livox_log(tmp_path / "log.mcap", [0, 110, 90, 120], late_ms={2: 25})
    found = clouds(opened(path, 100))
    assert [sorted(set(cloud.points["tag"].tolist())) for _, cloud in found] == [[0], [1, 2, 3]]
    assert (found[1][1].stamp_ns - logs.START_NS) // MS == 90
    offsets = found[1][1].points["offset_time"].reshape(3, 10)
    assert (np.diff(offsets[:, 0].astype(int)) // MS).tolist() == [-20, 30]


def test_a_clock_that_is_set_back_begins_new_windows(tmp_path):
    path = livox_log(tmp_path / "log.mcap", [5000, 5020, 10, 30, 120], late_ms={2: 6000, 3: 6000, 4: 6000})
    found = clouds(opened(path, 100))
    assert [sorted(set(cloud.points["tag"].tolist())) for _, cloud in found] == [[0, 1], [2, 3], [4]]


def test_a_damaged_cloud_is_reported_and_the_others_are_joined(tmp_path):
    path = livox_log(tmp_path / "log.mcap", [0, 20, 40], change=lambda number, data: data[:40] if number == 1 else data)
    source = opened(path, 100)
    ((_, cloud),) = clouds(source)
    assert set(cloud.points["tag"].tolist()) == {0, 2}
    (damage,) = source.damage
    assert "a cloud of /livox/lidar cannot be read" in str(damage)


@pytest.mark.parametrize("kind", ["ros2", "ros1", "protobuf", "json"])
def test_all_kinds_of_clouds(tmp_path, kind):
    path = tmp_path / "log.mcap"
    logs.cloud_log(path, logs.LAYOUTS["zstd"], kind=kind, frames=6, points=30)
    with seaclutter.open_log(path) as log:
        parts = [frame.cloud.points for frame in log.frames()]
    with seaclutter.open_log(path, integrate_ms=logs.PERIOD_NS * 3 / 1e6) as log:
        found = [frame.cloud.points for frame in log.frames()]
    assert [len(points) for points in found] == [90, 90]
    for name in parts[0].dtype.names:
        every = np.concatenate([points[name] for points in parts])
        np.testing.assert_array_equal(np.concatenate([points[name] for points in found]), every)


def test_relative_seconds_are_shifted(tmp_path):
    layout = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4"), ("time", "f4"), ("timestamp", "f8")]
    points = np.zeros(2, layout)
    points["time"], points["timestamp"] = (0, 0.01), (5, 6)
    entries = [
        logs.Entry("/points", logs.START_NS + k, logs.cloud_message("ros2", points, logs.START_NS + k * 50 * MS))
        for k in range(2)
    ]
    logs.write_log(tmp_path / "log.mcap", [logs.cloud_topic("/points")], entries)
    ((_, cloud),) = clouds(opened(tmp_path / "log.mcap", 100), "/points")
    np.testing.assert_allclose(cloud.points["time"], [0, 0.01, 0.05, 0.06], rtol=1e-6)
    assert cloud.points["timestamp"].tolist() == [5, 6, 5, 6]


def test_clouds_of_another_layout_begin_a_frame(tmp_path):
    few = np.zeros(2, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4")])
    more = np.zeros(2, [*few.dtype.descr, ("ring", "u2")])
    entries = [
        logs.Entry("/points", logs.START_NS + k, logs.cloud_message("ros2", points, logs.START_NS + k))
        for k, points in enumerate((few, few, more))
    ]
    logs.write_log(tmp_path / "log.mcap", [logs.cloud_topic("/points")], entries)
    assert [cloud.size for _, cloud in clouds(opened(tmp_path / "log.mcap", 100), "/points")] == [4, 2]


def test_a_missing_log_is_an_error(tmp_path):
    with pytest.raises((InputError, seaclutter.UsageError)):
        seaclutter.open_log(tmp_path / "none.mcap", integrate_ms=100)


DRIVER_POINT = np.dtype(
    [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4"), ("tag", "u1"), ("line", "u1"), ("timestamp", "f8")]
)
"""PointXYZRTLT of livox_ros_driver2, packed; the time is absolute, in nanoseconds."""


def driver_cloud(encoding, number, stamp_ns):
    """Return a PointCloud2 as livox_ros_driver2 publishes it."""
    types = wrapped.store(encoding).types
    points = np.zeros(10, DRIVER_POINT)
    points["x"], points["intensity"], points["tag"] = 30 + number, 200, number
    points["line"], points["timestamp"] = np.arange(10) % 4, stamp_ns + np.arange(10) * 10_000
    kinds = {"f4": 7, "u1": 2, "f8": 8}
    fields = [
        types["sensor_msgs/msg/PointField"](name, offset, kinds[kind.str[1:]], 1)
        for name, (kind, offset) in DRIVER_POINT.fields.items()
    ]
    head = wrapped.header(encoding, stamp_ns, "livox_frame")
    data = np.frombuffer(points.tobytes(), np.uint8)
    shape = 1, len(points), fields, False, DRIVER_POINT.itemsize, points.nbytes, data, True
    return wrapped.serialised(encoding, "sensor_msgs/msg/PointCloud2", head, *shape)


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
def test_clouds_of_the_livox_driver(tmp_path, encoding):
    stamps_ns = [logs.START_NS + n * 20 * MS for n in range(10)]
    entries = [logs.Entry("/livox/lidar", ns + MS, driver_cloud(encoding, n, ns)) for n, ns in enumerate(stamps_ns)]
    topic = wrapped.topic("/livox/lidar", "sensor_msgs/msg/PointCloud2", encoding)
    path = logs.write_log(tmp_path / "log.mcap", [topic], entries)
    (_, first), (_, second) = clouds(opened(path, 100))
    assert [cloud.stamp_ns for cloud in (first, second)] == [stamps_ns[0], stamps_ns[5]]
    assert DRIVER_POINT.itemsize == first.point_step == 26
    np.testing.assert_array_equal(second.points["tag"], np.repeat(np.arange(5, 10), 10))
    # Times are absolute, and stay as they are.
    expected = (np.array(stamps_ns)[:5, None] + np.arange(10) * 10_000).ravel()
    np.testing.assert_array_equal(first.points["timestamp"], expected.astype(np.float64))
    assert "resembles Mid-360" in execute("info", path).stdout
