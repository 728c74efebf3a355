"""Interfaces between the parts of the program: source -> frame -> filter -> sink.

A `Source` yields the records of a log. The pipeline decodes the point clouds among them into frames with a
`CloudCodec`, a `Filter` assigns a reason to every point of a frame, and each `Sink` consumes the results. `Labels`
provide the ground truth of a recording.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.records import Attachment, Buffer, Channel, Damage, Message, Metadata, Record, SensorFacts
from seaclutter_cli.truth import Truth


class Source(Protocol):
    """A recording: one file, or several files that form one stream."""

    name: str
    """Name of the recording in tables and file names."""
    format: str
    """Format of the recording, for display: ``MCAP``, ``ROS 1 bag``."""
    profile: str
    """MCAP profile of the records: ``ros2``, ``ros1`` or empty."""
    compression: str | None
    """Compression by its MCAP name (``zstd``, ``lz4``, empty for none); None if the recording does not determine it."""
    damage: list[Damage]
    """Parts that cannot be read; grows while the records are read."""
    warnings: list[str]
    """Warnings for the user about conditions that lose no data."""

    @property
    def metadata(self) -> Sequence[Metadata]:
        """Metadata records known before reading."""
        ...

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels known before reading, including those without messages."""
        ...

    @property
    def counts(self) -> dict[int, int]:
        """Number of messages for each channel id, where known before reading."""
        ...

    @property
    def facts(self) -> Mapping[str, SensorFacts]:
        """Facts about the sensor of each cloud topic, from its packets; complete when all records have been read."""
        ...

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message, where known before reading."""
        ...

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield attachments, metadata, and messages in the order of their log time.

        Parameters
        ----------
        start_ns, end_ns : int, optional
            Log times. Messages outside ``[start_ns, end_ns)`` may be omitted to save reading them.

        Yields
        ------
        Message, Attachment or Metadata
            The next record. Each call starts again at the first.
        """
        ...

    def skipped(self, start_ns: int) -> Mapping[int, int]:
        """Return the number of messages that `records` omits before ``start_ns``, by channel id."""
        ...

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels, in log time order.

        Parameters
        ----------
        channels : collection of int
            Ids of channels; those of decoded packets have no messages here.
        before_ns : int
            Log time.
        """
        ...

    def close(self) -> None:
        """Close files and free other resources."""
        ...


class CloudCodec(Protocol):
    """Decoder and encoder for point clouds in one message encoding."""

    def decode(self, data: Buffer) -> Cloud:
        """Return a cloud whose points are a view of the message.

        Raises
        ------
        CloudError
            If the message is not a valid point cloud.
        """
        ...

    def encode(self, cloud: Cloud) -> bytes:
        """Return a cloud as the bytes of a message."""
        ...


class Filter(Protocol):
    """A method that separates sea clutter from targets.

    A filter keeps state from frame to frame, so each topic of each recording needs a filter of its own, or a `reset`.
    """

    Params: ClassVar[type[Any]]
    """Dataclass of the method's configuration keys; the constructor takes an instance."""
    has_scenes: ClassVar[bool]
    """Whether the method has presets for classes of scene, which its results name."""
    has_water: ClassVar[bool]
    """Whether the method estimates the water."""
    needs_height: ClassVar[bool]
    """Whether the method depends on the heights of points."""

    def observe(self, frame: Frame) -> None:
        """Receive a frame of the first pass; called only if `needs_first_pass` is true."""
        ...

    @property
    def needs_first_pass(self) -> bool:
        """Whether the filter must `observe` all frames before the first `step`."""
        ...

    @property
    def look_ahead_s(self) -> float:
        """Time after a frame whose frames its result depends on, in seconds; 0 if it depends on no later frame."""
        ...

    def process(self, frame: Frame) -> Sequence[FilterResult]:
        """Receive the next frame and return the results that are complete, in the order of the frames."""
        ...

    def flush(self) -> Sequence[FilterResult]:
        """Return the results of all frames received so far, without waiting for later ones."""
        ...

    def step(self, frame: Frame) -> FilterResult:
        """Receive the next frame and return its result at once, without later frames; do not mix with `process`."""
        ...

    def reset(self) -> None:
        """Discard all state before another recording."""
        ...


class Labels(Protocol):
    """Ground truth of one recording, independent of the format of its labels."""

    def truth(self, frame: Frame) -> Truth | None:
        """Return the ground truth of a frame; None if the frame is not labelled.

        Raises
        ------
        LabelError
            If the labels do not match the frame.
        """
        ...

    def finish(self) -> None:
        """Check, after the last frame, that no label refers to a frame that does not exist.

        Raises
        ------
        LabelError
            If one does.
        """
        ...


class TilePoints(Protocol):
    """The N points of an airborne tile, in a fixed order."""

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Yield coordinates in metres, shape (3, n), for each part of the tile; can be iterated repeatedly."""
        ...

    def column(self, name: str) -> NDArray[Any] | None:
        """Return an attribute of all points by its LAS name, shape (N,); None if the tile does not have it."""
        ...


class Sink(Protocol):
    """A consumer of filtered frames and of the records that filters do not change.

    The pipeline calls `begin`, then `copy` and `write` in the order of log time, then `end`.
    """

    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:
        """Start a recording; ``clouds`` are its filtered channels."""
        ...

    def copy(self, record: Message | Attachment | Metadata) -> None:
        """Receive a record that is not filtered."""
        ...

    def write(self, result: FilterResult) -> None:
        """Receive a filtered frame."""
        ...

    def end(self) -> None:
        """End the recording."""
        ...
