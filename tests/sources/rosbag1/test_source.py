"""Intact ROS 1 bags, and files that are not bags."""

import gc
import random
import struct
import tracemalloc
from itertools import pairwise

import pytest
from rosbags.rosbag1 import Writer
from rosbags.rosbag1 import writer as rosbags_writer

from seaclutter_cli.errors import InputError
from seaclutter_cli.sources.rosbag1.records import MAGIC
from seaclutter_cli.sources.rosbag1.source import BagSource
from tests.sources.rosbag1.bags import BZ2, CLOUD, COMPRESSIONS, IMU, LZ4, START, TYPES, read, reference, write_bag


@pytest.fixture(params=["rosbags", "roscpp"])
def field_order(request, monkeypatch):
    """Write the header fields in the order of rosbags, or sorted like roscpp."""
    if request.param == "roscpp":

        def write(header, target, opcode=None):
            fields = dict(header) | ({"op": bytes([opcode])} if opcode else {})
            items = [f"{key}=".encode() + value for key, value in sorted(fields.items())]
            data = b"".join(struct.pack("<I", len(item)) + item for item in items)
            target.write(struct.pack("<I", len(data)) + data)
            return len(data) + 4

        monkeypatch.setattr(rosbags_writer.Header, "write", write)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_every_message_is_read_in_order(tmp_path, compression, field_order):
    path = write_bag(tmp_path / "x.bag", compression)
    messages, damage = read(path)
    assert messages == reference(path)
    assert not damage


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_messages_out_of_order_in_and_between_chunks_are_sorted(tmp_path, compression):
    times = [number * 1000 for number in range(60)]
    random.Random(3).shuffle(times)
    path = write_bag(tmp_path / "x.bag", compression, times=times)
    messages, damage = read(path)
    assert messages == reference(path)
    assert not damage


def test_source_describes_the_bag(tmp_path):
    source = BagSource(write_bag(tmp_path / "a b#c.bag", LZ4))
    assert (source.name, source.format, source.profile, source.compression) == ("a b#c", "ROS 1 bag", "ros1", "lz4")
    assert source.counts == {0: 30, 1: 30}
    cloud, imu = source.channels
    assert (cloud.id, cloud.topic, cloud.message_encoding) == (0, "/points", "ros1")
    assert dict(cloud.metadata) == {
        "callerid": "/driver",
        "latching": "0",
        "md5sum": "1158d486dd51d683ce2f1be655c3c181",
        "topic": "/points",
        "type": "sensor_msgs/PointCloud2",
    }
    for channel, typename in ((cloud, CLOUD), (imu, IMU)):
        assert channel.schema.name == typename.replace("/msg/", "/")
        assert channel.schema.encoding == "ros1msg"
        assert channel.schema.data.decode() == TYPES.generate_msgdef(typename)[0]


@pytest.mark.parametrize(("compression", "name"), [(None, ""), (BZ2, "zstd"), (LZ4, "lz4")])
def test_compression_has_its_mcap_name(tmp_path, compression, name):
    assert BagSource(write_bag(tmp_path / "x.bag", compression)).compression == name


def test_two_connections_on_one_topic_remain_separate(tmp_path):
    path = tmp_path / "x.bag"
    with Writer(path) as writer:
        first = writer.add_connection("/imu", IMU, typestore=TYPES, callerid="/a")
        second = writer.add_connection("/imu", IMU, typestore=TYPES, callerid="/b")
        writer.write(second, START, b"2")
        writer.write(first, START + 1, b"1")
    source = BagSource(path)
    assert [(m.channel.id, bytes(m.data)) for m in source.records()] == [(1, b"2"), (0, b"1")]
    assert [dict(channel.metadata)["callerid"] for channel in source.channels] == ["/a", "/b"]


def test_bag_without_messages(tmp_path):
    path = tmp_path / "x.bag"
    with Writer(path):
        pass
    assert read(path) == ([], [])
    with Writer(tmp_path / "y.bag") as writer:
        writer.add_connection("/imu", IMU, typestore=TYPES)
    assert [channel.topic for channel in BagSource(tmp_path / "y.bag").channels] == ["/imu"]
    assert read(tmp_path / "y.bag") == ([], [])


def test_messages_are_views_of_their_chunk(tmp_path):
    for compression in COMPRESSIONS:
        messages = list(BagSource(write_bag(tmp_path / "x.bag", compression)).records())
        assert isinstance(messages[0].data, memoryview)
        assert messages[0].data.obj is messages[1].data.obj


def test_messages_outlive_their_source(tmp_path):
    source = BagSource(write_bag(tmp_path / "x.bag"))
    message = next(iter(source.records()))
    data = bytes(message.data)
    source.close()
    del source
    gc.collect()
    assert bytes(message.data) == data


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"not a bag at all", "not a ROS 1 bag"),
        (MAGIC[:-2], "truncated"),
        (b"#ROSBAG V1.2\n" + bytes(100), "version 1.2"),
    ],
)
def test_files_that_are_not_bags_are_refused_in_one_line(tmp_path, content, words):
    path = tmp_path / "x.bag"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        BagSource(path)
    assert "\n" not in str(caught.value)


def test_encrypted_bags_are_refused(tmp_path):
    fields = {
        b"op": b"\x03",
        b"index_pos": bytes(8),
        b"conn_count": bytes(4),
        b"chunk_count": bytes(4),
        b"encryptor": b"aes",
    }
    items = [name + b"=" + value for name, value in fields.items()]
    header = b"".join(struct.pack("<I", len(item)) + item for item in items)
    path = tmp_path / "x.bag"
    path.write_bytes(MAGIC + struct.pack("<I", len(header)) + header + bytes(4))
    with pytest.raises(InputError, match="encrypted"):
        BagSource(path)


def peak_of_reading(path):
    source = BagSource(path)
    gc.collect()
    tracemalloc.start()
    for _ in source.records():
        pass
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    source.close()
    return peak


def test_memory_does_not_grow_with_the_bag(tmp_path):
    few, many = (
        peak_of_reading(write_bag(tmp_path / f"{count}.bag", LZ4, messages=count, size=5000, chunk=100_000))
        for count in (400, 3200)
    )
    assert many < few * 2


def test_overlapping_chunks_are_read_in_order(tmp_path):
    times = [number * 1000 + (5_000 if number % 3 else 0) for number in range(300)]
    messages, _ = read(write_bag(tmp_path / "x.bag", times=times, messages=300))
    assert all(early[0] <= late[0] for early, late in pairwise(messages))
