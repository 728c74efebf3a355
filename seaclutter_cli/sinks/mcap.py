"""Filtered MCAP file, a drop-in replacement for the input."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

from seaclutter_cli import __version__
from seaclutter_cli.errors import OutputError, UsageError
from seaclutter_cli.frame import FilterResult
from seaclutter_cli.interfaces import CloudCodec, Source
from seaclutter_cli.messages import find_codec, has_fixed_fields
from seaclutter_cli.messages.definitions import points_channel
from seaclutter_cli.messages.diagnostics import PLAIN, WATER, Diagnostics, diagnostics_format
from seaclutter_cli.messages.diagnostics import TOPIC as DIAGNOSTICS_TOPIC
from seaclutter_cli.messages.recorded import (
    DIAGNOSTICS,
    FILTERED,
    RAW,
    REMOVED,
    RecordedTopic,
    recorded_topics,
    to_metadata,
)
from seaclutter_cli.messages.scene import TOPIC as SCENE_TOPIC
from seaclutter_cli.messages.scene import SceneUpdate, scene_format
from seaclutter_cli.records import Attachment, Buffer, Channel, Message, Metadata
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.mcap_writer import McapWriter
from seaclutter_cli.storage.locations import Location

_NEW = -1
_MAX_CHANNELS = 2**16


@dataclass(frozen=True, kw_only=True)
class McapOptions:
    """Contents of a filtered MCAP file.

    Parameters
    ----------
    keep_raw : bool
        Keep the raw cloud on its topic and write the filtered cloud to ``<topic>/filtered``.
    with_removed : bool
        Write the removed points with their reasons to ``<topic>/removed``.
    keep_organized : bool
        Preserve the shape of organised clouds; removed points become NaN.
    diagnostics : bool
        Write a message with thresholds, corrections and counts for each frame.
    compression : str or None
        ``zstd``, ``lz4`` or empty for none; None uses the compression of the input, zstd if unknown.
    latched : tuple of str
        Topics whose last message before the start of a part is written, beside those that are known as latched.
    config : str
        Effective configuration as YAML, for the metadata of the file.
    water : bool
        Whether the method estimates the water, which adds level, attitude and wave height to the diagnostics.
    scene : callable, optional
        Function that returns the boxes of a filtered frame, which are written to ``/seaclutter/scene``.
    record : callable, optional
        Function that returns a metadata record about the run when all frames are written.
    method : str
        Name of the method, for the metadata of the file.
    is_part : bool
        Whether only a part of the recording is written.

    Examples
    --------
    >>> import seaclutter
    >>> both = seaclutter.McapOptions(keep_raw=True, with_removed=True)
    >>> done = seaclutter.filter_log("samples/sea.mcap", folder / "both.mcap", written=both)
    >>> with seaclutter.open_log(folder / "both.mcap") as log:
    ...     log.topics
    ('/points', '/points/filtered', '/points/removed')
    """

    keep_raw: bool = False
    with_removed: bool = False
    keep_organized: bool = False
    diagnostics: bool = True
    compression: str | None = None
    latched: tuple[str, ...] = ()
    config: str = ""
    water: bool = False
    scene: Callable[[FilterResult], SceneUpdate] | None = None
    record: Callable[[], Metadata] | None = None
    method: str = ""
    is_part: bool = False


@dataclass(frozen=True, slots=True)
class _Outputs:
    """Channel ids and encoders of the messages that are written for a cloud topic."""

    codec: CloudCodec
    filtered: int
    removed: int | None
    removed_codec: CloudCodec
    diagnostics: int | None
    serialise: Callable[[Diagnostics], bytes]
    scene: int | None
    draw: Callable[[SceneUpdate], bytes]


class McapSink(AbstractContextManager["McapSink"]):
    """Sink that writes a recording to a filtered MCAP file.

    Parameters
    ----------
    path : Path or Url
        Target; the file appears when the context exits without an error.
    options : McapOptions
        Contents of the file.
    group : OutputGroup, optional
        Files that appear together with this one.
    """

    def __init__(self, path: Location, options: McapOptions, group: OutputGroup | None = None) -> None:
        self._file = AtomicFile(path, group)
        self._options = options
        self._layout = WATER if options.water else PLAIN
        self._writer: McapWriter | None = None
        self._channels: dict[Channel, int] = {}
        self._used: set[int] = set()
        self._outputs: dict[Channel, _Outputs] = {}
        self._topics: dict[str, RecordedTopic] = {}
        self._first_frames: dict[str, int] = {}

    def __enter__(self) -> Self:
        """Return the sink."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the file under its name, or remove it after an error."""
        if kind is not None and self._writer is not None:
            self._writer.abort()
        self._file.__exit__(kind, error, trace)

    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:
        """Write the header and declare all channels."""
        compression = self._options.compression
        if compression is None:
            compression = "zstd" if source.compression is None else source.compression
        library = f"seaclutter {__version__}"
        self._writer = McapWriter(self._file.stream, profile=source.profile, library=library, compression=compression)
        entries = {"version": __version__, "config": self._options.config}
        self._writer.add_metadata(Metadata("seaclutter", entries))
        taken = {channel.topic for channel in source.channels}
        for channel in source.channels:
            self._declare(channel)
        several = len({channel.topic for channel in clouds}) > 1
        before = recorded_topics(source.metadata)
        for channel in clouds:
            earlier = before.get(channel.topic, RecordedTopic(RAW, channel.topic))
            methods, is_part = (*earlier.methods, self._options.method), self._options.is_part or earlier.is_part
            known = RecordedTopic(RAW, channel.topic, methods, is_part=is_part)
            self._outputs[channel] = self._add_outputs(channel, taken, known, several=several)

    def copy(self, record: Message | Attachment | Metadata) -> None:
        """Write a record unchanged."""
        if isinstance(record, Message):
            number = self._channels.get(record.channel)
            if number is None:
                number = self._declare(record.channel)
            self._put(number, record, record.data)
        elif isinstance(record, Attachment):
            self._open_writer.attach(record)
        else:
            self._open_writer.add_metadata(record)

    def write(self, result: FilterResult) -> None:
        """Write the messages of a filtered frame."""
        message, cloud = _record_of(result), result.frame.cloud
        self._first_frames.setdefault(message.channel.topic, result.frame.index)
        outputs = self._outputs[message.channel]
        if self._options.keep_raw:
            self.copy(message)
        self._put(outputs.filtered, message, self._filtered(outputs.codec, result))
        if outputs.removed is not None:
            mask = ~result.keep
            removed = cloud.select(mask).with_field("reason", result.reason[mask])
            self._put(outputs.removed, message, outputs.removed_codec.encode(removed))
        if outputs.diagnostics is not None:
            self._put(outputs.diagnostics, message, outputs.serialise(Diagnostics.of(result, self._layout)))
        if outputs.scene is not None and self._options.scene is not None:
            self._put(outputs.scene, message, outputs.draw(self._options.scene(result)))

    def end(self) -> None:
        """Write the records about topics and the run, and the summary."""
        first = self._first_frames
        self._open_writer.add_metadata(
            to_metadata({name: replace(t, first_frame=first.get(t.clouds, 0)) for name, t in self._topics.items()})
        )
        if self._options.record is not None:
            self._open_writer.add_metadata(self._options.record())
        self._open_writer.finish()

    def _filtered(self, codec: CloudCodec, result: FilterResult) -> Buffer:
        cloud = result.frame.cloud
        organised = cloud.height > 1
        if (not organised or self._options.keep_organized) and result.keep.all():
            return _record_of(result).data
        if organised and self._options.keep_organized:
            return codec.encode(cloud.blank(~result.keep))
        return codec.encode(cloud.select(result.keep))

    def _add_outputs(self, channel: Channel, taken: set[str], known: RecordedTopic, *, several: bool) -> _Outputs:
        codec = find_codec(channel)
        if codec is None:
            raise UsageError(f"topic {channel.topic} contains no point clouds")
        options = self._options
        encoding, schema, serialise = diagnostics_format(channel.message_encoding, self._layout)
        filtered, removed, removed_codec, diagnostics = self._channels[channel], None, codec, None
        self._topics[channel.topic] = known if options.keep_raw else replace(known, content=FILTERED)
        if options.keep_raw:
            name = f"{channel.topic}/filtered"
            filtered = self._add(replace(channel, topic=name), taken)
            self._topics[name] = replace(known, content=FILTERED)
        if options.with_removed:
            name = f"{channel.topic}/removed"
            points = points_channel(channel) if has_fixed_fields(channel) else channel
            removed_codec = find_codec(points) or codec
            removed = self._add(replace(points, topic=name), taken)
            self._topics[name] = replace(known, content=REMOVED)
        if options.diagnostics:
            name = DIAGNOSTICS_TOPIC + channel.topic * several
            diagnostics, name = self._shared_channel(Channel(_NEW, name, encoding, schema), taken)
            self._topics[name] = replace(known, content=DIAGNOSTICS)
        draw: Callable[[SceneUpdate], bytes] = _no_scene
        scene = None
        if options.scene:
            encoding, schema, draw = scene_format(channel.message_encoding)
            scene, _ = self._shared_channel(Channel(_NEW, SCENE_TOPIC, encoding, schema), taken)
        return _Outputs(codec, filtered, removed, removed_codec, diagnostics, serialise, scene, draw)

    def _shared_channel(self, channel: Channel, taken: set[str]) -> tuple[int, str]:
        """Return id and topic of a channel for several topics; a number is added if the log already has the topic."""
        number, name = 2, channel.topic
        while channel.topic in taken:
            channel = replace(channel, topic=f"{name}_{number}")
            number += 1
        if channel not in self._channels:
            self._declare(channel)
        return self._channels[channel], channel.topic

    def _add(self, channel: Channel, taken: set[str]) -> int:
        if channel.topic in taken:
            raise UsageError(f"topic {channel.topic} already exists in the log; the filter cannot write to it")
        kept = tuple(pair for pair in channel.metadata if pair[0] != "topic")  # quality of service, latching
        return self._declare(replace(channel, id=_NEW, metadata=kept))

    def _declare(self, channel: Channel) -> int:
        """Declare a channel under its own id if it is free, otherwise under the lowest free id."""
        number: int | None = channel.id
        if number not in range(_MAX_CHANNELS) or number in self._used:
            number = next((free for free in range(1, _MAX_CHANNELS) if free not in self._used), None)
        if number is None:
            raise OutputError(f"topic {channel.topic}: an MCAP file can have at most {_MAX_CHANNELS} channels")
        self._used.add(number)
        self._channels[channel] = number
        self._open_writer.add_channel(replace(channel, id=number))
        return number

    def _put(self, number: int, message: Message, data: Buffer) -> None:
        self._open_writer.write(number, message.log_time_ns, message.publish_time_ns, message.sequence, data)

    @property
    def _open_writer(self) -> McapWriter:
        if self._writer is None:
            raise RuntimeError("begin() has not been called")
        return self._writer


def _record_of(result: FilterResult) -> Message:
    if result.frame.message is None:
        raise ValueError("the frame has no message; only frames read from a log can be written")
    return result.frame.message


def _no_scene(_: SceneUpdate) -> bytes:
    raise RuntimeError("the options have no scene")
