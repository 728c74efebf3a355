"""Logs as outputs: the interface of their writers, and the files that they write, in one part or in several."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import TYPE_CHECKING, BinaryIO, Generic, TypeVar

from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Attachment, Buffer, Channel, Metadata
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.options import part_path, parts_after
from seaclutter_cli.threads import executor, threads

if TYPE_CHECKING:
    from concurrent.futures import Future


T = TypeVar("T")
R = TypeVar("R")
_MAX_THREADS = 4


class LogWriter(ABC):
    """Writer for the records of a log."""

    encoding: str | None = None
    """Encoding of all messages in the log; None if it takes messages of any encoding."""
    messages: int = 0
    """Number of messages written."""
    broken: Mapping[str, int] = MappingProxyType({})
    """Number of messages by topic that could not be translated to the encoding."""

    @property
    def lost(self) -> Sequence[str]:
        """What the log cannot keep of the records so far, in words."""
        return ()

    @abstractmethod
    def add_channel(self, channel: Channel) -> None:
        """Declare a channel under its own id, before its first message."""

    @abstractmethod
    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, data: Buffer) -> None:
        """Write a message of a declared channel."""

    @abstractmethod
    def attach(self, attachment: Attachment) -> None:
        """Write an attachment."""

    @abstractmethod
    def add_metadata(self, metadata: Metadata) -> None:
        """Write a metadata record."""

    @abstractmethod
    def finish(self) -> None:
        """Complete the log."""

    @abstractmethod
    def abort(self) -> None:
        """Free resources and leave the log incomplete."""


class LogOutput(AbstractContextManager["LogOutput"], ABC):
    """A log that appears under its name, alone or with a group, when the context exits without an error.

    If it is ``split``, it has several parts, and their names have numbers.
    """

    @abstractmethod
    def __init__(self, path: Path, group: OutputGroup | None = None, *, split: bool = False) -> None: ...

    @abstractmethod
    def part(self, number: int, source: Source, compression: str | None) -> LogWriter:
        """Return the writer of a part, which begins; parts before, but the first, must be finished."""

    @abstractmethod
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the log under its name, or remove it after an error."""


class LogFiles(LogOutput):
    """A file, or one for each part: ``NAME_0.SUFFIX`` and so on. The first one appears last."""

    def __init__(self, path: Path, group: OutputGroup | None = None, *, split: bool = False) -> None:
        self._path, self._split = path, split
        self._group = OutputGroup(group) if split else group
        self._number = 0
        self._first = self._last = self._open(0)

    def part(self, number: int, source: Source, compression: str | None) -> LogWriter:
        """Return the writer of a part, which begins; parts before, but the first, must be finished."""
        if number:
            if self._last is not self._first:
                self._last.__exit__(None, None, None)
            self._last, self._number = self._open(number), number
        return self.start(self._last.stream, source, compression)

    def _open(self, number: int) -> AtomicFile:
        return AtomicFile(part_path(self._path, number) if self._split else self._path, self._group)

    @staticmethod
    @abstractmethod
    def start(stream: BinaryIO, source: Source, compression: str | None) -> LogWriter:
        """Return the writer of a file, by default with the compression of the source if the format has it."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the files under their names, and delete further parts of an earlier run; remove all on an error."""
        if self._split and kind is None and self._group is not None:
            for leftover in parts_after(self._path, self._number):
                self._group.replaces(leftover)
        with ExitStack() as stack:
            if self._split and self._group is not None:
                stack.push(self._group.__exit__)
            stack.push(self._first.__exit__)
            if self._last is not self._first:
                stack.push(self._last.__exit__)
            stack.__exit__(kind, error, trace)


class Compressor(Generic[T, R]):
    """Threads that compress items; ``done`` receives each item and its result, in the thread of the caller.

    The results come in the order of the items, whatever the number of threads.
    """

    def __init__(self, compress: Callable[[T], R], done: Callable[[T, R], None]) -> None:
        workers = min(_MAX_THREADS, threads())
        self._pool = executor(workers, "compress")
        self._compress, self._done = compress, done
        self._pending: deque[tuple[T, Future[R]]] = deque()
        self._max_pending = workers + 1 if workers > 1 else 0

    def submit(self, item: T) -> None:
        """Begin with an item; wait for the first one if too many are pending."""
        self._pending.append((item, self._pool.submit(self._compress, item)))
        if len(self._pending) > self._max_pending:
            self._next()

    def drain(self) -> None:
        """Wait for all items."""
        while self._pending:
            self._next()

    def finish(self) -> None:
        """Wait for all items, and end the threads."""
        self.drain()
        self._pool.shutdown()

    def abort(self) -> None:
        """End the threads without waiting for the results."""
        self._pool.shutdown(cancel_futures=True)

    def _next(self) -> None:
        item, future = self._pending.popleft()
        self._done(item, future.result())
