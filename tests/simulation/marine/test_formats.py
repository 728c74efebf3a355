"""Round trip from a scene to a file and back to frames."""

from contextlib import closing

import numpy as np
import pytest

from seaclutter_cli.errors import UsageError
from seaclutter_cli.pipeline import frames
from seaclutter_cli.selection import Selection
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
def test_every_format_returns_the_frames(tmp_path, form):
    log = tmp_path / f"log.{form}"
    record(scene("RS-LiDAR-32"), log, tmp_path / "labels.csv")
    expected = list(simulate_frames(scene("RS-LiDAR-32")))
    found = read_log(log)
    assert [frame.index for frame in found] == list(range(FRAMES))
    assert [frame.size for frame in found] == [len(made.points) for made in expected]
    for frame, made in zip(found, expected, strict=True):
        assert abs(frame.stamp_ns - START_NS - (made.index + 1) * 10**8) < 2e6


@pytest.mark.parametrize("lidar", ["RS-LiDAR-32", "RS-LiDAR-16"])
def test_packets_have_the_precision_of_their_units(tmp_path, lidar):
    log = tmp_path / "log.pcap"
    record(scene(lidar), log, tmp_path / "labels.csv")
    for frame, simulated in zip(read_log(log), simulate_frames(scene(lidar)), strict=True):
        points = frame.cloud.points
        assert np.array_equal(points["ring"], simulated.points["ring"])
        assert np.array_equal(points["intensity"], simulated.points["intensity"])
        np.testing.assert_allclose(points["timestamp"] - START_NS / 1e9, simulated.points["timestamp"], atol=50e-6)
        read = np.array([points[axis] for axis in "xyz"], float)
        made = np.array([simulated.points[axis] for axis in "xyz"], float)
        ranges = np.linalg.norm(made, axis=0)
        assert np.abs(np.linalg.norm(read, axis=0) - ranges).max() < 0.0025 + 0.001
        azimuth = np.degrees(np.angle((read[0] + 1j * read[1]) / (made[0] + 1j * made[1])))
        elevation = np.degrees(np.arcsin(read[2] / np.linalg.norm(read, axis=0)) - np.arcsin(made[2] / ranges))
        assert np.abs(azimuth).max() < 0.0125  # truncated to 0.01 degrees, with offsets rounded to 0.01 degrees
        assert np.abs(elevation).max() < 0.005


def test_packets_are_for_robosense_only(tmp_path):
    with pytest.raises(UsageError, match="cannot write packets of OS1-64; choose one of RS-LiDAR-32, RS-LiDAR-16"):
        record(scene("OS1-64"), tmp_path / "log.pcap", tmp_path / "labels.csv")
    assert list(tmp_path.iterdir()) == []
