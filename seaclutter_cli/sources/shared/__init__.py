"""What sources of several formats have in common."""

from bisect import bisect_left
from collections.abc import Collection, Mapping, Sequence

from seaclutter_cli.interfaces import Source
from seaclutter_cli.records import Message


class SourceWrapper(Source):
    """A recording that is read through another source, and whose clouds are numbered by reading all of it."""

    def __init__(self, inner: Source) -> None:
        super().__init__()
        self._inner = inner
        self.name, self.format = inner.name, inner.format
        self.profile, self.compression, self.has_times = inner.profile, inner.compression, inner.has_times
        self.metadata, self.facts = inner.metadata, inner.facts
        self.damage, self.reported, self.warnings = inner.damage, inner.reported, inner.warnings

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message of the recording."""
        return self._inner.span_ns

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels of the recording."""
        return self._inner.latest(channels, before_ns)

    def close(self) -> None:
        """Close the recording."""
        self._inner.close()


class TimedSource(Source):
    """A recording that knows the times of its messages, in order and by channel id, before it is read."""

    _times_ns: Mapping[int, Sequence[int]]

    @property
    def counts(self) -> dict[int, int]:
        """Number of messages by channel id."""
        return {number: len(times) for number, times in self._times_ns.items()}

    def skipped(self, start_ns: int) -> Mapping[int, int]:
        """Return the number of messages before a time, by channel id."""
        return {number: bisect_left(times, start_ns) for number, times in self._times_ns.items()}

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Times of the first and the last message."""
        ends = [(times[0], times[-1]) for times in self._times_ns.values() if times]
        return (min(first for first, _ in ends), max(last for _, last in ends)) if ends else None
