"""Time spans, and last messages before a time, of every source, against a plain reading of all records."""

from contextlib import closing

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from seaclutter_cli.records import Message
from seaclutter_cli.sources.formats import open_source
from tests.logs import LAYOUTS, START_NS, Entry, Layout, Topic, cloud_log, write_log
from tests.paths import ROOT
from tests.sources.rosbag1.bags import BZ2, write_bag
from tests.sources.rosbag2.test_db3 import write_file, write_folder

LOGS = {
    **{
        f"mcap, {name}": lambda path, layout=layout: cloud_log(path / "a.mcap", layout)
        for name, layout in LAYOUTS.items()
    },
    "bag": lambda path: write_bag(path / "a.bag"),
    "bag bz2": lambda path: write_bag(path / "a.bag", BZ2),
    "db3": lambda path: write_file(path / "a.db3"),
    "db3 without index": lambda path: write_file(path / "a.db3", index=False),
    "rosbag2 folder": lambda path: write_folder(path / "a").parent,
    "capture": lambda _: ROOT / "samples" / "rs-lidar-32.pcap",
}


def expected(source, channels, before_ns):
    found = {}
    for record in source.records():
        if isinstance(record, Message) and record.channel.id in channels and record.log_time_ns < before_ns:
            found[record.channel.id] = record
    return sorted((m.log_time_ns, m.channel.id, m.sequence, bytes(m.data)) for m in found.values())


def latest(source, channels, before_ns):
    return [(m.log_time_ns, m.channel.id, m.sequence, bytes(m.data)) for m in source.latest(channels, before_ns)]


@pytest.fixture(params=LOGS)
def source(request, tmp_path):
    with closing(open_source(LOGS[request.param](tmp_path))) as source:
        yield source


def test_span(source):
    times = [record.log_time_ns for record in source.records() if isinstance(record, Message)]
    first, last = source.span_ns
    if source.format.startswith("PCAP"):  # times of packets, not of the frames that they complete
        assert first <= times[0] <= times[-1] <= last
    else:
        assert (first, last) == (min(times), max(times))


def test_last_messages_before_a_time(source):
    if source.format.startswith("PCAP"):
        assert source.latest([1], 2**63) == []
        return
    ids = [channel.id for channel in source.channels]
    first, last = source.span_ns
    for share in (0.0, 0.3, 0.5, 0.9, 1.0):
        before_ns = first + round(share * (last - first))
        for channels in ([], ids[:1], ids[1:], ids):
            assert latest(source, channels, before_ns) == expected(source, channels, before_ns)
    assert latest(source, ids, last + 1) == expected(source, ids, last + 1)


@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 30)), min_size=1, max_size=30), st.integers(0, 32))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
def test_messages_in_any_order(tmp_path, messages, before):
    topics = [Topic(f"/{name}") for name in "abc"]
    entries = [
        Entry(f"/{name}", START_NS + time, bytes([number]) * 40, sequence=number)
        for number, (name, time) in enumerate(messages)
    ]
    path = write_log(tmp_path / "a.mcap", topics, entries, Layout("", chunk_size=150))
    with closing(open_source(path)) as source:
        ids = [channel.id for channel in source.channels]
        assert latest(source, ids, START_NS + before) == expected(source, ids, START_NS + before)


def test_of_split_recordings(tmp_path):
    """A channel may have another number in each file."""
    folder = tmp_path / "bag"
    folder.mkdir()
    names = [("/a", "/b"), ("/b", "/a"), ("/b",)]
    for number, topics in enumerate(names):
        entries = [Entry(topic, START_NS + 10 * number + i, bytes([number, i])) for i, topic in enumerate(topics)]
        write_log(folder / f"bag_{number}.mcap", [Topic(topic) for topic in topics], entries)
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 5}\n")
    with closing(open_source(folder)) as source:
        ids = {channel.topic: channel.id for channel in source.channels}
        found = source.latest(ids.values(), START_NS + 100)
        assert [(m.channel.topic, bytes(m.data)) for m in found] == [("/a", b"\1\1"), ("/b", b"\2\0")]
        assert source.latest([ids["/a"]], START_NS + 10)[0].log_time_ns == START_NS
        assert source.span_ns == (START_NS, START_NS + 20)


def test_only_chunks_that_may_contain_a_message_are_read(tmp_path, monkeypatch):
    from seaclutter_cli.sources.mcap import source as module

    entries = [Entry("/tf_static", START_NS, b"x" * 100)]
    entries += [Entry("/imu", START_NS + number, b"y" * 100) for number in range(1, 100)]
    path = write_log(tmp_path / "a.mcap", [Topic("/tf_static"), Topic("/imu")], entries, Layout("", chunk_size=300))
    with closing(open_source(path)) as source:
        read, unpack = [], module.McapSource._unpack
        monkeypatch.setattr(module.McapSource, "_unpack", lambda self, chunk: read.append(chunk) or unpack(self, chunk))
        ids = {channel.topic: channel.id for channel in source.channels}
        assert source.latest([ids["/tf_static"]], START_NS + 90)[0].log_time_ns == START_NS
        assert source.latest([ids["/imu"]], START_NS + 90)[0].log_time_ns == START_NS + 89
        assert len(read) <= 3
