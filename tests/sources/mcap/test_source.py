"""Intact MCAP files in every layout, written and read by the ``mcap`` library as an independent reference."""

import gc
import io
import os
import subprocess
import sys
from collections import Counter
from dataclasses import replace

import lz4.frame
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap import records as mcap_records
from mcap.reader import NonSeekingReader

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Attachment, Message
from seaclutter_cli.sources.mcap import contents
from seaclutter_cli.sources.mcap.source import McapSource
from tests.logs import (
    CLOUD_KINDS,
    HEADER,
    LAYOUTS,
    MAGIC,
    START_NS,
    Entry,
    Extra,
    Layout,
    Topic,
    chunk_of,
    cloud_log,
    join,
    valid_end,
    write_log,
)

SCHEMA = mcap_records.Schema(1, b"string text", "ros2msg", "test/msg/Note")


def plain(record):
    """Return a record as a tuple that compares by value."""
    if isinstance(record, Message):
        channel = record.channel
        schema = channel.schema and (channel.schema.name, channel.schema.encoding, channel.schema.data)
        described = (channel.topic, channel.message_encoding, channel.metadata, schema)
        return (*described, record.log_time_ns, record.publish_time_ns, record.sequence, bytes(record.data))
    if isinstance(record, Attachment):
        return (record.name, record.media_type, record.log_time_ns, record.create_time_ns, bytes(record.data))
    return (record.name, record.entries)


def read(path):
    """Return the records of an intact file, and check that a second pass gives the same."""
    source = McapSource(path)
    assert source.damage == []
    known, counts = source.channels, source.counts
    records = [plain(record) for record in source.records()]
    assert [plain(record) for record in source.records()] == records
    assert source.damage == []
    assert source.channels == known
    messages = [record for record in source.records() if isinstance(record, Message)]
    assert {message.channel for message in messages} <= set(known)
    assert {number: count for number, count in counts.items() if count} == Counter(m.channel.id for m in messages)
    del messages
    source.close()
    return records


def reference(path):
    """Return metadata, attachments and messages of a file as the library reads them."""

    def reader():
        return NonSeekingReader(io.BytesIO(path.read_bytes()), validate_crcs=True)

    attachments = [(a.name, a.media_type, a.log_time, a.create_time, a.data) for a in reader().iter_attachments()]
    metadata = [(record.name, record.metadata) for record in reader().iter_metadata()]
    messages = []
    for schema, channel, message in reader().iter_messages():
        described = (channel.topic, channel.message_encoding, tuple(channel.metadata.items()))
        declared = schema and (schema.name, schema.encoding, schema.data)
        messages.append((*described, declared, message.log_time, message.publish_time, message.sequence, message.data))
    return metadata, attachments, messages


def assert_equal(path):
    records = read(path)
    metadata, attachments, messages = reference(path)
    extras = records[: len(metadata) + len(attachments)]
    assert [record for record in extras if len(record) == 2] == metadata
    assert [record for record in extras if len(record) == 5] == attachments
    assert records[len(extras) :] == messages


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_every_layout_reads_as_the_library_reads_it(tmp_path, layout):
    path = cloud_log(tmp_path / "log.mcap", layout, topics=("/bow/points", "/stern/points"), points=100)
    assert_equal(path)
    source = McapSource(path)
    assert source.name == "log"
    assert source.profile == "ros2"
    assert source.compression == (layout.compression if layout.chunked else None)
    source.close()


@pytest.mark.parametrize("kind", CLOUD_KINDS)
def test_every_cloud_encoding(tmp_path, kind):
    if kind == "protobuf":
        pytest.importorskip("google.protobuf")
    assert_equal(cloud_log(tmp_path / "log.mcap", kind=kind, points=50, frames=3))


TOPICS = (
    Topic("/a"),
    Topic("/b", "json", ("Note", "jsonschema", b"{}"), {"rate": "7", "frame": "lidar"}),
    Topic("/c", "raw", None),
    Topic("/never"),
)


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(list(LAYOUTS.values())),
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 30), st.integers(0, 90)), max_size=40),
    st.lists(st.tuples(st.integers(0, 40), st.integers(0, 50)), max_size=4),
    st.integers(50, 500),
    st.sampled_from((0, START_NS, 2**64 - 40)),
)
def test_any_order_and_size(tmp_path_factory, layout, messages, attachments, chunk_size, start_ns):
    entries = [
        Entry(TOPICS[topic].name, start_ns + time, bytes([number]) * size, sequence=number)
        for number, (topic, time, size) in enumerate(messages)
    ]
    extras = [Extra(f"file {number}", *position, bytes(size)) for number, (*position, size) in enumerate(attachments)]
    extras += [
        Extra(f"note {number}", position, entries={"number": str(number)})
        for number, (position, _) in enumerate(attachments)
    ]
    layout = replace(layout, chunk_size=chunk_size)
    assert_equal(write_log(tmp_path_factory.mktemp("any") / "log.mcap", TOPICS, entries, layout, extras=extras))


def test_channels_without_messages_are_known(tmp_path):
    for layout in LAYOUTS.values():
        path = write_log(tmp_path / "log.mcap", TOPICS, [Entry("/a", START_NS, b"x")], layout)
        source = McapSource(path)
        assert [channel.topic for channel in source.channels] == ["/a", "/b", "/c", "/never"]
        source.close()


def test_counts_come_from_the_statistics_where_chunks_have_no_index(tmp_path):
    source = McapSource(cloud_log(tmp_path / "log.mcap", LAYOUTS["no message index"], points=20))
    assert source.counts == {1: 6, 2: 12}
    source.close()


def write(path, *parts):
    path.write_bytes(join(*parts))
    return path


def note(number, time_ns=None, channel=1, data=b"note"):
    time_ns = START_NS + number if time_ns is None else time_ns
    return mcap_records.Message(channel, time_ns, data, time_ns, number)


def declared(channel=1, topic="/notes", schema=1):
    return mcap_records.Channel(channel, topic, "cdr", {}, schema)


def sequences(path):
    return [record[-2] for record in read(path)]


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())
def test_a_log_without_messages(tmp_path, layout):
    path = write_log(tmp_path / "log.mcap", TOPICS, [], layout)
    assert read(path) == []


def test_an_empty_log(tmp_path):
    path = write(tmp_path / "log.mcap", HEADER, *valid_end())
    assert read(path) == []


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_chunks_without_messages_or_without_anything(tmp_path, compression):
    empty = chunk_of(compression=compression)
    declaring = chunk_of(SCHEMA, declared(), compression=compression)
    filled = chunk_of(note(1), note(2), compression=compression)
    path = write(tmp_path / "log.mcap", HEADER, empty, declaring, filled, empty, *valid_end())
    assert sequences(path) == [1, 2]


def test_channels_declared_in_every_chunk(tmp_path):
    chunks = [chunk_of(SCHEMA, declared(), note(number)) for number in range(4)]
    assert sequences(write(tmp_path / "log.mcap", HEADER, *chunks, SCHEMA, declared(), *valid_end())) == [0, 1, 2, 3]


def test_a_schema_declared_after_its_channel(tmp_path):
    path = write(tmp_path / "log.mcap", HEADER, chunk_of(declared(), note(1)), chunk_of(SCHEMA, note(2)), *valid_end())
    assert [record[3] for record in read(path)] == [("test/msg/Note", "ros2msg", b"string text")] * 2


def test_an_index_of_a_channel_without_messages(tmp_path):
    index = mcap_records.MessageIndex(9, [])
    path = write(tmp_path / "log.mcap", HEADER, chunk_of(SCHEMA, declared(), note(1)), index, *valid_end())
    assert sequences(path) == [1]


def test_messages_inside_and_outside_chunks(tmp_path):
    parts = (note(5), SCHEMA, declared(), note(1), chunk_of(note(4), note(2)), note(3), declared(), note(0))
    assert sequences(write(tmp_path / "log.mcap", HEADER, *parts, *valid_end())) == [0, 1, 2, 3, 4, 5]


def test_unchunked_logs_are_read_in_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(contents, "_LOOSE_BYTES", 500)
    numbers = [number ^ 5 for number in range(200)]
    path = write(tmp_path / "log.mcap", HEADER, SCHEMA, declared(), *map(note, numbers), *valid_end())
    assert sequences(path) == list(range(200))


def test_private_and_extended_records(tmp_path):
    private = b"\x90" + (30).to_bytes(8, "little") + bytes(30)
    chunk = chunk_of(SCHEMA, declared(), private, note(1), declared(), note(2))
    header = b"\x01" + (16).to_bytes(8, "little") + b"\4\0\0\0ros2" + bytes(4) + b"more"
    path = write(tmp_path / "log.mcap", header, private, chunk, private, private, *valid_end())
    assert sequences(path) == [1, 2]


def _frames_of_unknown_size(data):
    compressor = zstandard.ZstdCompressor(write_content_size=False)
    return compressor.compress(data[:40]) + compressor.compress(data[40:])


@pytest.mark.parametrize(
    ("compression", "compress"),
    [("zstd", _frames_of_unknown_size), ("lz4", lambda data: lz4.frame.compress(data, store_size=False))],
)
def test_chunks_without_a_content_size(tmp_path, compression, compress):
    records = join(SCHEMA, declared(), note(1), note(2))[len(MAGIC) : -len(MAGIC)]
    chunk = chunk_of(records, compression=compression, data=compress(records))
    chunk.message_start_time, chunk.message_end_time = START_NS + 1, START_NS + 2
    assert sequences(write(tmp_path / "log.mcap", HEADER, chunk, *valid_end())) == [1, 2]


def test_messages_outlive_the_source(tmp_path):
    path = cloud_log(tmp_path / "log.mcap", LAYOUTS["unchunked"], points=20)
    source = McapSource(path)
    messages = list(source.records())
    expected = [plain(message) for message in messages]
    source.close()
    gc.collect()
    assert [plain(message) for message in messages] == expected


@pytest.mark.parametrize("layout", [LAYOUTS["zstd"], LAYOUTS["none"], LAYOUTS["unchunked"]])
def test_closing_in_the_middle(tmp_path, layout):
    source = McapSource(cloud_log(tmp_path / "log.mcap", layout, frames=30, points=50))
    records = source.records()
    first = [next(records) for _ in range(10)]
    source.close()
    records.close()
    assert len({plain(record)[0] for record in first}) == 4


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" * 2, b"no log at all", bytes(5000)])
def test_files_that_are_not_logs(tmp_path, content):
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"log\.mcap: (the file is empty|no readable record in this MCAP file)"):
        McapSource(path)


def test_paths_that_are_not_files(tmp_path):
    other = tmp_path / "log.txt"
    other.write_text("a log of words")
    for path, message in (
        (other, "not an MCAP file"),
        (tmp_path / "none.mcap", "No such file"),
        (tmp_path, "director"),
    ):
        with pytest.raises(InputError, match=message):
            McapSource(path)
    if hasattr(os, "mkfifo") and os.path.exists("/dev/null"):  # noqa: PTH110
        with pytest.raises(InputError, match="not a regular file"):
            McapSource(type(tmp_path)("/dev/null"))


_PEAK = """
import re, sys
from pathlib import Path
from seaclutter_cli.sources.mcap.source import McapSource

source, size = McapSource(Path(sys.argv[1])), 0
for record in source.records():
    if hasattr(record, "sequence"):
        sum(record.data[::4096])
    size += len(record.data)
print(size, *re.findall(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text()))
"""


def peak_kilobytes(path, size):
    """Return the peak memory of a process that reads a whole log, in kB."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", _PEAK, path]
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    found, peak = map(int, run.stdout.split())
    assert found == size
    return peak


def long_log(path, layout, count, extras=()):
    noise = os.urandom(1_000_000)
    entries = (Entry("/a", START_NS + number, noise, sequence=number) for number in range(count))
    return write_log(path, TOPICS, entries, layout, extras=extras)


needs_proc = pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="peak memory is read from /proc")  # noqa: PTH110


@needs_proc
@pytest.mark.parametrize("name", ["lz4", "none", "unchunked"])
def test_memory_does_not_grow_with_the_log(tmp_path, name):
    layout = replace(LAYOUTS[name], chunk_size=2_000_000)
    peaks = [peak_kilobytes(long_log(tmp_path / "log.mcap", layout, n), n * 1_000_000) for n in (1, 160)]
    assert peaks[1] < peaks[0] + 60_000


@needs_proc
def test_memory_does_not_grow_with_an_attachment(tmp_path):
    peaks = []
    for size in (1_000_000, 160_000_000):
        path = long_log(tmp_path / "log.mcap", Layout(), 1, [Extra("video", data=bytes(size))])
        peaks.append(peak_kilobytes(path, 1_000_000 + size))
    assert peaks[1] < peaks[0] + 60_000
