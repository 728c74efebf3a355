"""Processing of a recording: read frames from a source, filter them, pass the results to sinks."""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError, FieldError, InputError, UsageError
from seaclutter_cli.frame import FilterResult, Frame, Reason, Rings
from seaclutter_cli.interfaces import CloudCodec, Filter, Sink, Source
from seaclutter_cli.messages import diagnostics, find_codec
from seaclutter_cli.records import Channel, Damage, Message, Record

_NANO = 1_000_000_000
_MAX_UNFIT = 5

T = TypeVar("T")


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


def frames(source: Source, selection: Selection) -> Iterator[Frame]:
    """Yield the selected frames; see `read`, and `cloud_channels` for its errors."""
    clouds = cloud_channels(source, selection.topics)
    return (frame for _, frame in read(source, clouds, selection) if frame is not None)


def map_frames(source: Source, selection: Selection, use: Callable[[Frame], T]) -> Iterator[tuple[Frame, T]]:
    """Yield the selected frames, each with the result of a function.

    Raises
    ------
    FieldError
        If all frames of a topic lack a field that the function needs. If only some do, they are damage.
    """
    tallies: dict[str, TopicTally] = {}
    for frame in frames(source, selection):
        tally = tallies.setdefault(frame.topic, TopicTally())
        try:
            value = use(frame)
        except FieldError as error:
            _record_unfit(error, frame, tally, source)
            _report_lost(source, frame.topic, frame.index, frame.nbytes, error)
            continue
        tally.frames += 1
        yield frame, value
    for topic, tally in tallies.items():
        _require_fields(source, topic, tally)


def read(source: Source, clouds: Sequence[Channel], selection: Selection) -> Iterator[tuple[Record, Frame | None]]:
    """Yield the selected records of a source, clouds together with their frames.

    A message that is not a valid cloud is left out and added to the damage of the source. The index of a frame counts
    from the start of the recording, within its topic, even if the selection starts later.
    """
    codecs = {channel: codec for channel in clouds if (codec := find_codec(channel))}
    window = _Window(source, clouds, selection)
    for record in source.records(window.start_ns, window.end_ns):
        if not isinstance(record, Message):
            yield record, None
            continue
        codec = codecs.get(record.channel)
        if codec and window.closed:
            return
        index = window.count(record) if codec else 0
        if not window.contains(record):
            continue
        if codec is None:
            yield record, None
        elif frame := _decode(codec, record, index, source, selection.intensity_field):
            window.count_selected(record)
            yield record, frame


def _decode(codec: CloudCodec, message: Message, index: int, source: Source, intensity: str | None) -> Frame | None:
    try:
        return Frame.of_message(message, codec.decode(message.data), index, intensity)
    except CloudError as error:
        _report_lost(source, message.channel.topic, index, len(message.data), error)
        return None


def _report_lost(source: Source, topic: str, index: int, lost_bytes: int, error: Exception) -> None:
    what = f"frame {index} of {topic} is not a valid cloud ({error})"
    source.damage.append(Damage(Path(source.name), None, what, lost_bytes, 1))


class _Window:
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


@dataclass
class TopicTally:
    """Sums over the frames of one topic.

    Parameters
    ----------
    frames, points_in : int
        Filtered frames and their points.
    counts : ndarray, shape (7,), int64
        Points for each `Reason`; the first entry counts the points kept.
    rings : Rings or None
        Sums over the frames, including thresholds and corrections.
    scenes : counter of str
        Number of frames for each class of scene; empty for methods without presets.
    filter_s : float
        Seconds spent in the filter.
    unfit : list of FieldError
        Errors of the first frames, which lack a field.
    """

    frames: int = 0
    points_in: int = 0
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(Reason), np.int64))
    rings: Rings | None = None
    scenes: Counter[str] = field(default_factory=Counter)
    filter_s: float = 0.0
    unfit: list[FieldError] = field(default_factory=list)

    def add(self, result: FilterResult, seconds: float) -> None:
        """Add a frame."""
        self.frames += 1
        self.points_in += result.frame.size
        self.counts += result.counts
        self.filter_s += seconds
        if result.rings is not None:
            self.rings = result.rings if self.rings is None else self.rings + result.rings
        if result.scene is not None:
            self.scenes[result.scene] += 1


def run(
    source: Source,
    make_filter: Callable[[], Filter],
    sinks: Sequence[Sink],
    selection: Selection,
    on_frame: Callable[[FilterResult], object] = lambda _: None,
) -> dict[str, TopicTally]:
    """Filter a recording and return sums for each cloud topic; every topic has a filter of its own.

    Parameters
    ----------
    source : Source
        The recording.
    make_filter : callable
        Returns a new filter.
    sinks : sequence of Sink
        Receive every record or result, in the order of log time.
    selection : Selection
        Part to process; the rest does not reach the sinks.
    on_frame : callable, optional
        Called with the result of each frame.

    Returns
    -------
    dict of str to TopicTally
        Sums for each cloud topic.

    Raises
    ------
    FieldError
        If all frames of a topic lack a field that the method needs. If only some do, they are damage.
    """
    clouds = cloud_channels(source, selection.topics)
    filters = {channel.topic: make_filter() for channel in clouds}
    tallies = {topic: TopicTally() for topic in filters}
    _observe(source, selection, {topic: [method] for topic, method in filters.items()})
    for sink in sinks:
        sink.begin(source, clouds)
    for record, frame in read(source, clouds, selection):
        if frame is None:
            for sink in sinks:
                sink.copy(record)
            continue
        result = _step(filters[frame.topic], frame, tallies[frame.topic], source)
        if isinstance(result, FieldError):
            _report_lost(source, frame.topic, frame.index, frame.nbytes, result)
            continue
        for sink in sinks:
            sink.write(result)
        on_frame(result)
    for topic, tally in tallies.items():
        _require_fields(source, topic, tally)
    for sink in sinks:
        sink.end()
    return tallies


def run_each(
    source: Source,
    filters: Sequence[Filter],
    selection: Selection,
    on_frame: Callable[[Frame, Sequence[FilterResult | None], Sequence[float]], object],
) -> None:
    """Filter one cloud topic with several methods in one pass; each frame is decoded once.

    Parameters
    ----------
    source : Source
        The recording.
    filters : sequence of Filter
        New filters. Those that need a first pass share it.
    selection : Selection
        Part to process.
    on_frame : callable
        Called with each frame, the result of each filter (None if the filter cannot use the frame), and the seconds
        that each filter took. Coordinates and ranges, which all filters use, are computed before and not timed.
        Frames without coordinates are damage.

    Raises
    ------
    FieldError
        If all frames lack a field that one of the methods needs. If only some do, they are damage.
    UsageError
        If there are several cloud topics.
    """
    clouds = cloud_channels(source, selection.topics)
    topics = list(dict.fromkeys(channel.topic for channel in clouds))
    if len(topics) > 1:
        choices = " or ".join(f"-t {topic}" for topic in topics)
        raise UsageError(f"{source.name}: several point-cloud topics; choose one: {choices}")
    _observe(source, selection, {topics[0]: filters})
    tallies = [TopicTally() for _ in filters]
    for frame in frames(source, selection):
        try:
            _ = frame.valid
        except FieldError as error:
            _report_lost(source, frame.topic, frame.index, frame.nbytes, error)
            continue
        with suppress(FieldError):  # not every method needs intensities
            _ = frame.intensity
        before = [tally.filter_s for tally in tallies]
        results = [_step(method, frame, tally, source) for method, tally in zip(filters, tallies, strict=True)]
        unusable = next((result for result in results if isinstance(result, FieldError)), None)
        if unusable is not None:
            _report_lost(source, frame.topic, frame.index, frame.nbytes, unusable)
        seconds = [tally.filter_s - start for tally, start in zip(tallies, before, strict=True)]
        on_frame(frame, [None if isinstance(result, FieldError) else result for result in results], seconds)
    for tally in tallies:
        _require_fields(source, topics[0], tally)


def _require_fields(source: Source, topic: str, tally: TopicTally) -> None:
    """Raise `FieldError` if no frame had the fields that the method needs."""
    if tally.unfit and not tally.frames:
        raise FieldError(f"{source.name}, {topic}: {tally.unfit[0]}") from tally.unfit[0]


def _observe(source: Source, selection: Selection, filters: Mapping[str, Sequence[Filter]]) -> None:
    """Pass all frames to the filters that need a first pass."""
    waiting = {topic: [method for method in methods if method.needs_first_pass] for topic, methods in filters.items()}
    if not any(waiting.values()):
        return
    damage = list(source.damage)
    for frame in frames(source, selection):
        for method in waiting[frame.topic]:
            with suppress(FieldError):  # `step` reports it
                method.observe(frame)
    source.damage[:] = damage  # reading reports it again


def _step(method: Filter, frame: Frame, tally: TopicTally, source: Source) -> FilterResult | FieldError:
    started = perf_counter()
    try:
        result = method.step(frame)
    except FieldError as error:
        _record_unfit(error, frame, tally, source)
        return error
    tally.add(result, perf_counter() - started)
    return result


def _record_unfit(error: FieldError, frame: Frame, tally: TopicTally, source: Source) -> None:
    """Record that a frame lacks a field; raise `FieldError` if none of the first frames has it."""
    if not tally.frames:
        tally.unfit.append(error)
    if len(tally.unfit) == _MAX_UNFIT:
        _require_fields(source, frame.topic, tally)
