"""ROS 2 recordings against the reader of rosbags, sqlite3 and the rules of rosbag2."""

import re
import sqlite3
from contextlib import closing

import pytest
import yaml
from rosbags.rosbag2 import Reader

from seaclutter_cli.records import Channel, Schema
from seaclutter_cli.runs.convert import convert_log
from seaclutter_cli.sinks.bag_writer import BagWriter
from seaclutter_cli.sinks.options import Split
from seaclutter_cli.sources.formats import open_source
from tests.logs import Entry, Topic, cloud_messages, cloud_topic, write_log

START_NS = 1_700_000_000 * 10**9
KINDS = pytest.mark.parametrize("form", ["rosbag2-db3", "rosbag2-mcap"])


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return an MCAP log with clouds, a latched topic, and a topic without messages."""
    path = tmp_path_factory.mktemp("logs") / "trial.mcap"
    topics = [
        cloud_topic("/points"),
        Topic("/map", "cdr", ("std_msgs/msg/String", "ros2msg", b"string data\n"), {"offered_qos_profiles": QOS}),
        Topic("/empty", "cdr", ("std_msgs/msg/Bool", "ros2msg", b"bool data\n")),
    ]
    text = bytes((0, 1, 0, 0)) + (5).to_bytes(4, "little") + b"land\0"
    entries = [Entry("/map", START_NS, text)]
    clouds = cloud_messages("ros2", 10, 50)
    entries += [Entry("/points", START_NS + (k + 1) * 10**8, data) for k, data in enumerate(clouds)]
    return write_log(path, topics, entries, profile="ros2")


QOS = "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n" + "\n".join(
    f"  {name}:\n    sec: 0\n    nsec: 0" for name in ("deadline", "lifespan", "liveliness_lease_duration")
)
QOS += "\n  liveliness: 1\n  avoid_ros_namespace_conventions: false"


def convert(log, target, form, **written):
    (outcome,) = convert_log(log, target, to=form, **written, keep_going=True).outcomes
    assert (outcome.error, outcome.damage) == (None, [])
    return outcome


@KINDS
def test_the_folder_is_named_and_listed_as_by_rosbag2(log, tmp_path, form):
    convert(log, tmp_path / "day", form)
    suffix = {"rosbag2-db3": ".db3", "rosbag2-mcap": ".mcap"}[form]
    assert sorted(file.name for file in (tmp_path / "day").iterdir()) == [f"day_0{suffix}", "metadata.yaml"]
    info = yaml.safe_load((tmp_path / "day" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert info["storage_identifier"] == {"rosbag2-db3": "sqlite3", "rosbag2-mcap": "mcap"}[form]
    assert info["relative_file_paths"] == [f"day_0{suffix}"]
    assert info["message_count"] == sum(one["message_count"] for one in info["files"]) == 11
    assert info["starting_time"]["nanoseconds_since_epoch"] == START_NS
    assert info["duration"]["nanoseconds"] == 10**9
    counts = {one["topic_metadata"]["name"]: one["message_count"] for one in info["topics_with_message_count"]}
    assert counts == {"/points": 10, "/map": 1, "/empty": 0}


@KINDS
def test_rosbags_reads_topics_counts_and_quality_of_service(log, tmp_path, form):
    convert(log, tmp_path / "day", form)
    with Reader(tmp_path / "day") as reader:
        assert reader.message_count == 11
        assert (reader.start_time, reader.duration) == (START_NS, 10**9 + 1)
        topics = {c.topic: c for c in reader.connections}
        assert topics["/map"].ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"
        assert topics["/points"].digest.startswith("RIHS01_")
        assert len(list(reader.messages())) == 11


@KINDS
def test_quality_of_service_has_the_numbers_of_this_version(log, tmp_path, form):
    """Up to version 8 of the metadata, as in ROS 2 Iron; rosbag2 names policies since version 9, as in Jazzy."""
    names = {"history": "keep_last", "reliability": "best_effort", "durability": "volatile", "liveliness": "automatic"}
    named = re.sub("(history|reliability|durability|liveliness): 1", lambda m: f"{m[1]}: {names[m[1]]}", QOS)
    topic = Topic("/map", "cdr", ("std_msgs/msg/String", "ros2msg", b"string data\n"), {"offered_qos_profiles": named})
    entry = Entry("/map", START_NS, bytes((0, 1, 0, 0, 1, 0, 0, 0, 0)))
    convert(write_log(tmp_path / "log.mcap", [topic], [entry]), tmp_path / "day", form)
    numbered = QOS.replace("reliability: 1", "reliability: 2").replace("durability: 1", "durability: 2")
    info = yaml.safe_load((tmp_path / "day" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert info["version"] == 8
    (found,) = info["topics_with_message_count"]
    assert found["topic_metadata"]["offered_qos_profiles"] == numbered
    with closing(open_source(tmp_path / "day")) as source:
        assert [dict(channel.metadata)["offered_qos_profiles"] for channel in source.channels] == [numbered]


def test_the_database_has_the_schema_of_rosbag2(log, tmp_path):
    convert(log, tmp_path / "day", "rosbag2-db3")
    with closing(sqlite3.connect(tmp_path / "day" / "day_0.db3")) as db:
        assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert db.execute("SELECT schema_version FROM schema").fetchall() == [(4,)]
        assert ("timestamp_idx",) in db.execute("SELECT name FROM sqlite_master WHERE type = 'index'").fetchall()
        rows = db.execute("SELECT topic_type, encoding FROM message_definitions ORDER BY id").fetchall()
        assert rows[0] == ("sensor_msgs/msg/PointCloud2", "ros2msg")
        assert len(rows) == 3


@KINDS
def test_metadata_records_come_back(log, tmp_path, form):
    convert(log, tmp_path / "day", form)
    source = open_source(tmp_path / "day")
    assert {"seaclutter.run", "seaclutter.topics"} <= {one.name for one in source.metadata}
    source.close()


@KINDS
@pytest.mark.parametrize("split", [Split(duration_ns=3 * 10**8), Split(size=4000)])
def test_parts_are_files_of_one_folder(log, tmp_path, form, split):
    convert(log, tmp_path / "day", form, split=split)
    names = yaml.safe_load((tmp_path / "day" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert len(names["relative_file_paths"]) > 2
    with Reader(tmp_path / "day") as reader:
        assert len(list(reader.messages())) == 11


@KINDS
def test_the_same_bytes_in_every_run(log, tmp_path, form):
    contents = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        convert(log, tmp_path / name / "day", form)
        contents.append({file.name: file.read_bytes() for file in (tmp_path / name / "day").iterdir()})
    assert contents[0] == contents[1]


def test_publishers_of_one_topic_are_joined(tmp_path):
    """ROS 2 has one entry for a topic, ROS 1 one for each publisher. A log needs no clouds."""
    path = tmp_path / "a.bag"
    with path.open("wb") as stream:
        writer = BagWriter(stream, compression="")
        for number in (0, 1):
            schema = Schema("std_msgs/Bool", "ros1msg", b"bool data\n")
            writer.add_channel(Channel(number, "/on", "ros1", schema, (("callerid", f"/node_{number}"),)))
            writer.write(number, START_NS + number, START_NS + number, 0, b"\1")
        writer.finish()
    assert convert(path, tmp_path / "day", "rosbag2-db3").messages == 2
    with Reader(tmp_path / "day") as reader:
        assert [(c.topic, c.msgcount) for c in reader.connections] == [("/on", 2)]
