"""Parts of recordings: times, latched topics, numbers of frames."""

import json
import shutil
from contextlib import closing
from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.errors import SelectionError
from seaclutter_cli.messages.metadata import TOPICS_RECORD, RecordedTopic, recorded_topics, to_metadata
from seaclutter_cli.reading import frames
from seaclutter_cli.records import Message, Metadata
from seaclutter_cli.selection import Selection, parse_moment
from seaclutter_cli.sources.formats import open_source
from tests.logs import PERIOD_NS, START_NS, Entry, Topic, cloud_messages, cloud_topic, write_log
from tests.paths import ROOT
from tests.running import execute as run

SEA = ROOT / "samples" / "sea.mcap"
START = datetime.fromtimestamp(START_NS // 10**9, UTC)
QOS = "- history: 3\n  depth: 0\n  reliability: 1\n  durability: {}\n  deadline:\n    sec: 9223372036\n"
LATCHED = {
    "/tf_static": Topic("/tf_static"),
    "/camera/info": Topic("/camera/info", schema=("sensor_msgs/msg/CameraInfo", "ros2msg", b"")),
    "/map": Topic("/map", metadata={"offered_qos_profiles": QOS.format(1)}),
    "/map2": Topic("/map2", metadata={"offered_qos_profiles": QOS.format("transient_local")}),
    "/one": Topic("/one", "ros1", ("std_msgs/String", "ros1msg", b""), {"latching": "1"}),
}
OTHERS = {
    "/volatile": Topic("/volatile", metadata={"offered_qos_profiles": QOS.format(2)}),
    "/tf": Topic("/tf"),
    "/not": Topic("/not", "ros1", ("std_msgs/String", "ros1msg", b""), {"latching": "0"}),
}


def filtered(*arguments):
    return run("filter", *arguments, "-m", "none", code=0)


@pytest.fixture
def log(tmp_path):
    """Return a log of 20 frames; each other topic has two early messages and a late one."""
    names = {**LATCHED, **OTHERS}
    clouds = cloud_messages("ros2", 20, 30)
    entries = [Entry("/points", START_NS + i * PERIOD_NS, data, sequence=i) for i, data in enumerate(clouds)]
    for number, time in ((0, 0), (1, 3), (2, 15)):
        entries += [Entry(name, START_NS + time * PERIOD_NS + 1000, bytes([number]) * 8) for name in names]
    entries.sort(key=lambda entry: entry.log_time_ns)
    return write_log(tmp_path / "log.mcap", [cloud_topic("/points"), *names.values()], entries)


def messages(path):
    with closing(open_source(path)) as source:
        return [record for record in source.records() if isinstance(record, Message)]


def test_a_clip_begins_with_the_last_messages_of_latched_topics(log, tmp_path):
    filtered(log, "-o", tmp_path / "clip.mcap", "--start", 1, "--end", 1.2)
    found = messages(tmp_path / "clip.mcap")
    early = [message for message in found if not message.channel.topic.startswith(("/points", "/seaclutter"))]
    assert {message.channel.topic: bytes(message.data) for message in early} == dict.fromkeys(LATCHED, b"\1" * 8)
    start_ns = START_NS + 10 * PERIOD_NS
    assert all(start_ns - 2 <= message.log_time_ns <= start_ns for message in early)
    assert {message.publish_time_ns for message in early} == {START_NS + 3 * PERIOD_NS + 1000}
    assert found[: len(early)] == early
    assert sum(message.channel.topic == "/points" for message in found) == 2


def test_more_topics_on_request(log, tmp_path):
    filtered(log, "-o", tmp_path / "clip.mcap", "--start", 1, "--latched", "/volatile")
    early = {message.channel.topic for message in messages(tmp_path / "clip.mcap")[: len(LATCHED) + 1]}
    assert early == {*LATCHED, "/volatile"}


def test_a_whole_log_has_nothing_in_addition(log, tmp_path):
    filtered(log, "-o", tmp_path / "whole.mcap", "--no-diagnostics")
    assert len(messages(tmp_path / "whole.mcap")) == len(messages(log))


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ("0.5", "1.0"),
        ((START + timedelta(seconds=0.5)).isoformat(), (START + timedelta(seconds=1)).isoformat()),
        ((START + timedelta(seconds=0.5)).isoformat().replace("+00:00", ""), "1"),
        ((START + timedelta(seconds=0.5)).astimezone(timezone(timedelta(hours=5))).isoformat(), "1"),
        ((START + timedelta(seconds=0.5)).isoformat().replace("+00:00", "Z"), "1"),
        (f"{START_NS / 1e9 + 0.5:.1f}", f"{START_NS // 10**9 + 1}"),
    ],
)
def test_times_in_all_forms(log, tmp_path, start, end):
    filtered(log, "-o", tmp_path / "clip.mcap", "--start", start, "--end", end)
    times = [m.log_time_ns for m in messages(tmp_path / "clip.mcap") if m.channel.topic == "/points"]
    assert times == [START_NS + i * PERIOD_NS for i in range(5, 10)]


@pytest.mark.parametrize("text", ["", "noon", "nan", "inf", "12:30", "2026-13-01", "1e400"])
def test_other_texts_are_refused(log, tmp_path, text):
    result = run("filter", log, "-o", tmp_path / "clip.mcap", f"--start={text}", code=2)
    assert "expected seconds from the start, a time such as" in " ".join(result.stderr.split())


@given(st.integers(10**8, 4 * 10**9), st.integers(0, 999_999))
def test_seconds_since_1970_are_exact(seconds, microseconds):
    moment = parse_moment(f"{seconds}.{microseconds:06}")
    assert moment == datetime.fromtimestamp(seconds, UTC) + timedelta(microseconds=microseconds)


EMPTY = (["--start", "10"], ["--end", "-1"], ["--end", "2001-01-01"], ["--start", "3", "--end", "3"])


@pytest.mark.parametrize("part", EMPTY, ids=" ".join)
@pytest.mark.parametrize("command", ["filter", "evaluate", "calibrate", "report"])
def test_an_empty_part_is_refused_and_replaces_nothing(log, tmp_path, command, part):
    (tmp_path / "out.mcap").write_text("earlier")
    labels = tmp_path / "labels.csv"
    labels.write_text("frame,track_id,class,x,y,z,length,width,height,yaw\n0,,none,,,,,,,\n")
    more = ["--labels", labels] if command == "evaluate" else []
    result = run(command, log, "-o", tmp_path / "out.mcap", "--force", *part, *more, code=2)
    assert "Error: log: no frames " in result.stderr
    assert "; the log is 1.9 s long, from 2023-11-14 22:13:20 UTC" in result.stderr
    assert (tmp_path / "out.mcap").read_text() == "earlier"


def test_an_end_before_the_start_is_refused(log, tmp_path):
    result = run("filter", log, "-o", tmp_path / "out.mcap", "--start", 2, "--end", 1)
    assert (result.exit_code, result.stderr) == (2, "Error: the end, 1 s, is before the start, 2 s\n")
    with pytest.raises(SelectionError):
        Selection(start_s=START, end_s=datetime(2001, 1, 1))  # noqa: DTZ001 - without a zone: UTC


def test_of_several_recordings_those_without_frames_are_skipped(log, tmp_path):
    (cloud,) = cloud_messages("ros2", 1, 30)
    logs = tmp_path / "logs"
    logs.mkdir()
    write_log(logs / "short.mcap", [cloud_topic("/points")], [Entry("/points", START_NS, cloud)])
    log.rename(logs / "log.mcap")
    result = filtered(logs, "-o", f"{tmp_path}/out/", "--start", 1, "-v")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["log.mcap"]
    assert "short: skipped: short: no frames from 1 s on" in result.stderr
    assert "1 done, 1 skipped" in result.stdout
    run("filter", logs, "-o", f"{tmp_path}/none/", "-m", "none", "--start", 100, code=2)
    assert not list(tmp_path.glob("none/*"))


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """Return a folder with a log of six seconds and the first half second of it, both with labels of the whole."""
    folder = tmp_path_factory.mktemp("two")
    shutil.copy(SEA, folder / "a.mcap")
    filtered(SEA, "-o", folder / "b.mcap", "-n", 5)
    for name in "ab":
        shutil.copy(SEA.with_suffix(".labels.csv"), folder / f"{name}.labels.csv")
    return folder


@pytest.mark.parametrize(
    ("line", "jobs"),
    [
        ("filter {0} -o {1}/out/ --csv {1}/t.csv -m sor", 1),
        ("calibrate {0} -o {1}/c.yaml", 2),
        ("calibrate {0} -o {1}/c.yaml --labels {0} --choose", 1),
        ("evaluate {0} --labels {0} -o {1}/t.csv -m sor", 2),
        ("tune {0} --labels {0} -m sor -m ror -o {1}/c.yaml", 1),
    ],
)
def test_commands_leave_out_recordings_without_frames(two, tmp_path, line, jobs):
    result = run(*line.format(two, tmp_path).split(), "--start", 1, "-n", 21, "-j", jobs, code=0)
    assert "b: skipped: b: no frames from 1 s on" in result.stderr


def test_a_resumed_run_is_not_empty_because_the_rest_is(two, tmp_path):
    line = ["filter", two, "-o", f"{tmp_path}/out/", "--start", 1, "-m", "none", "--resume"]
    for expected in ("1 done, 1 skipped", "2 skipped"):
        result = run(*line, code=0)
        assert expected in result.stdout


def indices(path, topic="/points"):
    with closing(open_source(path)) as source:
        return [frame.index for frame in frames(source, Selection(topics=[topic]))]


def test_frames_of_a_clip_keep_their_numbers(log, tmp_path):
    filtered(log, "-o", tmp_path / "clip.mcap", "--start", 0.5, "--keep-raw", "--with-removed")
    for topic in ("/points", "/points/filtered", "/points/removed"):
        assert indices(tmp_path / "clip.mcap", topic) == list(range(5, 20))
    filtered(tmp_path / "clip.mcap", "-t", "/points/filtered", "-o", tmp_path / "part.mcap", "--start", 0.5)
    assert indices(tmp_path / "part.mcap", "/points/filtered") == list(range(10, 20))


def test_labels_by_frame_fit_a_clip(log, tmp_path):
    labels = tmp_path / "labels.csv"
    head = "frame,track_id,class,x,y,z,length,width,height,yaw\n"
    labels.write_text(head + "".join(f"{frame},,none,,,,,,,\n" for frame in range(20)))
    filtered(log, "-o", tmp_path / "clip.mcap", "--start", 0.5, "--end", 1)
    out = tmp_path / "frames.csv"
    result = run("evaluate", tmp_path / "clip.mcap", "--labels", labels, "-m", "none", "-o", out, code=0)
    rows = out.read_text().splitlines()[1:]
    assert [int(row.split(",")[2]) for row in rows] == sorted([5, 6, 7, 8, 9] * 2), "none and ideal"
    labels.write_text(head + "0,,none,,,,,,,\n1,,none,,,,,,,\n")
    result = run("evaluate", tmp_path / "clip.mcap", "--labels", labels, "-m", "none", "-o", out, "--force", code=1)
    assert "clip: no frame is labelled; it is a part of a recording, with frames from 5 on" in result.stderr


def test_what_a_filtered_log_records_about_its_topics(log, tmp_path):
    filtered(log, "-o", tmp_path / "once.mcap", "--with-removed", "--start", 0.2)
    result = run("filter", tmp_path / "once.mcap", "-t", "/points", "-o", tmp_path / "twice.mcap", "-m", "sor", code=0)
    assert "already filtered by none" in result.stderr
    with closing(open_source(tmp_path / "twice.mcap")) as source:
        assert recorded_topics(source.metadata) == {
            "/points": RecordedTopic("filtered", "/points", ("none", "sor"), 2, True),
            "/points/removed": RecordedTopic("removed", "/points", ("none",), 2, True),
            "/seaclutter/diagnostics": RecordedTopic("diagnostics", "/points", ("none",), 2, True),
            "/seaclutter/diagnostics_2": RecordedTopic("diagnostics", "/points", ("none", "sor"), 2, True),
        }


def test_a_log_filtered_without_diagnostics_is_recognised(log, tmp_path):
    filtered(log, "-o", tmp_path / "plain.mcap", "--no-diagnostics")
    result = run("filter", tmp_path / "plain.mcap", "-o", tmp_path / "again.mcap", "-m", "sor")
    assert "already filtered by none" in result.stderr


def test_two_lidars_have_a_diagnostics_topic_each_and_reports_of_both(tmp_path):
    clouds = cloud_messages("ros2", 4, 300)
    entries = [
        Entry(topic, START_NS + i * PERIOD_NS, data) for i, data in enumerate(clouds) for topic in ("/left", "/right")
    ]
    log = write_log(tmp_path / "log.mcap", [cloud_topic("/left"), cloud_topic("/right")], entries)
    both = ["-t", "/left", "-t", "/right"]
    filtered(log, *both, "-o", tmp_path / "out.mcap", "--keep-raw", "--with-removed")
    topics = {message.channel.topic for message in messages(tmp_path / "out.mcap")}
    assert {"/seaclutter/diagnostics/left", "/seaclutter/diagnostics/right"} < topics
    for topic in ("/left", "/right"):
        page = tmp_path / f"{topic[1:]}.html"
        run("report", tmp_path / "out.mcap", "-t", topic, "-o", page, code=0)
        assert page.exists()


@given(st.dictionaries(st.text(), st.text()))
def test_damaged_records_are_ignored(entries):
    assert recorded_topics([Metadata(TOPICS_RECORD, entries)]) == {}


def test_records_survive_a_round_trip():
    topics = {"/a": RecordedTopic("filtered", "/a", ("joint",), 7, True)}
    record = to_metadata(topics)
    assert recorded_topics([record]) == topics
    assert json.loads(record.entries["/a"])["first_frame"] == 7
