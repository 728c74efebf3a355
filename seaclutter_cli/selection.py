"""Selection of a part of a recording: topics, times, numbers of frames."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from seaclutter_cli.errors import InputError, UsageError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import diagnostics, find_codec
from seaclutter_cli.records import Channel, Message

_NANO = 1_000_000_000


@dataclass(frozen=True, kw_only=True)
class Selection:
    """The part of a recording to process.

    Parameters
    ----------
    topics : collection of str
        Topics of clouds; empty selects the only one.
    start_s, end_s : float or None
        Seconds from the start of the recording; the end is exclusive.
    frames : int or None
        Maximum number of frames per topic, from the start of the selection.
    intensity_field : str or None
        Name of the intensity field; None selects a usual one.
    """

    topics: Collection[str] = ()
    start_s: float | None = None
    end_s: float | None = None
    frames: int | None = None
    intensity_field: str | None = None

    @property
    def is_whole(self) -> bool:
        """Whether the selected topics are read from the first frame to the last."""
        return self.start_s is None and self.end_s is None and self.frames is None


def cloud_channels(source: Source, topics: Collection[str] = ()) -> list[Channel]:
    """Return the channels of the selected cloud topics.

    Raises
    ------
    InputError
        If the recording contains no point clouds.
    UsageError
        If a topic is missing or has no clouds, or if there are several cloud topics and none was selected.
    """
    clouds = [channel for channel in source.channels if find_codec(channel)]
    names = list(dict.fromkeys(channel.topic for channel in clouds))
    if not names:
        found = ", ".join(sorted({_describe(channel) for channel in source.channels})) or "no topics"
        raise InputError(f"{source.name}: no point clouds that can be read; the log has {found}")
    if not topics and len(names) > 1:
        choices = " ".join(f"-t {name}" for name in names)
        raise UsageError(f"{source.name}: several point-cloud topics; choose from: {choices}")
    for topic in topics:
        if topic not in names:
            choices = " ".join(f"-t {name}" for name in names)
            raise UsageError(f"{source.name}: no point-cloud topic {topic}; choose from: {choices}")
    return [channel for channel in clouds if not topics or channel.topic in topics]


def was_filtered(source: Source, topics: Collection[str] = ()) -> bool:
    """Return whether the selected cloud topics, by default all, contain only filtered clouds of an earlier run."""
    names = {channel.topic for channel in source.channels}
    clouds = topics or [channel.topic for channel in source.channels if find_codec(channel)]
    return diagnostics.TOPIC in names and not any(f"{topic}/filtered" in names for topic in clouds)


def _describe(channel: Channel) -> str:
    kind = channel.schema.name if channel.schema else "no schema"
    return f"{channel.topic} ({kind}, {channel.message_encoding})"


class Window:
    """Counter of the frames of a recording, which decides which records are selected.

    ``start_ns`` and ``end_ns`` are log times outside which nothing is selected; None without a bound.
    """

    def __init__(self, source: Source, clouds: Sequence[Channel], selection: Selection) -> None:
        self._selection = selection
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        topics = {channel.topic for channel in clouds}
        self._index = dict.fromkeys(topics, -1)
        self._selected = dict.fromkeys(topics, 0)
        if selection.start_s is not None or selection.end_s is not None:
            self._begin(source, clouds)

    def _begin(self, source: Source, clouds: Sequence[Channel]) -> None:
        """Find the bounds in log time and the index of the first frame of each topic within them."""
        self._first_ns = first_ns = _first_log_time(source)
        # A float of seconds may be off by less than a nanosecond; `contains` decides.
        if self._selection.start_s is not None:
            self.start_ns = first_ns + math.floor(self._selection.start_s * _NANO) - 1
            skipped = source.skipped(self.start_ns)
            for channel in clouds:
                self._index[channel.topic] += skipped.get(channel.id, 0)
        if self._selection.end_s is not None:
            self.end_ns = first_ns + math.ceil(self._selection.end_s * _NANO) + 1

    def count(self, message: Message) -> int:
        """Return the index of the next cloud message within its topic."""
        self._index[message.channel.topic] += 1
        return self._index[message.channel.topic]

    def count_selected(self, message: Message) -> None:
        """Count a selected frame."""
        self._selected[message.channel.topic] += 1

    @property
    def closed(self) -> bool:
        """Whether all topics have their maximum number of frames, which ends the selection."""
        frames = self._selection.frames
        return frames is not None and bool(self._selected) and all(count >= frames for count in self._selected.values())

    def contains(self, message: Message) -> bool:
        """Return whether a message is selected."""
        start, end, frames = self._selection.start_s, self._selection.end_s, self._selection.frames
        if start is not None or end is not None:
            seconds = (message.log_time_ns - self._first_ns) / _NANO
            if (start is not None and seconds < start) or (end is not None and seconds >= end):
                return False
        return frames is None or self._selected.get(message.channel.topic, -1) < frames


def _first_log_time(source: Source) -> int:
    """Return the log time of the first message of a recording; 0 if there is none."""
    damage = list(source.damage)
    records = source.records()
    first_ns = next((record.log_time_ns for record in records if isinstance(record, Message)), 0)
    del records  # closes the generator, which may report damage
    source.damage[:] = damage  # reading reports it again
    return first_ns
