"""Frames and selections of a recording: frames keep their indices, and only the required parts are read."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer as BagWriter

from seaclutter_cli.reading import frames, read
from seaclutter_cli.records import Attachment, Message, Metadata
from seaclutter_cli.selection import Selection, cloud_channels
from seaclutter_cli.sources.formats import open_source
from seaclutter_cli.sources.mcap.source import McapSource
from seaclutter_cli.sources.recordings import find_recordings
from seaclutter_cli.sources.rosbag1.source import BagSource
from tests.logs import (
    LAYOUTS,
    PERIOD_NS,
    Entry,
    Layout,
    _store,
    cloud_log,
    cloud_message,
    cloud_topic,
    sea_points,
    write_log,
)
from tests.paths import ROOT, shared
from tests.test_formats import FORMATS, STORE, TYPE, message


def split_log(folder):
    """Return a recording of three files with two, one and three frames."""
    for part, numbers in enumerate((range(2), range(2, 3), range(3, 6))):
        entries = [Entry("/points", *message(number)) for number in numbers]
        write_log(folder / f"log_{part}.mcap", [cloud_topic("/points")], entries, Layout(chunk_size=7000))
    return folder


def long_bag(path):
    writer = BagWriter(path)
    writer.set_compression(BagWriter.CompressionFormat.BZ2)
    writer.chunk_threshold = 8000
    with writer:
        connection = writer.add_connection("/points", TYPE, typestore=STORE)
        for number in range(40):
            time_ns, data = message(number)
            writer.write(connection, time_ns, STORE.cdr_to_ros1(data, TYPE))
    return path


def opened(log):
    (recording,) = find_recordings([str(log)])
    return recording.open()


def plain(frame):
    return frame.topic, frame.index, frame.stamp_ns, frame.log_time_ns, bytes(frame.message.data)


OTHERS = ("two topics", "split", "capture")


@pytest.fixture(scope="module", params=[*FORMATS, *(f"mcap {name}" for name in LAYOUTS), *OTHERS])
def log(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    if request.param in FORMATS:
        return FORMATS[request.param](folder)
    if request.param == "capture":
        return ROOT / "samples" / "rs-lidar-32.pcap"
    if request.param == "split":
        return split_log(folder)
    if request.param == "two topics":
        return cloud_log(folder / "log.mcap", Layout(chunk_size=9000), frames=8, topics=("/points", "/aft"))
    return cloud_log(folder / "log.mcap", LAYOUTS[request.param.removeprefix("mcap ")], frames=8)


@pytest.fixture(scope="module")
def whole(log):
    """Return the topics of points of a log, and all of its frames."""
    topics = {channel.topic for channel in cloud_channels(opened(log), ["/points"])}
    return topics, [plain(frame) for frame in frames(opened(log), Selection(topics=topics))]


@settings(max_examples=8)
@given(start=st.integers(-2, 12), length=st.integers(0, 12), shift_ns=st.sampled_from([-1, 0, 1, 40_000_000]))
def test_a_window_has_the_frames_and_indices_of_the_whole(log, whole, start, length, shift_ns):
    topics, every = whole
    start_s, end_s = (start * PERIOD_NS + shift_ns) / 1e9, ((start + length) * PERIOD_NS + shift_ns) / 1e9
    seconds = [(frame[3] - every[0][3]) / 1e9 for frame in every]
    for bounds in ((start_s, None), (None, end_s), (start_s, end_s)):
        low, high = bounds
        chosen = [
            frame
            for frame, at in zip(every, seconds, strict=True)
            if (low is None or at >= low) and (high is None or at < high)
        ]
        selection = Selection(topics=topics, start_s=low, end_s=high)
        source = opened(log)
        assert [plain(frame) for frame in frames(source, selection)] == chosen
        assert source.damage == []
        two = Selection(topics=topics, start_s=low, end_s=high, frames=2)
        assert [plain(frame) for frame in frames(opened(log), two)] == chosen[:2]


def test_a_window_of_packet_topics():
    log = shared("nebula/vlp16")
    whole = [plain(frame) for frame in frames(opened(log), Selection())]
    first_ns = next(record.log_time_ns for record in opened(log).records() if isinstance(record, Message))
    for start_s, end_s in ((0.0, 0.15), (0.15, None), (0.1, 0.25)):
        found = [plain(frame) for frame in frames(opened(log), Selection(start_s=start_s, end_s=end_s))]
        chosen = [one for one in whole if start_s <= (one[3] - first_ns) / 1e9 < (end_s or 9)]
        assert found == chosen != whole


def test_attachments_and_metadata_are_in_every_window(tmp_path):
    log = cloud_log(tmp_path / "log.mcap", frames=8)
    source = open_source(log)
    records = [record for record, _ in read(source, cloud_channels(source), Selection(start_s=0.3, end_s=0.4))]
    assert {type(record) for record in records} >= {Attachment, Metadata}


@pytest.mark.parametrize("name", ["mcap-zstd", "bag"])
def test_chunks_outside_of_the_window_are_not_unpacked(name, tmp_path, monkeypatch):
    if name == "bag":
        log, kind = long_bag(tmp_path / "log.bag"), BagSource
    else:
        log, kind = cloud_log(tmp_path / "log.mcap", Layout(chunk_size=9000), frames=40), McapSource
    unpacked = []
    unpack = kind._unpack
    monkeypatch.setattr(kind, "_unpack", lambda self, chunk: unpacked.append(chunk.offset) or unpack(self, chunk))
    source = open_source(log)
    chunks = len(source._chunks)
    unpacked.clear()
    list(frames(source, Selection()))
    assert len(unpacked) == chunks
    unpacked.clear()
    count = len(list(frames(source, Selection())))
    unpacked.clear()
    (last,) = frames(source, Selection(start_s=(count - 1.5) * 0.1))
    assert last.index == count - 1
    assert len(set(unpacked)) <= 5 < chunks  # one for the time of the first message, and those unpacked in advance


def test_frames_have_their_topics_and_arrays(tmp_path):
    log = cloud_log(tmp_path / "log.mcap", frames=3, topics=("/points", "/aft"))
    found = list(frames(open_source(log), Selection(topics=("/points", "/aft"))))
    assert [(frame.topic, frame.index) for frame in found] == [
        (topic, number) for number in range(3) for topic in ("/points", "/aft")
    ]
    assert all(frame.xyz.dtype == np.float64 and frame.xyz.shape == (frame.size, 3) for frame in found)


def test_frames_with_the_stamp_of_the_one_before_are_as_late_as_their_log_times(tmp_path):
    """Two sensors on one topic have stamps of their own, and a clock that stands still is no time."""
    stamps = {"lidar": [1, 1, 1, 4], "aft": [1, 2, 2, 2]}
    entries = []
    for number in range(4):
        for place, (frame_id, own) in enumerate(stamps.items()):
            header = _store("ros2").types["std_msgs/msg/Header"]
            stamp = _store("ros2").types["builtin_interfaces/msg/Time"](own[number], 0)
            data = cloud_message("ros2", sea_points(5), 0, header=header(stamp, frame_id))
            entries.append(Entry("/points", (100 + number) * 10**9 + place, data))
    source = open_source(write_log(tmp_path / "log.mcap", [cloud_topic("/points")], entries))
    found = [frame.stamp_ns / 10**9 for frame in frames(source, Selection())]
    assert found == [1, 1, 2, 2, 3, 3, 4, 4]
    assert [text.partition(" has ")[2][:30] for text in source.warnings] == [
        "frames of several sensors (fra",
        "frames with the stamp of the o",
    ]
