"""The command convert, and what filter and convert share: parts, other topics, formats, --resume, -j."""

import json
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import UsageError
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.metadata import recorded_topics
from seaclutter_cli.reading import frames
from seaclutter_cli.records import Message
from seaclutter_cli.selection import Selection
from seaclutter_cli.sinks import options as sinks_options
from seaclutter_cli.sinks.formats import OUTPUT_FORMATS
from seaclutter_cli.sinks.frames import FrameSink
from seaclutter_cli.sources.formats import open_source
from seaclutter_cli.sources.recordings import find_recordings
from tests.logs import Entry, Extra, Topic, cloud_messages, cloud_topic, write_log
from tests.pairs import covering
from tests.running import execute

START_NS = 1_700_000_000 * 10**9
TEXT = ("std_msgs/msg/String", "ros2msg", b"string data\n")
FORMS = pytest.mark.parametrize("form", OUTPUT_FORMATS)
LOG_FORMS = pytest.mark.parametrize("form", [name for name, kind in OUTPUT_FORMATS.items() if kind.has_topics])


run = partial(execute, code=0)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def text(word):
    return bytes((0, 1, 0, 0)) + (len(word) + 1).to_bytes(4, "little") + word.encode() + b"\0"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return a log of two seconds with clouds, texts, and static transforms at its beginning."""
    topics = [cloud_topic("/points"), Topic("/text", "cdr", TEXT), Topic("/tf_static", "cdr", TEXT)]
    topics.append(Topic("/camera/info", "json", None))
    entries = [Entry("/tf_static", START_NS, text("static")), Entry("/camera/info", START_NS, b"{}")]
    for number, data in enumerate(cloud_messages("ros2", 20, 50)):
        entries.append(Entry("/points", START_NS + number * 10**8, data, sequence=number))
        entries.append(Entry("/text", START_NS + number * 10**8 + 1, text(f"{number}")))
    path = tmp_path_factory.mktemp("logs") / "trial.mcap"
    return write_log(path, topics, entries, extras=[Extra("notes.txt", data=b"x")])


def target_of(folder, form):
    return folder / ("out" + ("" if OUTPUT_FORMATS[form].is_folder else OUTPUT_FORMATS[form].suffix))


def topics_in(path):
    with closing(open_source(path)) as source:
        found = [record.channel.topic for record in source.records() if isinstance(record, Message)]
        return {topic: found.count(topic) for topic in found}


def indices(path):
    with closing(open_source(path)) as source:
        return [frame.index for frame in frames(source, Selection())]


@LOG_FORMS
def test_all_topics_are_converted(log, tmp_path, form):
    run("convert", log, "-o", target_of(tmp_path, form), "--to", form)
    expected = {"/points": 20, "/text": 20, "/tf_static": 1}
    assert topics_in(target_of(tmp_path, form)) == expected | ({"/camera/info": 1} if form == "mcap" else {})


@FORMS
def test_what_is_lost_is_said_in_one_line(log, tmp_path, form):
    result = run("convert", log, "-o", target_of(tmp_path, form), "--to", form)
    lost = {
        "mcap": None,
        "bag": "1 attachment, sequence numbers, /camera/info (its messages have no definition)",
        "rosbag2-db3": "1 attachment, sequence numbers, /camera/info (its messages have no definition)",
        "rosbag2-mcap": "/camera/info (its messages have no definition)",
        "las": "log times other than stamps, 500 points without coordinates, 3 other topics, 1 attachment",
        "laz": "log times other than stamps, 500 points without coordinates, 3 other topics, 1 attachment",
    }.get(form, "log times other than stamps, 3 other topics, 1 attachment")
    lines = [line for line in result.stderr.splitlines() if "Warning" in line]
    assert [line.partition(": ")[2].partition(" cannot keep: ")[2] for line in lines] == ([lost] if lost else [])


@pytest.mark.parametrize(("form", "command"), covering(OUTPUT_FORMATS, ("convert", "filter")))
def test_clips_keep_frame_numbers(log, tmp_path, form, command):
    target = target_of(tmp_path, form)
    run(command, log, "-o", target, "--to", form, "--start", "0.5", "--end", "1.05")
    assert indices(target) == [5, 6, 7, 8, 9, 10]
    again = tmp_path / "again.mcap"
    run("convert", target, "-o", again, "--start", "0.2")
    assert indices(again) == [7, 8, 9, 10]


@LOG_FORMS
def test_clips_keep_latched_messages(log, tmp_path, form):
    target = target_of(tmp_path, form)
    run("convert", log, "-o", target, "--to", form, "--start", "2023-11-14T22:13:21Z", "-n", "2")
    assert topics_in(target) == {"/tf_static": 1, "/points": 2, "/text": 2}


@FORMS
def test_an_empty_clip_is_refused(log, tmp_path, form):
    result = run("convert", log, "-o", target_of(tmp_path, form), "--to", form, "--start", "90", code=2)
    assert "no recording has a frame in the selected time" in result.stderr or "no frames from 90 s" in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("form", "command"), covering(OUTPUT_FORMATS, ("filter", "convert")))
def test_resume_and_force(log, tmp_path, form, command):
    target = target_of(tmp_path, form)
    arguments = [command, log, "-o", target, "--to", form]
    run(*arguments)
    before = contents(target)
    assert "already exists; use --force" in run(*arguments, code=2).stderr
    assert "skipped, the output was complete" in run(*arguments, "--resume").output
    assert contents(target) == before
    result = run(*arguments, "--resume", "-n", "3", "-q")
    assert "Traceback" not in result.output
    assert len(indices(target)) == 3
    run(*arguments, "--force")
    assert {name: data for name, (data, _) in contents(target).items()} == {n: d for n, (d, _) in before.items()}


def contents(path):
    files = [path] if path.is_file() else sorted(path.iterdir())
    return {file.name: (file.read_bytes(), file.stat().st_mtime_ns) for file in files}


@FORMS
def test_several_recordings_in_processes_give_the_same_bytes(log, tmp_path, form):
    for name in ("a", "b"):
        (tmp_path / f"{name}.mcap").write_bytes(log.read_bytes())
    for jobs in ("1", "2"):
        run("convert", tmp_path / "a.mcap", tmp_path / "b.mcap", "-o", f"{tmp_path}/{jobs}/", "--to", form, "-j", jobs)
    trees = [
        {
            file.relative_to(tmp_path / jobs): file.read_bytes()
            for file in (tmp_path / jobs).rglob("*")
            if file.is_file()
        }
        for jobs in "12"
    ]
    assert trees[0] == trees[1]
    assert len(trees[0]) >= 2


@LOG_FORMS
def test_parts_are_one_recording(log, tmp_path, form):
    """By duration, parts begin at multiples of it; each records the number of its first frame."""
    target = target_of(tmp_path, form)
    run("convert", log, "-o", target, "--to", form, "--split", "0.5s")
    if OUTPUT_FORMATS[form].is_folder:
        path = target
        parts = sorted(one for one in target.iterdir() if one.name != "metadata.yaml")
    else:
        parts = sorted(tmp_path.iterdir())
        path = None
    assert [part.name.rpartition(".")[0] for part in parts] == [f"out_{number}" for number in range(4)]
    assert [indices(part) for part in parts] == [list(range(at, at + 5)) for at in (0, 5, 10, 15)]
    if path is None:
        (recording,) = find_recordings([str(tmp_path)])
        with closing(recording.open()) as source:
            assert [frame.index for frame in frames(source, Selection())] == list(range(20))
    else:
        assert indices(path) == list(range(20))


def test_parts_by_size(log, tmp_path):
    run("filter", log, "-o", tmp_path / "out.mcap", "--split", "5kB", "--keep-raw", "-m", "none")
    parts = sorted(tmp_path.iterdir(), key=lambda path: int(path.stem.partition("_")[2]))
    assert len(parts) > 3
    with closing(open_source(parts[1])) as source:
        recorded = recorded_topics(source.metadata)
        first = next(frames(source, Selection(topics=["/points"])))
    assert first.index == recorded["/points"].first_frame == recorded["/points/filtered"].first_frame > 0
    assert sum(topics_in(part).get("/points", 0) for part in parts) == 20


def test_fewer_parts_leave_none_of_an_earlier_run(log, tmp_path):
    run("convert", log, "-o", tmp_path / "out.bag", "--split", "0.3s")
    assert len(list(tmp_path.iterdir())) == 7
    result = run("convert", log, "-o", tmp_path / "out.bag", "--split", "1s", code=2)
    assert "out_0.bag: already exists" in result.stderr
    run("convert", log, "-o", tmp_path / "out.bag", "--split", "1s", "--force")
    assert (names(tmp_path)) == ["out_0.bag", "out_1.bag"]


def test_a_failed_run_leaves_no_part(log, tmp_path):
    result = run("filter", log, "-o", tmp_path / "out.bag", "--split", "0.3s", "--intensity-field", "none", code=1)
    assert "none" in result.stderr
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("options", "kept"),
    [
        (["--include", "^/t"], {"/text", "/tf_static"}),
        (["--include", "text", "--include", "camera"], {"/text", "/camera/info"}),
        (["--exclude", "^/t"], {"/camera/info"}),
        (["--include", "^/t", "--exclude", "static$"], {"/text"}),
    ],
)
def test_other_topics_by_regular_expression(log, tmp_path, options, kept):
    run("filter", log, "-o", tmp_path / "out.mcap", "--no-diagnostics", *options)
    assert set(topics_in(tmp_path / "out.mcap")) == {"/points", *kept}
    run("convert", log, "-o", tmp_path / "other.mcap", "-t", "/points", *options)
    assert set(topics_in(tmp_path / "other.mcap")) == {"/points", *kept}
    with closing(open_source(tmp_path / "out.mcap")) as source:
        assert {channel.topic for channel in source.channels} == {"/points", *kept}


@pytest.mark.parametrize("command", ["convert", "filter"])
def test_a_pattern_that_matches_nothing_is_named(log, tmp_path, command):
    result = run(command, log, "-o", tmp_path / "out.mcap", "--include", "radar", "--exclude", "^/t")
    assert "trial: --include radar matches no topic" in result.stderr
    assert "--exclude" not in result.stderr


def test_convert_without_a_topic_chooses_clouds_too(log, tmp_path):
    run("convert", log, "-o", tmp_path / "out.bag", "--include", "text")
    assert topics_in(tmp_path / "out.bag") == {"/text": 20}


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--include", "("], "not a regular expression"),
        (["--split", "7"], "expected a size such as 2GB, or a duration such as 10min"),
        (["--split", "0s"], "expected a size"),
        (["--to", "pcd", "--split", "1s"], "--split: PCD files have no topics"),
        (["--to", "bag", "--compression", "zstd"], "--compression: ROS 1 bags have lz4, none"),
        (["--to", "rosbag2-db3", "--compression", "lz4"], "ROS 2 recordings in sqlite3 have none"),
    ],
)
def test_wrong_options(log, tmp_path, options, problem):
    assert problem in run("convert", log, "-o", tmp_path / "out", *options, code=2).stderr
    assert names(tmp_path) == []


def test_frames_have_no_topics(log, tmp_path):
    result = run("filter", log, "-o", tmp_path / "out", "--to", "npz", "--keep-raw", "--with-scene", code=2)
    assert "--keep-raw, --with-scene: NPZ files have no topics" in result.stderr


def test_a_file_of_one_frame(log, tmp_path):
    result = run("convert", log, "-o", tmp_path / "out.pcd", code=2)
    assert "has room for one frame only; name a folder, as in -o out --to pcd, or add -n 1" in result.stderr
    assert names(tmp_path) == []
    run("convert", log, "-o", tmp_path / "out.pcd", "-n", "1")
    assert names(tmp_path) == ["out.pcd"]


def test_a_folder_of_something_else_is_not_replaced(log, tmp_path):
    mine = tmp_path / "trial" / "mine.txt"
    mine.parent.mkdir()
    mine.write_text("mine")
    result = run("convert", log, "-o", f"{tmp_path}/", "--to", "pcd", "--force", code=2)
    assert "trial: is a folder of something else" in result.stderr
    assert mine.read_text() == "mine"


def other_files(folder, kind):
    """Put what no run wrote into the output of a run; return its name."""
    if kind == "of a recorder":
        (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 5, relative_file_paths: []}")
        return "metadata.yaml has no record of a run"
    if kind == "of a program with the same name":
        (folder / "seaclutter.json").write_text('{"metadata": []}')
        return "seaclutter.json has no record of a run"
    if kind == "a folder":
        (folder / "photos").mkdir()
        return "not of the run that wrote it, photos"
    name = {"a frame": "000099.pcd", "a file": "notes.txt", "a log": "trial_7.db3"}[kind]
    (folder / name).write_bytes(b"mine")
    return f"not of the run that wrote it, {'0000' if kind == 'a frame' else name}"


@pytest.mark.parametrize(
    ("form", "kind"),
    [
        *(("rosbag2-db3", kind) for kind in ("of a recorder", "a file", "a folder", "a log")),
        *(("pcd", kind) for kind in ("of a program with the same name", "a file", "a folder", "a frame")),
    ],
)
def test_a_folder_with_other_files_is_not_replaced(log, tmp_path, form, kind):
    out = tmp_path / "out"
    run("convert", log, "-o", out, "--to", form)
    run("convert", log, "-o", out, "--to", form, "--force")
    problem = other_files(out, kind)
    before = {path: path.is_dir() or path.read_bytes() for path in out.iterdir()}
    result = run("convert", log, "-o", out, "--to", form, "--force", code=2)
    assert problem in " ".join(result.stderr.split())
    assert {path: path.is_dir() or path.read_bytes() for path in out.iterdir()} == before


def test_a_file_that_is_put_into_a_folder_while_it_is_replaced(log, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run("convert", log, "-o", out, "--to", "pcd")
    end = FrameSink.end

    def busy(sink):
        (out / "notes.txt").write_text("mine")
        end(sink)

    monkeypatch.setattr(FrameSink, "end", busy)
    result = run("convert", log, "-o", out, "--to", "pcd", "--force", "-n", "2", code=1)
    assert "notes.txt, so it was not replaced" in " ".join(result.stderr.split())
    assert (out / "notes.txt").read_text() == "mine"


def test_an_output_does_not_replace_its_input(log, tmp_path):
    run("convert", log, "-o", tmp_path / "out", "--to", "rosbag2-db3")
    for name in ("out", "out/out_0.db3"):
        result = run("convert", tmp_path / name, "-o", tmp_path / "out", "--to", "rosbag2-db3", "--force", code=2)
        assert "the input, LOGS" in result.stderr


def test_an_existing_folder_holds_the_outputs(log, tmp_path):
    (tmp_path / "all").mkdir()
    run("convert", log, "-o", tmp_path / "all", "--to", "rosbag2-mcap")
    assert (names(tmp_path / "all" / "trial")) == ["metadata.yaml", "trial_0.mcap"]


def test_json_and_manifest(log, tmp_path):
    result = run(
        "convert", log, "-o", tmp_path / "out.bag", "--json", "--manifest", tmp_path / "runs.json", "-t", "/points"
    )
    (found,) = json.loads(result.stdout)["results"] if "results" in result.stdout else json.loads(result.stdout)
    assert (found["format"], found["messages"], found["topics"]) == (
        "bag",
        41,
        {"/points": {"frames": 20, "points": 1000}},
    )
    assert found["lost"][0] == "1 attachment"
    (row,) = json.loads((tmp_path / "runs.json").read_text())
    assert (row["frames"], row["points_in"], row["points_out"]) == (20, 1000, 1000)


def test_organised_clouds_keep_their_shape(tmp_path):
    points = np.zeros(12, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4"), ("echo", "u2", 2)])
    points["x"] = np.arange(12)
    points["echo"] = np.arange(24).reshape(12, 2)
    data = CODECS["sensor_msgs/msg/PointCloud2", "cdr"].encode(from_array(points, stamp_ns=START_NS, height=3))
    log = write_log(tmp_path / "a.mcap", [cloud_topic("/points")], [Entry("/points", START_NS, data)])
    for form in ("pcd", "npz"):
        run("convert", log, "-o", tmp_path / f"out.{form}")
        with closing(open_source(tmp_path / f"out.{form}")) as source:
            (frame,) = frames(source, Selection())
            assert (frame.cloud.height, frame.cloud.width) == (3, 4)
            np.testing.assert_array_equal(frame.cloud.points["echo"], points["echo"])


def test_negative_stamps_keep_their_fraction(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for name in ("0", "1"):
        np.save(folder / f"{name}.npy", np.ones((3, 4), np.float32))
    (folder / "times.txt").write_text("-1.5\n2.25\n")
    (folder / "seaclutter.json").write_text('{"metadata": []}')
    run("convert", folder, "-o", tmp_path / "out", "--to", "pcd")
    assert (tmp_path / "out" / "times.txt").read_text() == "-1.500000000\n2.250000000\n"
    run("convert", tmp_path / "out", "-o", tmp_path / "again", "--to", "pcd")
    assert (tmp_path / "again" / "times.txt").read_text() == "-1.500000000\n2.250000000\n"
    run("convert", tmp_path / "out", "-o", tmp_path / "out.mcap")


@pytest.mark.parametrize("name", ["=1+1", "+a", "-b", "@c"])
def test_names_that_look_like_formulas(log, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    Path(f"{name}.mcap").write_bytes(log.read_bytes())
    run("filter", f"./{name}.mcap", "-o", "out.mcap", "-n", "1", "--csv", "t.csv", "--manifest", "m.csv", "-m", "none")
    assert Path("t.csv").read_text().splitlines()[1].startswith(f"'{name},")
    assert Path("m.csv").read_text().splitlines()[1].startswith(f"'{name},{name}.mcap".replace(f",{name}", f",'{name}"))


def test_an_expression_that_takes_too_long(log, tmp_path, monkeypatch):
    monkeypatch.setattr(sinks_options, "_MATCH_S", 0.05)
    with pytest.raises(UsageError, match="takes too long to find in /aa"):
        sinks_options.matches("(a|aa)+$", "/" + "a" * 60 + "b")
    result = run("convert", log, "-o", tmp_path / "out.mcap", "--exclude", "(", code=2)
    assert "not a regular expression" in result.stderr
