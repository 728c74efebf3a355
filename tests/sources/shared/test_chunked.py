"""Order and memory use of logs that are read chunk by chunk."""

import threading
import time
import weakref
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seaclutter_cli.records import Channel, Message
from seaclutter_cli.sources.shared import chunked
from seaclutter_cli.sources.shared.chunked import Chunk, in_time_order

CHANNEL = Channel(1, "/any", "", None)


class Memory(bytearray):
    """Bytes of a chunk with an observable lifetime."""


class Log:
    """Log of chunks, given by the times of their messages, that counts the bytes in memory."""

    def __init__(self, chunk_times, size=10):
        self.chunks, self.times, self.size = [], {}, size
        self.alive = self.most_alive = self.unpacked = 0
        self.lock = threading.RLock()
        for number, times in enumerate(chunk_times):
            offset = 100 * number
            self.chunks.append(Chunk(offset, size, min(times, default=0), max(times, default=0)))
            self.times[offset] = times

    def unpack(self, chunk):
        memory = Memory(len(self.times[chunk.offset]) * self.size)
        with self.lock:
            self.unpacked += 1
            self.alive += len(memory)
            self.most_alive = max(self.most_alive, self.alive)
        weakref.finalize(memory, self._freed, len(memory))
        return memory

    def load(self, chunk, unpacked):
        times = self.times[chunk.offset]
        view = memoryview(unpacked())
        parts = [view[self.size * number : self.size * (number + 1)] for number in range(len(times))]
        return [
            Message(CHANNEL, time_ns, chunk.offset, number, part)
            for number, (time_ns, part) in enumerate(zip(times, parts, strict=True))
        ]

    def messages(self, chunk):
        return self.load(chunk, partial(self.unpack, chunk))

    def _freed(self, size):
        with self.lock:
            self.alive -= size


def keys(messages):
    return [(m.log_time_ns, m.publish_time_ns, m.sequence) for m in messages]


@given(st.lists(st.lists(st.integers(0, 20), max_size=6), max_size=8), st.randoms())
def test_messages_are_in_order_of_time_and_then_of_the_file(chunk_times, random):
    log = Log(chunk_times)
    chunks = random.sample(log.chunks, len(log.chunks))
    expected = sorted(keys(message for chunk in log.chunks for message in log.messages(chunk)))
    assert keys(in_time_order(chunks, log.unpack, log.load)) == expected


def test_latest_possible_time():
    log = Log([[2**64 - 1, 0], [5]])
    assert [m.log_time_ns for m in in_time_order(log.chunks, log.unpack, log.load)] == [0, 5, 2**64 - 1]


@given(st.lists(st.lists(st.integers(0, 20), max_size=6), max_size=8), st.integers(0, 4000))
def test_nothing_is_lost_when_memory_is_short(chunk_times, bound):
    log = Log(chunk_times)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunked, "MAX_WAITING_BYTES", bound)
        messages = list(in_time_order(log.chunks, log.unpack, log.load))
    assert sorted(keys(messages)) == sorted(keys(m for chunk in log.chunks for m in log.messages(chunk)))


def drain(log):
    """Return the times of a log that is read without keeping messages."""
    times = []
    for message in in_time_order(log.chunks, log.unpack, log.load):
        times.append(message.log_time_ns)
        del message
    return times


def test_memory_of_chunks_that_follow_each_other():
    log = Log([range(50 * number, 50 * number + 50) for number in range(40)], size=1000)
    assert drain(log) == list(range(2000))
    assert log.most_alive <= 5 * 50_000


def test_memory_of_chunks_that_all_overlap(monkeypatch):
    monkeypatch.setattr(chunked, "MAX_WAITING_BYTES", 500_000)
    log = Log([range(number, 2000, 40) for number in range(40)], size=1000)
    times = drain(log)
    assert sorted(times) == list(range(2000))
    assert log.most_alive <= 500_000 + 4 * 50_000


def test_a_late_message_does_not_keep_its_chunk_in_memory(monkeypatch):
    monkeypatch.setattr(chunked, "MAX_WAITING_BYTES", 500_000)
    log = Log([[*range(50 * number, 50 * number + 50), 10**9 + number] for number in range(200)], size=1000)
    times = drain(log)
    assert times == sorted(times)
    assert log.most_alive <= 500_000 + 4 * 51_000


def test_reads_two_chunks_ahead_and_no_more():
    log = Log([[number] for number in range(20)])
    messages = in_time_order(log.chunks, log.unpack, log.load)
    for number in range(10):
        assert next(messages).log_time_ns == number
        assert log.unpacked <= number + 4
    messages.close()
    assert log.unpacked <= 14


@pytest.mark.parametrize("step", ["unpack", "load"])
def test_an_error_in_another_thread_is_raised(step):
    def fails(*_):
        raise RuntimeError("broken step")

    log = Log([[number] for number in range(5)])
    steps = {"unpack": log.unpack, "load": log.load, step: fails}
    with pytest.raises(RuntimeError, match="broken step"):
        list(in_time_order(log.chunks, **steps))


def test_chunks_are_loaded_in_order():
    """Later chunks wait for a chunk that takes long to unpack."""
    log = Log([[number] for number in range(8)])
    order = []

    def unpack(chunk):
        time.sleep(0.02 if chunk.offset % 200 == 0 else 0)
        return log.unpack(chunk)

    def load(chunk, unpacked):
        unpacked()
        order.append(chunk.offset)
        return []

    assert not list(in_time_order(log.chunks, unpack, load))
    assert order == [chunk.offset for chunk in log.chunks]
