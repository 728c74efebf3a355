"""The selected part of a recording: its records, with the clouds among them as frames."""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from seaclutter_cli.errors import CloudError, MissingExtraError, SeaclutterError, UnsupportedCloudError
from seaclutter_cli.frame import Frame
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import declares_latched, find_codec
from seaclutter_cli.records import Channel, Damage, Message, Record
from seaclutter_cli.selection import Selection, Window, cloud_channels

_LATCHED_TOPICS = re.compile(r"(^|/)(tf_static|robot_description)$")
_LATCHED_TYPES = re.compile(r"(^|/|\.)(CameraInfo|CameraCalibration)$")


def frames(source: Source, selection: Selection) -> Iterator[Frame]:
    """Yield the selected frames; see `read`, and `cloud_channels` for its errors."""
    clouds = cloud_channels(source, selection.topics)
    return (frame for _, frame in read(source, clouds, selection) if frame is not None)


def read(
    source: Source,
    clouds: Sequence[Channel],
    selection: Selection,
    *,
    with_latched: bool = False,
    unreadable: dict[str, str] | None = None,
) -> Iterator[tuple[Record, Frame | None]]:
    """Yield the selected records of a source, clouds together with their frames.

    A message that is not a valid cloud is left out and added to the damage of the source. The index of a frame counts
    from the start of the recording, within its topic, even if the selection starts later. If it does, the last messages
    before it on latched topics come first, if ``with_latched``.
    `UnsupportedCloudError` if the clouds of a topic are stored in a form that cannot be read, `MissingExtraError` if
    they need an extra. With ``unreadable``, the reason is stored there by topic instead; the topic yields no frames.
    """
    decoder = _Decoder(source, clouds, selection.intensity_field, unreadable)
    window = Window(source, clouds, selection)
    if with_latched and window.start_ns is not None:
        yield from ((message, None) for message in _latched_before(source, window.start_ns, selection.latched))
    for record in source.records(window.start_ns, window.end_ns):
        if not isinstance(record, Message):
            yield record, None
            continue
        is_cloud = record.channel in decoder.codecs
        if is_cloud and window.closed:
            return
        index = window.count(record) if is_cloud else 0
        if not window.contains(record):
            continue
        for frame in decoder.frames(record, index) if is_cloud else (None,):
            if frame is not None:
                window.count_selected(record)
            yield record, frame


class _Decoder:
    """Decoder of the messages of cloud topics; see `read`."""

    def __init__(
        self, source: Source, clouds: Sequence[Channel], intensity: str | None, unreadable: dict[str, str] | None
    ) -> None:
        self.codecs = {channel: codec for channel in clouds if (codec := find_codec(channel))}
        self._source, self._intensity, self._unreadable = source, intensity, unreadable

    def frames(self, message: Message, index: int) -> Iterator[Frame | None]:
        """Yield the frame of a message; None if clouds of its topic cannot be read, nothing if it is damaged."""
        topic = message.channel.topic
        if self._unreadable and topic in self._unreadable:
            yield None
            return
        try:
            cloud = self.codecs[message.channel].decode(message.data)
        except (UnsupportedCloudError, MissingExtraError) as error:
            if self._unreadable is None:
                raise _of_topic(error, self._source, topic) from error
            self._unreadable[topic] = str(_of_topic(error, self._source, topic))
            yield None
        except CloudError as error:
            report_lost(self._source, topic, index, len(message.data), error)
        else:
            yield Frame.of_message(message, cloud, index, self._intensity)


def _of_topic(error: SeaclutterError, source: Source, topic: str) -> SeaclutterError:
    if isinstance(error, UnsupportedCloudError):
        return UnsupportedCloudError(f"{source.name}, {topic}: {error}")
    return error


def _latched_before(source: Source, start_ns: int, topics: Collection[str]) -> Iterator[Message]:
    """Yield the last message before a time of each latched channel and topic, with this time as log time.

    Subscribers that come late get the last message of channels with the ROS 1 connection header ``latching`` or the
    ROS 2 durability ``transient_local``, static transforms, descriptions of robots, and calibrations of cameras.
    """

    def is_latched(channel: Channel) -> bool:
        kind = channel.schema.name if channel.schema else ""
        known = _LATCHED_TOPICS.search(channel.topic) or _LATCHED_TYPES.search(kind)
        return bool(known or channel.topic in topics or declares_latched(channel))

    channels = [channel.id for channel in source.channels if is_latched(channel) and find_codec(channel) is None]
    damage = list(source.damage)
    for message in source.latest(channels, start_ns) if channels else ():
        yield replace(message, log_time_ns=start_ns)
    source.damage[:] = damage  # of parts that are not selected


def report_lost(source: Source, topic: str, index: int, lost_bytes: int, error: Exception) -> None:
    """Record a frame that cannot be used as damage of the source."""
    problem = f"frame {index} of {topic} is not a valid cloud ({error})"
    source.damage.append(Damage(Path(source.name), None, problem, lost_bytes, 1))
