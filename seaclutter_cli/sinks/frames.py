"""Frames as files: a folder with a file for each frame, or a single file."""

from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

from seaclutter_cli import __version__
from seaclutter_cli.cloud import Cloud
from seaclutter_cli.errors import UsageError
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.interfaces import Sink, Source
from seaclutter_cli.messages import metadata
from seaclutter_cli.messages.metadata import SIDECAR, RecordedTopic, recorded_topics, to_metadata, to_text
from seaclutter_cli.records import Attachment, Channel, Metadata, Record
from seaclutter_cli.sinks.atomic import AtomicFile, AtomicFolder, OutputGroup
from seaclutter_cli.sinks.log import filtered_cloud, message_of
from seaclutter_cli.sinks.options import TIMES, McapOptions
from seaclutter_cli.sinks.point_files import NAMES, NO_COORDINATES, TOO_FAR, FrameWriter
from seaclutter_cli.text import count

TOPIC = "/points"
"""Topic of the frames when they are read again."""


class FrameSink(ExitStack, Sink):
    """Sink that writes each frame of one topic to a file: the target itself, or one named by its number in a folder.

    ``write_frame`` writes a cloud to a file, and returns what it cannot contain, see `FRAME_WRITERS`. If the
    recording is written as it is, frames are passed to `keep`.
    """

    def __init__(
        self, path: Path, options: McapOptions, group: OutputGroup | None, write_frame: FrameWriter, suffix: str
    ) -> None:
        super().__init__()
        self._path, self._options = path, options
        self._write_frame, self._suffix = write_frame, suffix
        is_file = path.suffix.lower() == suffix
        self._output = AtomicFile(path, group) if is_file else AtomicFolder(path, group, last=SIDECAR)
        self.push(self._output)
        self._metadata: list[Metadata] = []
        self._stamps_ns: list[int] = []
        self._others: set[str] = set()
        self._attachments, self._lost = 0, Counter[str]()
        self._has_log_times = self._has_poses = False

    @property
    def messages(self) -> int:
        """Number of frames written."""
        return len(self._stamps_ns)

    @property
    def lost(self) -> Sequence[str]:
        """What the files cannot keep of the recording, in words."""
        found = {
            "log times other than stamps": self._has_log_times,
            "the poses of clouds, which were applied to their points": self._has_poses,
            **{f"{count(self._lost[why], 'point')} {why}": self._lost[why] for why in (NO_COORDINATES, TOO_FAR)},
            NAMES: self._lost[NAMES],
            count(len(self._others), "other topic"): self._others,
            count(self._attachments, "attachment"): self._attachments,
        }
        return [name for name, is_lost in found.items() if is_lost]

    def begin(self, source: Source, clouds: Sequence[Channel]) -> None:
        """Check that there is one topic, and keep what is known about it."""
        topics = list(dict.fromkeys(channel.topic for channel in clouds))
        if len(topics) > 1:
            choices = " or ".join(f"-t {topic}" for topic in topics)
            raise UsageError(f"{source.name}: files of frames are of one topic; choose one: {choices}")
        known = recorded_topics(source.metadata).get(topics[0], RecordedTopic(metadata.RAW, topics[0]))
        methods = known.methods if self._options.as_is else (*known.methods, self._options.method)
        content = known.content if self._options.as_is else metadata.FILTERED
        is_part = self._options.is_part or known.is_part
        self._known = RecordedTopic(content, TOPIC, methods, is_part=is_part)
        if not self._options.as_is:
            self._metadata.append(Metadata("seaclutter", {"version": __version__, "config": self._options.config}))

    def copy(self, record: Record) -> None:
        """Keep a metadata record; count what is lost."""
        if isinstance(record, Metadata):
            self._metadata.append(record)
        elif isinstance(record, Attachment):
            self._attachments += 1
        else:
            self._others.add(record.channel.topic)

    def keep(self, frame: Frame) -> None:
        """Write a frame unchanged."""
        self._add(frame, frame.cloud)

    def write(self, result: FilterResult) -> None:
        """Write the points of a frame that were kept."""
        self._add(result.frame, filtered_cloud(result, self._options))

    def _add(self, frame: Frame, cloud: Cloud) -> None:
        message, self._has_poses = message_of(frame), self._has_poses or cloud.is_moved
        self._has_log_times |= frame.stamp_ns != message.log_time_ns
        if not self._stamps_ns:
            self._known = replace(self._known, first_frame=frame.index)
        elif not isinstance(self._output, AtomicFolder):
            raise UsageError(
                f"{self._path}: has room for one frame only; name a folder, as in"
                f" -o {self._path.name.removesuffix(self._suffix)} --to {self._suffix[1:]}, or add -n 1"
            )
        self._stamps_ns.append(frame.stamp_ns)
        output, name = self._output, f"{frame.index:06d}{self._suffix}"
        with output.open(name) if isinstance(output, AtomicFolder) else nullcontext(output.stream) as stream:
            self._lost += self._write_frame(stream, cloud.posed()) or Counter[str]()

    def end(self) -> None:
        """Write times and metadata records."""
        if not isinstance(self._output, AtomicFolder):
            return
        self._metadata.append(to_metadata({TOPIC: self._known}))
        if self._options.record is not None:
            self._metadata.append(self._options.record())
        with self._output.open(TIMES) as file:
            file.writelines(f"{Decimal(stamp).scaleb(-9):.9f}\n".encode() for stamp in self._stamps_ns)
        with self._output.open(SIDECAR) as file:
            file.write(to_text(self._metadata).encode())
