"""ROS 1 bags (format 2.0): intact, unindexed, truncated or damaged."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from seaclutter_cli.errors import InputError
from seaclutter_cli.limits import CHANNEL_BYTES, above, above_in_file, limits
from seaclutter_cli.messages.carried import from_message, is_carrier
from seaclutter_cli.records import Channel, Damage, Message, Metadata, Record
from seaclutter_cli.sources.rosbag1.chunks import read_index, unpack
from seaclutter_cli.sources.rosbag1.records import MAGIC, Op, read_record, walk
from seaclutter_cli.sources.rosbag1.survey import BagSurvey, channel_of
from seaclutter_cli.sources.shared.chunked import (
    Chunk,
    before,
    fitting_messages,
    in_time_order,
    latest_of,
    most_waiting,
    span_of,
    within,
)
from seaclutter_cli.sources.shared.facts import NO_FACTS
from seaclutter_cli.sources.shared.log_file import LogFile, LostDataError
from seaclutter_cli.text import count

_COMPRESSIONS = {b"lz4": "lz4", b"bz2": "zstd", b"none": ""}
_ANY_TIME = (0, 2**63)

Content = tuple[memoryview, int, str | None]


class BagSource:
    """A ROS 1 bag as a `Source`.

    A few unpacked chunks are in memory, and a few numbers for each chunk of the file. Messages are views of their
    chunk, or of the file if it is not compressed.

    Parameters
    ----------
    path : Path
        The bag, or the ``.bag.active`` file that a crashed recorder leaves.

    Raises
    ------
    InputError
        If the file is not a bag of format 2.0, or is encrypted.
    """

    format = "ROS 1 bag"
    profile = "ros1"
    facts = NO_FACTS

    def __init__(self, path: Path) -> None:
        self.name = path.name.removesuffix(".active").removesuffix(".bag")
        self.damage: list[Damage] = []
        self.warnings: list[str] = []
        self._reported: set[Damage] = set()
        self._path = path
        self._declared_bytes = 0
        self._file = LogFile(path)
        try:
            self._read_survey()
        except BaseException:
            self.close()
            raise

    def _read_survey(self) -> None:
        start = bytes(self._file[: len(MAGIC)])
        if start != MAGIC:
            raise InputError(f"{self._path}: {_describe(start)}")
        survey = BagSurvey(self._file)
        if survey.header is not None and survey.header.fields.get(b"encryptor"):
            raise InputError(f"{self._path}: the bag is encrypted; decrypt it first (rosbag decrypt)")
        self.compression = _COMPRESSIONS.get(survey.compression) if survey.compression else None
        self.damage += survey.damage(self._path)
        self._channels = survey.channels
        self._counts = survey.counts
        self._indexed = survey.indexed
        self._chunks = list(survey.chunks.values())
        self._unpack_untimed(survey)
        self.metadata = self._read_metadata()
        """Metadata records, which this program writes to a bag as a message."""

    def _read_metadata(self) -> Sequence[Metadata]:
        """Return the metadata records in a message about them, whose channels are then hidden."""
        self._hidden: set[int] = set()
        carriers = {number for number, channel in self._channels.items() if is_carrier(channel)}
        found = [from_message(message.data) for message in self.latest(carriers, _ANY_TIME[1])] if carriers else []
        if not all(found):
            return ()
        self._hidden = carriers
        return [record for records in found for record in records]

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels known before reading, including those without messages."""
        return [channel for number, channel in self._channels.items() if number not in self._hidden]

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id."""
        return {channel: self._counts[channel] for channel in self._channels if channel not in self._hidden}

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield metadata, then the messages in log time order; can be called again.

        Chunks outside ``[start_ns, end_ns)`` are left out.
        """
        yield from self.metadata
        read = 0
        chunks = within(self._chunks, start_ns, end_ns, self._is_counted)
        for message in in_time_order(chunks, self._unpack, self._load, most_waiting(len(self._file))):
            read += 1
            if message.channel.id not in self._hidden:
                yield message
        if len(chunks) == len(self._chunks):
            self._compare(read)

    def skipped(self, start_ns: int) -> Mapping[int, int]:
        """Return the number of messages per connection that `records` leaves out before ``start_ns``."""
        counts = Counter[int]()
        for chunk in before(self._chunks, start_ns, self._is_counted):
            index = read_index(self._file, chunk.offset + chunk.size)
            counts += index.counts if index else Counter()
        return counts

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message."""
        return span_of(self._chunks)

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels; only chunks that may have it are read."""
        return latest_of(self._chunks, self._read, self._channels_in, channels, before_ns)

    def _channels_in(self, chunk: Chunk) -> Collection[int] | None:
        index = read_index(self._file, chunk.offset + chunk.size)
        return index.counts if index else None

    def _is_counted(self, chunk: Chunk) -> bool:
        """Return whether an index counts the messages of a chunk."""
        return read_index(self._file, chunk.offset + chunk.size) is not None

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _unpack_untimed(self, survey: BagSurvey) -> None:
        """Unpack the chunks where unknown channels first occur, and those with unknown times."""
        for connection, offset in survey.first_use.items():
            if connection not in self._channels and offset in survey.chunks:
                self._read(survey.chunks[offset])
        for offset, size in survey.untimed.items():
            messages = self._read(Chunk(offset, size, *_ANY_TIME))
            if messages:
                times = [message.log_time_ns for message in messages]
                unpacked = survey.unpacked.get(offset, 0)
                self._chunks.append(Chunk(offset, size, min(times), max(times), unpacked=unpacked))
                self._counts.update(message.channel.id for message in messages)

    def _read(self, chunk: Chunk) -> list[Message]:
        return self._load(chunk, partial(self._unpack, chunk))

    def _load(self, chunk: Chunk, unpacked: Callable[[], Content]) -> list[Message]:
        """Return the messages of a chunk, and report its damage."""
        try:
            return self._loaded(chunk, *unpacked())
        except LostDataError as error:
            self._report(chunk.offset, error.problem, chunk.size, None)
            return []

    def _loaded(self, chunk: Chunk, content: memoryview, size: int, problem: str | None) -> list[Message]:
        gaps: list[tuple[int, int]] = []
        messages, unknown = self._messages(content, gaps)
        most = limits().chunk_messages
        if len(messages) > most:
            del messages[most:]
            problem = f"a chunk of {above('more messages', 'chunk_messages')}"
        elif problem is None and gaps:
            problem = "damaged records in this chunk"
        elif problem is None and unknown:
            problem = "messages of an unknown connection"
        if problem is not None:
            index = read_index(self._file, chunk.offset + chunk.size)
            lost_bytes = max(size - len(content), 0) + sum(stop - start for start, stop in gaps)
            lost = index.counts.total() - len(messages) if index else unknown
            self._report(chunk.offset, problem, lost_bytes, lost if lost > 0 else None)
        elif any(not chunk.start_ns <= message.log_time_ns <= chunk.end_ns for message in messages):
            self._report(chunk.offset, "messages of this chunk are outside the times in its index", 0, None)
        fitting, large_bytes = fitting_messages(messages, len(self._file))
        if large_bytes:
            problem = f"messages of {above_in_file('more bytes', 'message', len(self._file))}"
            self._report(chunk.offset, problem, large_bytes, len(messages) - len(fitting))
        return fitting

    def _unpack(self, chunk: Chunk) -> Content:
        """Return the records of a chunk, their expected size, and a description of their damage, if any."""
        end = chunk.offset + chunk.size
        record = read_record(self._file, chunk.offset)
        if record is None or record.op != Op.CHUNK or record.data > end:
            start, op = chunk.offset, None
        else:
            start, op = record.data, record
        if end - start > limits().chunk_bytes:
            return memoryview(b""), end - start, f"a chunk of {above(count(end - start, 'byte'), 'chunk_mib')}"
        data = self._file[start:end]
        if op is None:
            return data, chunk.size, None
        whole = op._replace(end=end, repaired=op.end != end)
        content, problem = unpack(data, whole, ends_bag=end == len(self._file), bag_bytes=len(self._file))
        return content, op.number(b"size"), problem

    def _messages(self, content: memoryview, gaps: list[tuple[int, int]]) -> tuple[list[Message], int]:
        """Return the messages of a chunk, at most one above the limit, and the number of unknown messages."""
        messages: list[Message] = []
        most = limits().chunk_messages
        unknown = 0
        for record in walk(content, 0, gaps):
            if record.op == Op.MESSAGE:
                channel = self._channels.get(record.number(b"conn"))
                if channel is None:
                    unknown += 1
                    continue
                time_ns = record.time_ns()
                messages.append(Message(channel, time_ns, time_ns, 0, content[record.data : record.end]))
                if len(messages) > most:
                    break
            elif record.op == Op.CONNECTION and record.number(b"conn") not in self._channels:
                self._declared_bytes += record.end - record.data + CHANNEL_BYTES
                if self._declared_bytes > limits().message_bytes:
                    gaps.append((record.start, record.end))
                else:
                    self._channels[record.number(b"conn")] = channel_of(content, record)
        return messages, unknown

    def _compare(self, read: int) -> None:
        """Report messages that the index lists and that are neither read nor reported as lost."""
        known = sum(damage.lost_messages or 0 for damage in self.damage)
        if self._indexed is not None and self._indexed > read + known:
            problem = f"the index lists {count(self._indexed, 'message')}, but {read:,} can be read"
            self._report(None, problem, 0, self._indexed - read - known)

    def _report(self, offset: int | None, problem: str, lost_bytes: int, lost_messages: int | None) -> None:
        damage = Damage(self._path, offset, problem, lost_bytes, lost_messages)
        if damage not in self._reported:
            self._reported.add(damage)
            self.damage.append(damage)


def _describe(start: bytes) -> str:
    if MAGIC.startswith(start):
        return "the bag is truncated in its first line"
    if start.startswith(b"#ROSBAG V"):
        version = start[9:].partition(b"\n")[0].strip().decode("utf-8", "replace")
        return f"bag version {version} is not supported; convert the bag to 2.0 first (rosbag reindex)"
    return "not a ROS 1 bag"
