"""Files and folders that a log is written to, in one part or in several."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from types import TracebackType
from typing import BinaryIO, Self

from seaclutter_cli import __version__
from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Attachment, Buffer, Channel, Metadata
from seaclutter_cli.sinks.atomic import AtomicFile, Leftover, OutputGroup
from seaclutter_cli.sinks.atomic_folder import AtomicFolder
from seaclutter_cli.sinks.bag_writer import BagWriter
from seaclutter_cli.sinks.db3_writer import Db3Writer
from seaclutter_cli.sinks.log_writer import LogWriter
from seaclutter_cli.sinks.mcap_writer import McapWriter
from seaclutter_cli.sinks.options import part_path, parts_after
from seaclutter_cli.sinks.ros_writer import MessagesOnly, TranslatingWriter
from seaclutter_cli.sinks.rosbag2_metadata import NAME, Contents, StoredFile
from seaclutter_cli.storage.locations import Location

_LIBRARY = f"seaclutter {__version__}"


class LogOutput(AbstractContextManager["LogOutput"], ABC):
    """A log that appears under its name when the context exits without an error.

    Parameters
    ----------
    path : Path or Url
        Target.
    group : OutputGroup, optional
        Outputs that appear together.
    split : bool, optional
        Whether the log has several parts; their names then have numbers.
    """

    @abstractmethod
    def __init__(self, path: Location, group: OutputGroup | None = None, *, split: bool = False) -> None: ...

    @abstractmethod
    def part(self, number: int, source: Source, compression: str | None) -> LogWriter:
        """Return the writer of a part, which begins; parts before, but the first, must be finished."""

    @abstractmethod
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the log under its name, or remove it after an error."""

    def __enter__(self) -> Self:
        """Return the output."""
        return self


class _Files(LogOutput):
    """A file, or one for each part: ``NAME_0.SUFFIX`` and so on. The first one appears last."""

    def __init__(self, path: Location, group: OutputGroup | None = None, *, split: bool = False) -> None:
        self._path, self._split = path, split
        self._group = OutputGroup(group) if split else group
        self._number = 0
        self._first = self._last = self._open(0)

    def part(self, number: int, source: Source, compression: str | None) -> LogWriter:
        if number:
            if self._last is not self._first:
                self._last.__exit__(None, None, None)
            self._last, self._number = self._open(number), number
        return self._start(self._last.stream, source, compression)

    def _open(self, number: int) -> AtomicFile:
        return AtomicFile(part_path(self._path, number) if self._split else self._path, self._group)

    @abstractmethod
    def _start(self, stream: BinaryIO, source: Source, compression: str | None) -> LogWriter: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._split and kind is None and self._group is not None:
            for leftover in parts_after(self._path, self._number):
                self._group.add(Leftover(leftover))
        with ExitStack() as stack:
            if self._split and self._group is not None:
                stack.push(self._group.__exit__)
            stack.push(self._first.__exit__)
            if self._last is not self._first:
                stack.push(self._last.__exit__)
            stack.__exit__(kind, error, trace)


def mcap_compression(source: Source, given: str | None) -> str:
    """Return the compression of an MCAP file: the one that was asked for, that of the input, or zstd."""
    return given if given is not None else "zstd" if source.compression is None else source.compression


class McapOutput(_Files):
    """MCAP files, which keep everything."""

    def _start(self, stream: BinaryIO, source: Source, compression: str | None) -> LogWriter:
        compression = mcap_compression(source, compression)
        return McapWriter(stream, profile=source.profile, library=_LIBRARY, compression=compression)


class BagOutput(_Files):
    """ROS 1 bags."""

    def _start(self, stream: BinaryIO, source: Source, compression: str | None) -> LogWriter:
        if compression is None:
            compression = "" if source.compression == "" else "lz4"
        return TranslatingWriter(MessagesOnly(BagWriter(stream, compression=compression)), "ros1")


class _Rosbag2Output(LogOutput):
    """A folder with storage files and a ``metadata.yaml``."""

    storage: str
    suffix: str

    def __init__(self, path: Location, group: OutputGroup | None = None, *, split: bool = False) -> None:  # noqa: ARG002
        self._folder = AtomicFolder(path, group, last=NAME)
        self._contents = Contents(self.storage)

    def part(self, number: int, source: Source, compression: str | None) -> LogWriter:
        name = f"{self._folder.path.name}_{number}{self.suffix}"
        self._contents.files.append(StoredFile(name))
        writer = self._start(name, source, compression)
        return TranslatingWriter(_Counted(writer, self._contents, is_first=number == 0), "cdr")

    @abstractmethod
    def _start(self, name: str, source: Source, compression: str | None) -> LogWriter: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                with self._folder.open(NAME) as file:
                    file.write(self._contents.to_text().encode())
        except BaseException as failure:
            self._folder.__exit__(type(failure), failure, None)
            raise
        self._folder.__exit__(kind, error, trace)


class Rosbag2Db3Output(_Rosbag2Output):
    """ROS 2 recordings in sqlite3 files."""

    storage, suffix = "sqlite3", ".db3"

    def _start(self, name: str, source: Source, compression: str | None) -> LogWriter:  # noqa: ARG002
        return MessagesOnly(Db3Writer(self._folder.part / name, self._folder.path))


class Rosbag2McapOutput(_Rosbag2Output):
    """ROS 2 recordings in MCAP files."""

    storage, suffix = "mcap", ".mcap"

    def _start(self, name: str, source: Source, compression: str | None) -> LogWriter:
        compression = mcap_compression(source, compression)
        return _ClosingWriter(self._folder.open(name), profile="ros2", library=_LIBRARY, compression=compression)


class _ClosingWriter(McapWriter):
    """MCAP writer that closes its file at the end."""

    def finish(self) -> None:
        super().finish()
        self._stream.close()

    def abort(self) -> None:
        super().abort()
        self._stream.close()


class _Counted:
    """Writer that takes note of what a recording contains, and joins the publishers of a topic, as rosbag2 does."""

    encoding: str | None = None

    def __init__(self, writer: LogWriter, contents: Contents, *, is_first: bool) -> None:
        self._writer, self._contents, self._is_first = writer, contents, is_first
        self._ids: dict[int, int] = {}
        self._declared: dict[tuple[str, str], int] = {}

    @property
    def lost(self) -> Sequence[str]:
        return self._writer.lost

    @property
    def messages(self) -> int:
        return self._writer.messages

    @property
    def broken(self) -> Mapping[str, int]:
        return self._writer.broken

    def add_channel(self, channel: Channel) -> None:
        kind = channel.topic, channel.schema.name if channel.schema else ""
        number = self._ids[channel.id] = self._declared.setdefault(kind, channel.id)
        if number == channel.id:
            self._contents.channels[number] = channel
            self._writer.add_channel(channel)

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, data: Buffer) -> None:
        number = self._ids[channel]
        self._contents.count(number, log_time_ns)
        self._writer.write(number, log_time_ns, publish_time_ns, sequence, data)

    def attach(self, attachment: Attachment) -> None:
        self._writer.attach(attachment)

    def add_metadata(self, metadata: Metadata) -> None:
        if self._is_first:
            self._contents.metadata.append(metadata)
        self._writer.add_metadata(metadata)

    def finish(self) -> None:
        self._writer.finish()

    def abort(self) -> None:
        self._writer.abort()
