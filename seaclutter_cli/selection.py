"""Selection of a part of a recording: topics, times, numbers of frames."""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from fractions import Fraction

from seaclutter_cli.errors import InputError, SelectionError, TopicError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import diagnostics, find_codec, main_clouds
from seaclutter_cli.messages.metadata import FILTERED, RAW, REMOVED, RecordedTopic, recorded_topics
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.text import suggestion

_NANO = 1_000_000_000
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_LEAST_EPOCH_S = 1e8

Moment = float | datetime
"""Seconds from the start of a recording, or a date and time; without a time zone, UTC."""


@dataclass(frozen=True, kw_only=True)
class Selection:
    """The part of a recording to process: topics of clouds, by default the only one, and times and numbers of frames.

    The end is exclusive, ``frames`` is the maximum for each topic, from the start. ``intensity_field`` is for fields
    without a usual name. Of ``latched`` topics, beside those of `is_latched`, the last message before the start is
    selected, too. Raise `SelectionError` if the end is before the start.
    """

    topics: Collection[str] = ()
    start_s: Moment | None = None
    end_s: Moment | None = None
    frames: int | None = None
    intensity_field: str | None = None
    latched: Collection[str] = ()

    def __post_init__(self) -> None:
        """Check the order of the limits; whether a time and seconds are in order is only known with a recording."""
        start, end = self.start_s, self.end_s
        if start is None or end is None:
            return
        start, end = (_in_utc(limit) if isinstance(limit, datetime) else limit for limit in (start, end))
        if type(start) is type(end) and start > end:  # type: ignore[operator]
            raise SelectionError(f"the end, {_shown(end)}, is before the start, {_shown(start)}")

    @property
    def is_whole(self) -> bool:
        """Whether the selected topics are read from the first frame to the last."""
        return self.start_s is None and self.end_s is None and self.frames is None

    @property
    def period(self) -> str:
        """The selected period in words; empty if all times are selected."""
        start = "" if self.start_s is None else f"from {_shown(self.start_s)}"
        end = "" if self.end_s is None else f"to {_shown(self.end_s)}"
        return f"{start} {end or 'on'}" if start else f"up {end}" if end else ""


def parse_moment(text: str) -> Moment:
    """Return seconds from the start of a recording, such as 12.5, or a date from seconds since 1970 or ISO 8601.

    Numbers from 10⁸ on, which would be three years of recording, are seconds since 1970. Raise `ValueError` for all
    else.
    """
    try:
        return _moment(text)
    except (ValueError, OverflowError) as error:
        expected = "seconds from the start, a time such as 2026-05-01T12:30:00Z, or seconds since 1970"
        raise ValueError(f"expected {expected}") from error


def _moment(text: str) -> Moment:
    try:
        number = float(text)
    except ValueError:
        return _in_utc(datetime.fromisoformat(text.strip()))
    if not math.isfinite(number):
        raise ValueError(text)
    return number if abs(number) < _LEAST_EPOCH_S else _EPOCH + timedelta(microseconds=round(Fraction(text) * 10**6))


def _in_utc(time: datetime) -> datetime:
    return time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)


def _shown(moment: Moment) -> str:
    if isinstance(moment, datetime):
        return _in_utc(moment).isoformat(sep=" ").replace("+00:00", " UTC")
    return f"{moment:g} s"


def hint_of(channels: Iterable[Channel]) -> str:
    """Return what to do about channels without clouds, after a semicolon; empty if nothing is known."""
    is_dds = any(channel.schema and "::dds_::" in channel.schema.name for channel in channels)
    return "; types with names of DDS are not read: record with rosbag2" if is_dds else ""


def cloud_channels(source: Source, topics: Collection[str] = ()) -> list[Channel]:
    """Return the channels of the selected cloud topics.

    Raise `InputError` if there are no point clouds; `TopicError` if a topic is missing or has none, or if there are
    several and none was selected.
    """
    clouds = [channel for channel in source.channels if find_codec(channel)]
    names = main_topics(source)
    if not names:
        kinds = {c: c.schema.name if c.schema else "no schema" for c in source.channels}
        found = ", ".join(sorted({f"{c.topic} ({kind}, {c.message_encoding})" for c, kind in kinds.items()}))
        the_log = f"the log has {found or 'no topics'}{hint_of(source.channels)}"
        raise InputError(f"{source.name}: no point clouds that can be read; {the_log}")
    if not topics and len(names) > 1:
        choices = " ".join(f"-t {name}" for name in names)
        raise TopicError(f"{source.name}: several point-cloud topics; choose from: {choices}")
    known = {channel.topic: None for channel in clouds}
    for topic in topics:
        if topic not in known:
            choices = " ".join(f"-t {name}" for name in known)
            raise TopicError(
                f"{source.name}: no point-cloud topic {topic}; {suggestion(topic, known)}choose from: {choices}"
            )
    return [channel for channel in clouds if channel.topic in (topics or names)]


def main_topics(source: Source) -> list[str]:
    """Return the cloud topics that are meant if none is named; see `main_clouds`."""
    return list(dict.fromkeys(channel.topic for channel in main_clouds(source.channels)))


def filtered_by(source: Source, topics: Collection[str] = ()) -> str | None:
    """Return by which methods an earlier run filtered all selected cloud topics, as in " by joint"; None if it did not.

    By default, these are the topics that are meant if none is named. The text is empty if the methods are unknown.
    """
    recorded, named = recorded_topics(source.metadata), topics or main_topics(source)
    if recorded:
        if any(topic not in recorded or recorded[topic].content not in (FILTERED, REMOVED) for topic in named):
            return None
    else:
        names = {channel.topic for channel in source.channels}
        if diagnostics.TOPIC not in names or any(f"{topic}/filtered" in names for topic in named):
            return None
    methods = dict.fromkeys(name for topic in named if topic in recorded for name in recorded[topic].methods)
    return f" by {', '.join(methods)}" if methods else ""


def removed_topic(source: Source, topic: str) -> str | None:
    """Return the topic of the points that an earlier run removed from the clouds of a topic.

    None if there is none, or if several runs filtered the clouds: it has the points of one of them.
    """
    recorded = recorded_topics(source.metadata)
    if topic in recorded and sum(name != "none" for name in recorded[topic].methods) > 1:
        return None
    names = {channel.topic for channel in source.channels if find_codec(channel)}
    if topic in recorded:
        of = recorded[topic].clouds
        names &= {name for name, one in recorded.items() if (one.content, one.clouds) == (REMOVED, of)}
    else:
        names &= {f"{topic.removesuffix('/filtered')}/removed"}
    return min(names - {topic}, default=None)


def lacks_points(source: Source, topic: str) -> bool:
    """Return whether earlier runs removed points from the clouds of a topic that the log does not have any more."""
    if filtered_by(source, [topic]) is None or removed_topic(source, topic):
        return False
    return {name for one in recorded_of(source, [topic]) for name in one.methods} != {"none"}


def studied(source: Source, selection: Selection) -> Selection:
    """Return a selection for studies of one cloud topic: by default, copies that an earlier run wrote do not count."""
    names, recorded = main_topics(source), recorded_topics(source.metadata)
    content = {name: recorded[name].content if name in recorded else RAW for name in names}
    first = next((kind for kind in (RAW, FILTERED) if kind in content.values()), REMOVED)
    chosen = [name for name in names if content[name] == first]
    return selection if selection.topics or len(chosen) == len(names) else replace(selection, topics=tuple(chosen))


def every_topic(source: Source, selection: Selection) -> Selection:
    """Return a selection of all cloud topics of a recording, or of those of the selected ones that it has."""
    chosen = studied(source, selection).topics or main_topics(source)
    known = {channel.topic for channel in source.channels if find_codec(channel)}
    return replace(selection, topics=tuple(topic for topic in chosen if topic in known) or selection.topics)


def recorded_of(source: Source, topics: Collection[str] = ()) -> list[RecordedTopic]:
    """Return what a log that this program wrote says about the selected topics, by default about all."""
    recorded = recorded_topics(source.metadata)
    return [one for name, one in recorded.items() if not topics or name in topics]


class Window:
    """Counter of the frames of a recording, which decides which records are selected.

    ``start_ns`` and ``end_ns`` are log times outside which nothing is selected; None without a bound.
    """

    def __init__(self, source: Source, clouds: Sequence[Channel], selection: Selection) -> None:
        self._selection = selection
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        topics = {channel.topic for channel in clouds}
        recorded = recorded_topics(source.metadata)
        self._index = {topic: recorded[topic].first_frame - 1 if topic in recorded else -1 for topic in topics}
        self._is_numbered = source.is_numbered
        self._selected = dict.fromkeys(topics, 0)
        if selection.start_s is not None or selection.end_s is not None:
            first_ns = _first_log_time(source)
            self.start_ns, self.end_ns = _bound(selection.start_s, first_ns), _bound(selection.end_s, first_ns)
        if self.start_ns is not None and not self._is_numbered:
            skipped = source.skipped(self.start_ns)
            for channel in clouds:
                self._index[channel.topic] += skipped.get(channel.id, 0)

    def count(self, message: Message) -> int:
        """Return the index of the next cloud message within its topic."""
        topic = message.channel.topic
        if self._is_numbered:
            return self._index[topic] + 1 + message.sequence
        self._index[topic] += 1
        return self._index[topic]

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
        if self.start_ns is not None and message.log_time_ns < self.start_ns:
            return False
        if self.end_ns is not None and message.log_time_ns >= self.end_ns:
            return False
        frames = self._selection.frames
        return frames is None or self._selected.get(message.channel.topic, -1) < frames


def _bound(moment: Moment | None, first_ns: int) -> int | None:
    if moment is None or isinstance(moment, datetime):
        return None if moment is None else (_in_utc(moment) - _EPOCH) // timedelta(microseconds=1) * 1000
    return first_ns + round(moment * _NANO)


def _first_log_time(source: Source) -> int:
    """Return the log time of the first message of a recording; 0 if there is none."""
    damage = list(source.damage)
    records = source.records()
    first_ns = next((record.log_time_ns for record in records if isinstance(record, Message)), 0)
    del records  # closes the generator, which may report damage
    source.restore_damage(damage)
    return first_ns
