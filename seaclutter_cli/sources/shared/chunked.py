"""Reader of logs that store messages in chunks: in time order, ahead of the consumer, in bounded memory."""

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush, heapreplace
from operator import attrgetter
from typing import TYPE_CHECKING, TypeVar

from seaclutter_cli.limits import limits
from seaclutter_cli.records import Message
from seaclutter_cli.threads import executor, threads

if TYPE_CHECKING:
    from concurrent.futures import Future

MAX_WAITING_BYTES = 256 * 2**20
"""Maximum bytes of waiting messages; above it, the earliest are yielded although earlier ones may follow."""

MAX_AHEAD_BYTES = 32 * 2**20
"""Maximum bytes that are unpacked ahead of the consumer, except for a single chunk."""

_OBJECT_BYTES = 300
_SMALL_BYTES = 16 * 2**10
_WAITING_LEAST, _WAITING_RATIO = 48 * 2**20, 8
_NEVER = 2**64

_log_time = attrgetter("log_time_ns")


@dataclass(frozen=True, slots=True)
class Chunk:
    """A part of a file that is read as a whole: offset, size, and log times of the first and last message.

    ``unpacked`` is its size in memory as far as declared; 0 if it is not compressed.
    """

    offset: int
    size: int
    start_ns: int
    end_ns: int
    unpacked: int = field(default=0, kw_only=True)


C = TypeVar("C", bound=Chunk)


def before(chunks: Iterable[C], start_ns: int, is_counted: Callable[[C], bool]) -> list[C]:
    """Return the chunks whose messages are all earlier than ``start_ns`` and can be counted without reading them."""
    return [chunk for chunk in chunks if chunk.end_ns < start_ns and is_counted(chunk)]


def within(chunks: Iterable[C], start_ns: int | None, end_ns: int | None, is_counted: Callable[[C], bool]) -> list[C]:
    """Return the chunks to read for a time range: all but those of `before` and those from ``end_ns`` on."""
    chosen = [chunk for chunk in chunks if end_ns is None or chunk.start_ns < end_ns]
    left_out = {chunk.offset for chunk in before(chosen, start_ns, is_counted)} if start_ns is not None else set()
    return [chunk for chunk in chosen if chunk.offset not in left_out]


def fitting_messages(messages: list[Message], file_bytes: int) -> tuple[list[Message], int]:
    """Return the messages within the limit of a message of a file, and the number of bytes of the others."""
    most = limits().message_bytes_of(file_bytes)
    large = [len(message.data) for message in messages if len(message.data) > most]
    return [message for message in messages if len(message.data) <= most] if large else messages, sum(large)


P = TypeVar("P")

_UNPACKERS = 2


def most_waiting(packed_bytes: int) -> int:
    """Return the maximum bytes of waiting messages of a file; less for a small one, which cannot need it."""
    return min(MAX_WAITING_BYTES, _WAITING_LEAST + _WAITING_RATIO * packed_bytes)


def in_time_order(
    chunks: Iterable[C],
    unpack: Callable[[C], P],
    load: Callable[[C, Callable[[], P]], list[Message]],
    most: int | None = None,
) -> Iterator[Message]:
    """Yield the messages of all chunks in log time order; messages of equal times in file order.

    Parameters
    ----------
    chunks : iterable of Chunk
        In any order.
    unpack : callable
        Returns the content of a chunk. Runs in two other threads, at most two chunks ahead.
    load : callable
        Returns the messages of a chunk in file order. Its arguments are the chunk, and a function that returns the
        unpacked content or raises the error of unpacking. Runs in the caller's thread, one chunk after another.
    most : int, optional
        Maximum bytes of waiting messages; `MAX_WAITING_BYTES` if not given.

    Notes
    -----
    Chunks rarely overlap in time with more than their neighbours. Where they do (a file regrouped by topic), messages
    above the limit of waiting messages are yielded early.
    """
    most = MAX_WAITING_BYTES if most is None else most
    waiting = _Waiting()
    for chunk, messages in _ahead(sorted(chunks, key=attrgetter("start_ns", "offset")), unpack, load):
        yield from waiting.before(chunk.start_ns)
        waiting.add(chunk, messages)
        if waiting.size > most:
            waiting.compact()
        while waiting.size > most:
            yield waiting.pop(compact=True)
    yield from waiting.before(_NEVER)


class _Run:
    """Waiting messages of a chunk, the next one last; they keep the whole chunk in memory until they are copied."""

    def __init__(self, messages: list[Message]) -> None:
        self.messages = sorted(messages, key=_log_time)
        self.messages.reverse()
        self.size = _bytes_of(messages)
        data = messages[0].data
        # A large chunk may contain little besides data that nobody needs.
        kept = memoryview(data.obj).nbytes if isinstance(data, memoryview) else 0
        self._loaded = max(self.size, kept if kept > _SMALL_BYTES else 0)
        if 2 * self.size <= self._loaded:
            self.compact()

    def compact(self) -> int:
        """Release the chunk if at most half of its bytes still wait; return the number of freed bytes."""
        before, waiting = self.size, _bytes_of(self.messages)
        if 2 * waiting > self._loaded:
            return 0
        self.messages = [replace(message, data=bytes(message.data)) for message in self.messages]
        self.size = self._loaded = waiting
        return before - waiting


class _Waiting:
    """Waiting messages of several chunks."""

    def __init__(self) -> None:
        self.size = 0
        self._heap: list[tuple[int, int, int, _Run]] = []
        self._added = 0

    def add(self, chunk: Chunk, messages: list[Message]) -> None:
        """Add the messages of a chunk."""
        if messages:
            run = _Run(messages)
            self.size += run.size
            self._added += 1
            heappush(self._heap, (run.messages[-1].log_time_ns, chunk.offset, self._added, run))

    def before(self, time_ns: int) -> Iterator[Message]:
        """Yield the messages before a time."""
        heap = self._heap
        while heap and heap[0][0] < time_ns:
            messages = heap[0][-1].messages
            while len(heap) == 1 and len(messages) > 1 and messages[-2].log_time_ns < time_ns:
                yield messages.pop()  # the usual case: no other chunk waits
            yield self.pop()

    def pop(self, *, compact: bool = False) -> Message:
        """Return the next message; with ``compact``, release its chunk if it has few waiting messages."""
        _, offset, number, run = self._heap[0]
        message = run.messages.pop()
        if not run.messages:
            heappop(self._heap)
            self.size -= run.size
            return message
        if compact:
            self.size -= run.compact()
        heapreplace(self._heap, (run.messages[-1].log_time_ns, offset, number, run))
        return message

    def compact(self) -> None:
        """Release the chunks that have few waiting messages."""
        self.size -= sum(run.compact() for *_, run in self._heap)


def _bytes_of(messages: Sequence[Message]) -> int:
    return sum([len(message.data) for message in messages]) + len(messages) * _OBJECT_BYTES


def _ahead(
    chunks: Iterable[C], unpack: Callable[[C], P], load: Callable[[C, Callable[[], P]], list[Message]]
) -> Iterator[tuple[C, list[Message]]]:
    ahead = _UNPACKERS if threads() > 1 else 0
    with executor(_UNPACKERS, "unpack") as pool:
        pending: deque[tuple[C, Future[P]]] = deque()
        try:
            for chunk in chunks:
                while pending and _memory(chunk, *(other for other, _ in pending)) > MAX_AHEAD_BYTES:
                    first, content = pending.popleft()
                    yield first, load(first, content.result)
                pending.append((chunk, pool.submit(unpack, chunk)))
                if len(pending) > ahead:
                    first, content = pending.popleft()
                    yield first, load(first, content.result)
            while pending:
                first, content = pending.popleft()
                yield first, load(first, content.result)
        finally:
            pool.shutdown(cancel_futures=True)


def _memory(*chunks: Chunk) -> int:
    return sum(max(chunk.size, chunk.unpacked) for chunk in chunks)


def span_of(chunks: Iterable[Chunk]) -> tuple[int, int] | None:
    """Return the log times of the first and the last message of chunks; None without chunks."""
    times = [(chunk.start_ns, chunk.end_ns) for chunk in chunks]
    return (min(start for start, _ in times), max(end for _, end in times)) if times else None


def latest_of(
    chunks: Iterable[C],
    read: Callable[[C], Sequence[Message]],
    channels_in: Callable[[C], Collection[int] | None],
    channels: Collection[int],
    before_ns: int,
) -> list[Message]:
    """Return the last message before a time of each of some channels, in log time order.

    Parameters
    ----------
    chunks : iterable of Chunk
        All chunks, in any order.
    read : callable
        Returns the messages of a chunk.
    channels_in : callable
        Returns the ids of the channels in a chunk; None if they are unknown.
    channels : collection of int
        Wanted channels.
    before_ns : int
        Log time.
    """
    found: dict[int, Message] = {}
    earlier = (chunk for chunk in chunks if chunk.start_ns < before_ns)
    for chunk in sorted(earlier, key=lambda chunk: chunk.end_ns, reverse=True):
        wanted = {id_ for id_ in channels if id_ not in found or found[id_].log_time_ns <= chunk.end_ns}
        if not wanted:
            break
        known = channels_in(chunk)
        if known is None or not wanted.isdisjoint(known):
            keep_latest(found, read(chunk), wanted, before_ns)
    return in_order(found)


def keep_latest(
    found: dict[int, Message], messages: Iterable[Message], wanted: Collection[int], before_ns: int
) -> None:
    """Keep the last message before a time of each wanted channel, with data that outlive the source."""
    last = {
        message.channel.id: message
        for message in sorted(messages, key=lambda message: message.log_time_ns)
        if message.log_time_ns < before_ns and message.channel.id in wanted
    }
    for id_, message in last.items():
        if id_ not in found or message.log_time_ns >= found[id_].log_time_ns:
            found[id_] = replace(message, data=bytes(message.data))


def in_order(found: Mapping[int, Message]) -> list[Message]:
    """Return messages by channel id as a list in log time order."""
    return sorted(found.values(), key=lambda message: (message.log_time_ns, message.channel.id))
