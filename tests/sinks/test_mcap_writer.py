"""MCAP writer against the mcap library: index, statistics, checksums, reproducible bytes."""

import io
import os
import struct
import subprocess
import sys
import threading
import zlib

import lz4.frame
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap import records as mcap_records
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.stream_reader import CRCValidationError, StreamReader

from seaclutter_cli.records import Attachment, Channel, Metadata, Schema
from seaclutter_cli.sinks.mcap_writer import COMPRESSIONS, McapWriter
from tests.logs import cloud_log, records_of
from tests.paths import ROOT

NOTE = Schema("note", "jsonschema", b"{}")
ALL = pytest.mark.parametrize("compression", COMPRESSIONS)


def written(items, compression="zstd", chunk_size=1000):
    """Write messages ``(channel, log_time, publish_time, sequence, data)``, attachments, metadata; return the file."""
    stream = io.BytesIO()
    before, McapWriter.chunk_size = McapWriter.chunk_size, chunk_size
    try:
        writer = McapWriter(stream, profile="ros2", compression=compression)
        for number, schema in ((1, NOTE), (2, NOTE), (3, None), (40_000, Schema("other", "ros2msg", b"int8 a\n"))):
            writer.add_channel(Channel(number, f"/{number}", "json", schema, (("key", "Ü"),)))
        for item in items:
            add = {
                tuple: lambda message: writer.write(*message),
                Attachment: writer.attach,
                Metadata: writer.add_metadata,
            }
            add[type(item)](item)
        writer.finish()
    finally:
        McapWriter.chunk_size = before
    return stream.getvalue()


def messages(reader, **options):
    found = reader.iter_messages(**options)
    return [(m.channel_id, m.log_time, m.publish_time, m.sequence, m.data) for _, _, m in found]


TIMES = st.one_of(st.integers(0, 2**64 - 1), st.integers(0, 5))
MESSAGES = st.tuples(
    st.sampled_from([1, 2, 3, 40_000]), TIMES, TIMES, st.integers(0, 2**32 - 1), st.binary(max_size=400)
)
EXTRAS = st.one_of(
    st.builds(Attachment, TIMES, TIMES, st.text(max_size=9), st.just("text/plain"), st.binary(max_size=300)),
    st.builds(Metadata, st.text(max_size=9), st.dictionaries(st.text(max_size=5), st.text(max_size=5), max_size=3)),
)


@ALL
@settings(max_examples=60, deadline=None)
@given(items=st.lists(st.one_of(MESSAGES, MESSAGES, EXTRAS), max_size=25))
def test_round_trip(compression, items):
    data = written(items, compression)
    expected = [item for item in items if isinstance(item, tuple)]
    for kind in (SeekingReader, NonSeekingReader):
        reader = kind(io.BytesIO(data), validate_crcs=True)
        by_time = sorted(expected, key=lambda message: message[1])
        assert messages(reader) == by_time
    reader = SeekingReader(io.BytesIO(data), validate_crcs=True)
    attachments = [(a.log_time, a.create_time, a.name, a.media_type, a.data) for a in reader.iter_attachments()]
    fields = ("log_time_ns", "create_time_ns", "name", "media_type", "data")
    given_attachments = [item for item in items if isinstance(item, Attachment)]
    assert attachments == [tuple(getattr(item, name) for name in fields) for item in given_attachments]
    given_metadata = [(item.name, item.entries) for item in items if isinstance(item, Metadata)]
    assert [(record.name, record.metadata) for record in reader.iter_metadata()] == given_metadata
    check_summary(reader.get_summary(), expected, len(given_attachments), len(given_metadata))


def check_summary(summary, expected, attachments, metadata):
    statistics = summary.statistics
    numbers = [message[0] for message in expected]
    assert statistics.message_count == len(expected)
    assert statistics.channel_message_counts == {number: numbers.count(number) for number in set(numbers)}
    assert (statistics.attachment_count, statistics.metadata_count) == (attachments, metadata)
    assert (statistics.channel_count, statistics.schema_count) == (4, 2)
    assert statistics.chunk_count == len(summary.chunk_indexes)
    times = [message[1] for message in expected] or [0]
    assert (statistics.message_start_time, statistics.message_end_time) == (min(times), max(times))
    assert {number: channel.topic for number, channel in summary.channels.items()} == {
        number: f"/{number}" for number in (1, 2, 3, 40_000)
    }
    assert {channel.metadata["key"] for channel in summary.channels.values()} == {"Ü"}
    assert summary.channels[3].schema_id == 0
    assert summary.channels[1].schema_id == summary.channels[2].schema_id != 0


@pytest.mark.filterwarnings("ignore:.*deprecated")
@ALL
def test_the_index_finds_every_message(compression):
    items = [(1 + k % 2, 1000 - k * 7 % 500, k, k, bytes(k % 90)) for k in range(300)]
    data = written(items, compression)
    reader = SeekingReader(io.BytesIO(data), validate_crcs=True)
    assert len(reader.get_summary().chunk_indexes) > 5
    for start, end in ((600, 700), (None, 520), (990, None)):
        chosen = [t for t in items if t[0] == 2 and (start or 0) <= t[1] < (end or 2**63)]
        found = messages(reader, topics=["/2"], start_time=start, end_time=end)
        assert found == sorted(chosen, key=lambda message: message[1])


@ALL
def test_message_indexes_refer_to_their_messages(compression):
    items = [(1 + k % 3, k * 5, k, k, bytes(k % 90)) for k in range(200)]
    data = written(items, compression)
    index = SeekingReader(io.BytesIO(data)).get_summary().chunk_indexes
    chunks = [record for record in StreamReader(io.BytesIO(data), emit_chunks=True).records if is_chunk(record)]
    by_offset = {piece.offset: piece for piece in records_of(data)}
    found = 0
    for entry, chunk in zip(index, chunks, strict=True):
        assert by_offset[entry.chunk_start_offset].op == 6
        assert entry.chunk_length == 9 + len(by_offset[entry.chunk_start_offset].content)
        raw = unpacked(chunk)
        assert zlib.crc32(raw) == chunk.uncompressed_crc
        for channel, offset in entry.message_index_offsets.items():
            number, size = struct.unpack_from("<HI", by_offset[offset].content)
            assert (number, by_offset[offset].op) == (channel, 7)
            for at in range(6, 6 + size, 16):
                time_ns, position = struct.unpack_from("<QQ", by_offset[offset].content, at)
                op, _, written_channel, _, log_time_ns = struct.unpack_from("<BQHIQ", raw, position)
                assert (op, written_channel, log_time_ns) == (5, channel, time_ns)
                found += 1
    assert found == len(items)


@ALL
def test_lengths_in_the_index_are_those_of_the_records(compression):
    items = [(1 + k % 3, k, k, k, bytes(k % 90)) for k in range(200)]
    items[50:50] = [Attachment(1, 2, "a", "b", b"attached"), Metadata("m", {"key": "value"})]
    data = written(items, compression)
    summary = SeekingReader(io.BytesIO(data)).get_summary()
    pieces = records_of(data)
    ends = {piece.offset: piece.end for piece in pieces}
    for entry in (*summary.attachment_indexes, *summary.metadata_indexes):
        assert entry.offset + entry.length == ends[entry.offset]
    for entry in summary.chunk_indexes:
        end = entry.chunk_start_offset + entry.chunk_length
        assert end == ends[entry.chunk_start_offset]
        behind = [piece.op for piece in pieces if end <= piece.offset < end + entry.message_index_length]
        assert behind == [7] * len(entry.message_index_offsets)
        assert end + entry.message_index_length in ends


def is_chunk(record):
    return isinstance(record, mcap_records.Chunk)


def unpacked(chunk):
    unpack = {"zstd": zstandard.decompress, "lz4": lz4.frame.decompress, "": bytes}[chunk.compression]
    raw = unpack(chunk.data)
    assert len(raw) == chunk.uncompressed_size
    return raw


def test_checksums_cover_chunks_attachments_and_the_summary():
    items = [(1, k, k, k, bytes(range(200))) for k in range(9)]
    items.append(Attachment(1, 2, "a", "b", b"attached"))
    data = written(items, "")
    pieces = records_of(data)
    for op, back in ((6, 1), (9, 6), (11, 3)):
        piece = next(piece for piece in pieces if piece.op == op)
        at = piece.end - back
        broken = data[:at] + bytes((data[at] ^ 1,)) + data[at + 1 :]
        assert checksums(broken) == [piece.op != op for op in (6, 9, 11)]
    assert checksums(data) == [True, True, True]


def checksums(data):
    """Return whether the checksums of the chunk, the attachment and the summary are valid."""
    try:
        messages(SeekingReader(io.BytesIO(data), validate_crcs=True))
        valid = [True]
    except CRCValidationError:
        valid = [False]
    pieces = records_of(data)
    attachment = next(piece.content for piece in pieces if piece.op == 9)
    valid.append(zlib.crc32(attachment[:-4]) == int.from_bytes(attachment[-4:], "little"))
    start = next(piece.end for piece in pieces if piece.op == 15)
    covered = data[start : pieces[-1].offset + 9 + 16]
    return [*valid, zlib.crc32(covered) == int.from_bytes(pieces[-1].content[16:], "little")]


def test_a_file_without_messages():
    reader = SeekingReader(io.BytesIO(written([])), validate_crcs=True)
    assert messages(reader) == []
    check_summary(reader.get_summary(), [], 0, 0)


def test_chunks_have_the_requested_size_unless_a_message_is_larger():
    items = [(1, k, k, k, bytes(300)) for k in range(20)] + [(1, 20, 0, 0, bytes(5000))]
    chunks = SeekingReader(io.BytesIO(written(items, ""))).get_summary().chunk_indexes
    assert [chunk.uncompressed_size for chunk in chunks] == [4 * 331] * 5 + [5031]


@ALL
@pytest.mark.parametrize("threads", [1, 2, 4, 64])
def test_bytes_do_not_depend_on_the_number_of_threads(monkeypatch, compression, threads):
    items = [(1 + k % 2, k, k, k, bytes(k * j % 256 for j in range(500))) for k in range(100)]
    items[50:50] = [Attachment(1, 2, "a", "b", b"attached"), Metadata("m", {"key": "value"})]
    monkeypatch.setenv("SEACLUTTER_THREADS", "1")
    expected = written(items, compression)
    monkeypatch.setenv("SEACLUTTER_THREADS", str(threads))
    assert written(items, compression) == expected


def test_few_chunks_are_pending_and_abort_stops_the_threads():
    before = threading.active_count()
    stream = io.BytesIO()
    writer = McapWriter(stream, profile="", compression="zstd")
    writer.add_channel(Channel(1, "/a", "json", None))
    noise = os.urandom(2**20)
    for k in range(12):
        writer.write(1, k, k, k, noise)
        assert len(stream.getvalue()) >= (k - 5) * 2**20
    writer.abort()
    assert threading.active_count() == before


class FullStream(io.BytesIO):
    def write(self, data):
        if self.tell() > 10_000:
            raise OSError(28, "No space left on device")
        return super().write(data)


def fill(writer):
    for k in range(100):
        writer.write(1, k, k, k, bytes(2**20))


def test_abort_stops_the_threads_after_an_error():
    before = threading.active_count()
    writer = McapWriter(FullStream(), profile="", compression="")
    writer.add_channel(Channel(1, "/a", "json", None))
    with pytest.raises(OSError, match="No space left"):
        fill(writer)
    writer.abort()
    assert threading.active_count() == before


def test_bytes_do_not_depend_on_openmp_or_hashes(tmp_path):
    log = cloud_log(tmp_path / "in.mcap", points=3000, topics=["/bow", "/stern"])
    found = set()
    for number, threads in enumerate(("1", "4")):
        out = tmp_path / f"{number}.mcap"
        environment = {**os.environ, "OMP_NUM_THREADS": threads, "PYTHONHASHSEED": threads}
        options = ["-t", "/bow", "-t", "/stern", "--with-removed", "--keep-raw", "-q", "--csv", str(out) + ".csv"]
        program = [sys.executable, "-m", "seaclutter_cli", "filter", str(log), "-o", str(out), *options]
        subprocess.run(program, check=True, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)
        found.add((out.read_bytes(), (tmp_path / f"{number}.mcap.csv").read_bytes()))
    assert len(found) == 1
