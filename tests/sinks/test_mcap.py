"""The filtered MCAP file as a drop-in replacement for its input."""

import threading
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from seaclutter_cli import __version__
from seaclutter_cli.config import load_config
from seaclutter_cli.errors import OutputError, UsageError
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.messages import find_codec
from seaclutter_cli.records import Channel, Message, Schema
from seaclutter_cli.sinks.log import LogSink
from seaclutter_cli.sinks.options import McapOptions
from seaclutter_cli.sources.formats import open_source
from tests.logs import (
    LAYOUTS,
    POINT,
    START_NS,
    cloud_log,
    cloud_message,
    cloud_messages,
    cloud_topic,
    sea_points,
)
from tests.sinks.runs import DIAGNOSTICS, KINDS, STORES, FakeSource, contents, decode, filter_log, log_of


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out.mcap"


@KINDS
def test_other_records_are_copied_unchanged(tmp_path, out, kind):
    before = contents(cloud_log(tmp_path / "in.mcap", kind=kind))
    filter_log(tmp_path / "in.mcap", out)
    after = contents(out)
    assert after.profile == before.profile
    assert after.topics["/imu"] == before.topics["/imu"]
    assert after.attachments == before.attachments != []
    assert [record for record in after.metadata if not record[0].startswith("seaclutter")] == before.metadata != []
    assert {number: after.channels[number] for number in before.channels} == before.channels
    assert set(after.topics) == {*before.topics, DIAGNOSTICS}
    order = [entry for entry in after.order if entry[1] != DIAGNOSTICS]
    assert order == before.order


@KINDS
@pytest.mark.parametrize("method", ["joint", "sor"])
def test_kept_points_are_on_their_topic_in_their_order(tmp_path, out, kind, method):
    before = contents(cloud_log(tmp_path / "in.mcap", kind=kind)).topics["/points"]
    results = filter_log(tmp_path / "in.mcap", out, method=method)
    after = contents(out).topics["/points"]
    assert len(after) == len(before) == len(results) == 6
    for old, new, result in zip(before, after, results, strict=True):
        assert new[:3] == old[:3], "log time, publish time and sequence"
        raw, filtered = decode(old.data, kind), decode(new.data, kind)
        expected = [point for point, reason in zip(raw.points, result.reason, strict=True) if reason == 0]
        assert 0 < len(expected) < len(raw.points)
        assert filtered.points == expected
        assert filtered.shape == (1, len(expected))
        assert filtered.description == raw.description


@pytest.mark.parametrize("compression", [None, "zstd", "lz4", ""])
@pytest.mark.parametrize("name", ["zstd", "lz4", "none", "unchunked, bare"])
def test_compression_of_the_input_or_as_requested(tmp_path, out, name, compression):
    log = cloud_log(tmp_path / "in.mcap", LAYOUTS[name], frames=2)
    filter_log(log, out, compression=compression)
    own = {"none": "", "unchunked, bare": "zstd"}.get(name, name)
    assert contents(out).compressions == {own if compression is None else compression}


@KINDS
def test_frames_without_points_are_still_written(tmp_path, out, kind):
    near = sea_points(50)
    for axis in "xyz":
        near[axis] = 0.1
    messages = [cloud_message(kind, points, START_NS) for points in (near, near[:0], sea_points(50))]
    results = filter_log(log_of(tmp_path / "in.mcap", messages, kind), out, with_removed=True)
    after = contents(out).topics
    assert [len(decode(entry.data, kind).points) for entry in after["/points"]][:2] == [0, 0]
    assert [len(decode(entry.data, kind).points) for entry in after["/points/removed"]][:2] == [50, 0]
    for old, new in zip(messages, after["/points"], strict=True):
        assert decode(new.data, kind).description == decode(old, kind).description
    assert results[0].counts[2] == 50


@KINDS
def test_a_frame_without_removed_points_is_the_same_message(tmp_path, out, kind):
    messages = cloud_messages(kind, 2, 40)
    filter_log(log_of(tmp_path / "in.mcap", messages, kind), out, method="none", diagnostics=False)
    assert [entry.data for entry in contents(out).topics["/points"]] == messages


def test_any_layout_of_points_is_preserved(tmp_path, out):
    """Padding, gaps, unaligned values, big endian, padded rows: kept points have the bytes of the input."""
    layout = {"names": POINT.names, "formats": [POINT[name] for name in POINT.names], "offsets": [9, 1, 5, 13, 30, 18]}
    points = np.frombuffer(np.random.default_rng(1).bytes(32 * 60), np.dtype(layout)).copy()
    for name in POINT.names:
        points[name] = sea_points(60)[name]
    rows = np.pad(points.view(np.uint8).reshape(3, -1), ((0, 0), (0, 11)), constant_values=7)
    padded = {"height": 3, "width": 20, "row_step": 651, "data": rows.reshape(-1)}
    swapped = {"is_bigendian": True, "data": points.astype(points.dtype.newbyteorder(">")).view(np.uint8)}
    messages = [cloud_message("ros2", points, START_NS, **changes) for changes in ({}, padded, swapped)]
    results = filter_log(log_of(tmp_path / "in.mcap", messages), out, method="ring_intensity_outlier")
    reasons = [result.reason.tolist() for result in results]
    assert reasons[0] == reasons[1] == reasons[2]
    assert 0 < results[0].counts[0] < 60
    for old, new, unpadded in zip(messages, contents(out).topics["/points"], [0, 0, 2], strict=True):
        filtered, raw = decode(new.data), decode(messages[unpadded])
        assert filtered.points == [p for p, reason in zip(raw.points, reasons[0], strict=True) if reason == 0]
        assert filtered.description == decode(old).description


def write_channels(path, channels, clouds=(), **options):
    """Write a log without messages; return the ids of its topics."""
    with LogSink(path, McapOptions(**options)) as sink:
        sink.begin(FakeSource(tuple(channels)), clouds)
        sink.end()
    return {topic: number for number, (topic, *_) in contents(path).channels.items()}


@pytest.mark.parametrize("ids", [(1, 2, 3), (9, 4, 700), (0, 1, 2), (65535, 65534, 0)])
def test_channels_keep_their_ids_even_without_messages(out, ids):
    channels = [Channel(number, f"/{number}", "json", None, (("key", "value"),)) for number in ids]
    assert write_channels(out, channels) == {f"/{number}": number for number in ids}
    assert contents(out).channels == {number: (f"/{number}", "json", None, {"key": "value"}) for number in ids}
    assert contents(out).statistics.message_count == 0


@pytest.mark.parametrize("number", [0, 2, 65535])
def test_new_channels_get_free_ids(out, number):
    cloud = Channel(number, "/points", "cdr", Schema(*cloud_topic("/points").schema))
    ids = write_channels(out, [Channel(1, "/one", "json", None), cloud], [cloud], keep_raw=True, with_removed=True)
    assert ids["/one"] == 1
    assert ids["/points"] == number
    assert len(ids) == len(set(ids.values())) == 5
    assert 0 not in {*ids.values()} - {number}, "some readers treat 0 as no channel"


def test_channels_that_share_an_id_or_have_an_impossible_one_get_another(out):
    channels = [Channel(number, topic, "json", None) for topic, number in (("/a", 1), ("/b", 1), ("/c", 70_000))]
    assert write_channels(out, channels) == {"/a": 1, "/b": 2, "/c": 3}


def test_too_many_channels(out):
    channels = [Channel(number, "/a", "json", None) for number in range(2**16 + 1)]
    with pytest.raises(OutputError, match="at most 65536 channels"):
        write_channels(out, channels)
    assert not list(out.parent.iterdir())


def test_a_channel_that_appears_late_is_declared(out):
    known, late = (Channel(1, topic, "json", Schema("note", "jsonschema", b"{}")) for topic in ("/known", "/late"))
    with LogSink(out, McapOptions()) as sink:
        sink.begin(FakeSource((known,)), [])
        for k, channel in enumerate((late, known, late)):
            sink.copy(Message(channel, k, k, k, b"{}"))
        sink.end()
    assert [entry.log_time for entry in contents(out).topics["/late"]] == [0, 2]


def test_two_publishers_of_one_topic_remain_separate(tmp_path, out):
    log = cloud_log(tmp_path / "in.mcap", topics=["/points", "/other"], frames=3)
    before = contents(log)
    with closing(open_source(log)) as source, LogSink(out, McapOptions(keep_raw=True)) as sink:
        same = {c: replace(c, topic="/points") if c.topic == "/other" else c for c in source.channels}
        sink.begin(FakeSource(tuple(same.values())), [c for c in same.values() if c.topic == "/points"])
        for k, record in enumerate(r for r in source.records() if isinstance(r, Message)):
            message = replace(record, channel=same[record.channel])
            if message.channel.topic == "/points":
                frame = Frame.of_message(message, find_codec(message.channel).decode(message.data), k)
                sink.write(FilterResult(frame, np.zeros(frame.size, np.uint8)))
        sink.end()
    topics = [topic for topic, *_ in contents(out).channels.values()]
    assert topics.count("/points") == topics.count("/points/filtered") == 2
    raw = [entry.data for topic in ("/points", "/other") for entry in before.topics[topic]]
    assert sorted(entry.data for entry in contents(out).topics["/points/filtered"]) == sorted(raw)


def test_the_effective_config_is_a_metadata_record(tmp_path, out):
    overrides = ["filter.update_weight=0.25", "filter.exclude_boxes=[[-1, 2.5, 3, 4, 5, 6]]"]
    filter_log(cloud_log(tmp_path / "in.mcap", frames=1), out, overrides=overrides)
    record = dict(contents(out).metadata)["seaclutter"]
    assert record["version"] == __version__
    (tmp_path / "again.yaml").write_text(record["config"])
    assert load_config(tmp_path / "again.yaml") == load_config(overrides=overrides)


def test_a_filtered_log_can_be_filtered_again(tmp_path, out):
    first = tmp_path / "first.mcap"
    filter_log(cloud_log(tmp_path / "in.mcap"), first)
    results = filter_log(first, out, method="sor")
    before, after = contents(first), contents(out)
    assert after.topics[DIAGNOSTICS] == before.topics[DIAGNOSTICS]
    assert after.topics["/imu"] == before.topics["/imu"]
    assert after.attachments == before.attachments
    assert len(after.topics[f"{DIAGNOSTICS}_2"]) == 6
    configs = [record["config"].splitlines()[1] for name, record in after.metadata if name == "seaclutter"]
    assert configs == ["  method: sor", "  method: joint"], "the newest first"
    assert [len(decode(entry.data).points) for entry in after.topics["/points"]] == [r.counts[0] for r in results]
    third = tmp_path / "third.mcap"
    filter_log(out, third)
    assert f"{DIAGNOSTICS}_3" in contents(third).topics


@pytest.mark.parametrize("kind", ["ros1", "ros2"])
def test_bags_become_mcap_files_with_complete_schemas(tmp_path, out, kind):
    typename, store = "sensor_msgs/msg/PointCloud2", STORES[kind]
    bag = tmp_path / "in.bag" if kind == "ros1" else tmp_path / "in"
    messages = cloud_messages(kind, 4, 200)
    options = {} if kind == "ros1" else {"version": 8, "storage_plugin": StoragePlugin.SQLITE3}
    with (BagWriter if kind == "ros1" else Rosbag2Writer)(bag, **options) as writer:
        connection = writer.add_connection("/points", typename, typestore=store)
        for k, data in enumerate(messages):
            writer.write(connection, START_NS + k, data)
    results = filter_log(bag, out)
    after = contents(out)
    assert after.profile == kind
    ((_, encoding, schema, _),) = [channel for channel in after.channels.values() if channel[0] == "/points"]
    suffix = "/msg" if kind == "ros2" else ""
    assert (encoding, *schema[:2]) == ("cdr" if suffix else kind, f"sensor_msgs{suffix}/PointCloud2", f"{kind}msg")
    alone = get_typestore(Stores.EMPTY if suffix else Stores.ROS1_NOETIC)
    alone.register(get_types_from_msg(schema[2].decode(), typename))
    for entry, result in zip(after.topics["/points"], results, strict=True):
        message = (alone.deserialize_cdr if suffix else alone.deserialize_ros1)(entry.data, typename)
        assert message.width == result.counts[0] > 0


def test_a_failed_run_leaves_no_file(tmp_path, out):
    log = cloud_log(tmp_path / "in.mcap")
    with pytest.raises(UsageError), closing(open_source(log)) as source, LogSink(out, McapOptions()) as sink:
        sink.begin(source, source.channels)  # one of them contains no clouds
    assert [path.name for path in tmp_path.iterdir()] == ["in.mcap"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, OutputError])
def test_a_failed_run_leaves_no_thread(tmp_path, out, error):
    before = threading.active_count()
    channel = Channel(1, "/a", "json", None)
    with pytest.raises(error):
        write_and_fail(out, channel, error)
    assert threading.active_count() == before
    assert list(tmp_path.iterdir()) == []


def write_and_fail(path, channel, error):
    with LogSink(path, McapOptions()) as sink:
        sink.begin(FakeSource((channel,)), [])
        for k in range(4):
            sink.copy(Message(channel, k, k, k, bytes(2**20)))
        raise error
