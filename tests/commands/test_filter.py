"""Tests of ``seaclutter filter``: summaries, selections, several recordings, errors."""

import csv
import json
from collections import Counter
from functools import partial

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import InputError
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from tests.paths import SAMPLE
from tests.running import execute

TYPE = "sensor_msgs/msg/PointCloud2"
POINT = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")]
SECOND_NS = 10**9


def points(number, size=300, top=255):
    rng = np.random.default_rng(number)
    cloud = np.zeros(size, POINT)
    cloud["x"], cloud["y"] = rng.uniform(-65, 65, (2, size))
    cloud["intensity"] = rng.uniform(0, top, size)
    return cloud


def write_log(path, topics=("/points",), frames=5, make=points):
    """Write a log with one frame per second on each topic, and a JSON topic."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = ros2_schema(TYPE)
        schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
        channels = [writer.register_channel(topic, "cdr", schema_id) for topic in topics]
        note = writer.register_channel("/note", "json", writer.register_schema("note", "jsonschema", b"{}"))
        for index in range(frames):
            stamp = (100 + index) * SECOND_NS
            for number, channel in enumerate(channels):
                data = CODECS[TYPE, "cdr"].encode(from_array(make(index + 100 * number), stamp_ns=stamp))
                writer.add_message(channel, stamp, data, stamp, index)
            writer.add_message(note, stamp, b"{}", stamp, index)
        writer.finish()
    return path


invoke = partial(execute, "filter")


def messages(path, topic):
    with path.open("rb") as stream:
        return [message for _, _, message in make_reader(stream, validate_crcs=True).iter_messages(topics=[topic])]


@pytest.fixture
def log(tmp_path):
    return write_log(tmp_path / "log.mcap")


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out.mcap"


def test_the_real_sample(out):
    result = invoke(SAMPLE, "-c", "snow", "-o", out, code=0)
    assert "/points: 3 frames, 629,023 points in, 474,323 out (75.4 %)" in result.stdout
    assert len(messages(out, "/points")) == 3


def test_the_summary_is_the_sum_of_the_table_of_frames(log, out, tmp_path):
    result = invoke(log, "-o", out, "--csv", tmp_path / "frames.csv", "--json")
    (outcome,) = json.loads(result.stdout)
    topic = outcome["topics"]["/points"]
    with (tmp_path / "frames.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert topic["frames"] == len(rows) == 5
    for column in ("points_in", "points_out", "invalid", "near", "low_intensity", "outlier", "far", "excluded"):
        assert topic[column] == sum(int(row[column]) for row in rows)
    assert sum(ring["low_intensity"] for ring in topic["rings"]) == topic["low_intensity"]
    assert topic["rings"][0]["mean_threshold"] == pytest.approx(np.mean([float(row["threshold_1"]) for row in rows]))
    assert [int(row["frame"]) for row in rows] == [0, 1, 2, 3, 4]
    assert int(rows[0]["stamp_ns"]) == 100 * SECOND_NS


@pytest.mark.parametrize("scene", ["open", "confined", "auto"])
def test_the_summary_counts_frames_by_scene(log, out, tmp_path, scene):
    if scene == "auto":
        pytest.importorskip("onnxruntime", reason="needs the extra scene")
    table = tmp_path / "frames.csv"
    arguments = (log, "-m", "adaptive_radius", "-s", f"filter.scene={scene}", "--force", "--csv", table, "-o", out)
    (outcome,) = json.loads(invoke(*arguments, "--json").stdout)
    with table.open() as stream:
        scenes = [row["scene"] for row in csv.DictReader(stream)]
    assert outcome["topics"]["/points"]["scenes"] == dict(Counter(scenes))
    assert set(scenes) <= ({"open", "confined"} if scene == "auto" else {scene})
    assert f"frames by scene: {scenes[0]} " in invoke(*arguments).stdout


def test_each_topic_has_its_own_state(tmp_path):
    both = write_log(tmp_path / "both.mcap", ("/port", "/starboard"))
    result = invoke(both, "-o", tmp_path / "x.mcap", code=2)
    assert "choose from: -t /port -t /starboard" in result.stderr
    assert not (tmp_path / "x.mcap").exists()
    result = invoke(both, "-o", tmp_path / "together.mcap", "-t", "/port", "-t", "/starboard", code=0)
    for topic in ("/port", "/starboard"):
        alone = tmp_path / f"{topic[1:]}.mcap"
        invoke(both, "-o", alone, "-t", topic, code=0)
        ours, theirs = (messages(path, topic) for path in (tmp_path / "together.mcap", alone))
        assert [message.data for message in ours] == [message.data for message in theirs]


def test_rows_of_a_recording_that_fails_midway_are_removed(tmp_path, monkeypatch):
    def require_frames(source, frames, selection):
        if source.name == "b":
            raise InputError(f"b: broken after {frames} frames")

    monkeypatch.setattr("seaclutter_cli.runs.log_work.require_frames", require_frames)
    logs = [write_log(tmp_path / f"{name}.mcap") for name in "abc"]
    table = tmp_path / "all.csv"
    invoke(*logs, "-j", 1, "-o", tmp_path / "out", "--csv", table, code=1)
    with table.open() as stream:
        assert [row["recording"] for row in csv.DictReader(stream)] == ["a"] * 5 + ["c"] * 5
    result = invoke(logs[1], "-o", tmp_path / "b.out.mcap", "--csv", tmp_path / "b.csv")
    assert result.stderr == "Error: b: broken after 5 frames\n"
    assert not list(tmp_path.glob("b.*csv*"))


def test_globs_are_expanded_unless_a_file_has_that_name(tmp_path):
    odd = write_log(tmp_path / "log [1] ä.mcap")
    invoke(odd, "-o", tmp_path / "odd.mcap", code=0)
    invoke(tmp_path / "log*.mcap", "-o", tmp_path / "star.mcap", code=0)
    assert (tmp_path / "odd.mcap").read_bytes() == (tmp_path / "star.mcap").read_bytes()


def test_a_single_recording_can_go_into_an_existing_folder(log, tmp_path):
    (tmp_path / "out").mkdir()
    invoke(log, "-o", tmp_path / "out", code=0)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["log.mcap"]


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("none.mcap", "-o", "x.mcap"), 2, "none.mcap: no such file or folder"),
        (("no*.mcap", "-o", "x.mcap"), 2, "no*.mcap: no file matches this pattern"),
        (("notes.txt", "-o", "x.mcap"), 1, "notes.txt: unknown format"),
        (("empty.mcap", "-o", "x.mcap"), 1, "empty.mcap: the file is empty"),
        (("hollow", "-o", "x.mcap"), 2, "hollow: no logs or frames in this folder"),
        (("log.mcap",), 2, "Missing option '-o'"),
        (("log.mcap", "-o", "log.mcap", "--force"), 2, "is part of the input"),
        (("log.mcap", "-o", "old.mcap"), 2, "old.mcap: already exists; use --force to replace it"),
        (("log.mcap", "-o", "x.mcap", "--csv", "old.csv"), 2, "old.csv: already exists"),
        (("log.mcap", "log2.mcap", "-o", "old.mcap"), 2, "is a file, but 2 recordings need a folder"),
        (("log.mcap", "sub/log.mcap", "-o", "dir"), 2, "would both become"),
        (("log.mcap", "-o", "x.mcap", "-t", "/note"), 2, "no point-cloud topic /note; choose from: -t /points"),
        (("log.mcap", "-o", "x.mcap", "--intensity-field", "power"), 1, "no field 'power'; the cloud has x, y, z"),
        (("log.mcap", "-o", "x.mcap", "-m", "magic"), 2, "unknown method 'magic'"),
        (("log.mcap", "-o", "x.mcap", "-s", "filter.end_m=5"), 2, "end_m (5) must be greater"),
        (("log.mcap", "-o", "x.mcap", "-n", "0"), 2, "-n"),
        (("plain.mcap", "-o", "x.mcap"), 1, "no intensity field; the cloud has x, y, z"),
        (("cloudless.mcap", "-o", "x.mcap"), 1, "no point clouds that can be read; the log has /note"),
    ],
)
def test_refused_arguments(tmp_path, monkeypatch, arguments, status, message):
    monkeypatch.chdir(tmp_path)
    for name in ("log", "log2", "sub/log"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_log(tmp_path / f"{name}.mcap")
    write_log(tmp_path / "plain.mcap", make=lambda number: points(number)[["x", "y", "z"]])
    write_log(tmp_path / "cloudless.mcap", topics=())
    (tmp_path / "notes.txt").write_text("hello")
    (tmp_path / "hollow").mkdir()
    for name in ("empty.mcap", "old.mcap", "old.csv"):
        (tmp_path / name).write_bytes(b"")
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    result = invoke(*arguments)
    assert (result.exit_code, message in result.stderr) == (status, True), result.stderr
    assert isinstance(result.exception, SystemExit)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


@pytest.mark.parametrize(("bad", "status"), [({0}, 3), ({0, 3}, 3), ({4}, 3), ({0, 1, 2, 3, 4}, 1)])
def test_frames_that_lack_a_field_are_left_out_unless_all_do(tmp_path, out, bad, status):
    def make(number):
        cloud = points(number)
        return cloud[["x", "y", "z"]] if number in bad else cloud

    result = invoke(write_log(tmp_path / "log.mcap", make=make), "-o", out)
    assert result.exit_code == status
    assert "no intensity field" in result.stderr
    if status == 3:
        assert len(messages(out, "/points")) == 5 - len(bad)
    else:
        assert not out.exists()


def test_a_log_without_frames_is_not_an_error(tmp_path, out):
    log = write_log(tmp_path / "none.mcap", frames=0)
    result = invoke(log, "-o", out, code=0)
    assert "0 frames" in result.stdout
    with out.open("rb") as stream:
        channels = make_reader(stream).get_summary().channels.values()
    assert {"/points", "/note", "/seaclutter/diagnostics"} <= {channel.topic for channel in channels}


@pytest.mark.parametrize(
    ("top", "thresholds", "warned"),
    [
        (1, "[30,16,7,4]", "no point can pass: intensities are 0"),
        (255, "[30,16,7,4]", None),
        (255, "[0,0,0,0]", "no point is below its threshold"),
        (1, "[0.5,0.4,0.3,0.2]", None),
    ],
)
def test_warnings_about_thresholds_that_cannot_fit(tmp_path, out, top, thresholds, warned):
    log = write_log(tmp_path / "log.mcap", make=lambda number: points(number, top=top))
    result = invoke(log, "-o", out, "-s", f"filter.initial_thresholds={thresholds}", code=0)
    assert (warned in result.stderr and "calibrate" in result.stderr) if warned else "Warning" not in result.stderr
    assert result.stderr.count("Warning") == bool(warned)
    assert "Warning" not in invoke(log, "-o", out, "--force", "-q").stderr


def test_a_warning_about_negative_intensities(tmp_path, out):
    def signed(number):
        cloud = points(number)
        cloud["intensity"][::2] -= 128
        return cloud

    assert "some intensities are negative" in invoke(write_log(tmp_path / "log.mcap", make=signed), "-o", out).stderr


@pytest.mark.parametrize(
    ("first", "second", "warned"),
    [
        ((), (), True),
        ((), ("-m", "none"), False),
        (("--keep-raw",), ("-t", "/points"), False),
        (("--keep-raw",), ("-t", "/points/filtered"), True),
    ],
)
def test_a_warning_about_filtered_logs(log, out, tmp_path, first, second, warned):
    invoke(log, "-o", out, "-q", *first)
    result = invoke(out, "-o", tmp_path / "again.mcap", *second, code=0)
    assert ("already filtered" in result.stderr) == warned


def test_a_log_without_remaining_points(log, out):
    result = invoke(log, "-o", out, "-s", "filter.start_m=500", "-s", "filter.end_m=560")
    assert "/points: no points are left; " in result.stderr
    assert "100.0 % were removed: nearer than 500 m (filter.start_m)" in result.stderr
