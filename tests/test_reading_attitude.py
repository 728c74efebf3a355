"""Frames get own ship's attitude where a log has it, and records keep their order."""

import operator
from math import cos, radians, sin

import numpy as np
import pytest

from seaclutter_cli.filters import FILTERS
from seaclutter_cli.messages.serialisation import Header, Writer
from seaclutter_cli.pipeline import run_each
from seaclutter_cli.reading import read, with_attitudes
from seaclutter_cli.records import Channel, Message, Schema
from seaclutter_cli.selection import Selection, cloud_channels
from seaclutter_cli.sources.formats import open_source
from tests.paths import ROOT

IMU = Channel(99, "/imu/data", "cdr", Schema("sensor_msgs/msg/Imu", "ros2msg", b""))
LATE_NS = 50_000_000


def imu(stamp_ns, yaw_deg):
    """Return an IMU's message that is logged late."""
    write, half = Writer(2), radians(yaw_deg) / 2
    write.header(Header(stamp_ns, "imu"))
    write.numbers("d" * 37, (0, 0, sin(half), cos(half), *[0] * 33))
    return Message(IMU, stamp_ns + LATE_NS, stamp_ns + LATE_NS, 0, write.message())


@pytest.fixture(scope="module")
def records():
    """Return records of the sample with their frames, and an IMU's messages in between, which turns by 10°/s."""
    source = open_source(ROOT / "samples" / "sea.mcap")
    pairs = list(read(source, cloud_channels(source), Selection(frames=8)))
    first_ns = next(frame.stamp_ns for _, frame in pairs if frame)
    pairs += [(imu(first_ns + k * 20_000_000, 5 + 0.2 * k), None) for k in range(20)]
    return sorted(pairs, key=lambda pair: getattr(pair[0], "log_time_ns", 0))


def test_frames_wait_for_the_messages_around_their_stamps(records):
    found = list(with_attitudes(records, [IMU]))
    assert [record for record, _ in found] == [record for record, _ in records]
    frames = [frame for _, frame in found if frame]
    known = [frame for frame in frames if frame.attitude]
    assert [frame.index for frame in known] == [0, 1, 2, 3]  # the messages end after 0.38 s
    for frame in known:
        x, y, _ = frame.attitude.rotation[:, 0]
        assert np.degrees(np.arctan2(y, x)) == pytest.approx(5 + (frame.stamp_ns - frames[0].stamp_ns) * 1e-8)


def test_frames_of_logs_without_attitudes_are_the_same_objects(records):
    assert list(with_attitudes(records, [Channel(1, "/points", "cdr", None)])) == records


def test_methods_that_do_not_use_attitudes_get_none(monkeypatch):
    seen = []
    monkeypatch.setattr("seaclutter_cli.pipeline.with_attitudes", lambda records, channels: seen.append(1) or records)
    for name in ("joint", "confirmed"):
        source = open_source(ROOT / "samples" / "sea.mcap")
        list(run_each(source, [FILTERS[name](FILTERS[name].Params())], Selection(frames=1)))
        assert len(seen) == (name == "confirmed")


def test_warnings_of_a_method_are_those_of_its_recording():
    class Warned(FILTERS["none"]):
        warnings = ("the sea is green",)

    source = open_source(ROOT / "samples" / "sea.mcap")
    list(run_each(source, [Warned(Warned.Params())], Selection(frames=1)))
    assert source.warnings[-1] == "/points: the sea is green"


def test_frames_that_wait_are_few_whatever_the_log_times_say():
    """A log whose times stand still would be held whole."""
    source = open_source(ROOT / "samples" / "sea.mcap")
    [record, frame] = next(pair for pair in read(source, cloud_channels(source), Selection(frames=1)) if pair[1])
    still = iter([(record, frame)] * 100)
    pairs = with_attitudes(still, [IMU])
    for taken in range(1, 101):
        next(pairs)
        assert 100 - operator.length_hint(still) - taken <= 16
    assert next(pairs, None) is None
