"""Recordings of scenes, and round trips from a scene to a file and back to frames."""

import csv
import json
from contextlib import closing

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.errors import OutputError, UsageError
from seaclutter_cli.reading import frames
from seaclutter_cli.selection import Selection
from seaclutter_cli.simulation.marine.recording import FORMATS, START_NS, record, simulate_frames
from seaclutter_cli.simulation.marine.scene import load_scene
from seaclutter_cli.sources.recordings import find_recordings

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


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    record(load_scene("calm").with_recording(frames=3), folder / "a.mcap", folder / "a.labels.csv")
    return folder


def test_other_libraries_read_the_log(made):
    typestore = get_typestore(Stores.ROS2_HUMBLE)
    with (made / "a.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        messages = list(reader.iter_messages())
        metadata = {item.name: item.metadata for item in reader.iter_metadata()}
    assert [message.log_time for _, _, message in messages] == [START_NS + k * 10**8 for k in (1, 2, 3)]
    cloud = typestore.deserialize_cdr(messages[1][2].data, "sensor_msgs/msg/PointCloud2")
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "intensity", "ring", "timestamp", "label"]
    expected = list(simulate_frames(load_scene("calm").with_recording(frames=2)))[1].points
    points = np.frombuffer(cloud.data, expected.dtype)
    np.testing.assert_array_equal(points["x"], expected["x"])
    np.testing.assert_allclose(points["timestamp"] - START_NS / 1e9, expected["timestamp"], atol=1e-6)
    assert json.loads(metadata["scene"]["scene"])["recording"]["frames"] == 3


def test_labels_are_native_csv(made):
    with (made / "a.labels.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["frame"] for row in rows] == [frame for frame in "012" for _ in range(3)]
    assert [row["class"] for row in rows[:3]] == ["ignore", "buoy", "sailing boat"]
    assert all(float(row["length"]) > 0 for row in rows)


def test_frames_without_targets_are_labelled_too(tmp_path):
    record(load_scene("clutter_only").with_recording(frames=2), tmp_path / "a.mcap", tmp_path / "a.csv")
    lines = (tmp_path / "a.csv").read_text().splitlines()[1:]
    assert [line.split(",")[:3] for line in lines] == [["0", "65535", "ignore"], ["1", "65535", "ignore"]]


@pytest.mark.parametrize("threads", [1, 5])
def test_the_bytes_do_not_depend_on_the_threads(made, tmp_path, monkeypatch, threads):
    monkeypatch.setenv("SEACLUTTER_THREADS", str(threads))
    record(load_scene("calm").with_recording(frames=3), tmp_path / "a.mcap", tmp_path / "a.labels.csv")
    for name in ("a.mcap", "a.labels.csv"):
        assert (tmp_path / name).read_bytes() == (made / name).read_bytes()


def test_an_interrupted_recording_leaves_no_files(tmp_path):
    def interrupt(frame):
        if frame.index == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(load_scene("calm"), tmp_path / "a.mcap", tmp_path / "a.csv", interrupt)
    assert list(tmp_path.iterdir()) == []


def test_an_output_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        record(load_scene("calm"), tmp_path / "file" / "a.mcap", tmp_path / "a.csv")
