"""Latched topics: a message stays valid until the next one, so a part of a log needs the last one before it."""

import re
from collections.abc import Collection, Iterator
from dataclasses import replace

from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import declares_latched, find_codec
from seaclutter_cli.records import Channel, Message

_TOPICS = re.compile(r"(^|/)(tf_static|robot_description)$")
_TYPES = re.compile(r"(^|/|\.)(CameraInfo|CameraCalibration)$")


def is_latched(channel: Channel) -> bool:
    """Return whether subscribers that come late get the last message of a channel.

    These are channels with the ROS 1 connection header ``latching`` or the ROS 2 durability ``transient_local``,
    static transforms, descriptions of robots, and calibrations of cameras.
    """
    kind = channel.schema.name if channel.schema else ""
    return bool(declares_latched(channel) or _TOPICS.search(channel.topic) or _TYPES.search(kind))


def latched_before(source: Source, start_ns: int, topics: Collection[str] = ()) -> Iterator[Message]:
    """Yield the last message before a time of each latched channel, with this time as log time.

    Parameters
    ----------
    source : Source
        The recording.
    start_ns : int
        Log time.
    topics : collection of str, optional
        Further topics to treat as latched.
    """
    channels = [c for c in source.channels if (is_latched(c) or c.topic in topics) and find_codec(c) is None]
    damage = list(source.damage)
    for message in source.latest([channel.id for channel in channels], start_ns) if channels else ():
        yield replace(message, log_time_ns=start_ns)
    source.damage[:] = damage  # of parts that are not selected
