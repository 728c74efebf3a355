"""Reading logs that store messages in chunks: in time order, ahead of the consumer, in bounded memory."""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from operator import attrgetter
from typing import TypeVar

from seaclutter_cli.records import Message

MAX_WAITING_BYTES = 256 * 2**20
"""Bytes of messages that may wait for their turn; beyond it, the earliest leave though earlier ones may follow."""

_log_time = attrgetter("log_time_ns")


@dataclass(frozen=True, slots=True)
class Chunk:
    """A part of a file that is read at once: place, size, and log times of the first and last message."""

    offset: int
    size: int
    start_ns: int
    end_ns: int


C = TypeVar("C", bound=Chunk)


def in_time_order(chunks: Iterable[C], load: Callable[[C], list[Message]]) -> Iterator[Message]:
    """Yield the messages of all chunks in the order of their log time; of equal times, in the order of the file.

    Parameters
    ----------
    chunks : iterable of Chunk
        In any order.
    load : callable
        Returns the messages of a chunk. Runs in another thread, one chunk after the other, at most two chunks ahead.

    Notes
    -----
    Chunks rarely overlap in time by more than their neighbours. Where they do (a file regrouped by topic), at most
    `MAX_WAITING_BYTES` wait, and what is above it leaves early.
    """
    waiting: list[Message] = []
    for chunk, messages in _ahead(sorted(chunks, key=attrgetter("start_ns", "offset")), load):
        ready = bisect_left(waiting, chunk.start_ns, key=_log_time)
        ready = max(ready, _overflow(waiting))
        yield from waiting[:ready]
        waiting = sorted((*waiting[ready:], *messages), key=_log_time)
    yield from waiting


def _overflow(waiting: list[Message]) -> int:
    """Count the earliest messages that have to leave for the rest to fit into the bound."""
    excess = sum(len(message.data) for message in waiting) - MAX_WAITING_BYTES
    count = 0
    while excess > 0:
        excess -= len(waiting[count].data)
        count += 1
    return count


def _ahead(chunks: Iterable[C], load: Callable[[C], list[Message]]) -> Iterator[tuple[C, list[Message]]]:
    with ThreadPoolExecutor(1, thread_name_prefix="read") as pool:
        pending: deque[tuple[C, Future[list[Message]]]] = deque()
        try:
            for chunk in chunks:
                pending.append((chunk, pool.submit(load, chunk)))
                if len(pending) > 2:
                    first, future = pending.popleft()
                    yield first, future.result()
            while pending:
                first, future = pending.popleft()
                yield first, future.result()
        finally:
            pool.shutdown(cancel_futures=True)
