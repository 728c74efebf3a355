"""Recordings that consist of several files."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

from seaclutter_cli.errors import InputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.limits import limits
from seaclutter_cli.records import Channel, Damage, Message, Record
from seaclutter_cli.sources.shared.base import SourceBase
from seaclutter_cli.sources.shared.chunked import in_order, keep_latest
from seaclutter_cli.sources.shared.unpacking import unpack_file, unpack_message
from seaclutter_cli.text import count


class SplitSource(SourceBase):
    """Several storage files in time order as one `Source`; one file is open at a time.

    Equal channels of different files become one channel; different channels get different ids. The name is that of the
    first file unless one is given; ``damage`` is what is already known, ``expected`` the file that lists the number of
    messages, and this number, and ``packed_messages`` whether messages are compressed one by one. Packets are decoded
    by whoever wraps this source. `InputError` if none of the files can be read.
    """

    def __init__(
        self,
        files: Sequence[Path],
        open_file: Callable[[Path], Source],
        *,
        name: str | None = None,
        damage: Sequence[Damage] = (),
        expected: tuple[Path, int] | None = None,
        packed_messages: bool = False,
    ) -> None:
        self.name = name or Path(files[0].name.removesuffix(".zstd").removesuffix(".active")).stem.removesuffix("_0")
        super().__init__()
        self.damage += damage
        self._open_file = open_file
        self._expected = expected
        self._packed_messages = packed_messages
        self._most = limits().message_bytes_of(sum(file.stat().st_size for file in files if file.is_file()))
        self._packed_damage: dict[Path, Damage] = {}
        self._stack = ExitStack()
        self._current: tuple[Path, Source] | None = None
        self._merged: dict[tuple[Channel, int], Channel] = {}
        self._relabelled: dict[Path, dict[int, Channel]] = {}
        self._look_at(files)
        self._at_opening = len(self.damage)

    def _look_at(self, files: Sequence[Path]) -> None:
        """Open every file once for its channels and warnings."""
        for file in files:
            try:
                source = self._source(file)
            except InputError as error:
                self.damage.append(Damage(file, None, str(error).removeprefix(f"{file}: ")))
                continue
            if not self._relabelled:
                self.format, self.profile, self.compression = source.format, source.profile, source.compression
                self.metadata = source.metadata
            self._relabelled[file] = {}
            for channel in source.channels:
                self._relabel(file, channel)
            self.warn(*source.warnings)
        if not self._relabelled:
            raise InputError("; ".join(f"{damage.path}: {damage.problem}" for damage in self.damage))

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels of all files."""
        return list(self._merged.values())

    @cached_property
    def counts(self) -> dict[int, int]:
        """Messages per channel id, as far as known before reading."""
        counts: Counter[int] = Counter()
        for file, channels in self._relabelled.items():
            for channel, messages in self._source(file).counts.items():
                if channel in channels:
                    counts[channels[channel].id] += messages
        return dict(counts)

    def skipped(self, start_ns: int) -> Mapping[int, int]:
        """Return the number of messages per channel id that `records` leaves out before ``start_ns``."""
        counts = Counter[int]()
        for file, channels in self._relabelled.items():
            for channel, messages in self._source(file).skipped(start_ns).items():
                if channel in channels:
                    counts[channels[channel].id] += messages
        return counts

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield the records of one file after another; can be called again.

        Within a file, messages are in log time order. Late messages that a recorder wrote to the next file remain in
        that file.
        """
        del self.damage[self._at_opening :]
        read = 0
        for file in self._relabelled:
            source = self._source(file)
            broken = 0
            try:
                for record in source.records(start_ns, end_ns):
                    if not isinstance(record, Message):
                        yield record
                        continue
                    message = self._message(file, record)
                    if message is None:
                        broken += 1
                        continue
                    read += 1
                    yield message
            finally:
                self.damage += [self._packed_damage[file]] if file in self._packed_damage else []
                self.damage += [replace(damage, path=file) for damage in source.damage]
                if broken:
                    self.damage.append(Damage(file, None, "damaged compressed messages", lost_messages=broken))
        if start_ns is None and end_ns is None:
            self._compare(read)

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message of all files that state them."""
        spans = [span for file in self._relabelled if (span := self._source(file).span_ns)]
        return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else None

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels, from the last file that has one."""
        found: dict[int, Message] = {}
        for file, numbers in reversed(self._relabelled.items()):
            wanted = [number for number, channel in numbers.items() if channel.id in set(channels) - set(found)]
            messages = self._source(file).latest(wanted, before_ns) if wanted else []
            relabelled = [self._message(file, message) for message in messages]
            keep_latest(found, [message for message in relabelled if message], channels, before_ns)
        return in_order(found)

    def close(self) -> None:
        """Close the open file."""
        self._current = None
        self._stack.close()

    def _source(self, file: Path) -> Source:
        """Return the opened source of a file, and close the previous one."""
        if self._current is not None and self._current[0] == file:
            return self._current[1]
        self.close()
        path = file
        if file.name.lower().endswith(".mcap.zstd"):
            folder = self._stack.enter_context(TemporaryDirectory(prefix="seaclutter-"))
            path, damage = unpack_file(file, Path(folder))
            if damage is not None:
                self._packed_damage[file] = damage
        source = self._stack.enter_context(closing(self._open_file(path)))
        self._current = (file, source)
        return source

    def _message(self, file: Path, message: Message) -> Message | None:
        """Return a message with its channel of the whole recording; None if it cannot be unpacked."""
        channel = self._relabelled[file].get(message.channel.id) or self._relabel(file, message.channel)
        if channel.id == message.channel.id and not self._packed_messages:
            return message
        data = unpack_message(message.data, self._most) if self._packed_messages else message.data
        if data is None:
            return None
        return Message(channel, message.log_time_ns, message.publish_time_ns, message.sequence, data)

    def _relabel(self, file: Path, channel: Channel) -> Channel:
        """Return the channel of the whole recording that corresponds to a channel of a file."""
        known = self._relabelled[file]
        unnumbered = replace(channel, id=0)
        occurrence = sum(replace(other, id=0) == unnumbered for other in known.values())
        merged = self._merged.get((unnumbered, occurrence))
        if merged is None:
            taken = {other.id for other in self._merged.values()}
            merged = replace(channel, id=max(taken) + 1) if channel.id in taken else channel
            self._merged[unnumbered, occurrence] = merged
        known[channel.id] = merged
        return merged

    def _compare(self, read: int) -> None:
        """Report expected messages that are missing and not reported yet."""
        if self._expected is None:
            return
        path, expected = self._expected
        known = sum(damage.lost_messages or 0 for damage in self.damage)
        if expected > read + known:
            problem = f"{count(expected, 'message')} listed here, but the files contain {read:,}"
            self.damage.append(Damage(path, None, problem, lost_messages=expected - read - known))
