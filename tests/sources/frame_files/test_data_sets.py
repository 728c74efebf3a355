"""Public data sets from the water, in folders written to their descriptions."""

import math
import struct
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

import seaclutter
from seaclutter_cli.records import Message
from seaclutter_cli.sources.formats import open_source
from seaclutter_cli.sources.frame_files.arrays import read_bin
from seaclutter_cli.sources.frame_files.sidecars import poses_beside
from tests.running import execute
from tests.sources.frame_files import data_sets

POSE = "geometry_msgs/msg/PoseStamped"
US, PERIOD_US = data_sets.US, data_sets.PERIOD_US


run = partial(execute, code=0)


def frames(path):
    with seaclutter.open_log(path) as log:
        return list(log.frames())


def test_canoe(tmp_path):
    found = frames(data_sets.canoe(tmp_path / "canoe-2025-08-21-19-16"))
    assert [frame.stamp_ns for frame in found] == [(US + k * PERIOD_US) * 1000 for k in range(3)]
    for number, frame in enumerate(found):
        np.testing.assert_array_equal(frame.xyz, data_sets.places(number))
        assert frame.intensity.tolist() == [500 + k for k in range(240)]
        points = frame.cloud.points
        assert points["timestamp"].tolist() == [US + number * PERIOD_US - 50_000 + k for k in range(240)], "exact"
        assert points["reflectivity"].tolist() == [k % 256 for k in range(240)]
        assert set(points["ambient"]) == {40}


def matrix(x, y, z, w):
    """Return the rotation of a unit quaternion, as in textbooks."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def principal(axis, angle):
    """Return the principal rotation about an axis as the kit defines it (passive)."""
    c, s = math.cos(angle), math.sin(angle)
    first, second = [(1, 2), (2, 0), (0, 1)][axis]
    found = np.eye(3)
    found[first, first] = found[second, second] = c
    found[first, second], found[second, first] = s, -s
    return found


def test_poses_of_canoe_are_messages_before_their_frames(tmp_path):
    source = open_source(data_sets.canoe(tmp_path / "canoe"))
    records = [record for record in source.records() if isinstance(record, Message)]
    assert [record.channel.topic for record in records] == ["/pose", "/points"] * 3
    assert source.counts == {1: 3, 2: 3}
    store = get_typestore(Stores.ROS2_HUMBLE)
    for number, record in enumerate(records[::2]):
        message = store.deserialize_cdr(record.data, POSE)
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == record.log_time_ns == (US + number * PERIOD_US) * 1000
        assert message.header.frame_id == "enu"
        position = message.pose.position
        assert (position.x, position.y, position.z) == (1.5 + number, -2.0, 0.5)
        turned = message.pose.orientation
        expected = principal(0, 0.01) @ principal(1, -0.02) @ principal(2, 0.5 + number)
        np.testing.assert_allclose(matrix(turned.x, turned.y, turned.z, turned.w), expected, atol=1e-12)
    start_ns = (US + PERIOD_US) * 1000
    assert source.skipped(start_ns) == {1: 1, 2: 1}
    assert len(list(source.records(start_ns))) == 4


@settings(max_examples=100, deadline=None)
@given(st.tuples(*[st.floats(-4, 4)] * 3))
def test_angles_of_poses(tmp_path_factory, angles):
    folder = tmp_path_factory.mktemp("canoe")
    (folder / "novatel").mkdir()
    (folder / "novatel" / "lidar_poses.csv").write_text(f"head\n{US},0,0,0,{angles[0]},{angles[1]},{angles[2]}\n")
    (pose,) = poses_beside(folder / "lidar").values()
    expected = principal(0, angles[0]) @ principal(1, angles[1]) @ principal(2, angles[2])
    np.testing.assert_allclose(matrix(*pose.orientation), expected, atol=1e-9)


def test_canoe_without_poses_and_with_broken_ones(tmp_path):
    plain = data_sets.canoe(tmp_path / "plain", poses=False)
    assert [channel.topic for channel in open_source(plain).channels] == ["/points"]
    table = plain / "novatel" / "lidar_poses.csv"
    for text, problem in (("h\n1,2,3\n", "line 2: must have at least 7 values, has 3"), ("h\n1,2,3,4,5,6,x", "line 2")):
        table.write_text(text)
        source = open_source(plain)
        assert [channel.topic for channel in source.channels] == ["/points"]
        assert problem in source.warnings[0]
        assert source.warnings[0].endswith("the log has no poses")
    table.write_text("h\n7,0,0,0,0,0,0\n")  # of other frames
    assert len(open_source(plain).channels) == 1


def test_canoe_from_info_to_a_filtered_log(tmp_path):
    folder, out = data_sets.canoe(tmp_path / "canoe-2025-08-21-19-16"), tmp_path / "out.mcap"
    shown = run("info", folder).stdout
    assert "x f8, y f8, z f8, intensity u2, timestamp f8" in shown
    assert "/pose" in shown
    run("filter", folder, "-o", out, "-m", "global_intensity", "-s", "filter.threshold=600")
    with seaclutter.open_log(out) as log:
        kept = list(log.frames())
        counts = {channel.topic: log._source.counts[channel.id] for channel in log._source.channels}
    assert counts["/pose"] == 3
    assert 0 < kept[0].size < 240


def test_pohang_canal(tmp_path):
    folder = data_sets.pohang(tmp_path / "pohang00") / "lidar"
    found = frames(folder / "lidar_port")
    assert [frame.stamp_ns for frame in found] == [(US + k * PERIOD_US) * 1000 for k in range(3)]
    points, places = found[1].cloud.points, data_sets.places(1).astype(np.float32)
    for axis, column in zip("xyz", places.T, strict=True):
        np.testing.assert_array_equal(points[axis][20:], column[20:])
    assert points["intensity"][20:].tolist() == [300 + k for k in range(20, 240)]
    assert points["t"].tolist() == [400 * k for k in range(240)]
    np.testing.assert_allclose(points["range"][20:] / 1000, np.linalg.norm(places[20:], axis=1), atol=1e-3)
    assert not found[1].valid[:20].any()
    assert found[1].valid[20:].all()


def test_the_three_lidars_of_pohang_canal_are_three_recordings(tmp_path):
    folder = data_sets.pohang(tmp_path / "pohang00")
    run("filter", folder / "lidar", "-o", f"{tmp_path}/out/", "-m", "none")
    names = {"lidar_front.mcap", "lidar_port.mcap", "lidar_starboard.mcap"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names


def test_usvinland(tmp_path):
    folder = data_sets.usvinland(tmp_path / "N03_2_Sequence_80_536-Lidar", frames=12)
    found = frames(folder)
    assert [frame.stamp_ns for frame in found] == [(US + k * PERIOD_US) * 1000 for k in range(12)]
    np.testing.assert_allclose(found[11].xyz, data_sets.places(11), rtol=1e-6)
    (folder / "3.bin").unlink()
    assert [frame.stamp_ns for frame in frames(folder)][3] == (US + 4 * PERIOD_US) * 1000, "by its number"


@pytest.mark.parametrize("size", [0, 38 * 8, 28 * 8, 16 * 19 * 7])
def test_kitti_files_stay_what_they_are(tmp_path, size):
    rng = np.random.default_rng(size)
    points = rng.normal(0, [30, 30, 2, 30], (size // 16, 4)).astype("<f4")
    points[:, 3] = abs(points[:, 3])
    path = tmp_path / "0.bin"
    path.write_bytes(points.tobytes())
    cloud = read_bin(path)
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "intensity"]
    assert bytes(cloud.data) == points.tobytes()


def test_the_content_decides_where_sizes_fit_both(tmp_path):
    path = tmp_path / "0.bin"
    path.write_bytes(struct.pack("<dddHQHH", 1, 2, 3, 4, US, 5, 6) * 56)  # 56 * 38 is a multiple of 28 and 16
    assert len(read_bin(path).fields) == 7
    path.write_bytes(struct.pack("<ffffIHHI", 3, 4, 0, 9, 1, 2, 3, 5000) * 76)
    assert [field.name for field in read_bin(path).fields][-1] == "range"
    path.write_bytes(struct.pack("<ffffIHHI", 3, 4, 0, 9, 1, 2, 3, 9000) * 76)
    assert [field.name for field in read_bin(path).fields][-1] == "range", "whatever it is"
