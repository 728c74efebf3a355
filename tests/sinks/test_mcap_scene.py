"""Boxes and clusters in a filtered MCAP file: ``filter --with-scene``."""

import json

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from seaclutter_cli.commands import cli
from tests.commands.test_evaluate import make_labels, make_log
from tests.logs import cloud_log
from tests.paths import ROOT

TOPIC = "/seaclutter/scene"


def filtered(log, target, *arguments, status=0):
    words = ["filter", log, "-o", target, "-m", "ring_intensity", *arguments]
    result = CliRunner().invoke(cli, list(map(str, words)))
    assert result.exit_code == status, result.output
    return result


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
    assert [(len(one.cubes), [text.text for text in one.texts]) for one in entities][11] == (3, ["unconfirmed"])


def test_without_labels_there_are_clusters(log, tmp_path):
    filtered(log, tmp_path / "f.mcap", "--with-scene")
    found = scenes(tmp_path / "f.mcap")
    assert [[entity.id for entity in message.entities] for message in found] == [["/points clusters"]] * 6


def test_other_logs_than_ros_logs_get_json(tmp_path):
    log = cloud_log(tmp_path / "log.mcap", kind="protobuf", frames=3, points=500)
    filtered(log, tmp_path / "f.mcap", "--with-scene")
    with (tmp_path / "f.mcap").open("rb") as stream:
        found = [(schema.name, json.loads(m.data)) for schema, _, m in make_reader(stream).iter_messages([TOPIC])]
    assert [name for name, _ in found] == ["foxglove.SceneUpdate"] * 3
    assert all(content["entities"][0]["id"].endswith("clusters") for _, content in found)


def test_by_default_there_is_no_scene(log, tmp_path):
    filtered(log, tmp_path / "f.mcap")
    assert scenes(tmp_path / "f.mcap") == []


def test_a_log_that_has_scenes_keeps_them(log, tmp_path):
    filtered(log, tmp_path / "f.mcap", "--with-scene")
    filtered(tmp_path / "f.mcap", tmp_path / "g.mcap", "--with-scene")
    with AnyReader([tmp_path / "g.mcap"]) as reader:
        assert {TOPIC, f"{TOPIC}_2"} <= {connection.topic for connection in reader.connections}


def test_labels_without_a_scene_are_an_error(log, tmp_path):
    labels = make_labels(tmp_path / "boxes.csv")
    assert "--with-scene" in filtered(log, tmp_path / "f.mcap", "--labels", labels, status=2).stderr
