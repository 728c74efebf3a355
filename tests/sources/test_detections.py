"""Detections and ground truth of Autoferry's scenarios, in folders written to their description."""

import json
from functools import partial

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

import seaclutter
from seaclutter_cli.errors import InputError, LabelError
from seaclutter_cli.labels import open_labels
from seaclutter_cli.records import Message
from seaclutter_cli.sources.formats import open_source
from tests.running import execute
from tests.sources import scenarios

LIDAR, RADAR = "/lidar/detections", "/radar/detections"


run = partial(execute, code=0)


def frames(path, topic):
    with seaclutter.open_log(path) as log:
        return list(log.frames(topic))


def test_positions_are_clouds_with_x_north_and_y_west(tmp_path):
    path = scenarios.write(tmp_path) / "scenario2_detections.json"
    first, empty = frames(path, LIDAR)
    assert first.xyz.tolist() == [[118.0, -426.0, 0.0]]
    assert empty.size == 0
    (radar,) = frames(path, RADAR)
    assert radar.xyz.tolist() == [[118.5, -426.5, 0], [50, 60, 0], [-122.5, -197.5, 0]]
    assert [one.stamp_ns for one in (first, radar, empty)] == [
        1620114892_250000000 + k * 125_000_000 for k in (0, 2, 4)
    ]


def test_own_ship_is_a_pose_before_each_cloud(tmp_path):
    source = open_source(scenarios.write(tmp_path) / "scenario2_detections.json")
    records = [record for record in source.records() if isinstance(record, Message)]
    assert [record.channel.topic for record in records] == ["/pose", LIDAR, "/pose", RADAR, "/pose", LIDAR]
    store = get_typestore(Stores.ROS2_HUMBLE)
    poses = [store.deserialize_cdr(one.data, "geometry_msgs/msg/PoseStamped").pose for one in records[::2]]
    assert [(one.position.x, one.position.y) for one in poses] == [(-16.5, 390.25), (-15.5, 391.5), (-14.5, 393.0)]
    assert {one.orientation.w for one in poses} == {1.0}
    ids = {channel.topic: channel.id for channel in source.channels}
    assert source.counts == {ids[LIDAR]: 2, ids[RADAR]: 1, ids["/pose"]: 3}
    start_ns = records[2].log_time_ns
    assert source.skipped(start_ns) == {ids[LIDAR]: 1, ids[RADAR]: 0, ids["/pose"]: 1}
    assert len(list(source.records(start_ns, start_ns + 1))) == 2
    assert source.span_ns == (records[0].log_time_ns, records[-1].log_time_ns)
    assert source.warnings == ["scenario2: 2 detections of cameras are left out; they are bearings"]


def test_targets_are_relative_to_own_ship(tmp_path):
    folder = scenarios.write(tmp_path)
    labels = open_labels(folder)
    for topic, indices in ((LIDAR, (0, 4)), (RADAR, (2,))):
        for frame, index in zip(frames(folder / "scenario2_detections.json", topic), indices, strict=True):
            own, chosen = scenarios.OWN[index], scenarios.TARGETS if index < 4 else scenarios.TARGETS[1:]
            expected = [[place[0] - own[0], own[1] - place[1], 0] for place in chosen]
            targets = labels.truth(frame).targets
            np.testing.assert_allclose(targets.centers, expected)
            assert not targets.sizes.any()
            assert targets.tracks == (("1", "2") if index < 4 else ("2",))
    assert open_labels(folder / "scenario2_groundTruth.json").truth(frame) is not None


def test_evaluate_counts_detections(tmp_path):
    folder = scenarios.write(tmp_path)
    settings = ("min_cluster_points=1", "min_visible_points=1", "box_margin_m=25")
    words = [word for setting in settings for word in ("-s", f"evaluation.{setting}")]
    log = folder / "scenario2_detections.json"
    run("evaluate", log, "-t", RADAR, "--labels", folder, "-m", "none", *words, "--summary", tmp_path / "s.json")
    summary = json.loads((tmp_path / "s.json").read_text())["methods"]["none"]
    assert (summary["frames"], summary["N_FP"]) == (1, 1), "one of three positions is at no target"
    assert (
        "choose from: -t /lidar/detections -t /radar/detections"
        in run("evaluate", log, "--labels", folder, code=2).stderr
    )


@pytest.mark.parametrize(
    "change",
    [
        {"measurement": [1, 2, 3]},
        {"measurement": "x"},
        {"measurement": [1, float("nan")]},
        {"time": -1},
        {"time": 1e300},
        {"time": None},
        {"ownshipPosition": [1]},
        {"sensorID": [1]},
    ],
)
def test_detections_that_are_not_valid_are_damage(tmp_path, change):
    path = scenarios.write(tmp_path, **{"0": change}) / "scenario2_detections.json"
    result = run("info", path, "-t", LIDAR, code=3)
    assert "detection 0 is not valid" in result.stderr
    assert len(frames(path, LIDAR)) == 1


@pytest.mark.parametrize("text", ["", "{}", "3", "[", "\x00"])
def test_files_that_are_no_detections(tmp_path, text):
    path = tmp_path / "scenario2_detections.json"
    path.write_text(text)
    with pytest.raises(InputError, match="scenario2_detections"):
        open_source(path)


@pytest.mark.parametrize(
    ("text", "problem"),
    [("[]", "an entry for each detection"), ("{", "not valid JSON"), ('[{"targetID": 1}, [], [], [], []]', "position")],
)
def test_ground_truth_that_is_not_valid(tmp_path, text, problem):
    folder = scenarios.write(tmp_path)
    (folder / "scenario2_groundTruth.json").write_text(text)
    with pytest.raises(LabelError, match=problem):
        open_labels(folder).truth(frames(folder / "scenario2_detections.json", LIDAR)[0])


def test_ground_truth_needs_its_detections(tmp_path):
    folder = scenarios.write(tmp_path)
    (folder / "scenario2_detections.json").unlink()
    with pytest.raises(LabelError, match="no labels in a known format"):
        open_labels(folder)
