"""Packets of many messages at once."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.errors import CloudError
from seaclutter_cli.records import Buffer, Message
from seaclutter_cli.sensors.packets import Packets
from seaclutter_cli.sources.shared.packet_messages import (
    LATEST_NS,
    NANO,
    has_single_packets,
    read_packets,
    read_places,
    runs,
)


@dataclass
class Batch:
    """The packets of messages of one topic.

    Parameters
    ----------
    packets : list of Packets
        All packets in order, in runs of equal length.
    frame_id : str or None
        Coordinate frame in the last message that names one.
    problems : list of tuple of int and CloudError
        Messages that cannot be read, by position.
    """

    packets: list[Packets] = field(default_factory=list)
    frame_id: str | None = None
    problems: list[tuple[int, CloudError]] = field(default_factory=list)


def read_batch(messages: Sequence[Message]) -> Batch:
    """Return the packets of messages of one topic.

    Notes
    -----
    Messages with one packet differ only in stamps, flags and payloads if their lengths are equal. They are read as
    one array, which is several times faster than one after the other.
    """
    batch, at = Batch(), 0
    for _, group in groupby(messages, key=lambda message: len(message.data)):
        alike = list(group)
        if len(alike) == 1 or not _read_alike(alike, batch):
            _read_each(alike, batch, at)
        at += len(alike)
    return batch


def _read_each(messages: Sequence[Message], batch: Batch, first: int) -> None:
    """Add the packets of messages, of which the first has a position in the batch."""
    times_ns: list[int] = []
    payloads: list[Buffer] = []
    for number, message in enumerate(messages, first):
        try:
            read = read_packets(message)
        except CloudError as error:
            batch.problems.append((number, error))
            continue
        times_ns += read.times_ns
        payloads += read.payloads
        batch.frame_id = batch.frame_id if read.frame_id is None else read.frame_id
    batch.packets += runs(times_ns, payloads)


def _read_alike(messages: Sequence[Message], batch: Batch) -> bool:
    """Add the packets of messages of equal length with one packet each; return whether they are alike."""
    if not has_single_packets(messages[0].channel):
        return False
    try:
        first, places = read_places(messages[0])
    except CloudError:
        return False
    rows = np.frombuffer(b"".join(message.data for message in messages), np.uint8).reshape(len(messages), -1)
    if (rows[:, places.fixed] != rows[0, places.fixed]).any():
        return False
    times_ns = np.array([min(message.log_time_ns, LATEST_NS) for message in messages], np.int64)
    if places.stamp is not None:
        stamps_ns = _stamps(rows[:, places.stamp : places.stamp + 8], places.order)
        times_ns = np.where(stamps_ns == 0, times_ns, stamps_ns)
    batch.packets.append(Packets(times_ns, rows[:, places.payload]))
    batch.frame_id = batch.frame_id if first.frame_id is None else first.frame_id
    return True


def _stamps(data: NDArray[np.uint8], order: str) -> NDArray[np.int64]:
    """Return the times in stamps, shape (M, 8), in nanoseconds of Unix time."""
    sec, nanosec = np.ascontiguousarray(data).view(order + "u4").astype(np.int64).T
    return np.asarray(sec * NANO + nanosec)
