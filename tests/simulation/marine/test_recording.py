import csv
import json

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.errors import OutputError
from seaclutter_cli.simulation.marine.formats import START_NS
from seaclutter_cli.simulation.marine.recording import record, simulate_frames
from seaclutter_cli.simulation.marine.scene import load_scene


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
