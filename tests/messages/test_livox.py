"""Livox messages, written and read by rosbags."""

import numpy as np
import pytest

from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages import CODECS, find_codec
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel, Schema
from tests import logs
from tests.messages import wrapped

CODEC = {"ros1": CODECS["livox_ros_driver/CustomMsg", "ros1"], "cdr": CODECS["livox_ros_driver2/msg/CustomMsg", "cdr"]}


def points(number, seed=0):
    return wrapped.livox_points(logs.sea_points(max(number, 1), (seed,)))[:number]


@pytest.mark.parametrize("frame_id", ["", "l", "livox", "livox_frame"])  # all alignments of what follows
@pytest.mark.parametrize("number", [0, 1, 50])
@pytest.mark.parametrize(("encoding", "little"), [("ros1", True), ("cdr", True), ("cdr", False)])
def test_messages_are_read_and_written_as_rosbags_does(encoding, little, number, frame_id):
    data = wrapped.livox(encoding, points(number), frame_id=frame_id, little=little)
    cloud = CODEC[encoding].decode(data)
    assert (cloud.stamp_ns, cloud.frame_id, cloud.size) == (logs.START_NS, frame_id, number)
    assert (cloud.extra.timebase_ns, cloud.extra.lidar_id) == (logs.START_NS - 1000, 192)
    for name in points(0).dtype.names:
        np.testing.assert_array_equal(cloud.points[name], points(number)[name])
    assert CODEC[encoding].encode(cloud) == wrapped.livox(encoding, points(number), frame_id=frame_id)


@pytest.mark.parametrize("encoding", CODEC)
def test_the_kept_points_remain(encoding):
    cloud = CODEC[encoding].decode(wrapped.livox(encoding, points(50)))
    keep = cloud.points["line"] == 2
    data = CODEC[encoding].encode(cloud.select(keep))
    message = wrapped.deserialised(encoding, wrapped.LIVOX, data)
    assert message.point_num == len(message.points) == keep.sum()
    assert [(str(p.x), p.reflectivity, p.offset_time) for p in message.points] == [
        (str(float(p["x"])), int(p["reflectivity"]), int(p["offset_time"])) for p in points(50)[keep]
    ]
    assert message.rsvd.tolist() == [7, 8, 9]


@pytest.mark.parametrize("encoding", CODEC)
def test_truncated_messages_are_errors(encoding):
    data = wrapped.livox(encoding, points(3))
    for size in range(len(data)):
        with pytest.raises(CloudError):
            CODEC[encoding].decode(data[:size])


def test_other_points_cannot_be_written():
    cloud = CODEC["cdr"].decode(wrapped.livox("cdr", points(3)))
    other = CODECS["sensor_msgs/msg/PointCloud2", "cdr"].decode(logs.cloud_messages("ros2", 1, 5)[0])
    with pytest.raises(CloudError, match="only the points of a Livox message"):
        CODEC["cdr"].encode(other)
    assert CODEC["cdr"].encode(cloud.with_field("reason", np.zeros(3, np.uint8)))


def test_messages_of_all_drivers_are_known():
    for driver in ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces"):
        for encoding, name in (("cdr", f"{driver}/msg/CustomMsg"), ("ros1", f"{driver}/CustomMsg")):
            assert find_codec(Channel(1, "/livox/lidar", encoding, Schema(name, "ros2msg", b"")))


@pytest.mark.parametrize("driver", ["livox_ros_driver2", "livox_interfaces"])
def test_recordings_without_definitions_get_them(driver):
    """Recorders write none before ROS 2 Iron."""
    text = ros2_schema(f"{driver}/msg/CustomMsg").data.decode()
    assert text == wrapped.topic("/livox/lidar", wrapped.LIVOX).schema[2].decode().replace("livox_ros_driver2", driver)
