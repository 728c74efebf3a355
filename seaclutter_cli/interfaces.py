"""Interfaces between the parts of the program: source -> frame -> filter -> sink.

A `Source` yields the records of a log. The pipeline decodes the point clouds among them into frames with a
`CloudCodec`, a `Filter` assigns a reason to every point of a frame, and each `Sink` consumes the results. `Labels`
provide the ground truth of a recording.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.records import Buffer, Channel, Damage, Message, Metadata, Record, SensorFacts
from seaclutter_cli.truth import Truth


class Source(ABC):
    """A recording: one file, or several files that form one stream.

    By default it is in ROS 2 format, nothing of it is compressed, latched or skipped, and no file stays open. That of a
    plug-in opens a file by its path; the file's first bytes, or else its name, tell that it is in the format.
    """

    suffixes: ClassVar[tuple[str, ...]] = ()
    """Ends of the names of files in the format of a plug-in, in lower case."""
    magics: ClassVar[tuple[bytes, ...]] = ()
    """First bytes of such files, up to 16."""
    name: str
    """Name of the recording in tables and file names."""
    format: str
    """Format of the recording, for display: ``MCAP``, ``ROS 1 bag``."""
    profile = "ros2"
    """MCAP profile of the records: ``ros2``, ``ros1`` or empty."""
    compression: str | None = None
    """Compression by its MCAP name (``zstd``, ``lz4``, empty for none); None if the recording does not determine it."""
    metadata: Sequence[Metadata] = ()
    """Metadata records known before reading."""
    facts: Mapping[str, SensorFacts] = MappingProxyType({})
    """Facts about the sensor of each cloud topic, from its packets; complete when all records have been read."""
    has_times = True
    """Whether the frames have times of their own; else they are those of a rate that was given or assumed."""
    is_numbered = False
    """Whether the ``sequence`` of messages counts the frames, from 0, also those that cannot be read."""

    def __init__(self) -> None:
        self.damage: list[Damage] = []
        """Parts that cannot be read; grows while the records are read."""
        self.reported: set[Damage] = set()
        """Those of `report`."""
        self.warnings: list[str] = []
        """Warnings for the user about conditions that lose no data."""

    @property
    @abstractmethod
    def channels(self) -> Sequence[Channel]:
        """Channels known before reading, including those without messages."""

    @property
    def counts(self) -> dict[int, int]:
        """Number of messages for each channel id, where known before reading."""
        return {}

    @property
    @abstractmethod
    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message, where known before reading."""

    @abstractmethod
    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield the records in log time order; messages outside ``[start_ns, end_ns)`` may be omitted, which is faster.

        Metadata and attachments come first. Each call starts again at the first record.
        """

    def skipped(self, start_ns: int) -> Mapping[int, int]:  # noqa: ARG002 - nothing is omitted
        """Return the number of messages that `records` omits before ``start_ns``, by channel id."""
        return {}

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:  # noqa: ARG002 - nothing is latched
        """Return the last message before a log time of each of some channels, by their ids, in log time order."""
        return []

    def close(self) -> None:  # noqa: B027 - most sources keep nothing open
        """Close files and free other resources."""

    def report(
        self,
        problem: str,
        lost_bytes: int = 0,
        lost_messages: int | None = None,
        *,
        offset: int | None = None,
        path: Path | None = None,
    ) -> None:
        """Add damage, by default of the recording as a whole, that is not known yet: a log may be read again."""
        damage = Damage(path or Path(self.name), offset, problem, lost_bytes, lost_messages)
        if damage not in self.reported:
            self.reported.add(damage)
            self.damage.append(damage)

    def restore_damage(self, damage: Iterable[Damage]) -> None:
        """Forget all other damage than this, so that the next reading adds it."""
        self.damage[:] = damage
        self.reported.intersection_update(self.damage)

    def warn(self, *texts: str) -> None:
        """Add warnings that are not known yet."""
        self.warnings += [text for text in texts if text not in self.warnings]


class CloudCodec(Protocol):
    """Decoder and encoder for point clouds in one message encoding.

    That of a plug-in has the attribute ``messages``: pairs of the name of a schema and the encoding, such as
    ``("acme_msgs/msg/Scan", "cdr")``.
    """

    def decode(self, data: Buffer) -> Cloud:
        """Return a cloud whose points are a view of the message; `CloudError` if it is not a valid point cloud."""

    def encode(self, cloud: Cloud) -> bytes:
        """Return a cloud as the bytes of a message."""


@dataclass(frozen=True)
class NoParams:
    """Parameters of a method without configuration keys."""


class Filter(ABC):
    """A method that separates sea clutter from targets; by default without state, first pass or look-ahead.

    A filter may keep state from frame to frame, so each topic of each recording needs one of its own, or a `reset`.

    Examples
    --------
    >>> import numpy as np
    >>> import seaclutter
    >>> class Low(seaclutter.Filter):
    ...     def step(self, frame):
    ...         reason = np.where(frame.valid, seaclutter.Reason.KEPT, seaclutter.Reason.INVALID).astype(np.uint8)
    ...         reason[frame.valid & (frame.xyz[:, 2] < -2)] = seaclutter.Reason.OUTLIER
    ...         return seaclutter.FilterResult(frame, reason)
    >>> done = seaclutter.filter_log("samples/sea.mcap", folder / "low.mcap", method=Low)
    >>> done.outcomes[0].frames
    60
    """

    Params: ClassVar[type[Any]] = NoParams
    """Dataclass of the method's configuration keys; the constructor takes an instance."""
    has_scenes: ClassVar[bool] = False
    """Whether the method has presets for classes of scene, which its results name."""
    has_water: ClassVar[bool] = False
    """Whether the method estimates the water."""
    needs_height: ClassVar[bool] = False
    """Whether the method depends on the heights of points."""
    uses_attitude: ClassVar[bool] = False
    """Whether the method uses own ship's attitude where a log has it."""
    warnings: Sequence[str] = ()
    """Warnings for the user about the frames so far."""
    needs_first_pass: bool = False
    """Whether the filter must `observe` all frames before the first `step`."""
    look_ahead_s: float = 0.0
    """Time after a frame whose frames its result depends on, in seconds; 0 if it depends on no later frame."""

    def __init__(self, params: Any = None) -> None:
        self.params = self.Params() if params is None else params

    def observe(self, frame: Frame) -> None:  # noqa: B027 - most filters need no first pass
        """Receive a frame of the first pass; called only if `needs_first_pass` is true."""

    def process(self, frame: Frame) -> Sequence[FilterResult]:
        """Receive the next frame and return the results that are complete, in the order of the frames."""
        return [self.step(frame)]

    def flush(self) -> Sequence[FilterResult]:
        """Return the results of all frames received so far, without waiting for later ones."""
        return []

    @abstractmethod
    def step(self, frame: Frame) -> FilterResult:
        """Receive the next frame and return its result at once, without later frames; do not mix with `process`."""

    def reset(self) -> None:  # noqa: B027 - most filters have no state
        """Discard all state before another recording."""


class Labels(Protocol):
    """Ground truth of one recording, independent of the format of its labels."""

    def truth(self, frame: Frame) -> Truth | None:
        """Return the ground truth of a frame, None without; `LabelError` if the labels do not match the frame."""

    def finish(self) -> None:
        """Raise `LabelError` if a label refers to a frame that does not exist; called after the last frame."""


class TilePoints(Protocol):
    """The N points of an airborne tile, in a fixed order."""

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Yield coordinates in metres, shape (3, n), for each part of the tile; can be iterated repeatedly."""

    def column(self, name: str) -> NDArray[Any] | None:
        """Return an attribute of all points by its LAS name, shape (N,); None if the tile does not have it."""


class Sink(ABC):
    """A consumer of results and of other records: `begin`, then `copy` and `write` in log time order, then `end`."""

    @abstractmethod
    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:
        """Start a recording; ``clouds`` are its filtered channels."""

    def copy(self, record: Record) -> None:  # noqa: B027 - tables are of frames
        """Receive a record that is not filtered."""

    @abstractmethod
    def write(self, result: FilterResult) -> None:
        """Receive a filtered frame."""

    def end(self) -> None:  # noqa: B027 - tables have no end
        """End the recording."""
