"""Processing of a recording: read frames from a source, filter them, pass the results to sinks."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import (
    CloudError,
    FieldError,
    MissingExtraError,
    SeaclutterError,
    UnsupportedCloudError,
    UsageError,
)
from seaclutter_cli.frame import WATER_COLUMNS, FilterResult, Frame, Reason, Rings, WaterState
from seaclutter_cli.holding import HeldFrame, HeldRecord, RecordHolder
from seaclutter_cli.interfaces import Filter, Sink, Source
from seaclutter_cli.latched import latched_before
from seaclutter_cli.messages import find_codec
from seaclutter_cli.records import Channel, Damage, Message, Record
from seaclutter_cli.selection import Selection, Window, cloud_channels

_MAX_UNFIT = 5

T = TypeVar("T")


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


def read(
    source: Source,
    clouds: Sequence[Channel],
    selection: Selection,
    *,
    with_latched: bool = False,
    unreadable: dict[str, str] | None = None,
) -> Iterator[tuple[Record, Frame | None]]:
    """Yield the selected records of a source, clouds together with their frames.

    A message that is not a valid cloud is left out and added to the damage of the source. The index of a frame counts
    from the start of the recording, within its topic, even if the selection starts later. If it does, the last messages
    before it on latched topics come first, if ``with_latched``.

    Raises
    ------
    UnsupportedCloudError
        If the clouds of a topic are stored in a form that cannot be read. With ``unreadable``, the reason is stored
        there by topic instead, and the topic yields no frames.
    MissingExtraError
        Likewise if they need an extra that is not installed.
    """
    decoder = _Decoder(source, clouds, selection.intensity_field, unreadable)
    window = Window(source, clouds, selection)
    if with_latched and window.start_ns is not None:
        yield from ((message, None) for message in latched_before(source, window.start_ns, selection.latched))
    for record in source.records(window.start_ns, window.end_ns):
        if not isinstance(record, Message):
            yield record, None
            continue
        is_cloud = record.channel in decoder.codecs
        if is_cloud and window.closed:
            return
        index = window.count(record) if is_cloud else 0
        if not window.contains(record):
            continue
        for frame in decoder.frames(record, index) if is_cloud else (None,):
            if frame is not None:
                window.count_selected(record)
            yield record, frame


class _Decoder:
    """Decoder of the messages of cloud topics; see `read`."""

    def __init__(
        self, source: Source, clouds: Sequence[Channel], intensity: str | None, unreadable: dict[str, str] | None
    ) -> None:
        self.codecs = {channel: codec for channel in clouds if (codec := find_codec(channel))}
        self._source, self._intensity, self._unreadable = source, intensity, unreadable

    def frames(self, message: Message, index: int) -> Iterator[Frame | None]:
        """Yield the frame of a message; None if clouds of its topic cannot be read, nothing if it is damaged."""
        topic = message.channel.topic
        if self._unreadable and topic in self._unreadable:
            yield None
            return
        try:
            cloud = self.codecs[message.channel].decode(message.data)
        except (UnsupportedCloudError, MissingExtraError) as error:
            if self._unreadable is None:
                raise _of_topic(error, self._source, topic) from error
            self._unreadable[topic] = str(_of_topic(error, self._source, topic))
            yield None
        except CloudError as error:
            _report_lost(self._source, topic, index, len(message.data), error)
        else:
            yield Frame.of_message(message, cloud, index, self._intensity)


def _of_topic(error: SeaclutterError, source: Source, topic: str) -> SeaclutterError:
    if isinstance(error, UnsupportedCloudError):
        return UnsupportedCloudError(f"{source.name}, {topic}: {error}")
    return error


def _report_lost(source: Source, topic: str, index: int, lost_bytes: int, error: Exception) -> None:
    problem = f"frame {index} of {topic} is not a valid cloud ({error})"
    source.damage.append(Damage(Path(source.name), None, problem, lost_bytes, 1))


@dataclass
class TopicTally:
    """Sums over the frames of one topic.

    Parameters
    ----------
    frames, points_in : int
        Filtered frames and their points.
    counts : ndarray, shape (8,), int64
        Points for each `Reason`; the first entry counts the points kept.
    rings : Rings or None
        Sums over the frames, including thresholds and corrections.
    scenes : counter of str
        Number of frames for each class of scene; empty for methods without presets.
    water : ndarray, shape (4,), float64
        Sums of the values of `WaterState`.
    water_frames : int
        Number of frames with water; 0 for methods that do not estimate it.
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
    water: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(WATER_COLUMNS)))
    water_frames: int = 0
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
        if result.water is not None:
            self.water += astuple(result.water)
            self.water_frames += 1

    @property
    def mean_water(self) -> WaterState | None:
        """Mean state of the water; None if there is none."""
        return WaterState(*(self.water / self.water_frames).tolist()) if self.water_frames else None


def run(
    source: Source,
    make_filter: Callable[[], Filter],
    sinks: Sequence[Sink],
    selection: Selection,
    on_frame: Callable[[FilterResult], object] = lambda _: None,
    tallies: dict[str, TopicTally] | None = None,
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
    tallies : dict of str to TopicTally, optional
        Receives the sums while they grow; they are complete when sinks end.

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
    tallies = {} if tallies is None else tallies
    tallies.update((topic, TopicTally()) for topic in filters)
    _observe(source, selection, {topic: [method] for topic, method in filters.items()})
    for sink in sinks:
        sink.begin(source, clouds)
    holder = RecordHolder({topic: [method] for topic, method in filters.items()})
    for held in _held(holder, read(source, clouds, selection, with_latched=True)):
        if not isinstance(held, HeldFrame):
            for sink in sinks:
                sink.copy(held.record)
            continue
        (result,) = _counted(held, [tallies[held.frame.topic]], source)
        if isinstance(result, FieldError):
            _report_lost(source, held.frame.topic, held.frame.index, held.frame.nbytes, result)
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
    holder = RecordHolder({topics[0]: filters})
    records = read(source, clouds, selection)
    usable = ((record, frame) for record, frame in records if frame is not None and _has_coordinates(frame, source))
    for held in _held(holder, usable):
        if not isinstance(held, HeldFrame):
            continue
        frame, results = held.frame, _counted(held, tallies, source)
        unusable = next((result for result in results if isinstance(result, FieldError)), None)
        if unusable is not None:
            _report_lost(source, frame.topic, frame.index, frame.nbytes, unusable)
        seconds = [0.0 if isinstance(r, FieldError) else s for r, s in zip(results, held.seconds, strict=True)]
        on_frame(frame, [None if isinstance(result, FieldError) else result for result in results], seconds)
    for tally in tallies:
        _require_fields(source, topics[0], tally)


def _held(holder: RecordHolder, records: Iterable[tuple[Record, Frame | None]]) -> Iterator[HeldRecord]:
    """Yield all records in order, frames with their results."""
    for record, frame in records:
        yield from holder.add(record, frame)
    yield from holder.finish()


def _has_coordinates(frame: Frame, source: Source) -> bool:
    """Return whether a frame has coordinates, and compute what all filters use, so that it is not timed."""
    try:
        _ = frame.valid
    except FieldError as error:
        _report_lost(source, frame.topic, frame.index, frame.nbytes, error)
        return False
    with suppress(FieldError):  # not every method needs intensities
        _ = frame.intensity
    return True


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


def _counted(held: HeldFrame, tallies: Sequence[TopicTally], source: Source) -> list[FilterResult | FieldError]:
    """Return the results of the filters after adding each to its sums."""
    for result, tally, seconds in zip(held.known, tallies, held.seconds, strict=True):
        if isinstance(result, FieldError):
            _record_unfit(result, held.frame, tally, source)
        else:
            tally.add(result, seconds)
    return held.known


def _record_unfit(error: FieldError, frame: Frame, tally: TopicTally, source: Source) -> None:
    """Record that a frame lacks a field; raise `FieldError` if none of the first frames has it."""
    if not tally.frames:
        tally.unfit.append(error)
    if len(tally.unfit) == _MAX_UNFIT:
        _require_fields(source, frame.topic, tally)
