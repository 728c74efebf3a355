"""Reader of logs that store messages in chunks: in time order, ahead of the consumer, in bounded memory."""

from abc import abstractmethod
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from functools import partial
from heapq import heappop, heappush
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from seaclutter_cli.interfaces import Source
from seaclutter_cli.limits import above_in_file, limits
from seaclutter_cli.records import Message, Record
from seaclutter_cli.sources.shared.log_file import LogFile, LostDataError
from seaclutter_cli.sources.shared.unpacking import unpacked_file
from seaclutter_cli.threads import abandoned, executor, threads

if TYPE_CHECKING:
    from concurrent.futures import Future

MAX_WAITING_BYTES = 256 * 2**20
"""Maximum bytes of waiting messages; above it, the earliest are yielded although earlier ones may follow."""

MAX_AHEAD_BYTES = 32 * 2**20
"""Maximum bytes that are unpacked ahead of the consumer, except for a single chunk."""

_OBJECT_BYTES = 300
_WAITING_LEAST, _WAITING_RATIO = 48 * 2**20, 8
_NEVER = 2**64


@dataclass(frozen=True, slots=True)
class Chunk:
    """A part of a file that is read as a whole; ``unpacked`` size, and number of ``messages``, as far as known."""

    offset: int
    size: int
    start_ns: int
    end_ns: int
    unpacked: int = field(default=0, kw_only=True)
    messages: int = field(default=0, kw_only=True)


C = TypeVar("C", bound=Chunk)
P = TypeVar("P")

_Entry = tuple[int, int, int, Message]
"""Time of a waiting message, the offset of its chunk, and its number in the chunk, which are its place in order."""

_UNPACKERS = 2
_log_time = attrgetter("log_time_ns")


def in_time_order(
    chunks: Iterable[C],
    unpack: Callable[[C], P],
    load: Callable[[C, Callable[[], P]], list[Message]],
    most: int | None = None,
) -> Iterator[Message]:
    """Yield the messages of all chunks in log time order; messages of equal times in file order.

    ``unpack`` returns the content of a chunk, in two other threads, at most two chunks ahead. ``load`` returns the
    messages of a chunk in file order, given a function that returns its content or raises the error of unpacking; one
    chunk after another in the caller's thread. Chunks rarely overlap in time with more than their neighbours. Where
    they do (a file regrouped by topic), waiting messages above ``most`` bytes are yielded early.
    """
    most = MAX_WAITING_BYTES if most is None else most
    ordered = sorted(chunks, key=attrgetter("start_ns", "offset"))
    following = iter([*(chunk.start_ns for chunk in ordered[1:]), _NEVER])
    waiting: list[_Entry] = []
    size = 0
    for chunk, messages in _ahead(ordered, unpack, load):
        before_ns = next(following)
        if not waiting:  # as in most logs: faster than a heap
            messages.sort(key=_log_time)
            ready = bisect_left(messages, before_ns, key=_log_time)
            yield from islice(messages, ready)
            del messages[:ready]
        size += _add(waiting, chunk, messages, before_ns)
        del messages
        while waiting and (waiting[0][0] < before_ns or size > most):
            size -= _bytes_of(waiting[0][-1])
            yield heappop(waiting)[-1]


def _add(waiting: list[_Entry], chunk: Chunk, messages: list[Message], before_ns: int) -> int:
    """Add the messages of a chunk, as copies if they wait for the next one, and return their size in memory."""
    for number, message in enumerate(messages):
        waits = message.log_time_ns >= before_ns  # a view keeps the whole chunk in memory
        entry = replace(message, data=bytes(message.data)) if waits else message
        heappush(waiting, (message.log_time_ns, chunk.offset, number, entry))
    return sum(map(_bytes_of, messages))


def _bytes_of(message: Message) -> int:
    return len(message.data) + _OBJECT_BYTES


def _ahead(
    chunks: Iterable[C], unpack: Callable[[C], P], load: Callable[[C, Callable[[], P]], list[Message]]
) -> Iterator[tuple[C, list[Message]]]:
    ahead = _UNPACKERS if threads() > 1 else 0
    pending: deque[tuple[C, Future[P]]] = deque()
    with abandoned(executor(_UNPACKERS, "unpack")) as pool:
        for chunk in (*chunks, None):
            while pending and (chunk is None or len(pending) > ahead or _memory(chunk, pending) > MAX_AHEAD_BYTES):
                first, content = pending.popleft()
                yield first, load(first, content.result)
            if chunk is not None:
                pending.append((chunk, pool.submit(unpack, chunk)))


def _memory(chunk: Chunk, pending: Iterable[tuple[Chunk, object]]) -> int:
    return sum(max(one.size, one.unpacked) for one in (chunk, *(other for other, _ in pending)))


def keep_latest(
    found: dict[int, Message], messages: Iterable[Message], wanted: Collection[int], before_ns: int
) -> None:
    """Keep the last message before a time of each wanted channel, with data that outlive the source."""
    last = {
        message.channel.id: message
        for message in sorted(messages, key=_log_time)
        if message.log_time_ns < before_ns and message.channel.id in wanted
    }
    for id_, message in last.items():
        if id_ not in found or message.log_time_ns >= found[id_].log_time_ns:
            found[id_] = replace(message, data=bytes(message.data))


def in_order(found: Mapping[int, Message]) -> list[Message]:
    """Return messages by channel id as a list in log time order."""
    return sorted(found.values(), key=lambda message: (message.log_time_ns, message.channel.id))


class ChunkedSource(Source, Generic[C, P]):
    """A log in one file whose messages are in chunks of kind ``C``, with content ``P``; a few are in memory."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._chunks: list[C] = []
        self._hidden: set[int] = set()
        """Ids of channels with messages that are no messages of the recording."""
        with ExitStack() as stack:
            file = stack.enter_context(unpacked_file(path, self.damage))
            self._file = stack.enter_context(closing(LogFile(file)))
            self._open()
            self._stack = stack.pop_all()

    @abstractmethod
    def _open(self) -> None:
        """Find the chunks of the file, which is open."""

    @abstractmethod
    def _check_number(self, found: int) -> None:
        """Compare the number of messages in the file, readable or reported as lost, with the one that it states."""

    @abstractmethod
    def _indexed(self, chunk: C) -> Counter[int] | None:
        """Return the number of messages per channel according to a chunk's index; None if it does not count all."""

    @abstractmethod
    def _unpack(self, chunk: C) -> P:
        """Return the content of a chunk; runs in other threads."""

    @abstractmethod
    def _messages(self, chunk: C, unpacked: Callable[[], P]) -> list[Message]:
        """Return the messages of a chunk in file order, and report its damage, given a function that unpacks it."""

    def _load(self, chunk: C, unpacked: Callable[[], P]) -> list[Message]:
        """Return the messages of a chunk that are within the limit of a message, and report the others."""
        try:
            messages = self._messages(chunk, unpacked)
        except LostDataError as error:
            self._report(chunk.offset, error.problem, chunk.size, chunk.messages or None)
            return []
        most = limits().bytes_of("message", len(self._file))
        large = [len(message.data) for message in messages if len(message.data) > most]
        if not large:
            return messages
        problem = f"messages of {above_in_file('more bytes', 'message', len(self._file))}"
        self._report(chunk.offset, problem, sum(large), len(large))
        return [message for message in messages if len(message.data) <= most]

    def _extras(self) -> Iterable[Record]:
        """Return the metadata records and attachments."""
        return self.metadata

    def _read(self, chunk: C) -> list[Message]:
        return self._load(chunk, partial(self._unpack, chunk))

    def _before(self, chunks: Iterable[C], start_ns: int) -> list[C]:
        """Return the chunks whose messages are all earlier than a time and can be counted without reading them."""
        return [chunk for chunk in chunks if chunk.end_ns < start_ns and self._indexed(chunk) is not None]

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield metadata and attachments, then the messages of chunks with times in ``[start_ns, end_ns)``."""
        yield from self._extras()
        chosen = [chunk for chunk in self._chunks if end_ns is None or chunk.start_ns < end_ns]
        left_out = {chunk.offset for chunk in self._before(chosen, start_ns)} if start_ns is not None else set()
        chosen = [chunk for chunk in chosen if chunk.offset not in left_out]
        # A small file cannot need as much as a large one.
        most = min(MAX_WAITING_BYTES, _WAITING_LEAST + _WAITING_RATIO * len(self._file))
        found = 0
        for message in in_time_order(chosen, self._unpack, self._load, most):
            found += 1
            if message.channel.id not in self._hidden:
                yield message
        if len(chosen) == len(self._chunks):
            self._check_number(found)

    def skipped(self, start_ns: int) -> Mapping[int, int]:
        """Return the number of messages per channel id that `records` leaves out before ``start_ns``."""
        counts = Counter[int]()
        for chunk in self._before(self._chunks, start_ns):
            counts.update(self._indexed(chunk) or {})
        return counts

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message."""
        # Empty chunks have no times.
        times = [(chunk.start_ns, chunk.end_ns) for chunk in self._chunks if chunk.messages or chunk.end_ns]
        return (min(start for start, _ in times), max(end for _, end in times)) if times else None

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels; only chunks that may have it are read."""
        found: dict[int, Message] = {}
        earlier = (chunk for chunk in self._chunks if chunk.start_ns < before_ns)
        for chunk in sorted(earlier, key=lambda chunk: chunk.end_ns, reverse=True):
            wanted = {id_ for id_ in channels if id_ not in found or found[id_].log_time_ns <= chunk.end_ns}
            if not wanted:
                break
            known = self._indexed(chunk)
            if known is None or not wanted.isdisjoint(known):
                keep_latest(found, self._read(chunk), wanted, before_ns)
        return in_order(found)

    def close(self) -> None:
        """Close the file."""
        self._stack.close()

    def _report(self, offset: int | None, problem: str, lost_bytes: int, lost_messages: int | None = None) -> None:
        self.report(problem, lost_bytes, lost_messages, offset=offset, path=self._path)
