"""MCAP files with a wrong index, or wrong sizes, times or declarations."""

import os
import struct
import subprocess
import sys
from dataclasses import replace

import pytest
from mcap import records as mcap_records
from mcap.opcode import Opcode

from tests.logs import HEADER, MAGIC, START_NS, Piece, chunk_of, join, records_of, valid_end
from tests.sources.damaged import damage_texts, flip, message_blocks, read, small_log, stream_of

SCHEMA = mcap_records.Schema(1, b"string text", "ros2msg", "test/msg/Note")
CHANNEL = mcap_records.Channel(1, "/notes", "cdr", {}, 1)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "log.mcap"
    path.touch()
    return path


def changed(data, op, change, number=0):
    """Return a log with a changed record in the summary, and without the checksum that would reveal it."""
    pieces = records_of(data)
    target = [piece for piece in pieces if piece.op == op][number]
    record = getattr(mcap_records, Opcode(op).name.title().replace("_", "")).read(stream_of(target))
    change(record)
    parts = [record if piece is target else piece for piece in pieces]
    parts[-1] = replace(mcap_records.Footer.read(stream_of(pieces[-1])), summary_crc=0)
    return join(*parts)


def _move(entry):
    entry.chunk_start_offset += 5


def _far(entry):
    entry.chunk_start_offset = 2**62


def _later(entry):
    entry.message_start_time += 10**9


@pytest.mark.parametrize("change", [_move, _far, _later])
@pytest.mark.parametrize("name", ["zstd", "none", "no message index"])
def test_wrong_chunk_index(path, name, change):
    whole, extras, _ = read(path, small_log(name))
    messages, found, damage = read(path, changed(small_log(name), Opcode.CHUNK_INDEX, change, 2))
    assert (messages, found) == (whole, extras)
    offset = message_blocks(name)[2].start
    problem = "the index at the end does not fit 1 of 5 chunks; the log is read without it"
    assert damage_texts(damage) == [f"byte {offset}: {problem}"]


def test_chunk_index_with_too_many_chunks(path):
    data = changed(small_log("zstd"), Opcode.CHUNK_INDEX, _far)
    pieces = records_of(data)
    indexes = [piece for piece in records_of(small_log("zstd")) if piece.op == Opcode.CHUNK_INDEX]
    pieces.insert(pieces.index(next(piece for piece in pieces if piece.op == Opcode.CHUNK_INDEX)), indexes[0])
    messages, _, damage = read(path, join(*pieces))
    assert len(messages) == 12
    assert "the index at the end lists 1 chunk that the file does not contain" in str(damage[0])


@pytest.mark.parametrize("name", ["zstd", "unchunked", "no message index"])
def test_wrong_statistics(path, name):
    offset = next(piece.offset for piece in records_of(small_log(name)) if piece.op == Opcode.STATISTICS)
    for difference, expected in (
        (3, "the file lacks 3 of 15 messages; left out: 3 messages"),
        (-2, "the file contains 2 messages more than its statistics state"),
    ):

        def change(entry, difference=difference):
            entry.message_count += difference

        messages, _, damage = read(path, changed(small_log(name), Opcode.STATISTICS, change))
        assert len(messages) == 12
        assert damage_texts(damage) == [f"byte {offset}: {expected}"]


def test_attachment_only_in_the_statistics(path):
    pieces = [piece for piece in records_of(small_log("unchunked")) if piece.op != Opcode.ATTACHMENT]
    footer = mcap_records.Footer.read(stream_of(pieces.pop()))
    moved = 9 + len(
        next(piece for piece in records_of(small_log("unchunked")) if piece.op == Opcode.ATTACHMENT).content
    )
    footer = replace(footer, summary_start=footer.summary_start - moved, summary_crc=0)
    _, extras, damage = read(path, join(*pieces, footer))
    assert extras == ["vessel"]
    assert "the file lacks 1 of 2 attachments and metadata records" in str(damage[0])


@pytest.mark.parametrize("name", ["zstd", "no message index", "unchunked"])
def test_summary_with_a_wrong_checksum(path, name):
    data = small_log(name)
    start = next(piece.end for piece in records_of(data) if piece.op == Opcode.DATA_END)
    whole, extras, _ = read(path, data)
    messages, found, damage = read(path, flip(data, len(data) - 9))
    assert (messages, found) == (whole, extras)
    assert damage_texts(damage) == [f"byte {start}: the index at the end is damaged; the log is read without it"]


def test_a_log_without_its_end(path):
    data = small_log("zstd")
    whole, extras, _ = read(path, data)
    for op in (Opcode.DATA_END, Opcode.STATISTICS, Opcode.FOOTER):
        end = next(piece.offset for piece in records_of(data) if piece.op == op)
        for rest in (b"", MAGIC):
            messages, found, damage = read(path, data[:end] + rest)
            assert (messages, found) == (whole, extras)
            assert "the recording was not closed: the file has no footer" in str(damage[-1])


def note(number, channel=1):
    return mcap_records.Message(channel, START_NS + number, b"note %d" % number, START_NS, number)


def sequences(result):
    return [message[3] for message in result[0]]


@pytest.mark.parametrize("has_index", [True, False])
def test_chunks_with_wrong_times(path, has_index):
    """Messages are in order if a message index reveals the wrong times."""
    parts = [SCHEMA, CHANNEL]
    for number, wrong in enumerate((0, 10**9, 0, -(10**9))):
        times = {"message_start_time": START_NS + number + wrong, "message_end_time": START_NS + number + wrong}
        parts.append(chunk_of(note(number), **times))
        if has_index:
            parts.append(mcap_records.MessageIndex(1, [(START_NS + number, 0)]))
    result = read(path, join(HEADER, *parts, *valid_end()))
    assert sorted(sequences(result)) == [0, 1, 2, 3]
    assert [item.problem for item in result[2]] == ["messages of this chunk are outside the times that it states"] * 2
    assert sequences(result) == [0, 1, 2, 3] or not has_index


def test_a_channel_declared_differently(path):
    other = replace(CHANNEL, topic="/other")
    chunks = (chunk_of(SCHEMA, CHANNEL, note(1)), chunk_of(other, note(2)), chunk_of(other, note(3)))
    parts = (HEADER, *chunks, mcap_records.DataEnd(0))
    start = len(join(*parts)) - len(MAGIC)
    messages, _, damage = read(path, join(*parts, SCHEMA, CHANNEL, mcap_records.Footer(start, 0, 0)))
    assert [message[0] for message in messages] == ["/notes"] * 3
    assert [item.problem for item in damage] == ["channel 1 is declared again, with different content"]


def test_undeclared_channels_and_schemas(path):
    chunk = chunk_of(CHANNEL, note(1), note(2, channel=7), note(3, channel=7))
    messages, _, damage = read(path, join(HEADER, chunk, *valid_end()))
    assert [message[:1] + message[3:4] for message in messages] == [("/notes", 1)]
    offset = len(join(HEADER)) - len(MAGIC)
    assert sorted(damage_texts(damage)) == [
        f"byte {offset}: messages of channel 7, which is not declared; left out: 2 messages",
        f"byte {offset}: topic /notes has schema 1, which is not declared",
    ]


def test_a_damaged_attachment(path):
    data = small_log("zstd")
    piece = next(piece for piece in records_of(data) if piece.op == Opcode.ATTACHMENT)
    messages, extras, damage = read(path, flip(data, piece.end - 20))
    assert (len(messages), extras) == (12, ["vessel"])
    assert damage_texts(damage) == [
        f"byte {piece.offset}: damaged attachment (its checksum is wrong); left out: {len(piece.content):,} bytes"
    ]


def test_message_index_of_a_missing_chunk(path):
    lost = message_blocks("zstd")[2]
    data = small_log("zstd")
    for garbage in (b"", bytes(50), b"\xff" * 500):
        messages, _, damage = read(path, data[: lost.start] + garbage + data[lost.end :])
        assert len(messages) == 12 - len(lost.messages)
        assert sum(item.lost_messages or 0 for item in damage) == len(lost.messages)


_HUGE = (2**31, 2**40, 2**63 - 1, 2**64 - 1)


def _huge_files():
    """Yield files that declare more bytes than fit into memory."""
    records = join(SCHEMA, CHANNEL, note(1))[8:-8]
    valid = chunk_of(note(2))
    for huge in _HUGE:
        for compression in ("zstd", "lz4", ""):
            chunk = chunk_of(records, compression=compression, uncompressed_size=huge, uncompressed_crc=0)
            yield join(HEADER, SCHEMA, CHANNEL, chunk, valid, *valid_end())
        for op in range(1, 20):
            yield join(HEADER, SCHEMA, CHANNEL, struct.pack("<BQ", op, huge), valid, *valid_end())
        for op in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.MESSAGE_INDEX):
            content = struct.pack("<IIII", *[min(huge, 2**32 - 1)] * 4) + bytes(60)
            yield join(HEADER, SCHEMA, CHANNEL, Piece(0, op, content), valid, *valid_end())


_FRUGAL = """
import resource, sys
from pathlib import Path
from seaclutter_cli.sources.mcap.source import McapSource

McapSource(Path(sys.argv[1])).close()
resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30))
for path in map(Path, sys.argv[2:]):
    source = McapSource(path)
    print(sum(hasattr(record, "sequence") for record in source.records()), len(source.damage))
"""


def test_huge_sizes_take_neither_memory_nor_time(tmp_path):
    pytest.importorskip("resource")
    intact = tmp_path / "intact.mcap"
    intact.write_bytes(small_log("zstd"))
    paths = [tmp_path / f"{number}.mcap" for number, _ in enumerate(_huge_files())]
    for path, data in zip(paths, _huge_files(), strict=True):
        path.write_bytes(data)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", _FRUGAL, intact, *paths]
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=60)
    assert run.returncode == 0, run.stderr
    for line in run.stdout.splitlines():
        messages, damage = map(int, line.split())
        assert messages >= 1
        assert damage


def opcode(data, piece, op):
    """Return a log with another opcode of one record."""
    return data[: piece.offset] + bytes((op,)) + data[piece.offset + 1 :]


@pytest.mark.parametrize("op", [0, 5, 6, 12, 14, 16, 0x86, 0xFF])
@pytest.mark.parametrize("name", ["zstd", "unchunked"])
def test_changed_opcodes(path, name, op):
    data = small_log(name)
    for piece in records_of(data):
        result = read(path, opcode(data, piece, op))
        lost = piece.op == Opcode.MESSAGE and op != Opcode.MESSAGE
        assert len(set(sequences(result)) & set(range(12))) == 12 - lost, piece
        assert result[2] or not lost
        # Outside chunks, a declaration may be read as a message.
        assert len(result[0]) == 12 - lost or (name, op) == ("unchunked", Opcode.MESSAGE)


def test_messages_of_zeros_are_read_as_messages(path):
    """Zeros match the layout of many kinds of records."""
    for size in range(80):
        messages = [mcap_records.Message(1, time, bytes(size), time, 0) for time in range(3)]
        for parts in ((SCHEMA, CHANNEL, *messages), (chunk_of(SCHEMA, CHANNEL, *messages, uncompressed_crc=0),)):
            result = read(path, join(HEADER, *parts, *valid_end()))
            assert [message[1] for message in result[0]] == [0, 1, 2]
            assert result[2] == []


def test_a_log_whose_first_record_is_unknown(path):
    data = small_log("zstd")
    for op in range(256):
        assert len(read(path, opcode(data, records_of(data)[0], op))[0]) == 12


def test_valid_summary_at_a_wrong_offset(path):
    """The checksum of the summary is correct, its offsets are not."""
    data = small_log("unchunked")
    first = next(piece for piece in records_of(data) if piece.op == Opcode.CHANNEL)
    broken = data[: first.offset] + bytes(30) + data[first.end :]
    messages, _, damage = read(path, broken)
    assert len(messages) == 12
    assert "the index at the end is damaged; the log is read without it" in str(damage[-1])
