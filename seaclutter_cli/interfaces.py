"""The map of the program: source -> frame -> filter -> sink.

A source yields the records of a log. The pipeline decodes the point clouds among them into frames, a filter gives every
point of a frame a reason, and sinks write what comes out.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.records import Attachment, Buffer, Channel, Damage, Message, Metadata, Record, SensorFacts
from seaclutter_cli.truth import Truth


class Source(Protocol):
    """A recording: one file, or several that are one stream."""

    name: str
    """Name of the recording, as it appears in tables and file names."""
    format: str
    """What the recording is, for people: ``MCAP``, ``ROS 1 bag``."""
    profile: str
    """MCAP profile of what comes out: ``ros2``, ``ros1`` or empty."""
    compression: str | None
    """Compression of the recording as MCAP names it (``zstd``, ``lz4``, empty for none); None if it has no say."""
    damage: list[Damage]
    """What could not be read; grows while the records are read."""
    warnings: list[str]
    """What the user should know besides; nothing is lost."""

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels known before reading, those without messages too."""
        ...

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id as far as known before reading."""
        ...

    @property
    def facts(self) -> Mapping[str, SensorFacts]:
        """What packets reveal of the sensor behind each cloud topic; complete once the records have been read."""
        ...

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:
        """Yield attachments, metadata, and messages in the order of their log time; can be called again.

        Messages outside of ``[start_ns, end_ns)`` may be left out where that saves reading them.
        """
        ...

    def skipped(self, start_ns: int) -> Mapping[int, int]:
        """Return how many messages per channel id `records` leaves out at the beginning, given this start."""
        ...

    def close(self) -> None:
        """Free what is held open."""
        ...


class CloudCodec(Protocol):
    """Point clouds in one message encoding."""

    def decode(self, data: Buffer) -> Cloud:
        """Return a view on the message's points; `CloudError` if it is no valid cloud."""
        ...

    def encode(self, cloud: Cloud) -> bytes:
        """Return the message of a cloud."""
        ...


class Filter(Protocol):
    """A method that tells sea clutter from targets. Keeps state from frame to frame of one topic of one recording."""

    Params: ClassVar[type[Any]]
    """Dataclass of the method's config keys; the filter is made from one."""

    def observe(self, frame: Frame) -> None:
        """Look at a frame in a pass before the first `step`; called only where ``needs_first_pass``."""
        ...

    @property
    def needs_first_pass(self) -> bool:
        """Whether all frames must be observed before the first `step`."""
        ...

    def step(self, frame: Frame) -> FilterResult:
        """Return a reason for every point; called once a frame, in order."""
        ...

    def reset(self) -> None:
        """Forget all state: a recording starts."""
        ...


class NamedScene(Protocol):
    """A decision on the class of scene that a frame shows."""

    @property
    def name(self) -> str:
        """Name of the class."""
        ...


class SceneSource(Protocol):
    """Whatever tells the class of scene. Keeps state from frame to frame of one topic of one recording."""

    def scene(self, frame: Frame) -> NamedScene:
        """Return the scene; called once a frame, in order."""
        ...

    def reset(self) -> None:
        """Forget all state: a recording starts."""
        ...


class Labels(Protocol):
    """The truth of one recording, in whatever form it was labelled."""

    def truth(self, frame: Frame) -> Truth | None:
        """Return what is truly in a frame, None where it is not labelled; `LabelError` if the labels do not fit."""
        ...

    def finish(self) -> None:
        """Check, after the last frame, that there are no labels left of frames that were not there; `LabelError`."""
        ...


class TilePoints(Protocol):
    """The points of an airborne tile, N of them, in an order that stays."""

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Yield coordinates in metres, shape (3, n) for each part of the tile; can be gone through again."""
        ...

    def intensity(self) -> NDArray[Any] | None:
        """Return the intensity of all points, shape (N,); None if the tile has none."""
        ...


class Sink(Protocol):
    """A consumer of what comes out of the filter."""

    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:
        """Start a recording of which ``clouds`` are filtered."""
        ...

    def copy(self, record: Message | Attachment | Metadata) -> None:
        """Take a record that no filter touches."""
        ...

    def write(self, result: FilterResult) -> None:
        """Take a filtered frame."""
        ...

    def end(self) -> None:
        """End the recording."""
        ...
