"""Codec for Foxglove's cloud as a ROS message, against rosbags."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages.foxglove import RosFoxglovePointCloud
from tests.messages import wrapped
from tests.messages.clouds import Field, Plain, broken, plain_clouds

CODECS = {"cdr": RosFoxglovePointCloud(2), "ros1": RosFoxglovePointCloud(1)}
ENCODINGS = pytest.mark.parametrize("encoding", ["cdr", "ros1"])
FIELDS = (Field("x", 0, "f4"), Field("intensity", 4, "u1"), Field("t", 5, "f8"))
PLAIN = Plain(1, 3, FIELDS, 13, 39, False, bytes(range(39)), False, 1_700_000_000_123_456_789, "lidär")


@ENCODINGS
@settings(max_examples=100, deadline=None)
@given(st.data())
def test_round_trip_of_messages_from_rosbags(encoding, data):
    plain = data.draw(plain_clouds(encoding, counts=False))
    message = wrapped.foxglove(plain, encoding)
    cloud = CODECS[encoding].decode(message)
    assert (cloud.stamp_ns, cloud.frame_id) == (plain.stamp_ns, plain.frame_id)
    assert [(f.name, f.offset, f.type) for f in cloud.fields] == [tuple(f)[:3] for f in plain.fields]
    assert cloud.size == (len(plain.data) // plain.point_step if plain.point_step else 0)
    assert CODECS[encoding].encode(cloud) == message


@ENCODINGS
def test_rosbags_reads_a_selection(encoding):
    cloud = CODECS[encoding].decode(wrapped.foxglove(PLAIN, encoding))
    data = CODECS[encoding].encode(cloud.select(np.array([True, False, True])))
    found = wrapped.deserialised(encoding, wrapped.FOXGLOVE, data)
    assert (found.timestamp.sec, found.timestamp.nanosec, found.frame_id) == (1_700_000_000, 123_456_789, "lidär")
    assert (found.pose.position.x, found.pose.orientation.w, found.point_stride) == (1.0, 0.8, 13)
    assert found.data.tobytes() == PLAIN.data[:13] + PLAIN.data[26:]


def test_big_endian_cdr():
    cloud = CODECS["cdr"].decode(wrapped.foxglove(PLAIN, "cdr", little=False))
    assert (bytes(cloud.data), cloud.extra[:3]) == (PLAIN.data, (1.0, 2.0, 3.0))


@ENCODINGS
@settings(max_examples=200, deadline=None)
@given(st.data())
def test_damaged_messages_give_a_cloud_or_a_cloud_error(encoding, data):
    try:
        cloud = CODECS[encoding].decode(data.draw(broken(wrapped.foxglove(PLAIN, encoding))))
    except CloudError:
        return
    assert CODECS[encoding].decode(CODECS[encoding].encode(cloud)).size == cloud.size


def test_truncated_messages_are_errors():
    data = wrapped.foxglove(PLAIN, "cdr")
    for size in range(len(data)):
        with pytest.raises(CloudError):
            CODECS["cdr"].decode(data[:size])
