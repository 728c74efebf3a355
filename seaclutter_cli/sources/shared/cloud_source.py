"""The simplest base of a source: clouds on one topic at times that are known before they are read."""

from abc import abstractmethod
from collections.abc import Iterator, Sequence

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.errors import CloudError
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.sources.shared import TimedSource

_TYPE = "sensor_msgs/msg/PointCloud2"


class CloudSource(TimedSource):
    """A recording of clouds; ``stamps_ns`` are their times in order, in nanoseconds of Unix time.

    A cloud for which `cloud` raises `CloudError` is damage.
    """

    channels: Sequence[Channel] = ()

    def __init__(self, name: str, stamps_ns: Sequence[int], topic: str = "/points") -> None:
        super().__init__()
        self.name = name
        self.channels = [Channel(1, topic, "cdr", ros2_schema(_TYPE))]
        self._times_ns = {1: list(stamps_ns)}

    @abstractmethod
    def cloud(self, index: int) -> Cloud:
        """Return the cloud with a number, from 0, and its time; see `from_array`."""

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Message]:
        """Yield the clouds with times in ``[start_ns, end_ns)`` as messages."""
        for index, stamp_ns in enumerate(self._times_ns[1]):
            if (start_ns is None or stamp_ns >= start_ns) and (end_ns is None or stamp_ns < end_ns):
                try:
                    data = CODECS[_TYPE, "cdr"].encode(self.cloud(index))
                except CloudError as error:
                    self.report(f"cloud {index}: {error}", lost_messages=1)
                else:
                    yield Message(self.channels[0], stamp_ns, stamp_ns, index, data)
