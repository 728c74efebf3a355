"""ROS 1 bags against the format description and the reader of rosbags."""

import io
import struct

import numpy as np
import pytest
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.errors import OutputError
from seaclutter_cli.records import Channel, Metadata, Schema
from seaclutter_cli.sinks.bag_writer import BagWriter
from seaclutter_cli.sources.formats import open_source

STORE = get_typestore(Stores.ROS1_NOETIC)
START_NS = 1_700_000_000 * 10**9 + 5
BOTH = pytest.mark.parametrize("compression", ["", "lz4"])


def channel(number, topic, **metadata):
    text, md5 = STORE.generate_msgdef("std_msgs/msg/String")
    entries = {"md5sum": md5, "type": "std_msgs/String", **metadata}
    return Channel(number, topic, "ros1", Schema("std_msgs/String", "ros1msg", text.encode()), tuple(entries.items()))


def message(text):
    return struct.pack("<I", len(text)) + text.encode()


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write messages ``(channel, time, text)`` on two topics in small chunks; return the path."""
    monkeypatch.setattr(BagWriter, "chunk_size", 1000)

    def bag(messages, compression="", metadata=()):
        stream = io.BytesIO()
        writer = BagWriter(stream, compression=compression)
        writer.add_channel(channel(0, "/a", latching="1", callerid="/node"))
        writer.add_channel(channel(7, "/b"))
        for number, time_ns, text in messages:
            writer.write(number, time_ns, time_ns, 0, message(text))
        for record in metadata:
            writer.add_metadata(record)
        writer.finish()
        path = tmp_path / "out.bag"
        path.write_bytes(stream.getvalue())
        return path

    return bag


MESSAGES = [((0, 7)[k % 3 == 0], START_NS + k * 10**8, "x" * (k * 7 % 300)) for k in range(60)]


@BOTH
def test_rosbags_reads_all_messages_by_the_index(write, compression):
    with Reader(write(MESSAGES, compression)) as reader:
        found = [({"/a": 0, "/b": 7}[c.topic], time, bytes(data)[4:].decode()) for c, time, data in reader.messages()]
        assert found == MESSAGES
        assert reader.message_count == 60
        assert (reader.start_time, reader.end_time) == (START_NS, MESSAGES[-1][1] + 1)
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts == {"/a": 40, "/b": 20}
        middle = [time for _, time, _ in reader.messages(start=START_NS + 10**9, stop=START_NS + 2 * 10**9)]
        assert middle == [time for _, time, _ in MESSAGES[10:20]]


def test_connections_have_what_a_recorder_writes(write):
    with Reader(write(MESSAGES)) as reader:
        first, second = reader.connections
        assert (first.ext.latching, first.ext.callerid) == (1, "/node")
        assert (second.ext.latching, second.ext.callerid) == (None, None)
        assert {c.digest for c in reader.connections} == {STORE.generate_msgdef("std_msgs/msg/String")[1]}
        assert {c.msgdef.data for c in reader.connections} == {"string data\n"}


def test_the_header_has_4096_bytes_without_sizes_and_the_index_follows_the_chunks(write):
    """ROS 1 writes such a header over it, when it appends or reindexes."""
    data = write(MESSAGES).read_bytes()
    assert data.startswith(b"#ROSBAG V2.0\n")
    fields = fields_at(data, 13)
    size = struct.unpack_from("<I", data, 13)[0]
    assert size + struct.unpack_from("<I", data, 17 + size)[0] == 4096
    assert fields[b"op"] == b"\x03"
    index, connections, chunks = (
        int.from_bytes(fields[k], "little") for k in (b"index_pos", b"conn_count", b"chunk_count")
    )
    assert fields_at(data, index)[b"op"] == b"\x07"
    assert connections == 2
    numbers, at = [], index
    for _ in range(connections):
        numbers.append(int.from_bytes(fields_at(data, at)[b"conn"], "little"))
        at += 4 + struct.unpack_from("<I", data, at)[0]
        at += 4 + struct.unpack_from("<I", data, at)[0]
    assert numbers == [0, 1]  # the next one that ROS 1 appends is 2
    assert data.count(b"op=\x05") == data.count(b"op=\x06") == chunks > 3


def fields_at(data, at):
    size, found, at = struct.unpack_from("<I", data, at)[0], {}, at + 4
    end = at + size
    while at < end:
        length = struct.unpack_from("<I", data, at)[0]
        name, _, value = data[at + 4 : at + 4 + length].partition(b"=")
        found[name] = value
        at += 4 + length
    return found


def test_lz4_frames_have_the_options_that_ros_requires(write):
    """Independent blocks, a checksum of the content, neither its size nor checksums of blocks."""
    data = write(MESSAGES, "lz4").read_bytes()
    at = data.index(b"\x04\x22\x4d\x18")
    version, independent, block_checksum, size, checksum = (
        data[at + 4] >> 6,
        data[at + 4] >> 5 & 1,
        data[at + 4] >> 4 & 1,
        data[at + 4] >> 3 & 1,
        data[at + 4] >> 2 & 1,
    )
    assert (version, independent, block_checksum, size, checksum) == (1, 1, 0, 0, 1)
    assert data[at + 4] & 3 == 0
    assert 4 <= data[at + 5] >> 4 <= 7


@BOTH
def test_metadata_come_back_and_are_no_topic(write, compression):
    records = [Metadata("a", {"k": "Ü\n"}), Metadata("seaclutter.run", {"version": "1"})]
    path = write(MESSAGES, compression, records)
    source = open_source(path)
    assert list(source.metadata) == records
    assert [c.topic for c in source.channels] == ["/a", "/b"]
    found = list(source.records())
    assert found[:2] == records
    assert len(found) == 62
    assert set(source.counts.values()) == {40, 20}
    assert not source.damage
    source.close()
    with Reader(path) as reader:
        assert reader.connections[-1].topic == "/seaclutter/metadata"
        assert reader.end_time == MESSAGES[-1][1] + 1


def test_a_foreign_topic_of_that_name_stays_a_topic(tmp_path):
    path = tmp_path / "a.bag"
    with path.open("wb") as stream:
        writer = BagWriter(stream, compression="")
        writer.add_channel(channel(0, "/seaclutter/metadata"))
        writer.write(0, START_NS, START_NS, 0, message("hello"))
        writer.finish()
    source = open_source(path)
    assert [c.topic for c in source.channels] == ["/seaclutter/metadata"]
    assert (source.metadata, len(list(source.records()))) == ((), 1)
    source.close()


def test_no_messages(write):
    path = write([])
    with Reader(path) as reader:
        assert reader.message_count == 0
    source = open_source(path)
    assert ([c.topic for c in source.channels], source.damage) == (["/a", "/b"], [])
    source.close()


def test_times_after_2106_are_an_error(write):
    with pytest.raises(OutputError, match=r"^message 0 on /\w+: a ROS 1 bag cannot contain its log time, \d+ ns"):
        write([(0, 2**32 * 10**9, "x")])


def test_the_last_second_of_2106_fits(write):
    time_ns = (2**32 - 1) * 10**9 + 999_999_999
    with Reader(write([(0, np.uint64(time_ns).item(), "x")])) as reader:
        assert reader.start_time == time_ns
