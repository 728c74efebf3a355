"""Recordings that consist of several files: which files form one, and reading them as one source.

Recorders begin a new file, with the next number, when one has reached a limit.
"""

import re
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Generic, TypeVar

from seaclutter_cli.errors import InputError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import main_clouds
from seaclutter_cli.records import Channel, Damage, Message, Record
from seaclutter_cli.sources.shared.chunked import in_order, keep_latest
from seaclutter_cli.text import count, duration

MAX_GAP_S = 10.0
"""Greatest time between two files of one recording in seconds."""

MAX_OVERLAP_S = 1.0
"""Greatest overlap of two files of one recording in seconds: recorders write late messages to the next file."""

_NANO = 1_000_000_000

K = TypeVar("K", Path, int)

_NUMBER, _SUFFIXES = "(0|[1-9][0-9]{0,8})", r"(?P<suffix>\.mcap|\.db3|\.bag)(\.zstd|\.active)?"
_TIME = r"_[0-9]{4}_[0-9]{2}_[0-9]{2}-[0-9]{2}_[0-9]{2}_[0-9]{2}"
_NUMBERED = [
    re.compile(rf"(?P<number>{_NUMBER})_(?P<name>.+){_TIME}{_SUFFIXES}", re.IGNORECASE),
    re.compile(rf"(?P<name>.+)_(?P<number>{_NUMBER}){_SUFFIXES}", re.IGNORECASE),
]
"""Names of numbered files: ``2_run_2026_05_01-12_30_00.mcap``, as rosbag2 names them since 2026, and ``run_2.mcap``."""


class JoinedSource(Source, Generic[K]):
    """Several sources with keys of kind ``K`` as one; each of their channels becomes one of the whole."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name
        self._known: dict[K, dict[int, Channel]] = {}
        """Channels of the whole by source and by their ids in it."""

    @abstractmethod
    def _source(self, key: K) -> Source: ...

    @abstractmethod
    def _whole(self, key: K, channel: Channel) -> Channel:
        """Return the channel of the whole for a channel of a source that is not known yet."""

    @cached_property
    def counts(self) -> dict[int, int]:
        """Messages per channel id, as far as known before reading."""
        return dict(self._sum(lambda source: source.counts))

    def skipped(self, start_ns: int) -> Mapping[int, int]:
        """Return the number of messages per channel id that `records` leaves out before ``start_ns``."""
        return self._sum(lambda source: source.skipped(start_ns))

    def _sum(self, counts_of: Callable[[Source], Mapping[int, int]]) -> Counter[int]:
        counts = Counter[int]()
        for key, channels in self._known.items():
            for channel, messages in counts_of(self._source(key)).items():
                if channel in channels:
                    counts[channels[channel].id] += messages
        return counts

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message of all sources that state them."""
        spans = [span for key in self._known if (span := self._source(key).span_ns)]
        return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else None

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels, from the last source that has one."""
        found: dict[int, Message] = {}
        for key, numbers in reversed(self._known.items()):
            wanted = [number for number, channel in numbers.items() if channel.id in set(channels) - set(found)]
            messages = self._source(key).latest(wanted, before_ns) if wanted else []
            keep_latest(found, [self._message(key, message) for message in messages], channels, before_ns)
        return in_order(found)

    def _message(self, key: K, message: Message) -> Message:
        """Return a message with its channel of the whole recording."""
        own = message.channel
        channel = self._known[key].get(own.id) or self._add(key, own)
        return message if (channel.id, channel.topic) == (own.id, own.topic) else replace(message, channel=channel)

    def _add(self, key: K, channel: Channel) -> Channel:
        self._known[key][channel.id] = whole = self._whole(key, channel)
        return whole


class SplitSource(JoinedSource[Path]):
    """Several storage files in time order as one `Source`; one file is open at a time.

    Equal channels of different files become one. ``damage`` is what is already known, ``expected`` the file that
    lists the number of messages, and this number.
    `InputError` if none of the files can be read.
    """

    def __init__(
        self,
        files: Sequence[Path],
        open_file: Callable[[Path], Source],
        *,
        name: str | None = None,
        damage: Sequence[Damage] = (),
        expected: tuple[Path, int] | None = None,
    ) -> None:
        super().__init__(name or joined_name(files))
        self.damage += damage
        self._open_file = open_file
        self._expected = expected
        self._stack = ExitStack()
        self._current: tuple[Path, Source] | None = None
        self._merged: dict[tuple[Channel, int], Channel] = {}
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
            if not self._known:
                self.format, self.profile, self.compression = source.format, source.profile, source.compression
                self.metadata = source.metadata
            self._known[file] = {}
            for channel in source.channels:
                self._add(file, channel)
            self.warn(*source.warnings)
        if not self._known:
            raise InputError("; ".join(f"{damage.path}: {damage.problem}" for damage in self.damage))

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels of all files."""
        return list(self._merged.values())

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield the records of one file after another, late messages in the file to which the recorder wrote them."""
        self.restore_damage(self.damage[: self._at_opening])
        read = 0
        for file in self._known:
            source = self._source(file)
            source.restore_damage(self._of_current)
            try:
                for record in source.records(start_ns, end_ns):
                    if isinstance(record, Message):
                        read += 1
                        yield self._message(file, record)
                    else:
                        yield record
            finally:
                self.damage += [replace(damage, path=file) for damage in source.damage]
        known = sum(damage.lost_messages or 0 for damage in self.damage)
        if start_ns is None and end_ns is None and self._expected and self._expected[1] > read + known:
            path, expected = self._expected
            problem = f"{count(expected, 'message')} listed here, but the files contain {read:,}"
            self.damage.append(Damage(path, None, problem, lost_messages=expected - read - known))

    def close(self) -> None:
        """Close the open file."""
        self._current = None
        self._stack.close()

    def _source(self, key: Path) -> Source:
        """Return the opened source of a file, and close the previous one."""
        if self._current is not None and self._current[0] == key:
            return self._current[1]
        self.close()
        source = self._stack.enter_context(closing(self._open_file(key)))
        self._current, self._of_current = (key, source), list(source.damage)
        return source

    def _whole(self, key: Path, channel: Channel) -> Channel:
        unnumbered = replace(channel, id=0)
        occurrence = sum(replace(other, id=0) == unnumbered for other in self._known[key].values())
        if (merged := self._merged.get((unnumbered, occurrence))) is None:
            taken = {other.id for other in self._merged.values()}
            merged = replace(channel, id=max(taken) + 1) if channel.id in taken else channel
            self._merged[unnumbered, occurrence] = merged
        return merged


def split_groups(files: Sequence[Path]) -> list[list[Path]]:
    """Return files in groups of equal names with consecutive numbers from 0; other files are groups of one."""
    groups: list[list[Path]] = []
    growing: dict[tuple[Path, str, str], list[Path]] = {}
    for file in sorted(files, key=lambda file: numbered(file)[1]):
        match = _match(file)
        key = (file.parent, match["name"], match["suffix"].lower()) if match else (file.parent, file.name, "")
        group = growing.get(key)
        if group is not None and len(group) == numbered(file)[1]:
            group.append(file)
            continue
        groups.append([file])
        if numbered(file)[1] == 0:
            growing[key] = groups[-1]
    order = {file: index for index, file in enumerate(files)}
    return sorted(groups, key=lambda group: order[group[0]])


def numbered(file: Path) -> tuple[str, int]:
    """Return the name of a file without its number, and the number; -1 without one."""
    match = _match(file)
    return (match["name"], int(match["number"])) if match else (file.name, -1)


def _match(file: Path) -> re.Match[str] | None:
    return next((match for pattern in _NUMBERED if (match := pattern.fullmatch(file.name))), None)


def without_time(name: str) -> str:
    """Return the name of a folder without the time that recorders append."""
    return re.sub(f"{_TIME}$", "", name)


def joined_name(files: Sequence[Path]) -> str:
    """Return the name of the recording that files form."""
    name, number = numbered(files[0])
    if len(files) > 1 and number == 0:
        return name
    return Path(files[0].name.removesuffix(".zstd").removesuffix(".active")).stem.removesuffix("_0")


@dataclass(frozen=True)
class _Content:
    """What a file says about its place in a recording: log times, and topics with their types."""

    path: Path
    span_ns: tuple[int, int]
    clouds: frozenset[tuple[str, str]]


def joined(
    files: Sequence[Path], open_file: Callable[[Path], Source], note: Callable[[str], object]
) -> list[list[Path]]:
    """Return numbered files in groups, each of which is one recording.

    A file continues a recording if it begins at the end of the file before it, and has the same cloud topics, or some
    of them. A file that cannot be opened, or has no messages, does not part a recording. ``note`` receives the reasons.
    """
    groups, last, reasons = [[files[0]]], _content(files[0], open_file), []
    for file in files[1:]:
        content = _content(file, open_file)
        reason = _difference(last, content) if last and content else None
        if reason is None:
            groups[-1].append(file)
        else:
            groups.append([file])
            reasons.append(reason)
        last = content or last
    for group in groups:
        if len(group) > 1:
            note(f"{group[0]} to {group[-1].name} are one recording; --no-join separates them")
    if reasons:
        more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
        note(f"{files[0]} to {files[-1].name} are {len(groups)} recordings: {reasons[0]}{more}; --join makes them one")
    return groups


def _content(file: Path, open_file: Callable[[Path], Source]) -> _Content | None:
    with suppress(InputError), closing(open_file(file)) as source:
        clouds = ((c.topic, c.schema.name if c.schema else "") for c in main_clouds(source.channels))
        return _Content(file, source.span_ns, frozenset(clouds)) if source.span_ns else None
    return None


def _difference(last: _Content, content: _Content) -> str | None:
    """Return why one file does not continue another; None if it does."""
    gap_s = (content.span_ns[0] - last.span_ns[1]) / _NANO
    if gap_s > MAX_GAP_S:
        return f"{content.path.name} begins {duration(gap_s)} after the end of {last.path.name}"
    middle_ns = sum(last.span_ns) / 2
    if gap_s < 0 and (gap_s < -MAX_OVERLAP_S or content.span_ns[0] <= middle_ns):
        return f"{content.path.name} begins {duration(-gap_s)} before the end of {last.path.name}"
    if not (last.clouds <= content.clouds or content.clouds <= last.clouds):
        return f"{content.path.name} has other point-cloud topics than {last.path.name}"
    return None
