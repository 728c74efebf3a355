"""Processing of a recording: filter its frames, and pass the results to sinks in the order of the log."""

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, field
from itertools import chain, starmap
from time import perf_counter
from typing import TypeVar

import numpy as np

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.errors import ArrayError, CloudError, FieldError, TopicError
from seaclutter_cli.frame import WATER_COLUMNS, FilterResult, Frame, Reason, Rings, WaterState
from seaclutter_cli.given import naming_method
from seaclutter_cli.interfaces import Filter, Sink, Source
from seaclutter_cli.reading import frames, read, rejoined, report_lost, with_attitudes
from seaclutter_cli.records import Message, Record
from seaclutter_cli.selection import Selection, cloud_channels

_MAX_UNFIT = 5
_SLACK_NS = 100_000_000
_MAX_HELD_BYTES = 128 << 20
_IN_ORDER = "must return one result for each frame, in their order"

T = TypeVar("T")

Filtered = tuple[Frame, Sequence[FilterResult | None], Sequence[float | None]]
"""A frame, its result of each method, and the seconds that each took, as far as known."""


@dataclass
class TopicTally:
    """Sums over the frames of one topic.

    ``counts``, shape (9,), are the points for each `Reason`, ``scenes`` the frames for each class of scene; ``water``,
    shape (5,), are sums of `WaterState` over ``water_frames``, ``undecided``, shape (2, 2), those of the results;
    ``unfit`` are errors of first frames, which lack a field.
    """

    frames: int = 0
    points_in: int = 0
    counts: Ints = field(default_factory=lambda: np.zeros(len(Reason), np.int64))
    rings: Rings | None = None
    scenes: Counter[str] = field(default_factory=Counter)
    water: Floats = field(default_factory=lambda: np.zeros(len(WATER_COLUMNS)))
    water_frames: int = 0
    undecided: Ints = field(default_factory=lambda: np.zeros((2, 2), np.int64))
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
        if result.undecided is not None:
            self.undecided += result.undecided

    @property
    def mean_water(self) -> WaterState | None:
        """Mean state of the water; None if there is none."""
        return WaterState(*(self.water / self.water_frames).tolist()) if self.water_frames else None


@dataclass
class HeldRecord:
    """A record with its frame, if it is a cloud, and results or errors of its filters, None until they are known.

    A frame that was made from arrays has no record.
    """

    record: Record | None
    frame: Frame | None
    results: list[FilterResult | FieldError | None]
    seconds: list[float]

    @property
    def nbytes(self) -> int:
        """Size of its message in bytes."""
        return len(self.record.data) if isinstance(self.record, Message) else 0


class RecordHolder:
    """Holder of the records that wait for filters which look ahead.

    Filters return the results of a topic in the order of its frames, some of them only with later frames. Every record
    behind an incomplete frame waits, so that the order of the log is kept. If the log goes on for longer than a filter
    looks ahead without another frame of its topic, or if the messages that wait exceed 128 MB, the filter decides with
    what it has. The arrays decoded from these messages take memory in addition.
    """

    def __init__(self, filters: Mapping[str, Sequence[Filter]]) -> None:
        self._filters = filters
        self._held: deque[HeldRecord] = deque()
        self._waiting = {topic: [deque[HeldRecord]() for _ in own] for topic, own in filters.items()}
        self._held_bytes = 0
        self._last_ns: dict[str, int] = {}

    def add(self, record: Record | None, frame: Frame | None) -> Iterator[HeldRecord]:
        """Add the next record of the log; yield those that are complete, in order."""
        held = HeldRecord(record, frame, [], []) if frame is None else self._filter(record, frame)
        self._held.append(held)
        self._held_bytes += held.nbytes
        yield from self._complete()
        while isinstance(record, Message) and self._flush_late(record.log_time_ns):
            yield from self._complete()

    def finish(self) -> Iterator[HeldRecord]:
        """Yield all records that are left, after the end of the log."""
        for topic in self._filters:
            self._flush(topic)
        yield from self._complete()

    def _filter(self, record: Record | None, frame: Frame) -> HeldRecord:
        filters = self._filters[frame.topic]
        self._last_ns[frame.topic] = frame.log_time_ns
        held = HeldRecord(record, frame, [None] * len(filters), [0.0] * len(filters))
        for number, method in enumerate(filters):
            started = perf_counter()
            try:
                with naming_method(method, f"frame {frame.index} of {frame.topic}"):
                    results = method.process(frame)
            except FieldError as error:
                held.results[number] = error
                continue
            held.seconds[number] = perf_counter() - started
            self._waiting[frame.topic][number].append(held)
            self._assign(frame.topic, number, results)
        return held

    def _assign(self, topic: str, number: int, results: Sequence[FilterResult], *, is_all: bool = False) -> None:
        waiting = self._waiting[topic][number]
        with naming_method(self._filters[topic][number], topic):
            for result in results:
                if not waiting or result.frame is not waiting[0].frame or not len(result.counts):
                    raise ArrayError(_IN_ORDER)
                waiting.popleft().results[number] = result
            if is_all and waiting:
                raise ArrayError(_IN_ORDER)

    def _flush(self, topic: str) -> None:
        for number, method in enumerate(self._filters[topic]):
            if self._waiting[topic][number]:
                with naming_method(method, topic):
                    results = method.flush()
                self._assign(topic, number, results, is_all=True)

    def _flush_late(self, log_time_ns: int) -> bool:
        """Let a filter decide if later frames do not come or the wait takes too much memory; return whether it did."""
        frame = self._held[0].frame if self._held else None
        if frame is None:
            return False
        ahead_ns = max(int(1e9 * method.look_ahead_s) for method in self._filters[frame.topic])
        late = log_time_ns - self._last_ns[frame.topic] > ahead_ns + _SLACK_NS
        if late or self._held_bytes > _MAX_HELD_BYTES:
            self._flush(frame.topic)
            return True
        return False

    def _complete(self) -> Iterator[HeldRecord]:
        while self._held and None not in self._held[0].results:
            held = self._held.popleft()
            self._held_bytes -= held.nbytes
            yield held


def run(
    source: Source,
    make_filter: Callable[[], Filter],
    sinks: Sequence[Sink],
    selection: Selection,
    tallies: dict[str, TopicTally],
) -> Iterator[FilterResult]:
    """Filter a recording, and yield the result of each frame; every cloud topic has a filter of its own.

    The sinks receive every record or result of the selected part before, in the order of log time. ``tallies`` receive
    the sums for each topic while they grow; they are complete when sinks end.
    `FieldError` if all frames of a topic lack a field that the method needs; if only some do, they are damage.
    """
    clouds = cloud_channels(source, selection.topics)
    filters = {channel.topic: [make_filter()] for channel in clouds}
    tallies.update((topic, TopicTally()) for topic in filters)
    _observe(source, selection, filters)
    for sink in sinks:
        sink.begin(source, clouds)
    records = _as_used(read(source, clouds, selection, with_latched=True), source, filters)
    for held in _filtered(source, filters, {topic: [tallies[topic]] for topic in filters}, records):
        if held.frame is None and held.record is not None:
            for sink in sinks:
                sink.copy(held.record)
        for result in held.results:
            if isinstance(result, FilterResult):
                for sink in sinks:
                    sink.write(result)
                yield result
    for sink in sinks:
        sink.end()


def run_each(
    source: Source, filters: Sequence[Filter], selection: Selection, removed: str | None = None
) -> Iterator[Filtered]:
    """Filter one cloud topic with several methods in one pass; each frame is decoded once.

    The filters are new; those that need a first pass share it. Yields each frame, the result of each filter (None if
    the filter cannot use the frame), and the seconds that each filter took. Coordinates and ranges, which all filters
    use, are computed before and not timed. Frames without coordinates are damage. If the log has the points that an
    earlier run removed, on the topic ``removed``, they are in the frames again when the filters have seen these.
    `FieldError` if all frames lack a field that one of the methods needs; `TopicError` if there are several topics.
    """
    clouds = cloud_channels(source, selection.topics)
    topics = list(dict.fromkeys(channel.topic for channel in clouds))
    if len(topics) > 1:
        choices = " or ".join(f"-t {topic}" for topic in topics)
        raise TopicError(f"{source.name}: several point-cloud topics; choose one: {choices}")
    _observe(source, selection, {topics[0]: filters})
    tallies = [TopicTally() for _ in filters]

    def is_usable(record: Record, frame: Frame | None) -> bool:
        if frame is None:
            return isinstance(record, Message) and record.channel.topic == removed
        return _has_coordinates(frame, source)

    records = _as_used(read(source, clouds, selection), source, {topics[0]: filters})
    usable = (each for each in records if is_usable(*each))
    every = _filtered(source, {topics[0]: filters}, {topics[0]: tallies}, usable)
    if removed:
        yield from _rejoined(every, source)
        return
    for held in every:
        if held.frame is not None:
            yield held.frame, _known(held.results), held.seconds


def _known(results: Iterable[FilterResult | FieldError | None]) -> list[FilterResult | None]:
    return [result if isinstance(result, FilterResult) else None for result in results]


def _rejoined(every: Iterable[HeldRecord], source: Source) -> Iterator[Filtered]:
    """Yield frames and results with the points removed from them, which follow them; frames without are damage."""
    waiting: HeldRecord | None = None
    for held in chain(every, [None]):
        frame = waiting.frame if waiting else None
        if waiting and frame:
            try:
                record = held.record if held and not held.frame else None
                yield *rejoined(frame, _known(waiting.results), record), waiting.seconds
            except CloudError as error:
                report_lost(source, frame.topic, frame.index, frame.nbytes, error)
        waiting = held if held and held.frame else None


def _as_used(
    records: Iterator[tuple[Record, Frame | None]], source: Source, filters: Mapping[str, Sequence[Filter]]
) -> Iterator[tuple[Record, Frame | None]]:
    """Yield records, with own ship's attitude if any filter uses it."""
    used = any(method.uses_attitude for own in filters.values() for method in own)
    return with_attitudes(records, source.channels) if used else records


def _filtered(
    source: Source,
    filters: Mapping[str, Sequence[Filter]],
    tallies: Mapping[str, Sequence[TopicTally]],
    records: Iterable[tuple[Record, Frame | None]],
) -> Iterator[HeldRecord]:
    """Yield all records in order, frames with results, which are added to the sums by topic; report unusable frames."""
    holder = RecordHolder(filters)
    for held in chain(chain.from_iterable(starmap(holder.add, records)), holder.finish()):
        frame = held.frame
        if frame is not None:
            for result, tally, seconds in zip(held.results, tallies[frame.topic], held.seconds, strict=True):
                if isinstance(result, FilterResult):
                    tally.add(result, seconds)
                elif result is not None:
                    _record_unfit(result, frame, tally, source)
            error = next((result for result in held.results if isinstance(result, FieldError)), None)
            if error is not None:
                report_lost(source, frame.topic, frame.index, frame.nbytes, error)
        yield held
    for topic, own in tallies.items():
        for tally in own:
            _require_fields(source, topic, tally)
        source.warn(*(f"{topic}: {text}" for method in filters[topic] for text in method.warnings))


def _has_coordinates(frame: Frame, source: Source) -> bool:
    """Return whether a frame has coordinates, and compute what all filters use, so that it is not timed."""
    try:
        _ = frame.valid
    except FieldError as error:
        report_lost(source, frame.topic, frame.index, frame.nbytes, error)
        return False
    with suppress(FieldError):  # not every method needs intensities
        _ = frame.intensity
    return True


def _require_fields(source: Source, topic: str, tally: TopicTally) -> None:
    if tally.unfit and not tally.frames:
        raise FieldError(f"{source.name}, {topic}: {tally.unfit[0]}") from tally.unfit[0]


def _observe(source: Source, selection: Selection, filters: Mapping[str, Sequence[Filter]]) -> None:
    waiting = {topic: [method for method in methods if method.needs_first_pass] for topic, methods in filters.items()}
    if not any(waiting.values()):
        return
    damage = list(source.damage)
    for frame in frames(source, selection):
        for method in waiting[frame.topic]:
            with suppress(FieldError), naming_method(method, f"frame {frame.index} of {frame.topic}"):
                method.observe(frame)  # `step` reports that it lacks a field
    source.restore_damage(damage)


def _record_unfit(error: FieldError, frame: Frame, tally: TopicTally, source: Source) -> None:
    """Record that a frame lacks a field; raise `FieldError` if none of the first frames has it."""
    if not tally.frames:
        tally.unfit.append(error)
    if len(tally.unfit) == _MAX_UNFIT:
        _require_fields(source, frame.topic, tally)


def map_frames(source: Source, selection: Selection, use: Callable[[Frame], T]) -> Iterator[tuple[Frame, T]]:
    """Yield the selected frames, each with the result of a function.

    `FieldError` if all frames of a topic lack a field that the function needs; if only some do, they are damage.
    """
    tallies: dict[str, TopicTally] = {}
    for frame in frames(source, selection):
        tally = tallies.setdefault(frame.topic, TopicTally())
        try:
            value = use(frame)
        except FieldError as error:
            _record_unfit(error, frame, tally, source)
            report_lost(source, frame.topic, frame.index, frame.nbytes, error)
            continue
        tally.frames += 1
        yield frame, value
    for topic, tally in tallies.items():
        _require_fields(source, topic, tally)
