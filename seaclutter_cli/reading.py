"""The selected part of a recording: its records, with the clouds among them as frames."""

import re
from collections import deque
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from seaclutter_cli.arrays import Bytes
from seaclutter_cli.cloud import Cloud, from_array, structured
from seaclutter_cli.errors import CloudError, MissingExtraError, UnsupportedCloudError, about
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import declares_latched, find_codec
from seaclutter_cli.records import Channel, Message, Record, StampClock
from seaclutter_cli.selection import Selection, Window, cloud_channels

if TYPE_CHECKING:
    from seaclutter_cli.messages.navigation import Navigation

_LATCHED_TOPICS = re.compile(r"(^|/)(tf_static|robot_description)$")
_LATCHED_TYPES = re.compile(r"(^|/|\.)(CameraInfo|CameraCalibration)$")

_MAX_SENSORS = 64
_FIXED_FRAMES = ("odom", "map", "earth", "world", "camera_init")  # of REP 105, and of usual programs for registration
_ATTITUDE_NS, _MOST_FRAMES, _MOST_RECORDS = 200_000_000, 16, 4096


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
    codecs = {channel: codec for channel in clouds if (codec := find_codec(channel))}
    window, stamps = Window(source, clouds, selection), _Stamps()
    if with_latched and window.start_ns is not None:
        yield from _latched_before(source, window.start_ns, selection.latched)
    for record in source.records(window.start_ns, window.end_ns):
        if not isinstance(record, Message):
            yield record, None
            continue
        codec = codecs.get(record.channel)
        if codec and window.closed:
            return
        index = window.count(record) if codec else 0
        if not window.contains(record):
            continue
        frame = None
        topic = record.channel.topic
        if codec and topic not in (unreadable or ()):
            try:
                with about(f"{source.name}, {topic}", UnsupportedCloudError):
                    cloud = codec.decode(record.data)
                frame = stamps.checked(Frame.of_message(record, cloud, index, selection.intensity_field), source)
                window.count_selected(record)
            except (UnsupportedCloudError, MissingExtraError) as error:
                if unreadable is None:
                    raise
                unreadable[topic] = str(error)
            except CloudError as error:
                report_lost(source, topic, index, len(record.data), error)
                continue
        yield record, frame


class _Stamps:
    """Stamps of the last frames of each topic: what is said about them, and what stands in for those that stand still.

    A frame with the stamp of the one before is as much later as its log time is. Frames of several sensors on one topic
    have stamps of their own.
    """

    def __init__(self) -> None:
        self._clocks: dict[str, dict[str, StampClock]] = {}

    def checked(self, frame: Frame, source: Source) -> Frame:
        """Return the next frame, with a stamp that is later than the one before if its log time is; warn once."""
        cloud, message, topic = frame.cloud, frame.message, frame.topic
        if cloud.has_wrong_rows:
            source.warn(f"{topic} has a wrong row_step: rows are read as {cloud.width} x {cloud.point_step} bytes")
        if cloud.frame_id.rpartition("/")[2] in _FIXED_FRAMES:
            source.warn(
                f"{topic} has clouds in the fixed frame {cloud.frame_id!r}, not in that of the lidar; "
                "if own ship moves, use those of the driver"
            )
        if cloud.repeated_name:
            source.warn(f"{topic} has several fields {cloud.repeated_name!r}: the first one is read")
        known = self._clocks.setdefault(topic, {})
        if not cloud.stamp_ns or message is None:
            return frame
        if cloud.frame_id not in known and known:
            source.warn(f"{topic} has frames of several sensors (frame ids {next(iter(known))!r} and others)")
            if len(known) >= _MAX_SENSORS:
                known.popitem()
        stamp_ns, text = known.setdefault(cloud.frame_id, StampClock()).next(cloud.stamp_ns, message.log_time_ns)
        if text:
            source.warn(f"{topic} {text}")
        return frame if stamp_ns == cloud.stamp_ns else replace(frame, stamp_ns=stamp_ns)


def with_attitudes(
    records: Iterable[tuple[Record, Frame | None]], channels: Sequence[Channel]
) -> Iterator[tuple[Record, Frame | None]]:
    """Yield records, frames with own ship's attitude where the log has it around their stamps.

    A frame waits for that, and records behind it, until the log is 0.2 s ahead, or too many wait. ``channels`` are
    those of the log.
    """
    from seaclutter_cli.messages.navigation import Navigation  # not needed by most methods

    if not any(map(Navigation.tells_attitude, channels)):
        yield from records
        return
    navigation, held, now_ns, waiting = Navigation(), deque[tuple[Record, Frame | None]](), 0, 0
    for record, frame in records:
        held.append((record, frame))
        waiting += frame is not None
        if isinstance(record, Message):
            navigation.see(record)
            now_ns = record.log_time_ns
        while held:
            first = _with_attitude(held[0][1], navigation)
            has_room = waiting <= _MOST_FRAMES and len(held) <= _MOST_RECORDS
            if first and not first.attitude and now_ns - first.log_time_ns <= _ATTITUDE_NS and has_room:
                break
            waiting -= first is not None
            yield held.popleft()[0], first
    for record, frame in held:
        yield record, _with_attitude(frame, navigation)


def _with_attitude(frame: Frame | None, navigation: "Navigation") -> Frame | None:
    return frame and replace(frame, attitude=navigation.attitude(frame.cloud.frame_id, frame.stamp_ns))


def removed_points(message: Message) -> tuple[Cloud, Bytes]:
    """Return the points that an earlier run removed from a frame, shape (N,), and their reasons, given its message."""
    if (codec := find_codec(message.channel)) is None:
        raise CloudError(f"topic {message.channel.topic} contains no point clouds")
    cloud = codec.decode(message.data)
    # The filter added the last field, ``reason`` with or without underscores.
    names = cloud.dtype.names or ("",)
    if not names[-1].startswith("reason"):
        raise CloudError("the cloud of removed points has no field 'reason'")
    return cloud, np.minimum(cloud.points[names[-1]], max(Reason)).astype(np.uint8)


def rejoined(
    frame: Frame, results: Sequence[FilterResult | None], record: Record | None
) -> tuple[Frame, list[FilterResult | None]]:
    """Return a frame and its results with the points that an earlier run removed from it, after those that were left.

    The frame has the fields that both clouds have; raise `CloudError` if the record is not of these points.
    """
    if not isinstance(record, Message) or record.log_time_ns != frame.log_time_ns:
        raise CloudError("the points removed from it are missing")
    removed, reasons = removed_points(record)
    left = np.flatnonzero(frame.valid)  # organised clouds keep the places of what was removed
    kept, others = frame.cloud.points, removed.points
    common = [name for name in kept.dtype.names or () if name in (others.dtype.names or ())]
    columns = {name: np.concatenate((kept[name][left], others[name].astype(kept[name].dtype))) for name in common}
    cloud = from_array(structured(columns), stamp_ns=frame.cloud.stamp_ns, frame_id=frame.cloud.frame_id)
    whole = Frame(cloud, frame.topic, frame.stamp_ns, frame.index, frame.intensity_field, frame.message)
    return whole, [
        one and replace(one, frame=whole, reason=np.concatenate((one.reason[left], reasons))) for one in results
    ]


def _latched_before(source: Source, start_ns: int, topics: Collection[str]) -> Iterator[tuple[Message, None]]:
    """Yield the last message before a time of each latched channel and topic, with this time as log time, and no frame.

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
        yield replace(message, log_time_ns=start_ns), None
    source.restore_damage(damage)  # parts that are not selected


def report_lost(source: Source, topic: str, index: int, lost_bytes: int, error: Exception) -> None:
    """Record a frame that cannot be used as damage of the source."""
    source.report(f"frame {index} of {topic} is not a valid cloud ({error})", lost_bytes, 1)
