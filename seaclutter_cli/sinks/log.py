"""A recording as a log: filtered, a drop-in replacement for the input, or as it is."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from seaclutter_cli import __version__
from seaclutter_cli.cloud import Cloud
from seaclutter_cli.errors import OutputError, UsageError
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import CloudCodec, Sink, Source
from seaclutter_cli.messages import find_codec, has_fixed_fields, metadata
from seaclutter_cli.messages.definitions import points_channel
from seaclutter_cli.messages.diagnostics import PLAIN, WATER, Diagnostics, diagnostics_format
from seaclutter_cli.messages.diagnostics import TOPIC as DIAGNOSTICS_TOPIC
from seaclutter_cli.messages.metadata import RecordedTopic, recorded_topics, to_metadata
from seaclutter_cli.records import Attachment, Buffer, Channel, Message, Metadata, Record
from seaclutter_cli.registry import imported
from seaclutter_cli.sinks.atomic import OutputGroup
from seaclutter_cli.sinks.log_output import LogOutput, LogWriter
from seaclutter_cli.sinks.mcap_writer import McapOutput
from seaclutter_cli.sinks.options import McapOptions, Parts

if TYPE_CHECKING:
    from seaclutter_cli.messages.translation import Translations

_NEW = -1
_MAX_CHANNELS = 2**16

_Output = tuple[int, Callable[[FilterResult], Buffer]]
"""Channel id of the messages that are written for the frames of a cloud topic, and their encoder."""


class LogSink(ExitStack, Sink):
    """Sink that writes a recording to a log; if it is written as it is, frames are passed to `keep`."""

    def __init__(
        self,
        path: Path,
        options: McapOptions,
        group: OutputGroup | None = None,
        output: Callable[..., LogOutput] = McapOutput,
    ) -> None:
        super().__init__()
        self._output = output(path, group, split=options.split is not None)
        self.push(self._output)
        self.push(self._abort)
        self._options = options
        self._parts = Parts(options.split)
        self._writers: list[LogWriter] = []  # of the first part, which is completed last, and of the current one
        self._channels: dict[Channel, int] = {}
        self._declared: dict[int, Channel] = {}
        self._joined: dict[tuple[str, str], int] = {}
        self._outputs: dict[Channel, list[_Output]] = {}
        self._topics: dict[str, RecordedTopic] = {}
        self._first_frames: dict[str, int] = {}
        self._next_frames: dict[str, int] = {}
        self._lost: dict[str, None] = {}
        self.messages = 0
        """Number of messages written; complete after `end`."""
        self._translations: Translations | None = None
        if self._output.encoding:  # slow to import
            self._translations = imported("messages.translation.Translations")(self._output.encoding)

    def _abort(self, kind: type[BaseException] | None, *_: object) -> None:
        for writer in self._writers if kind is not None else ():
            writer.abort()

    @property
    def lost(self) -> Sequence[str]:
        """What the log cannot keep of the recording, in words; complete after `end`."""
        return [*self._lost, *(self._translations.lost if self._translations else ())]

    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:
        """Write the header and declare all channels."""
        self._source = source
        self._begin_part()
        taken = {channel.topic for channel in source.channels}
        self._selected = {channel.topic for channel in clouds}
        for channel in source.channels:
            if self._takes(channel):
                self._declare(channel)
        before = recorded_topics(source.metadata)
        self._topics |= before if self._options.as_is else {}
        for channel in clouds:
            earlier = before.get(channel.topic, RecordedTopic(metadata.RAW, channel.topic))
            methods, is_part = (*earlier.methods, self._options.method), self._options.is_part or earlier.is_part
            known = RecordedTopic(metadata.RAW, channel.topic, methods, is_part=is_part)
            if self._options.as_is:
                self._topics[channel.topic] = replace(earlier, is_part=is_part)
            else:
                self._outputs[channel] = self._add_outputs(channel, taken, known)

    def copy(self, record: Record) -> None:
        """Write a record unchanged."""
        if self._options.objects:
            self._options.objects.copy(record)
        if isinstance(record, Message):
            if self._takes(record.channel):
                self._make_room(record, len(record.data))
                self._copy(record, is_frame=False)
        elif isinstance(record, Attachment):
            self._writer.attach(record)
        else:
            self._writer.add_metadata(record)

    def keep(self, frame: Frame) -> None:
        """Write a frame unchanged."""
        self._copy(self._counted(frame))

    def write(self, result: FilterResult) -> None:
        """Write the messages of a filtered frame."""
        message = self._counted(result.frame)
        if self._options.keep_raw:
            self._copy(message)
        for number, encode in self._outputs[message.channel]:
            self._put(number, message, encode(result))

    def end(self) -> None:
        """Write the records about topics and the run, and the summary; report messages that could not be translated."""
        self._end_part()
        first = self._writers[0]
        if self._options.record is not None:
            first.add_metadata(self._options.record())
        first.finish()
        for topic, messages in self._translations.broken.items() if self._translations else ():
            self._source.report(f"messages on {topic} that do not fit their definition", 0, messages)

    def _takes(self, channel: Channel) -> bool:
        return channel.topic in self._selected or self._options.takes(channel.topic)

    def _make_room(self, message: Message, size: int) -> None:
        if self._parts.is_next(message.log_time_ns, size):
            self._end_part()
            self._begin_part()
            for number, channel in self._declared.items():
                self._add_channel(replace(channel, id=number))

    def _begin_part(self) -> None:
        writer = self._output.part(self._source, self._options.compression)
        self._writers, self._writer = [*self._writers[:1], writer], writer
        self._first_frames = dict(self._next_frames)
        if not self._options.as_is:
            writer.add_metadata(Metadata("seaclutter", {"version": __version__, "config": self._options.config}))

    def _end_part(self) -> None:
        """Write the record about topics; the first part is finished at the end of the log."""
        first = self._first_frames
        if self._topics:
            topics = {name: replace(t, first_frame=first.get(t.clouds, 0)) for name, t in self._topics.items()}
            self._writer.add_metadata(to_metadata(topics))
        if len(self._writers) > 1:
            self._writer.finish()
        self._lost |= dict.fromkeys(self._writer.lost)
        self.messages += self._writer.messages

    def _counted(self, frame: Frame) -> Message:
        """Return the message of a frame, for which there is room in the current part."""
        message = message_of(frame)
        self._make_room(message, len(message.data))
        self._first_frames.setdefault(frame.topic, frame.index)
        self._next_frames[frame.topic] = frame.index + 1
        return message

    def _add_outputs(self, channel: Channel, taken: set[str], known: RecordedTopic) -> list[_Output]:
        codec, options = find_codec(channel), self._options
        if codec is None:
            raise UsageError(f"topic {channel.topic} contains no point clouds")
        text = self._output.encoding or channel.message_encoding
        filtered = self._channels[channel]
        self._topics[channel.topic] = known if options.keep_raw else replace(known, content=metadata.FILTERED)
        if options.keep_raw:
            filtered = self._add(channel, "/filtered", taken, replace(known, content=metadata.FILTERED))
        outputs: list[_Output] = [(filtered, partial(_filtered_message, codec, options))]
        if options.with_removed:
            points = points_channel(channel) if has_fixed_fields(channel) else channel
            removed = self._add(points, "/removed", taken, replace(known, content=metadata.REMOVED))
            outputs.append((removed, partial(_removed_message, find_codec(points) or codec)))
        if options.diagnostics:
            layout = WATER if options.water else PLAIN
            name = DIAGNOSTICS_TOPIC + channel.topic * (len(self._selected) > 1)
            encoding, schema, serialise = diagnostics_format(text, layout)
            number, name = self._shared_channel(Channel(_NEW, name, encoding, schema), taken)
            self._topics[name] = replace(known, content=metadata.DIAGNOSTICS)
            outputs.append((number, lambda result: serialise(Diagnostics.of(result).content(layout))))
        if options.scene or options.objects:
            from seaclutter_cli.messages import scene as boxes  # most runs write none
        if scene := options.scene:
            encoding, schema, draw = boxes.scene_format(text)
            number, _ = self._shared_channel(Channel(_NEW, boxes.SCENE_TOPIC, encoding, schema), taken)
            outputs.append((number, lambda result: draw(scene(result).content)))
        if live := options.objects:
            encoding, schema, write = boxes.detections_format(text)
            number, _ = self._shared_channel(Channel(_NEW, boxes.OBJECTS_TOPIC, encoding, schema), taken)
            outputs.append((number, lambda result: write(live.detections(result))))
        return outputs

    def _shared_channel(self, channel: Channel, taken: set[str]) -> tuple[int, str]:
        """Return id and topic of a channel for several topics; a number is added if the log already has the topic."""
        number, name = 2, channel.topic
        while channel.topic in taken:
            channel = replace(channel, topic=f"{name}_{number}")
            number += 1
        if channel not in self._channels:
            self._declare(channel)
        return self._channels[channel], channel.topic

    def _add(self, channel: Channel, suffix: str, taken: set[str], known: RecordedTopic) -> int:
        name = channel.topic + suffix
        if name in taken:
            raise UsageError(f"topic {name} already exists in the log; the filter cannot write to it")
        self._topics[name] = known
        kept = tuple(pair for pair in channel.metadata if pair[0] != "topic")  # quality of service, latching
        return self._declare(replace(channel, id=_NEW, topic=name, metadata=kept))

    def _declare(self, channel: Channel) -> int:
        """Declare a channel under its own id if it is free, otherwise under the lowest free id."""
        kind = channel.topic, channel.schema.name if channel.schema else ""
        if self._output.joins_publishers and kind in self._joined:
            self._channels[channel] = self._joined[kind]
            return self._joined[kind]
        number: int | None = channel.id
        if number not in range(_MAX_CHANNELS) or number in self._declared:
            number = next((free for free in range(1, _MAX_CHANNELS) if free not in self._declared), None)
        if number is None:
            raise OutputError(f"topic {channel.topic}: a log can have at most {_MAX_CHANNELS} channels")
        self._channels[channel] = number
        self._declared[number] = channel
        if self._add_channel(replace(channel, id=number)):
            self._joined[kind] = number
        return number

    def _add_channel(self, channel: Channel) -> bool:
        """Declare a channel, unless its messages cannot be translated; return whether they can."""
        translated = self._translations.channel(channel) if self._translations else channel
        if translated is not None:
            self._writer.add_channel(translated)
        elif channel.topic in self._selected:
            raise OutputError(f"{self.lost[-1]} cannot be written in this format")
        return translated is not None

    def _copy(self, message: Message, *, is_frame: bool = True) -> None:
        number = self._channels.get(message.channel)
        number = self._declare(message.channel) if number is None else number
        self._put(number, message, message.data, is_frame=is_frame)

    def _put(self, number: int, message: Message, data: Buffer, *, is_frame: bool = True) -> None:
        found = self._translations.message(number, data, is_frame=is_frame) if self._translations else data
        if found is not None:
            self._writer.write(number, message.log_time_ns, message.publish_time_ns, message.sequence, found)


def message_of(frame: Frame) -> Message:
    """Return the message of a frame."""
    if frame.message is None:
        raise ValueError("the frame has no message; only frames read from a log can be written")
    return frame.message


def _filtered_message(codec: CloudCodec, options: McapOptions, result: FilterResult) -> Buffer:
    cloud, kept = result.frame.cloud, filtered_cloud(result, options)
    return message_of(result.frame).data if kept is cloud else codec.encode(kept)


def _removed_message(codec: CloudCodec, result: FilterResult) -> Buffer:
    mask = ~result.keep
    return codec.encode(result.frame.cloud.select(mask).with_field("reason", result.reason[mask]))


def filtered_cloud(result: FilterResult, options: McapOptions) -> Cloud:
    """Return the points of a frame that were kept; the cloud itself if it does not change."""
    cloud = result.frame.cloud
    organised = cloud.height > 1
    if (not organised or options.keep_organized) and result.keep.all():
        return cloud
    return cloud.blank(~result.keep) if organised and options.keep_organized else cloud.select(result.keep)
