"""ROS 1 bags that are unindexed, truncated or damaged."""

import bz2
import random
import struct
import tracemalloc
from collections import Counter

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from seaclutter_cli.errors import InputError
from seaclutter_cli.sources.rosbag1.records import MAGIC, Op, find_record, read_record, walk
from seaclutter_cli.sources.rosbag1.source import BagSource
from tests.pairs import turns
from tests.sources.rosbag1.bags import BZ2, COMPRESSIONS, LZ4, chunk_spans, read, reference, write_bag


@pytest.fixture
def _one_thread(monkeypatch):
    """Read the chunks of a bag that is damaged hundreds of times without further threads, which is faster."""
    monkeypatch.setenv("SEACLUTTER_THREADS", "1")


def unindexed(path):
    """Return the bytes of a bag whose recorder crashed before it wrote the index."""
    data = bytearray(path.read_bytes())
    at = data.index(b"index_pos=") + 10
    (index,) = struct.unpack_from("<Q", data, at)
    data[at : at + 8] = bytes(8)
    return bytes(data[:index])


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_unindexed_bag_is_read_and_reported(tmp_path, compression):
    path = write_bag(tmp_path / "x.bag", compression)
    active = tmp_path / "y.bag.active"
    active.write_bytes(unindexed(path))
    messages, (damage,) = read(active)
    assert messages == reference(path)
    assert "did not close" in damage.problem
    source = BagSource(active)
    assert (source.name, source.counts) == ("y", {0: 30, 1: 30})
    assert [channel.topic for channel in source.channels] == ["/points", "/imu"]


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_bag_without_any_index_is_read_in_order(tmp_path, compression):
    times = [number * 1000 for number in range(60)]
    random.Random(3).shuffle(times)
    path = write_bag(tmp_path / "x.bag", compression, times=times)
    data = unindexed(path)
    records = list(walk(memoryview(data), len(MAGIC), []))
    bare = tmp_path / "y.bag"
    bare.write_bytes(MAGIC + b"".join(data[r.start : r.end] for r in records if r.op != Op.INDEX))
    messages, (damage,) = read(bare)
    assert messages == reference(path)
    assert "did not close" in damage.problem


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_chunk_infos_replace_lost_index_records(tmp_path, compression):
    path = write_bag(tmp_path / "x.bag", compression)
    expected = reference(path)
    data = bytearray(path.read_bytes())
    for record in walk(memoryview(bytes(data)), len(MAGIC), []):
        if record.op == Op.INDEX:
            at = data.index(b"count=", record.start)
            data[at : at + 10] = b"count=\xff\xff\0\0"
    path.write_bytes(data)
    assert read(path)[0] == expected
    assert BagSource(path).counts == {0: 30, 1: 30}


def test_wrong_times_in_the_index_do_not_change_the_order(tmp_path):
    path = write_bag(tmp_path / "x.bag", LZ4)
    expected = reference(path)
    data = bytearray(path.read_bytes())
    index = [record for record in walk(memoryview(bytes(data)), len(MAGIC), []) if record.op == Op.INDEX]
    for record in index[::3]:
        data[record.data + 3] ^= 0x10
    path.write_bytes(data)
    assert read(path)[0] == expected


def check_survivors(path, expected, safe, *, changed):
    """Check that a damaged bag gives all safe messages and no invented ones, and that losses are reported."""
    messages, damage = read(path, twice=False)
    found = Counter((time, data) for time, _, data in messages)
    assert not safe - found
    if not changed:
        assert not found - expected
        assert damage
    elif len(messages) < expected.total():
        assert damage
    for entry in damage:
        assert entry.path == path
        assert ("left out" in str(entry)) == bool(entry.lost_bytes or entry.lost_messages)
    return messages, damage


def check_cut(path, whole, cut, messages, chunks):
    path.write_bytes(whole[:cut])
    safe: Counter = Counter()
    first = 0
    for _, end, count in chunks:
        if end <= cut:
            safe.update((time, data) for time, _, data in messages[first : first + count])
        first += count
    expected = Counter((time, data) for time, _, data in messages)
    return check_survivors(path, expected, safe, changed=False)


@turns(9)
@pytest.mark.usefixtures("_one_thread")
@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_cut_at_every_byte_of_the_end(tmp_path, compression, turn):
    """A ninth of the bytes, another one for each compression."""
    path = write_bag(tmp_path / "x.bag", compression, messages=14, size=150, chunk=700)
    messages, chunks, whole = reference(path), chunk_spans(path), path.read_bytes()
    cut_path = tmp_path / "cut.bag"
    start = len(whole) - 2000 + (COMPRESSIONS.index(compression) + turn) % 9
    for cut in range(start, len(whole), 9):
        check_cut(cut_path, whole, cut, messages, chunks)


@pytest.mark.parametrize("compression", [None, LZ4])
def test_complete_messages_of_a_truncated_chunk_are_read(tmp_path, compression):
    path = write_bag(tmp_path / "x.bag", compression, messages=200, size=5000, chunk=10**6)
    messages, ((offset, end, _), *_) = reference(path), chunk_spans(path)
    whole = path.read_bytes()
    found, damage = check_cut(tmp_path / "cut.bag", whole, offset + (end - offset) * 3 // 4, messages, [])
    assert 120 <= len(found) <= 150
    assert found == messages[: len(found)]
    assert any("the bag ends inside a chunk" in entry.problem and entry.lost_bytes > 200_000 for entry in damage)


def flip(data, at, bits):
    return data[:at] + bytes([data[at] ^ bits]) + data[at + 1 :]


@pytest.fixture
def intact(tmp_path, compression):
    """Return the messages, chunks and bytes of a bag, for many examples."""
    path = write_bag(tmp_path / "x.bag", compression, messages=40)
    return reference(path), chunk_spans(path), path.read_bytes()


@pytest.mark.usefixtures("_one_thread")
@pytest.mark.parametrize("compression", COMPRESSIONS)
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(where=st.floats(0, 1, exclude_max=True), bits=st.integers(1, 255))
def test_flipped_bytes_cost_at_most_their_chunk(tmp_path, intact, where, bits):
    messages, chunks, whole = intact
    at = int(where * len(whole))
    broken = tmp_path / "broken.bag"
    broken.write_bytes(flip(whole, at, bits))
    if at < len(MAGIC):
        with pytest.raises(InputError):
            read(broken)
        return
    safe: Counter = Counter()
    first = 0
    for offset, end, count in chunks:
        if not offset <= at < end:
            safe.update((time, data) for time, _, data in messages[first : first + count])
        first += count
    expected = Counter((time, data) for time, _, data in messages)
    check_survivors(broken, expected, safe, changed=True)


def test_header_of_a_chunk_destroyed(tmp_path):
    path = write_bag(tmp_path / "x.bag")
    messages, chunks, whole = reference(path), chunk_spans(path), bytearray(path.read_bytes())
    whole[chunks[1][0] : chunks[1][0] + 20] = bytes(20)
    path.write_bytes(whole)
    found, (damage,) = read(path)
    assert found == messages
    assert damage.lost_messages is None
    assert damage.lost_bytes < 100


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("length", [20, 500, 3000])
def test_losses_add_up(tmp_path, compression, length):
    path = write_bag(tmp_path / "x.bag", compression)
    messages, (_, (offset, *_), *_), whole = reference(path), chunk_spans(path), bytearray(path.read_bytes())
    whole[offset - length // 2 : offset + length // 2] = bytes(length)
    path.write_bytes(whole)
    found, damage = read(path)
    assert len(found) + sum(entry.lost_messages or 0 for entry in damage) == len(messages)


def test_lost_chunk_is_counted(tmp_path):
    path = write_bag(tmp_path / "x.bag", LZ4)
    messages, chunks, whole = reference(path), chunk_spans(path), bytearray(path.read_bytes())
    offset, end, count = chunks[1]
    whole[offset:end] = bytes(end - offset)
    path.write_bytes(whole)
    found, (damage,) = read(path)
    assert found == messages[: chunks[0][2]] + messages[chunks[0][2] + count :]
    assert (damage.offset, damage.lost_bytes, damage.lost_messages) == (offset, end - offset, count)
    assert str(end) in damage.problem


def test_damaged_content_of_a_chunk_is_counted(tmp_path):
    path = write_bag(tmp_path / "x.bag", BZ2)
    messages, chunks, whole = reference(path), chunk_spans(path), bytearray(path.read_bytes())
    offset, end, count = chunks[2]
    whole[(offset + end) // 2] ^= 0xFF
    path.write_bytes(whole)
    found, (damage,) = read(path)
    assert len(found) == len(messages) - count
    assert (damage.offset, damage.lost_messages) == (offset, count)


def test_no_size_is_trusted(tmp_path):
    path = write_bag(tmp_path / "x.bag", LZ4)
    messages, whole = reference(path), path.read_bytes()
    chunk = next(r for r in walk(memoryview(whole), len(MAGIC), []) if r.op == Op.CHUNK)
    huge = b"\xff\xff\xff\xff"
    for at in (whole.index(b"size=", chunk.start) + 5, chunk.data - 4, chunk.start):
        path.write_bytes(whole[:at] + huge + whole[at + 4 :])
        tracemalloc.start()
        found, damage = read(path)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak < 20e6
        assert damage
        assert len(found) >= len(messages) - 7


def test_decompression_bomb_takes_no_memory(tmp_path, monkeypatch):
    monkeypatch.setenv("SEACLUTTER_MAX_CHUNK_MIB", "1")
    bomb = bz2.compress(bytes(2**26))
    items = [b"op=\x05", b"compression=bz2", b"size=" + struct.pack("<I", 2**26)]
    header = b"".join(struct.pack("<I", len(item)) + item for item in items)
    path = tmp_path / "x.bag"
    path.write_bytes(MAGIC + struct.pack("<I", len(header)) + header + struct.pack("<I", len(bomb)) + bomb)
    tracemalloc.start()
    messages, damage = read(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert not messages
    assert damage
    assert peak < 16e6


def test_messages_without_a_description_are_counted(tmp_path):
    path = write_bag(tmp_path / "x.bag")
    data = path.read_bytes().replace(
        b"\t\0\0\0conn=\1\0\0\0\x0a\0\0\0topic=/imu", b"\t\0\0\0conn=\x77\0\0\0\x0a\0\0\0topic=/imu"
    )
    path.write_bytes(data)
    messages, damage = read(path)
    assert {topic for _, topic, _ in messages} == {"/points"}
    assert sum(entry.lost_messages for entry in damage) == 30


def test_records_are_found_after_garbage():
    record = b"\x26\0\0\0\x09\0\0\0conn=\1\0\0\0\x04\0\0\0op=\2\x0d\0\0\0time=\1\0\0\0\2\0\0\0\3\0\0\0abc"
    view = memoryview(b"\0op=\2 time=" * 3 + record + record)
    at = find_record(view, 0)
    assert view[at:] == record + record
    found = read_record(view, at)
    assert (found.op, found.time_ns(), bytes(view[found.data : found.end])) == (Op.MESSAGE, 1_000_000_002, b"abc")
