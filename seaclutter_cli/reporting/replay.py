"""Filter results that are read back from a filtered log, not computed again.

The log was written by ``filter --keep-raw --with-removed``: the raw cloud is on its topic, the kept and the removed
points are on two additional topics, and each frame has a diagnostics message.
"""

from collections.abc import Iterator

import numpy as np

from seaclutter_cli.arrays import Bytes, Ints
from seaclutter_cli.errors import CloudError, InputError
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.interfaces import Source
from seaclutter_cli.messages import find_codec
from seaclutter_cli.messages.diagnostics import TOPIC, read_diagnostics
from seaclutter_cli.messages.metadata import DIAGNOSTICS, recorded_topics
from seaclutter_cli.reading import read, removed_points
from seaclutter_cli.records import Message
from seaclutter_cli.selection import Selection

_FILTERED, _REMOVED = "/filtered", "/removed"


def filtered_topics(source: Source) -> list[str]:
    """Return the cloud topics whose kept points, removed points and diagnostics are all in the log."""
    names = {channel.topic for channel in source.channels}
    clouds = (channel.topic for channel in source.channels if find_codec(channel))
    parts = ((one, (one + _FILTERED, one + _REMOVED, _diagnostics_topic(source, one))) for one in clouds)
    return [topic for topic, wanted in parts if names.issuperset(wanted)]


def _diagnostics_topic(source: Source, topic: str) -> str:
    recorded = recorded_topics(source.metadata)
    found = (name for name, one in recorded.items() if (one.content, one.clouds) == (DIAGNOSTICS, topic))
    return next(found, TOPIC)


def replay(source: Source, topic: str, selection: Selection) -> Iterator[FilterResult]:
    """Yield the filter results of the frames of a topic; frames without removed points or diagnostics are left out.

    Raise `CloudError` if a removed point is not in the raw cloud.
    """
    clouds = [channel for channel in source.channels if channel.topic == topic]
    diagnostics = _diagnostics_topic(source, topic)
    frame: Frame | None = None
    removed: Message | None = None
    for record, found_frame in read(source, clouds, selection):
        if found_frame is not None:
            frame, removed = found_frame, None
        elif not isinstance(record, Message) or frame is None:
            continue
        elif record.channel.topic == f"{topic}{_REMOVED}":
            removed = record
        elif record.channel.topic == diagnostics and removed is not None:
            try:
                found = read_diagnostics(record)
            except InputError as error:
                source.report(str(error), len(record.data), 1)
                continue
            if found.topic == topic and found.points_in == frame.size:
                yield FilterResult(frame, _reasons(frame, removed), found.rings, found.scene, found.water)
                frame = removed = None


def _reasons(frame: Frame, message: Message) -> Bytes:
    """Return the reasons of the points of a frame, given the message with those removed.

    Points are matched by their bytes; points with equal bytes are interchangeable.
    """
    raw = frame.cloud
    removed, reasons = removed_points(message)
    size = raw.dtype.itemsize
    both = (np.ascontiguousarray(one.points) for one in (removed, raw))
    rows = [points.view(np.uint8).reshape(len(points), points.itemsize)[:, :size] for points in both]
    alike = np.concatenate(rows).view(f"V{size}").reshape(-1)
    keys = np.unique(alike, return_inverse=True)[1].reshape(-1)
    if (indices := _find(keys[: removed.size], keys[removed.size :])) is None:
        raise CloudError(f"frame {frame.index}: a removed point is not in the raw cloud")
    reason = np.full(raw.size, Reason.KEPT, np.uint8)
    reason[indices] = reasons
    return reason


def _find(sought: Ints, among: Ints) -> Ints | None:
    """Return the index of each key in ``among``, distinct indices for equal keys; None if a key is missing."""
    order, others = np.argsort(sought, kind="stable"), np.argsort(among, kind="stable")
    ranked = sought[order]
    repeat = np.arange(len(ranked)) - np.searchsorted(ranked, ranked, side="left")
    index = np.searchsorted(among[others], ranked, side="left") + repeat
    if len(index) and (index.max() >= len(among) or (among[others][index] != ranked).any()):
        return None
    found = np.empty(len(sought), np.int64)
    found[order] = others[index]
    return found
