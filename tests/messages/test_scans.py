"""Codecs for laser scans against rosbags and a loop over beams."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages.scans import LaserScan, MultiEchoLaserScan
from tests.messages import wrapped

ONE = {"cdr": LaserScan(2), "ros1": LaserScan(1)}
MANY = {"cdr": MultiEchoLaserScan(2), "ros1": MultiEchoLaserScan(1)}
ENCODINGS = pytest.mark.parametrize("encoding", ["cdr", "ros1"])
RANGES = st.one_of(
    st.floats(0, 80, width=32), st.sampled_from([0.0, -1.0, math.inf, -math.inf, math.nan, 0.5, 60.0, 1e30])
)
FIRST, _, INCREMENT, *_, LEAST, MOST = (float(np.float32(value)) for value in wrapped.PLANE)


def expected(beams):
    """Return the points of lists of ranges of each beam, computed one by one: None where there is no return."""
    points = []
    for beam, ranges in enumerate(beams):
        for echo, value in enumerate(ranges):
            angle = FIRST + beam * INCREMENT
            valid = value == value and LEAST <= value <= MOST
            place = (value * math.cos(angle), value * math.sin(angle)) if valid else None
            points.append((beam, echo, place))
    return points


def check(cloud, beams):
    wanted = expected(beams)
    assert cloud.size == len(wanted)
    for point, (beam, echo, place) in zip(cloud.points, wanted, strict=True):
        assert point["index"] == beam
        assert "echo" not in cloud.dtype.names or point["echo"] == echo
        if place is None:
            assert all(math.isnan(point[axis]) for axis in "xyz")
        else:
            assert (point["x"], point["y"]) == pytest.approx(place, rel=1e-6, abs=1e-6)
            assert point["z"] == 0


@ENCODINGS
@settings(max_examples=100, deadline=None)
@given(st.data())
def test_scans_from_rosbags(encoding, data):
    ranges = data.draw(st.lists(RANGES, max_size=8))
    intensities = data.draw(st.sampled_from([[], [float(k) for k in range(len(ranges))]]))
    message = wrapped.scan(encoding, ranges, intensities)
    cloud = ONE[encoding].decode(message)
    check(cloud, [[value] for value in ranges])
    assert ("intensity" in cloud.dtype.names) == bool(intensities)
    if intensities:
        assert cloud.points["intensity"].tolist() == intensities
    assert ONE[encoding].encode(cloud) == message


@ENCODINGS
@settings(max_examples=100, deadline=None)
@given(st.data())
def test_scans_with_several_echoes_from_rosbags(encoding, data):
    beams = data.draw(st.lists(st.lists(RANGES, max_size=3), max_size=6))
    intensities = [[float(k) for k, _ in enumerate(beam)] for beam in beams] if data.draw(st.booleans()) else []
    message = wrapped.echoes(encoding, beams, intensities)
    cloud = MANY[encoding].decode(message)
    check(cloud, beams)
    assert MANY[encoding].encode(cloud) == message


@ENCODINGS
def test_removed_ranges_become_nan(encoding):
    ranges = [1.0, math.inf, 3.0, 0.0, 5.0]
    cloud = ONE[encoding].decode(wrapped.scan(encoding, ranges, [9, 8, 7, 6, 5]))
    data = ONE[encoding].encode(cloud.select(np.array([False, False, True, False, True])))
    found = wrapped.deserialised(encoding, wrapped.SCAN, data)
    assert [repr(float(value)) for value in found.ranges] == ["nan", "inf", "3.0", "0.0", "5.0"], "no return is kept"
    assert found.intensities.tolist() == [9, 8, 7, 6, 5]
    assert (found.header.frame_id, round(found.angle_increment, 6)) == ("scanner", 0.05)
    assert np.isfinite(ONE[encoding].decode(data).points["x"]).tolist() == [False, False, True, False, True]


@ENCODINGS
def test_removed_echoes_are_left_out(encoding):
    beams = [[1.0, 2.0], [], [3.0, math.nan, 4.0]]
    strength = [[10, 20], [], [30, 0, 40]]
    cloud = MANY[encoding].decode(wrapped.echoes(encoding, beams, strength))
    data = MANY[encoding].encode(cloud.select(np.array([False, True, False, False, True])))
    found = wrapped.deserialised(encoding, wrapped.ECHOES, data)
    assert [repr(echo.echoes.tolist()) for echo in found.ranges] == ["[2.0]", "[]", "[nan, 4.0]"]
    assert [echo.echoes.tolist() for echo in found.intensities] == [[20], [], [0, 40]]


def test_big_endian_cdr():
    ranges = [1.0, 2.0, 3.0]
    check(ONE["cdr"].decode(wrapped.scan("cdr", ranges, [], little=False)), [[value] for value in ranges])
    assert ONE["cdr"].encode(ONE["cdr"].decode(wrapped.scan("cdr", ranges, [], little=False))) == wrapped.scan(
        "cdr", ranges, []
    )


@pytest.mark.parametrize(
    ("codec", "message", "text"),
    [
        (ONE, wrapped.scan("cdr", [1, 2], [1]), "2 ranges, but 1 intensities"),
        (MANY, wrapped.echoes("cdr", [[1, 2]], [[1]]), "differ in number"),
        (MANY, wrapped.echoes("cdr", [[1, 2], [3]], [[1, 2]]), "differ in number"),
    ],
)
def test_intensities_that_do_not_fit(codec, message, text):
    with pytest.raises(CloudError, match=text):
        codec["cdr"].decode(message)


def test_a_scan_that_expands_to_more_than_a_message_may(monkeypatch):
    monkeypatch.setenv("SEACLUTTER_MAX_MESSAGE_MIB", "1")
    with pytest.raises(CloudError, match="SEACLUTTER_MAX_MESSAGE_MIB"):
        ONE["cdr"].decode(wrapped.scan("cdr", np.ones(60_000), []))
