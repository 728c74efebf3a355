"""What sources of several formats have in common."""

from abc import abstractmethod
from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping, Sequence

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.errors import CloudError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import POINT_CLOUD, ros2_schema
from seaclutter_cli.records import Channel, Message


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

    channels: Sequence[Channel] = ()
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


class CloudSource(TimedSource):
    """A recording of clouds; ``stamps_ns`` are their times in order, in nanoseconds of Unix time.

    A cloud for which `cloud` raises `CloudError` is damage.
    """

    def __init__(self, name: str, stamps_ns: Sequence[int], topic: str = "/points") -> None:
        super().__init__()
        self.name = name
        self.channels = [Channel(1, topic, "cdr", ros2_schema(POINT_CLOUD))]
        self._times_ns = {1: list(stamps_ns)}

    @abstractmethod
    def cloud(self, index: int) -> Cloud:
        """Return the cloud with a number, from 0, and its time; see `from_array`."""

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Message]:
        """Yield the clouds with times in ``[start_ns, end_ns)`` as messages."""
        for index, stamp_ns in enumerate(self._times_ns[1]):
            if (start_ns is None or stamp_ns >= start_ns) and (end_ns is None or stamp_ns < end_ns):
                try:
                    data = CODECS[POINT_CLOUD, "cdr"].encode(self.cloud(index))
                except CloudError as error:
                    self.report(f"cloud {index}: {error}", lost_messages=1)
                else:
                    yield Message(self.channels[0], stamp_ns, stamp_ns, index, data)
