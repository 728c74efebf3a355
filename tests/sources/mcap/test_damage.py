"""MCAP files that are cut, flipped, filled with zeros, or bytes of which are missing or too many."""

import random
import time
from collections import Counter
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode

from seaclutter_cli.records import Message
from seaclutter_cli.sources.mcap.source import McapSource
from seaclutter_cli.sources.shared import chunked
from tests.logs import LAYOUTS, MAGIC, records_of
from tests.sources.damaged import MOST_SECONDS, flip, places, read, said, small_log

SMALL = ("zstd", "lz4", "none", "unchunked", "no summary", "bare", "unchunked, bare", "no message index", "no index")


@pytest.fixture
def path(tmp_path, monkeypatch):
    """Return the path of a log that is written thousands of times, and read without a thread, which takes longer."""

    def at_once(chunks, unpack, load):
        return ((chunk, load(chunk, partial(unpack, chunk))) for chunk in chunks)

    monkeypatch.setattr(chunked, "_ahead", at_once)
    path = tmp_path / "log.mcap"
    path.touch()
    return path


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


@pytest.mark.parametrize("name", ["zstd", "unchunked"])
@pytest.mark.parametrize("kind", ["missing", "more"])
def test_a_byte_missing_or_more_at_every_place(path, name, kind):
    data = small_log(name)
    for at in range(len(data)):
        messages, extras, damage = read(
            path, data[:at] + (data[at + 1 :] if kind == "missing" else b"\xa5" + data[at:])
        )
        hit = [place for place in places(name) if place.start < at + (kind == "missing") and at < place.end]
        untouched = [message for place in places(name) if place not in hit for message in place.messages]
        assert [message for message in messages if message in untouched] == untouched, at
        assert len(messages) <= 12
        assert extras
        assert damage


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
