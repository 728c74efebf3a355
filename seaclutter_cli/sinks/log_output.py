"""Logs as outputs: the interface of their writers, and the files that they write, in one part or in several."""

from abc import ABC, abstractmethod
from collections import Counter, defaultdict, deque
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, ClassVar

from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Attachment, Buffer, Channel, Metadata
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.options import part_path, parts_after
from seaclutter_cli.text import count as counted
from seaclutter_cli.threads import executor, threads

if TYPE_CHECKING:
    from concurrent.futures import Future

_MAX_THREADS = 4


class LogWriter(ABC):
    """Writer for the records of a log: its channels by id, messages by channel, and log times of the messages.

    By default, the log has neither publish times nor attachments, and its ``metadata`` records are kept for the end.
    """

    def __init__(self) -> None:
        self.channels: dict[int, Channel] = {}
        self.counts: Counter[int] = Counter()
        self.start_ns, self.end_ns = 2**64 - 1, 0
        self.metadata: list[Metadata] = []
        self._attachments = 0
        self._has_publish_times = self._has_sequences = False

    @property
    def messages(self) -> int:
        """Number of messages written."""
        return self.counts.total()

    @property
    def lost(self) -> Sequence[str]:
        """What the log cannot keep of the records so far, in words."""
        found = {
            counted(self._attachments, "attachment"): self._attachments,
            "publish times": self._has_publish_times,
            "sequence numbers": self._has_sequences,
        }
        return [name for name, is_lost in found.items() if is_lost]

    @abstractmethod
    def add_channel(self, channel: Channel) -> None:
        """Declare a channel under its own id, before its first message."""

    @abstractmethod
    def put(self, channel: int, times_ns: tuple[int, int], sequence: int, data: Buffer) -> None:
        """Write a message of a declared channel with its log time and its publish time."""

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, data: Buffer) -> None:
        """Write a message of a declared channel, and count it."""
        self._has_publish_times |= publish_time_ns != log_time_ns
        self._has_sequences |= sequence != 0
        self.put(channel, (log_time_ns, publish_time_ns), sequence, data)
        self.counts[channel] += 1
        self.start_ns, self.end_ns = min(self.start_ns, log_time_ns), max(self.end_ns, log_time_ns)

    def attach(self, attachment: Attachment) -> None:  # noqa: ARG002
        """Write an attachment, or count it as lost."""
        self._attachments += 1

    def add_metadata(self, metadata: Metadata) -> None:
        """Write a metadata record, or keep it for the end."""
        self.metadata.append(metadata)

    @abstractmethod
    def finish(self) -> None:
        """Complete the log."""

    @abstractmethod
    def abort(self) -> None:
        """Free resources and leave the log incomplete."""


@dataclass(slots=True)
class Chunk:
    """Messages to be written, copied because a small view would keep a large input chunk in memory.

    The index has the log time of each message and its offset in the data, one after the other, by channel.
    """

    data: bytearray = field(default_factory=bytearray)
    start_ns: int = 2**64 - 1
    end_ns: int = 0
    crc: int = 0
    index: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))


class ChunkedWriter(LogWriter):
    """Writer of chunks of ``chunk_size`` bytes, which threads compress; the bytes do not depend on their number."""

    chunk_size: ClassVar[int]

    def __init__(self, stream: BinaryIO) -> None:
        super().__init__()
        self._stream, self._offset = stream, 0
        self._chunk = Chunk()
        workers = min(_MAX_THREADS, threads())
        self._pool = executor(workers, "compress")
        self._pending: deque[tuple[Chunk, Future[Buffer | bytearray]]] = deque()
        self._max_pending = workers + 1 if workers > 1 else 0

    @abstractmethod
    def compress(self, chunk: Chunk) -> Buffer | bytearray:
        """Return the compressed data of a chunk; called in other threads."""

    @abstractmethod
    def write_chunk(self, chunk: Chunk, data: Buffer | bytearray) -> None:
        """Write a chunk, given its compressed data."""

    def write_bytes(self, *parts: Buffer | bytearray) -> None:
        """Write bytes between chunks."""
        for part in parts:
            self._stream.write(part)
            self._offset += len(part)

    def add(self, channel: int, log_time_ns: int, *parts: Buffer) -> None:
        """Add a message to the current chunk."""
        chunk = self._chunk
        chunk.index[channel] += (log_time_ns, len(chunk.data))
        for part in parts:
            chunk.data += part
        chunk.start_ns, chunk.end_ns = min(chunk.start_ns, log_time_ns), max(chunk.end_ns, log_time_ns)
        if len(chunk.data) >= self.chunk_size:
            self._submit()

    def drain(self, pending: int = 0) -> None:
        """Write the chunks that are complete, but for a number of the last ones."""
        while len(self._pending) > pending:
            chunk, future = self._pending.popleft()
            self.write_chunk(chunk, future.result())

    def finish_chunks(self) -> None:
        """Write all chunks, and end the threads."""
        if self._chunk.data:
            self._submit()
        self.drain()
        self._pool.shutdown()

    def abort(self) -> None:
        """Stop the threads and leave the file incomplete."""
        self._pool.shutdown(cancel_futures=True)

    def _submit(self) -> None:
        chunk, self._chunk = self._chunk, Chunk()
        self._pending.append((chunk, self._pool.submit(self.compress, chunk)))
        self.drain(self._max_pending)


class LogOutput(AbstractContextManager["LogOutput"], ABC):
    """A log that appears when the context exits, alone or with a group; if it is split, in numbered parts."""

    encoding: str | None = None
    """Encoding of all messages in the log; None if it takes messages of any encoding."""
    joins_publishers: bool = False
    """Whether the publishers of a topic become one channel."""

    @abstractmethod
    def part(self, source: Source, compression: str | None) -> LogWriter:
        """Return the writer of the next part, which begins; parts before, but the first, must be finished."""


class LogFiles(ExitStack, LogOutput):
    """A file, or one for each part: ``NAME_0.SUFFIX`` and so on. The first one appears last."""

    def __init__(self, path: Path, group: OutputGroup | None = None, *, split: bool = False) -> None:
        super().__init__()
        self._path, self._split, self._parts = path, split, 0
        self._group = self.enter_context(OutputGroup(group))
        self.push(self._replace_leftovers)
        self._file = self.enter_context(self._open(0))  # the first one, then the current one
        self._later = self.enter_context(ExitStack())

    def part(self, source: Source, compression: str | None) -> LogWriter:
        """Return the writer of the next part, which begins; parts before, but the first, must be finished."""
        if self._parts:
            self._later.close()
            self._file = self._later.enter_context(self._open(self._parts))
        self._parts += 1
        return self.start(self._file.stream, source, compression)

    def _open(self, number: int) -> AtomicFile:
        return AtomicFile(part_path(self._path, number) if self._split else self._path, self._group)

    @staticmethod
    @abstractmethod
    def start(stream: BinaryIO, source: Source, compression: str | None) -> LogWriter:
        """Return the writer of a file, by default with the compression of the source if the format has it."""

    def _replace_leftovers(self, _: object, error: BaseException | None, __: object) -> None:
        """Let the files, if all are complete, replace further parts of an earlier run."""
        if self._split and error is None:
            self._group.replaced += parts_after(self._path, self._parts - 1)
