"""MCAP files that are cut, flipped, filled with zeros, or that lie about themselves."""

import io
import os
import random
import struct
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap import records as mcap_records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.stream_reader import breakup_chunk

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Message
from seaclutter_cli.sources import chunked
from seaclutter_cli.sources.mcap import McapSource
from tests.logs import (
    HEADER,
    LAYOUTS,
    MAGIC,
    START_NS,
    Entry,
    Extra,
    Piece,
    Topic,
    chunk_of,
    join,
    log_bytes,
    records_of,
    sound_end,
)

TOPICS = (Topic("/notes"), Topic("/imu", "raw", None, {"rate": "20"}))
EXTRAS = (Extra("file", 4, bytes(range(60))), Extra("vessel", 7, entries={"name": "Nord"}))
SMALL = ("zstd", "lz4", "none", "unchunked", "no summary", "bare", "unchunked, bare", "no message index", "no index")
MOST_SECONDS = 5
SCHEMA = mcap_records.Schema(1, b"string text", "ros2msg", "test/msg/Note")
CHANNEL = mcap_records.Channel(1, "/notes", "cdr", {}, 1)


class Place(NamedTuple):
    """Messages that stand or fall together: those of a chunk, or a single one outside chunks."""

    start: int
    end: int
    messages: tuple


@cache
def small_log(name):
    """Return a log of two thousand bytes."""
    noise = random.Random(4)
    entries = [
        Entry(TOPICS[number % 3 == 2].name, START_NS + 10 * number, noise.randbytes(20 + number), 5 + number, number)
        for number in range(12)
    ]
    return log_bytes(TOPICS, entries, replace(LAYOUTS[name], chunk_size=120), extras=EXTRAS)


def stream_of(piece):
    return ReadDataStream(io.BytesIO(piece.content))


@cache
def places(name):
    """Return where the messages of a log are, as the library sees it."""
    found = []
    for piece in records_of(small_log(name)):
        if piece.op == Opcode.CHUNK:
            records = breakup_chunk(mcap_records.Chunk.read(stream_of(piece)), validate_crc=True)
        elif piece.op == Opcode.MESSAGE:
            records = [mcap_records.Message.read(stream_of(piece), len(piece.content))]
        else:
            continue
        messages = [
            (TOPICS[m.channel_id - 1].name, m.log_time, m.publish_time, m.sequence, m.data)
            for m in records
            if isinstance(m, mcap_records.Message)
        ]
        found.append(Place(piece.offset, piece.end, tuple(messages)))
    return found


@pytest.fixture
def path(tmp_path, monkeypatch):
    """Return the path of a log that is written thousands of times, and read without a thread, which takes longer."""
    monkeypatch.setattr(chunked, "_ahead", lambda chunks, load: ((chunk, load(chunk)) for chunk in chunks))
    path = tmp_path / "log.mcap"
    path.touch()
    return path


def read(path, data):
    """Read a file that may be damaged; None where nothing in it can be read."""
    with path.open("r+b") as file:
        file.write(data)
        file.truncate()
    began = time.monotonic()
    try:
        source = McapSource(path)
    except InputError as error:
        assert str(path) in str(error)  # noqa: PT017
        return None, [], []
    messages, extras = [], []
    for record in source.records():
        if isinstance(record, Message):
            values = (record.log_time_ns, record.publish_time_ns, record.sequence, bytes(record.data))
            messages.append((record.channel.topic, *values))
        else:
            extras.append(record.name)
    for damage in source.damage:
        assert damage.path == path
        assert 0 <= damage.offset <= len(data)
        assert damage.lost_bytes >= 0
        assert str(path) in str(damage)
    source.close()
    assert time.monotonic() - began < MOST_SECONDS
    return messages, extras, source.damage


@pytest.mark.parametrize("name", SMALL)
def test_cut_at_every_byte(path, name):
    data = small_log(name)
    whole, extras, damage = read(path, data)
    assert (len(whole), extras, damage) == (12, ["file", "vessel"], [])
    ends = [piece.end for piece in records_of(data) if piece.op in (Opcode.ATTACHMENT, Opcode.METADATA)]
    for size in range(len(data)):
        messages, extras, damage = read(path, data[:size])
        expected = [message for place in places(name) if place.end <= size for message in place.messages]
        if messages is None:
            assert not expected
            assert size < ends[0]
            continue
        assert damage
        assert len(extras) == sum(end <= size for end in ends)
        # Of a chunk that is cut, there may be more.
        assert messages[: len(expected)] == expected
        assert messages == whole[: len(messages)]
        if name in ("none", "bare"):
            assert len(messages) == _uncompressed_messages(data[:size])


def _uncompressed_messages(data):
    """Count the messages that can be seen in a file that is cut, by their beginning and end."""
    return sum(message[-1] in data for place in places("none") for message in place.messages)


def declares(name, at):
    """Tell whether a place in a log without a summary is where it declares its channels."""
    if LAYOUTS[name].summary:
        return False
    first = places(name)[0]
    return at < (first.end if LAYOUTS[name].chunked else first.start)


@pytest.mark.parametrize("name", SMALL)
def test_a_byte_flipped_at_every_place(path, name):
    data, noise = small_log(name), random.Random(1)
    everything = {message for place in places(name) for message in place.messages}
    for at in range(len(data)):
        flipped = bytearray(data)
        flipped[at] ^= noise.choice((1, 2, 4, 8, 16, 32, 64, 128, 255))
        messages, extras, damage = read(path, bytes(flipped))
        hit = next((place for place in places(name) if place.start <= at < place.end), None)
        untouched = [message for place in places(name) if place is not hit for message in place.messages]
        kept = [message for message in messages if message in everything]
        if not declares(name, at):
            assert [message for message in kept if not hit or message not in hit.messages] == untouched, at
        # What stands outside chunks is protected by nothing but the statistics.
        if (len(kept) < 12 and LAYOUTS[name].crcs and LAYOUTS[name].chunked) or (
            len(extras) < 2 and LAYOUTS[name].summary
        ):
            assert damage, at
        if LAYOUTS[name].crcs and LAYOUTS[name].chunked and not declares(name, at):
            assert kept == messages, at
        times = [message[1] for message in messages]
        assert times == sorted(times) or not LAYOUTS[name].message_index, at


def flip(data, at):
    flipped = bytearray(data)
    flipped[at] ^= 0xFF
    return bytes(flipped)


def said(damage):
    """Return what is reported, without the file."""
    return [str(item).split("log.mcap: ", 1)[1] for item in damage]


@pytest.mark.parametrize("name", ["zstd", "lz4", "none"])
def test_a_broken_chunk_is_left_out_whole_and_told_of(path, name):
    whole, *_ = read(path, small_log(name))
    for place in places(name):
        for at in range(place.start + 60, place.end, 7):
            messages, extras, damage = read(path, flip(small_log(name), at))
            if messages == whole and name == "lz4":
                continue  # the frame has bits without meaning
            assert messages == [message for message in whole if message not in place.messages]
            assert extras == ["file", "vessel"]
            (item,) = damage
            assert (item.offset, item.lost_bytes) == (place.start, place.end - place.start)
            assert item.lost_messages == len(place.messages)
            kinds = ("fails its checksum", "cannot be decompressed", "does not hold the")
            assert item.what.startswith(tuple(f"the chunk {kind}" for kind in kinds))


def test_two_broken_chunks(path):
    first, second = places("zstd")[1], places("zstd")[3]
    messages, _, damage = read(path, flip(flip(small_log("zstd"), first.end - 1), second.end - 1))
    assert [item.offset for item in damage] == [first.start, second.start]
    kept = [place for place in places("zstd") if place not in (first, second)]
    assert messages == [message for place in kept for message in place.messages]


@pytest.mark.parametrize("name", ["zstd", "none", "unchunked"])
@pytest.mark.parametrize(
    "garbage", [b"\xa5" * 100, bytes(1000), bytes(range(256)), b"\x05" + bytes(40), MAGIC], ids=range(5)
)
def test_garbage_between_records(path, name, garbage):
    data = small_log(name)
    whole, extras, _ = read(path, data)
    for piece in records_of(data):
        messages, found, damage = read(path, data[: piece.offset] + garbage + data[piece.offset :])
        assert messages == whole
        assert found == extras
        assert sum(item.lost_bytes for item in damage if item.what == "broken bytes between records") == len(garbage)


@pytest.mark.parametrize("name", ["zstd", "none", "unchunked"])
def test_a_tail_of_zeros_as_a_crash_leaves_it(path, name):
    data = small_log(name)
    end = places(name)[2].end
    for size in (9, 1000, 50_000_000):
        with path.open("r+b") as file:
            file.write(data[:end])
            file.truncate(end)
            file.truncate(end + size)
        began = time.monotonic()
        source = McapSource(path)
        messages = [record for record in source.records() if isinstance(record, Message)]
        assert time.monotonic() - began < MOST_SECONDS
        assert len(messages) == sum(len(place.messages) for place in places(name)[:3])
        assert said(source.damage) == [
            f"byte {end}: no record can be read from here on; left out: {size} bytes",
            f"byte {end + size}: the recording was not closed: the file has no footer; left out: nothing",
        ]
        source.close()


def test_zeros_in_the_middle(path):
    data = small_log("none")
    whole, *_ = read(path, data)
    for start in range(len(data) - 300):
        messages, _, damage = read(path, data[:start] + bytes(300) + data[start + 300 :])
        hit = [place for place in places("none") if place.start < start + 300 and start < place.end]
        kept = [message for place in places("none") if place not in hit for message in place.messages]
        assert [message for message in messages if message in kept] == kept
        assert damage or data[start : start + 300] == bytes(300)
        assert set(messages) <= set(whole)


def test_what_follows_the_end_is_left_out(path):
    data = small_log("zstd")
    whole, extras, _ = read(path, data)
    for junk in (b"x", bytes(100), b"#!/bin/sh\n" * 50, data):
        assert read(path, data + junk)[:2] == (whole, extras)
        damage = read(path, data + junk)[2]
        assert said(damage) == [f"byte {len(data)}: bytes behind the end of the recording; left out: {len(junk)} bytes"]


def test_the_beginning_is_missing(path):
    data = small_log("zstd")
    for cut in range(1, places("zstd")[1].end + 1):
        messages, _, damage = read(path, data[cut:])
        kept = [place for place in places("zstd") if place.start >= cut]
        assert messages == [message for place in kept for message in place.messages]
        assert damage


def changed(data, op, change, number=0):
    """Return a log of which a record of the summary is changed, without a checksum that would tell."""
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
def test_a_chunk_index_that_lies(path, name, change):
    whole, extras, _ = read(path, small_log(name))
    messages, found, damage = read(path, changed(small_log(name), Opcode.CHUNK_INDEX, change, 2))
    assert (messages, found) == (whole, extras)
    offset = places(name)[2].start
    what = "the index at the end does not fit 1 of 5 chunks; the log was read without it"
    assert said(damage) == [f"byte {offset}: {what}; left out: nothing"]


def test_a_chunk_index_that_names_too_many(path):
    data = changed(small_log("zstd"), Opcode.CHUNK_INDEX, _far)
    pieces = records_of(data)
    indexes = [piece for piece in records_of(small_log("zstd")) if piece.op == Opcode.CHUNK_INDEX]
    pieces.insert(pieces.index(next(piece for piece in pieces if piece.op == Opcode.CHUNK_INDEX)), indexes[0])
    messages, _, damage = read(path, join(*pieces))
    assert len(messages) == 12
    assert "the index at the end names 1 chunks that are not there" in str(damage[0])


@pytest.mark.parametrize("name", ["zstd", "unchunked", "no message index"])
def test_statistics_that_lie(path, name):
    place = next(piece.offset for piece in records_of(small_log(name)) if piece.op == Opcode.STATISTICS)
    for difference, expected in (
        (3, "3 of 15 messages are nowhere in the file; left out: 3 messages"),
        (-2, "the file holds 2 messages more than its statistics say; left out: nothing"),
    ):

        def change(entry, difference=difference):
            entry.message_count += difference

        messages, _, damage = read(path, changed(small_log(name), Opcode.STATISTICS, change))
        assert len(messages) == 12
        assert said(damage) == [f"byte {place}: {expected}"]


def test_an_attachment_that_only_the_statistics_know(path):
    pieces = [piece for piece in records_of(small_log("unchunked")) if piece.op != Opcode.ATTACHMENT]
    footer = mcap_records.Footer.read(stream_of(pieces.pop()))
    moved = 9 + len(
        next(piece for piece in records_of(small_log("unchunked")) if piece.op == Opcode.ATTACHMENT).content
    )
    footer = replace(footer, summary_start=footer.summary_start - moved, summary_crc=0)
    _, extras, damage = read(path, join(*pieces, footer))
    assert extras == ["vessel"]
    assert "1 of 2 attachments and metadata records are nowhere in the file" in str(damage[0])


@pytest.mark.parametrize("name", ["zstd", "no message index", "unchunked"])
def test_a_summary_whose_checksum_is_wrong(path, name):
    data = small_log(name)
    start = next(piece.end for piece in records_of(data) if piece.op == Opcode.DATA_END)
    whole, extras, _ = read(path, data)
    messages, found, damage = read(path, flip(data, len(data) - 9))
    assert (messages, found) == (whole, extras)
    assert said(damage) == [
        f"byte {start}: the index at the end is broken; the log was read without it; left out: nothing"
    ]


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
def test_chunks_that_lie_about_their_times(path, has_index):
    """Messages are in order all the same where an index of messages tells of the lie."""
    parts = [SCHEMA, CHANNEL]
    for number, wrong in enumerate((0, 10**9, 0, -(10**9))):
        times = {"message_start_time": START_NS + number + wrong, "message_end_time": START_NS + number + wrong}
        parts.append(chunk_of(note(number), **times))
        if has_index:
            parts.append(mcap_records.MessageIndex(1, [(START_NS + number, 0)]))
    result = read(path, join(HEADER, *parts, *sound_end()))
    assert sorted(sequences(result)) == [0, 1, 2, 3]
    assert [item.what for item in result[2]] == ["the messages of this chunk are of other times than it says"] * 2
    assert sequences(result) == [0, 1, 2, 3] or not has_index


def test_a_channel_declared_differently(path):
    other = replace(CHANNEL, topic="/other")
    chunks = (chunk_of(SCHEMA, CHANNEL, note(1)), chunk_of(other, note(2)), chunk_of(other, note(3)))
    parts = (HEADER, *chunks, mcap_records.DataEnd(0))
    start = len(join(*parts)) - len(MAGIC)
    messages, _, damage = read(path, join(*parts, SCHEMA, CHANNEL, mcap_records.Footer(start, 0, 0)))
    assert [message[0] for message in messages] == ["/notes"] * 3
    assert [item.what for item in damage] == ["channel 1 is declared again, and differently"]


def test_channels_and_schemas_that_are_nowhere(path):
    chunk = chunk_of(CHANNEL, note(1), note(2, channel=7), note(3, channel=7))
    messages, _, damage = read(path, join(HEADER, chunk, *sound_end()))
    assert [message[:1] + message[3:4] for message in messages] == [("/notes", 1)]
    place = len(join(HEADER)) - len(MAGIC)
    assert sorted(said(damage)) == [
        f"byte {place}: messages of channel 7, which is declared nowhere; left out: 2 messages",
        f"byte {place}: topic /notes has schema 1, which is nowhere; left out: nothing",
    ]


def test_a_broken_attachment(path):
    data = small_log("zstd")
    piece = next(piece for piece in records_of(data) if piece.op == Opcode.ATTACHMENT)
    messages, extras, damage = read(path, flip(data, piece.end - 20))
    assert (len(messages), extras) == (12, ["vessel"])
    assert said(damage) == [
        f"byte {piece.offset}: broken attachment (its checksum is wrong); left out: {len(piece.content)} bytes"
    ]


def test_an_index_of_messages_whose_chunk_is_gone(path):
    lost = places("zstd")[2]
    data = small_log("zstd")
    for garbage in (b"", bytes(50), b"\xff" * 500):
        messages, _, damage = read(path, data[: lost.start] + garbage + data[lost.end :])
        assert len(messages) == 12 - len(lost.messages)
        assert sum(item.lost_messages or 0 for item in damage) == len(lost.messages)


_HUGE = (2**31, 2**40, 2**63 - 1, 2**64 - 1)


def _huge_files():
    """Yield files that promise more than any memory holds."""
    records = join(SCHEMA, CHANNEL, note(1))[8:-8]
    sound = chunk_of(note(2))
    for huge in _HUGE:
        for compression in ("zstd", "lz4", ""):
            chunk = chunk_of(records, compression=compression, uncompressed_size=huge, uncompressed_crc=0)
            yield join(HEADER, SCHEMA, CHANNEL, chunk, sound, *sound_end())
        for op in range(1, 20):
            yield join(HEADER, SCHEMA, CHANNEL, struct.pack("<BQ", op, huge), sound, *sound_end())
        for op in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.MESSAGE_INDEX):
            content = struct.pack("<IIII", *[min(huge, 2**32 - 1)] * 4) + bytes(60)
            yield join(HEADER, SCHEMA, CHANNEL, Piece(0, op, content), sound, *sound_end())


_FRUGAL = """
import resource, sys
from pathlib import Path
from seaclutter_cli.sources.mcap import McapSource

McapSource(Path(sys.argv[1])).close()
resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30))
for path in map(Path, sys.argv[2:]):
    source = McapSource(path)
    print(sum(hasattr(record, "sequence") for record in source.records()), len(source.damage))
"""


def test_promises_of_huge_sizes_take_neither_memory_nor_time(tmp_path):
    pytest.importorskip("resource")
    sound = tmp_path / "sound.mcap"
    sound.write_bytes(small_log("zstd"))
    paths = [tmp_path / f"{number}.mcap" for number, _ in enumerate(_huge_files())]
    for path, data in zip(paths, _huge_files(), strict=True):
        path.write_bytes(data)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", _FRUGAL, sound, *paths]
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=60)
    assert run.returncode == 0, run.stderr
    for line in run.stdout.splitlines():
        messages, damage = map(int, line.split())
        assert messages >= 1
        assert damage


LAYOUT_NAMES = st.sampled_from(list(LAYOUTS))


@st.composite
def mutations(draw):
    """Return a function that damages bytes in some places."""
    kinds = st.sampled_from(("cut", "flip", "insert", "zero", "remove", "repeat"))
    steps = draw(
        st.lists(st.tuples(kinds, st.floats(0, 1), st.integers(1, 200), st.binary(min_size=1)), min_size=1, max_size=5)
    )

    def mutate(data):
        for kind, place, size, noise in steps:
            at = round(place * len(data))
            if kind == "cut":
                data = data[:at]
            elif kind == "flip" and at < len(data):
                data = data[:at] + bytes((data[at] ^ (noise[0] or 1),)) + data[at + 1 :]
            elif kind == "insert":
                data = data[:at] + noise + data[at:]
            elif kind == "zero":
                data = data[:at] + bytes(len(data[at : at + size])) + data[at + size :]
            elif kind == "remove":
                data = data[:at] + data[at + size :]
            else:
                data = data[:at] + data[at : at + size] + data[at:]
        return data

    return mutate


@settings(max_examples=300, deadline=None)
@given(LAYOUT_NAMES, mutations())
def test_any_damage(tmp_path_factory, name, mutate):
    path = tmp_path_factory.mktemp("any") / "log.mcap"
    path.touch()
    messages, _, damage = read(path, mutate(small_log(name)))
    if messages is not None and LAYOUTS[name].crcs and LAYOUTS[name].compression:
        everything = Counter(message[1:] for place in places(name) for message in place.messages)
        assert {message[1:] for message in messages} <= set(everything)
        assert damage or len(messages) == 12


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=300), st.sampled_from((b"", MAGIC)))
def test_any_bytes(tmp_path_factory, data, start):
    path = tmp_path_factory.mktemp("any") / "log.mcap"
    path.touch()
    read(path, start + data)
