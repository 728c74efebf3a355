"""A lidar whose packets have a revolution, a number, a time, and eight points."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from seaclutter.plugins import (
    NO_END,
    DecoderOptions,
    PacketFamily,
    PacketFrame,
    Packets,
    SensorFacts,
    point_dtype,
    view_packets,
)

MAGIC = np.frombuffer(b"EXLI", "<u4")[0]
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "u1"), ("ring", "u1")])
PACKET = np.dtype(
    [("magic", "<u4"), ("revolution", "<u4"), ("number", "<u4"), ("time_ns", "<i8"), ("points", POINT, 8)]
)


class ExampleLidar(PacketFamily):
    """Recognises the packets of the lidar."""

    title = "Example lidar"

    def recognises(self, payload: NDArray[np.uint8]) -> bool:
        """Return whether a UDP payload is one of its packets."""
        return payload.size == PACKET.itemsize and payload[:4].tobytes() == b"EXLI"

    def decoder(self, packets: Packets, options: DecoderOptions) -> "Decoder":
        """Return a decoder for one lidar."""
        return Decoder()


class Decoder:
    """Joins packets to revolutions."""

    places_end = NO_END

    def __init__(self) -> None:
        self.facts = SensorFacts("Example lidar")
        self._rows: list[NDArray[np.void]] = []
        self._last = -1

    def places(self, packets: Packets) -> NDArray[np.int64]:
        """Return the number of each packet, by which they are put in order, and copies left out."""
        found = np.full(len(packets), -1, np.int64)
        rows = view_packets(packets.payloads, PACKET)
        return np.where(rows["magic"] == MAGIC, rows["number"].astype(np.int64), -1) if len(rows) else found

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the revolutions that packets complete."""
        rows = view_packets(packets.payloads, PACKET)
        good = rows[rows["magic"] == MAGIC]
        self.facts.bad_packets += len(packets) - len(good)
        for row in good:
            if self._last >= 0:
                self.facts.lost_packets += max(0, int(row["number"]) - self._last - 1)
            self._last = int(row["number"])
            if self._rows and row["revolution"] != self._rows[-1]["revolution"]:
                yield from self.finish()
            self._rows.append(row)

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the points that wait."""
        if not self._rows:
            return
        rows, self._rows = np.array(self._rows, PACKET), []
        points = np.zeros(rows["points"].size, point_dtype())
        for name in POINT.names or ():
            points[name] = rows["points"][name].reshape(-1)
        points["timestamp"] = np.repeat(rows["time_ns"] * 1e-9, 8)
        yield PacketFrame(points, int(rows["time_ns"][0]))
