"""Records in the order of the log, held back until the results of the frames among them are complete."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter

from seaclutter_cli.errors import FieldError
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import Filter
from seaclutter_cli.records import Message, Record

_SLACK_NS = 100_000_000
_MAX_HELD_BYTES = 128 << 20


@dataclass
class HeldRecord:
    """A record of the log that is not filtered."""

    record: Record

    @property
    def complete(self) -> bool:
        """Whether all results are known."""
        return True

    @property
    def nbytes(self) -> int:
        """Size of its message in bytes."""
        return len(self.record.data) if isinstance(self.record, Message) else 0


@dataclass
class HeldFrame(HeldRecord):
    """A frame with the results of its filters.

    Parameters
    ----------
    record : Message
        Message of the frame.
    frame : Frame
        The frame.
    results : list of FilterResult, FieldError or None
        Result of each filter, or the error of a filter that cannot use the frame; None until it is known.
    seconds : list of float
        Time that each filter took when it received the frame.
    """

    frame: Frame
    results: list[FilterResult | FieldError | None]
    seconds: list[float]

    @property
    def complete(self) -> bool:
        """Whether all results are known."""
        return None not in self.results

    @property
    def known(self) -> list[FilterResult | FieldError]:
        """The results that are known."""
        return [result for result in self.results if result is not None]


class RecordHolder:
    """Holder of the records that wait for filters which look ahead.

    Filters return the results of a topic in the order of its frames, some of them only with later frames. Every record
    behind an incomplete frame waits, so that the order of the log is kept. If the log goes on for longer than a filter
    looks ahead without another frame of its topic, or if the messages that wait exceed 128 MB, the filter decides with
    what it has. The arrays decoded from these messages take memory in addition.

    Parameters
    ----------
    filters : mapping of str to sequence of Filter
        Filters of the frames of each topic.
    """

    def __init__(self, filters: Mapping[str, Sequence[Filter]]) -> None:
        self._filters = filters
        self._held: deque[HeldRecord] = deque()
        self._waiting = {topic: [deque[HeldFrame]() for _ in own] for topic, own in filters.items()}
        self._held_bytes = 0
        self._last_ns: dict[str, int] = {}

    def add(self, record: Record, frame: Frame | None) -> Iterator[HeldRecord]:
        """Add the next record of the log; yield those that are complete, in order."""
        held = HeldRecord(record) if frame is None else self._filter(record, frame)
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

    def _filter(self, record: Record, frame: Frame) -> HeldFrame:
        filters = self._filters[frame.topic]
        self._last_ns[frame.topic] = frame.log_time_ns
        held = HeldFrame(record, frame, [None] * len(filters), [0.0] * len(filters))
        for number, method in enumerate(filters):
            started = perf_counter()
            try:
                results = method.process(frame)
            except FieldError as error:
                held.results[number] = error
                continue
            held.seconds[number] = perf_counter() - started
            self._waiting[frame.topic][number].append(held)
            self._assign(frame.topic, number, results)
        return held

    def _assign(self, topic: str, number: int, results: Sequence[FilterResult]) -> None:
        for result in results:
            self._waiting[topic][number].popleft().results[number] = result

    def _flush(self, topic: str) -> None:
        for number, method in enumerate(self._filters[topic]):
            if self._waiting[topic][number]:
                self._assign(topic, number, method.flush())

    def _flush_late(self, log_time_ns: int) -> bool:
        """Let a filter decide if later frames do not come or the wait takes too much memory; return whether it did."""
        held = self._held[0] if self._held else None
        if not isinstance(held, HeldFrame):
            return False
        ahead_ns = max(int(1e9 * method.look_ahead_s) for method in self._filters[held.frame.topic])
        late = log_time_ns - self._last_ns[held.frame.topic] > ahead_ns + _SLACK_NS
        if late or self._held_bytes > _MAX_HELD_BYTES:
            self._flush(held.frame.topic)
            return True
        return False

    def _complete(self) -> Iterator[HeldRecord]:
        while self._held and self._held[0].complete:
            held = self._held.popleft()
            self._held_bytes -= held.nbytes
            yield held
