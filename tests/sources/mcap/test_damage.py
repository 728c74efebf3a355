"""MCAP files with truncated, flipped, zeroed, missing or additional bytes."""

import random
import time
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode

from seaclutter_cli.records import Message
from seaclutter_cli.sources.mcap import records
from seaclutter_cli.sources.mcap.source import McapSource
from seaclutter_cli.sources.shared import chunked
from seaclutter_cli.text import count
from tests.logs import LAYOUTS, MAGIC, join, records_of
from tests.pairs import turns
from tests.sources.damaged import MOST_SECONDS, damage_texts, flip, message_blocks, read, small_log

SMALL = ("zstd", "lz4", "none", "unchunked", "no summary", "bare", "unchunked, bare", "no message index", "no index")


TURNS = 12
"""Each test takes a twelfth of all offsets, another one for each layout, as these resemble each other."""


def offsets(name, size, turn):
    return range((SMALL.index(name) + turn) % TURNS, size, TURNS)


@pytest.fixture
def path(tmp_path, monkeypatch):
    """Return the path of a log that is written thousands of times, and read without threads, which is faster."""

    def at_once(chunks, unpack, load):
        return ((chunk, load(chunk, partial(unpack, chunk))) for chunk in chunks)

    monkeypatch.setattr(chunked, "_ahead", at_once)
    path = tmp_path / "log.mcap"
    path.touch()
    return path


@turns(TURNS)
@pytest.mark.parametrize("name", SMALL)
def test_cut_at_every_byte(path, name, turn):
    data = small_log(name)
    whole, extras, damage = read(path, data)
    assert (len(whole), extras, damage) == (12, ["file", "vessel"], [])
    ends = [piece.end for piece in records_of(data) if piece.op in (Opcode.ATTACHMENT, Opcode.METADATA)]
    for size in offsets(name, len(data), turn):
        messages, extras, damage = read(path, data[:size])
        expected = [message for block in message_blocks(name) if block.end <= size for message in block.messages]
        if messages is None:
            assert not expected
            assert size < ends[0]
            continue
        assert damage
        assert len(extras) == sum(end <= size for end in ends)
        # A truncated chunk may give more messages.
        assert messages[: len(expected)] == expected
        assert messages == whole[: len(messages)]
        if name in ("none", "bare"):
            assert len(messages) == _uncompressed_messages(data[:size])


def _uncompressed_messages(data):
    """Return the number of messages that a truncated file contains completely."""
    return sum(message[-1] in data for block in message_blocks("none") for message in block.messages)


def declares(name, at):
    """Return whether a log without a summary declares its channels at an offset."""
    if LAYOUTS[name].summary:
        return False
    first = message_blocks(name)[0]
    return at < (first.end if LAYOUTS[name].chunked else first.start)


@turns(TURNS)
@pytest.mark.parametrize("name", SMALL)
def test_a_byte_flipped_at_every_offset(path, name, turn):
    data, noise = small_log(name), random.Random(1)
    everything = {message for block in message_blocks(name) for message in block.messages}
    for at in offsets(name, len(data), turn):
        flipped = bytearray(data)
        flipped[at] ^= noise.choice((1, 2, 4, 8, 16, 32, 64, 128, 255))
        messages, extras, damage = read(path, bytes(flipped))
        hit = next((block for block in message_blocks(name) if block.start <= at < block.end), None)
        untouched = [message for block in message_blocks(name) if block is not hit for message in block.messages]
        kept = [message for message in messages if message in everything]
        if not declares(name, at):
            assert [message for message in kept if not hit or message not in hit.messages] == untouched, at
        # Outside chunks, only the statistics protect the messages.
        if (len(kept) < 12 and LAYOUTS[name].crcs and LAYOUTS[name].chunked) or (
            len(extras) < 2 and LAYOUTS[name].summary
        ):
            assert damage, at
        if LAYOUTS[name].crcs and LAYOUTS[name].chunked and not declares(name, at):
            assert kept == messages, at
        times = [message[1] for message in messages]
        assert times == sorted(times) or not LAYOUTS[name].message_index, at


@turns(TURNS)
@pytest.mark.parametrize("name", ["zstd", "unchunked"])
@pytest.mark.parametrize("kind", ["missing", "added"])
def test_a_byte_missing_or_added_at_every_offset(path, name, kind, turn):
    data = small_log(name)
    for at in offsets(name, len(data), turn):
        messages, extras, damage = read(
            path, data[:at] + (data[at + 1 :] if kind == "missing" else b"\xa5" + data[at:])
        )
        hit = [block for block in message_blocks(name) if block.start < at + (kind == "missing") and at < block.end]
        untouched = [message for block in message_blocks(name) if block not in hit for message in block.messages]
        assert [message for message in messages if message in untouched] == untouched, at
        assert len(messages) <= 12
        assert extras
        assert damage


@pytest.mark.parametrize("name", ["zstd", "lz4", "none"])
def test_a_damaged_chunk_is_left_out_and_reported(path, name):
    whole, *_ = read(path, small_log(name))
    for block in message_blocks(name):
        for at in range(block.start + 60, block.end, 7):
            messages, extras, damage = read(path, flip(small_log(name), at))
            if messages == whole and name == "lz4":
                continue  # some bits of the frame have no meaning
            assert messages == [message for message in whole if message not in block.messages]
            assert extras == ["file", "vessel"]
            (item,) = damage
            assert (item.offset, item.lost_bytes) == (block.start, block.end - block.start)
            assert item.lost_messages == len(block.messages)
            kinds = ("fails its checksum", "cannot be decompressed", "does not have the declared")
            assert item.problem.startswith(tuple(f"the chunk {kind}" for kind in kinds))


def test_two_damaged_chunks(path):
    first, second = message_blocks("zstd")[1], message_blocks("zstd")[3]
    messages, _, damage = read(path, flip(flip(small_log("zstd"), first.end - 1), second.end - 1))
    assert [item.offset for item in damage] == [first.start, second.start]
    kept = [block for block in message_blocks("zstd") if block not in (first, second)]
    assert messages == [message for block in kept for message in block.messages]


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
        assert sum(item.lost_bytes for item in damage if item.problem == "damaged bytes between records") == len(
            garbage
        )


@pytest.mark.parametrize("name", ["zstd", "none", "unchunked"])
def test_zeros_at_the_end_after_a_crash(path, name):
    data = small_log(name)
    end = message_blocks(name)[2].end
    for size in (9, 1000, 50_000_000):
        with path.open("r+b") as file:
            file.write(data[:end])
            file.truncate(end)
            file.truncate(end + size)
        began = time.process_time()
        source = McapSource(path)
        messages = [record for record in source.records() if isinstance(record, Message)]
        assert time.process_time() - began < MOST_SECONDS
        assert len(messages) == sum(len(block.messages) for block in message_blocks(name)[:3])
        assert damage_texts(source.damage) == [
            f"byte {end}: no readable record follows; left out: {count(size, 'byte')}",
            f"byte {end + size}: the recording was not closed: the file has no footer",
        ]
        source.close()


def test_zeros_in_the_middle(path):
    data = small_log("none")
    whole, *_ = read(path, data)
    for start in range(0, len(data) - 300, 3):
        messages, _, damage = read(path, data[:start] + bytes(300) + data[start + 300 :])
        hit = [block for block in message_blocks("none") if block.start < start + 300 and start < block.end]
        kept = [message for block in message_blocks("none") if block not in hit for message in block.messages]
        assert [message for message in messages if message in kept] == kept
        assert damage or data[start : start + 300] == bytes(300)
        assert set(messages) <= set(whole)


def test_bytes_after_the_end_are_left_out(path):
    data = small_log("zstd")
    whole, extras, _ = read(path, data)
    for junk in (b"x", bytes(100), b"#!/bin/sh\n" * 50, data):
        assert read(path, data + junk)[:2] == (whole, extras)
        damage = read(path, data + junk)[2]
        assert damage_texts(damage) == [
            f"byte {len(data)}: bytes after the end of the recording; left out: {count(len(junk), 'byte')}"
        ]


def test_missing_beginning(path):
    data = small_log("zstd")
    for cut in range(1, message_blocks("zstd")[1].end + 1):
        messages, _, damage = read(path, data[cut:])
        kept = [block for block in message_blocks("zstd") if block.start >= cut]
        assert messages == [message for block in kept for message in block.messages]
        assert damage


@st.composite
def mutations(draw):
    """Return a function that damages bytes at some offsets."""
    kinds = st.sampled_from(("cut", "flip", "insert", "zero", "remove", "repeat"))
    steps = draw(
        st.lists(st.tuples(kinds, st.floats(0, 1), st.integers(1, 200), st.binary(min_size=1)), min_size=1, max_size=5)
    )

    def mutate(data):
        for kind, position, size, noise in steps:
            at = round(position * len(data))
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


def test_few_of_the_bytes_that_could_be_a_record_are_examined(monkeypatch):
    """Coordinates look like records of terabytes; a search among them must not take minutes."""
    examined = []
    monkeypatch.setattr(records, "_record", lambda _, at: examined.append(at))
    noise = np.random.default_rng(1).integers(0, 256, (20_000, 16), np.uint8)
    noise[:, 3], noise[:, 9:12] = 5, 0
    walker = records._Walker(noise.tobytes(), lambda *_: None)
    assert walker.next_record(0, noise.size) == noise.size
    assert len(examined) < 100


@settings(max_examples=300, deadline=None)
@given(mutations())
def test_records_of_a_chunk_are_read_in_turn_only_if_a_search_finds_the_same(mutate):
    log = small_log("unchunked, bare")
    inside = [piece for piece in records_of(log) if piece.op in records._INSIDE]
    content = join(*inside)[len(MAGIC) : -len(MAGIC)]
    assert inside
    assert records._is_chain(content)
    gaps, searched = [], []
    damaged = mutate(content)
    in_turn = list(records.split(damaged, lambda *gap: gaps.append(gap), trusted=False))
    found = [(span.op, span.start, span.end) for span in records.walk(damaged, lambda *gap: searched.append(gap))]
    assert in_turn == found
    assert gaps == searched
