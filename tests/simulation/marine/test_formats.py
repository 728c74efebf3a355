"""The chain scene -> packets -> frames is closed."""

from contextlib import closing

import numpy as np
import pytest

from seaclutter_cli.errors import UsageError
from seaclutter_cli.pipeline import Selection, frames
from seaclutter_cli.simulation.marine.formats import FORMATS, START_NS
from seaclutter_cli.simulation.marine.recording import record, simulate_frames
from seaclutter_cli.simulation.marine.scene import load_scene
from seaclutter_cli.sources import find_recordings

FRAMES = 3


def scene(lidar):
    return load_scene("calm").with_recording(frames=FRAMES, lidar=lidar)


def read_log(path):
    with closing(find_recordings([str(path)])[0].open(rate_hz=10.0)) as source:
        return list(frames(source, Selection()))


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_gives_the_frames_again(tmp_path, form):
    log = tmp_path / f"log.{form}"
    record(scene("RS-LiDAR-32"), log, tmp_path / "labels.csv")
    expected = list(simulate_frames(scene("RS-LiDAR-32")))
    found = read_log(log)
    assert [frame.index for frame in found] == list(range(FRAMES))
    assert [frame.size for frame in found] == [len(turn.points) for turn in expected]
    for frame, turn in zip(found, expected, strict=True):
        assert abs(frame.stamp_ns - START_NS - (turn.index + 1) * 10**8) < 2e6


@pytest.mark.parametrize("lidar", ["RS-LiDAR-32", "RS-LiDAR-16"])
def test_packets_are_as_exact_as_their_units(tmp_path, lidar):
    log = tmp_path / "log.pcap"
    record(scene(lidar), log, tmp_path / "labels.csv")
    for frame, turn in zip(read_log(log), simulate_frames(scene(lidar)), strict=True):
        points = frame.cloud.points
        assert np.array_equal(points["ring"], turn.points["ring"])
        assert np.array_equal(points["intensity"], turn.points["intensity"])
        np.testing.assert_allclose(points["timestamp"] - START_NS / 1e9, turn.points["timestamp"], atol=50e-6)
        got = np.array([points[axis] for axis in "xyz"], float)
        made = np.array([turn.points[axis] for axis in "xyz"], float)
        ranges = np.linalg.norm(made, axis=0)
        assert np.abs(np.linalg.norm(got, axis=0) - ranges).max() < 0.0025 + 0.001
        azimuth = np.degrees(np.angle((got[0] + 1j * got[1]) / (made[0] + 1j * made[1])))
        elevation = np.degrees(np.arcsin(got[2] / np.linalg.norm(got, axis=0)) - np.arcsin(made[2] / ranges))
        assert np.abs(azimuth).max() < 0.0125  # cut to hundredths of a degree, with offsets rounded to them
        assert np.abs(elevation).max() < 0.005


def test_packets_are_of_robosense_only(tmp_path):
    with pytest.raises(UsageError, match=r"OS1-64 cannot be written; those of RS-LiDAR-32, RS-LiDAR-16 can"):
        record(scene("OS1-64"), tmp_path / "log.pcap", tmp_path / "labels.csv")
    assert list(tmp_path.iterdir()) == []
