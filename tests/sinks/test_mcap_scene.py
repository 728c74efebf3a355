"""Boxes and clusters in a filtered MCAP file: ``filter --with-scene``."""

import json
from functools import partial

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.sinks.objects import LiveObjects
from seaclutter_cli.tracking.follow import Follower
from tests.commands.test_evaluate import make_labels, make_log
from tests.logs import cloud_log
from tests.paths import ROOT
from tests.running import execute

TOPIC = "/seaclutter/scene"


def filtered(log, target, *arguments, status=0):
    return execute("filter", log, "-o", target, "-m", "ring_intensity", *arguments, code=status)


@pytest.fixture
def log(tmp_path):
    return make_log(tmp_path / "log.mcap")


def scenes(path):
    with AnyReader([path]) as reader:
        chosen = [connection for connection in reader.connections if connection.topic == TOPIC]
        found = reader.messages(connections=chosen) if chosen else ()
        return [reader.deserialize(data, one.msgtype) for one, _, data in found]


def test_boxes_and_clusters(log, tmp_path):
    labels = make_labels(tmp_path / "boxes.csv")
    filtered(log, tmp_path / "f.mcap", "--with-scene", "--labels", labels)
    found = scenes(tmp_path / "f.mcap")
    assert len(found) == 6
    groups = [{entity.id: entity for entity in message.entities} for message in found]
    assert [len(group["/points clusters"].cubes) for group in groups] == [1, 2, 0, 2, 0, 1]
    assert [len(group["/points labels"].cubes) for group in groups] == [1, 1, 0, 1, 1, 0]
    assert [text.text for text in groups[1]["/points clusters"].texts] == ["false alarm"]
    assert [text.text for text in groups[4]["/points labels"].texts] == ["boat (missed)"]
    box = groups[0]["/points labels"].cubes[0]
    assert (box.pose.position.x, box.size.x) == (30.5, 3)


def test_unconfirmed_clusters_are_named(tmp_path):
    filtered(ROOT / "samples" / "sea.mcap", tmp_path / "f.mcap", "-m", "confirmed", "-n", 16, "--with-scene")
    entities = [message.entities[0] for message in scenes(tmp_path / "f.mcap")]
    assert [(len(one.cubes), [text.text for text in one.texts]) for one in entities][8] == (4, ["unconfirmed"] * 2)


def test_without_labels_there_are_clusters(log, tmp_path):
    filtered(log, tmp_path / "f.mcap", "--with-scene")
    found = scenes(tmp_path / "f.mcap")
    assert all(message.entities[0].id == "/points clusters" for message in found)
    assert not any(entity.id.endswith("labels") for message in found for entity in message.entities)


def test_objects_keep_their_ids(tmp_path):
    filtered(ROOT / "samples" / "sea.mcap", tmp_path / "f.mcap", "-m", "confirmed", "-n", 20, "--with-scene")
    last = {entity.id: entity for entity in scenes(tmp_path / "f.mcap")[-1].entities}
    boat = last["/points object 2"]
    assert (len(boat.cubes), len(boat.arrows)) == (1, 1)
    assert 6 < float({pair.key: pair.value for pair in boat.metadata}["vy_ms"]) < 8
    with AnyReader([tmp_path / "f.mcap"]) as reader:
        chosen = [one for one in reader.connections if one.topic == "/seaclutter/objects"]
        found = [reader.deserialize(data, one.msgtype) for one, _, data in reader.messages(connections=chosen)]
    assert [[one.id for one in message.detections][:2] for message in found] == [["1", "2"]] * 20
    assert found[-1].detections[0].results[0].hypothesis.class_id == "confirmed"


def test_entities_of_objects_that_are_gone_are_deleted():
    live = LiveObjects(partial(Follower, 1.5, 5))
    box = np.stack(np.meshgrid(np.arange(0, 3, 0.3), np.arange(20, 21, 0.3), [0.0, 0.5]), axis=-1).reshape(-1, 3)
    results = []
    for k in range(20):
        points = box if k < 10 else np.array([[60.0, 60, 0]])
        frame = Frame.of_arrays(points, np.full(len(points), 50.0), stamp_ns=10**9 + k * 10**8, index=k)
        results.append(live.tracks(FilterResult(frame, np.zeros(len(points), np.uint8))))
    assert [len(tracks) for tracks, _ in results] == [1] * 10 + [0] * 10
    assert [gone for _, gone in results if gone] == [["/points object 1"]]


def test_other_logs_than_ros_logs_get_json(tmp_path):
    log = cloud_log(tmp_path / "log.mcap", kind="protobuf", frames=3, points=500)
    filtered(log, tmp_path / "f.mcap", "--with-scene")
    with (tmp_path / "f.mcap").open("rb") as stream:
        found = [(schema.name, json.loads(m.data)) for schema, _, m in make_reader(stream).iter_messages([TOPIC])]
    assert [name for name, _ in found] == ["foxglove.SceneUpdate"] * 3
    assert all(content["entities"][0]["id"].endswith("clusters") for _, content in found)


def test_a_log_that_has_scenes_keeps_them(log, tmp_path):
    filtered(log, tmp_path / "f.mcap", "--with-scene")
    filtered(tmp_path / "f.mcap", tmp_path / "g.mcap", "--with-scene")
    with AnyReader([tmp_path / "g.mcap"]) as reader:
        assert {TOPIC, f"{TOPIC}_2"} <= {connection.topic for connection in reader.connections}


def test_labels_without_a_scene_are_an_error(log, tmp_path):
    labels = make_labels(tmp_path / "boxes.csv")
    assert "--with-scene" in filtered(log, tmp_path / "f.mcap", "--labels", labels, status=2).stderr
