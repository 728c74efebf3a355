"""Frames of a fixed duration, for lidars whose scans do not repeat."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud
from seaclutter_cli.errors import CloudError, FieldError
from seaclutter_cli.interfaces import Source
from seaclutter_cli.limits import limits
from seaclutter_cli.messages import CODECS, find_codec, has_fixed_fields, main_clouds
from seaclutter_cli.messages.definitions import points_channel
from seaclutter_cli.records import Channel, Message, Record, StampClock
from seaclutter_cli.sources.shared import SourceWrapper

_RELATIVE = ("offset_time", "t", "time")
"""Point times relative to the stamp, of Livox, Ouster and Velodyne: whole nanoseconds, or seconds as float32."""
_MAX_WINDOWS = 64


@dataclass
class _Window:
    """Clouds that wait to be joined, and the number of their window."""

    number: int = 0
    clouds: list[Cloud] = field(default_factory=list)
    layout: object = None
    size: int = 0
    first_ns: int | None = None
    frames: int = 0
    clock: StampClock = field(default_factory=StampClock)


class Integrated(SourceWrapper):
    """A recording in which the clouds of each time window are one cloud.

    Windows of a topic begin with its first cloud of each frame id; a late cloud belongs to the open one. Joined clouds
    are not organised and have their earliest stamp. They come before the message that begins the next window, with its
    times. Messages whose points have fixed fields become ``sensor_msgs/PointCloud2``.
    """

    def __init__(self, inner: Source, window_ns: int, topics: Collection[str] = ()) -> None:
        super().__init__(inner)
        self._window_ns = window_ns
        clouds = [channel for channel in inner.channels if find_codec(channel)]
        chosen = [channel for channel in clouds if channel.topic in topics] if topics else main_clouds(clouds)
        self._clouds = {channel.id for channel in chosen}

    @property
    def channels(self) -> Sequence[Channel]:
        """Channels of the recording, with those of joined clouds."""
        joined = self._clouds
        return [_joined(channel) if channel.id in joined else channel for channel in self._inner.channels]

    @property
    def counts(self) -> dict[int, int]:
        """Messages per channel id; the number of joined clouds is not known."""
        return {number: messages for number, messages in self._inner.counts.items() if number not in self._clouds}

    def latest(self, channels: Collection[int], before_ns: int) -> list[Message]:
        """Return the last message before a time of each of some channels whose clouds are not joined."""
        return super().latest([number for number in channels if number not in self._clouds], before_ns)

    def records(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[Record]:  # noqa: ARG002
        """Yield the records before ``end_ns``, with joined clouds; can be called again."""
        windows: dict[tuple[Channel, str], _Window] = {}
        times = (0, 0)
        for record in self._inner.records():
            if isinstance(record, Message):
                if end_ns is not None and record.log_time_ns >= end_ns:
                    return
                times = max(times[0], record.log_time_ns), record.publish_time_ns
                codec = find_codec(record.channel) if record.channel.id in self._clouds else None
                if codec:
                    try:
                        cloud = codec.decode(record.data).posed()
                    except (CloudError, FieldError) as error:
                        self.report(f"a cloud of {record.channel.topic} cannot be read ({error})", len(record.data), 1)
                        continue
                    # Sensors that share a topic have windows of their own.
                    key = record.channel, cloud.frame_id
                    key = key if key in windows or len(windows) < _MAX_WINDOWS else (record.channel, "")
                    yield from self._add(record, cloud, windows.setdefault(key, _Window()))
                    continue
            yield record
        for (channel, _), window in windows.items():
            yield from self._join(channel, window, times)

    def _add(self, message: Message, cloud: Cloud, window: _Window) -> Iterator[Message]:
        """Add a cloud, and yield the joined cloud of the window before if it begins another one."""
        stamp_ns = message.log_time_ns
        if cloud.stamp_ns:
            stamp_ns, text = window.clock.next(cloud.stamp_ns, stamp_ns)
            if text:
                self.warn(f"{message.channel.topic} {text}")
        if window.first_ns is None or stamp_ns < window.first_ns + (window.number - 1) * self._window_ns:
            yield from self._join(message.channel, window, (message.log_time_ns, message.publish_time_ns))
            window.first_ns, window.number = stamp_ns, 0  # the first cloud, or a clock that was set back
        number = max((stamp_ns - window.first_ns) // self._window_ns, window.number)
        data = cloud.size * cloud.point_step
        layout = (cloud.fields, cloud.point_step, cloud.big_endian, cloud.frame_id)
        fits = not window.clouds or window.layout == layout
        if number > window.number or not fits or window.size + data > limits().message_bytes:
            yield from self._join(message.channel, window, (message.log_time_ns, message.publish_time_ns))
        window.number, window.layout = number, layout
        window.clouds.append(replace(cloud, stamp_ns=stamp_ns))
        window.size += data

    def _join(self, channel: Channel, window: _Window, times: tuple[int, int]) -> Iterator[Message]:
        clouds, window.clouds, window.size = window.clouds, [], 0
        if not clouds:
            return
        joined, number = _joined(channel), window.frames
        window.frames += 1
        codec = CODECS[joined.schema.name if joined.schema else "", joined.message_encoding]
        try:
            data = codec.encode(_one(clouds))
        except CloudError as error:
            self.report(f"frame {number} of {channel.topic} cannot be written ({error})", 0, 1)
            return
        yield Message(joined, *times, number, data)


def _joined(channel: Channel) -> Channel:
    return points_channel(channel) if has_fixed_fields(channel) else channel


def _one(clouds: Sequence[Cloud]) -> Cloud:
    """Return an unorganised cloud of the points of clouds with the same layout, with the earliest stamp."""
    start_ns = min(cloud.stamp_ns for cloud in clouds)
    shifted = [_shifted(cloud, start_ns) for cloud in clouds]
    data, width = memoryview(b"".join(points.tobytes() for points in shifted)), sum(map(len, shifted))
    dense = all(cloud.dense for cloud in clouds)
    return replace(clouds[0], stamp_ns=start_ns, height=1, width=width, row_step=len(data), data=data, dense=dense)


def _shifted(cloud: Cloud, start_ns: int) -> NDArray[np.void]:
    """Return the points of a cloud, shape (N,), with their times relative to an earlier stamp."""
    points: NDArray[np.void] = cloud.points
    late_ns = cloud.stamp_ns - start_ns
    names = [name for name in points.dtype.names or () if name in _RELATIVE and points.dtype[name].itemsize == 4]
    if not late_ns or not names:
        return points
    points = points.copy()
    for name in names:
        is_float = points.dtype[name].kind == "f"
        points[name] += points.dtype[name].type(late_ns / 1e9 if is_float else late_ns)
    return points
