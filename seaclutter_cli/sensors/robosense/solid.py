"""Decoder for RoboSense's lidars without a rotor: RS-M1 and RS-E1."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.errors import InputError
from seaclutter_cli.records import SensorFacts
from seaclutter_cli.sensors.packets import (
    EXPERIMENTAL,
    NO_END,
    DecoderOptions,
    PacketFamily,
    PacketFrame,
    Packets,
    SensorClock,
    make_points,
    view_packets,
)
from seaclutter_cli.sensors.robosense.packets import HELIOS_TIME, header_times

_ID = bytes.fromhex("55aa5aa5")
_M1_CHANNEL = np.dtype(
    [("distance", ">u2"), ("pitch", ">u2"), ("yaw", ">u2"), ("intensity", "u1"), ("attributes", "V2")]
)
_E1_CHANNEL = np.dtype([("distance", ">u2"), ("direction", ">i2", (3,)), ("intensity", "u1"), ("attributes", "V1")])
_UNIT_M, _MOST_M = np.float32(0.005), np.float32(200)
_ANGLE_OFFSET, _MIN_ANGLE, _MAX_ANGLE = 32768, -9000, 45000
_VECTOR_BASE = np.float32(32768)
_LATE = 10
"""Packets whose number is at most this much lower than the one before are late; lower ones begin a frame."""
_MAX_POINTS = 4_000_000


@dataclass(frozen=True)
class SolidModel:
    """A model: its data packets, whose blocks have a time and channels, and its least valid distance.

    ``positions`` returns x, y, z, shape (3, ...), of channels and their distances in metres, shape (...,).
    """

    name: str
    packet: np.dtype[Any]
    least_m: float
    positions: Callable[[NDArray[Any], NDArray[np.float32]], NDArray[np.float32]]


def _m1_positions(channels: NDArray[Any], range_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return positions from angles in hundredths of a degree, in the order of operations of RoboSense's driver."""
    pitch, yaw = (_radians(channels[name]) for name in ("pitch", "yaw"))
    across = range_m * np.cos(pitch).astype("f4")
    x, y = across * np.cos(yaw).astype("f4"), across * np.sin(yaw).astype("f4")
    return np.stack([x, y, range_m * np.sin(pitch).astype("f4")])


def _radians(angles: NDArray[Any]) -> Floats:
    hundredths = angles.astype(np.int64) - _ANGLE_OFFSET
    hundredths[(hundredths < _MIN_ANGLE) | (hundredths >= _MAX_ANGLE)] = 0  # as in the driver
    return np.asarray(hundredths * 0.01 * np.pi / 180)


def _e1_positions(channels: NDArray[Any], range_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return positions from unit vectors."""
    direction = np.moveaxis(channels["direction"].astype(np.float32), -1, 0)
    return np.asarray(direction * range_m / _VECTOR_BASE)


def _packet(channel: np.dtype[Any], channels: int, blocks: int, size: int, time: list[Any]) -> np.dtype[Any]:
    block = np.dtype([*time, ("channels", channel, (channels,))])
    names, formats = ["id", "number", "time", "blocks"], ["S4", ">u2", HELIOS_TIME, (block, (blocks,))]
    return np.dtype({"names": names, "formats": formats, "offsets": [0, 4, 10, 32], "itemsize": size})


_M1_PACKET = _packet(_M1_CHANNEL, 5, 25, 1210, [("late_us", "u1"), ("return", "u1")])
_E1_PACKET = _packet(_E1_CHANNEL, 1, 96, 1200, [("late_us", ">u2")])
_MODELS = {
    1210: SolidModel("RS-M1", _M1_PACKET, 0.2, _m1_positions),
    1200: SolidModel("RS-E1", _E1_PACKET, 0.005, _e1_positions),
}
"""Supported models, by the length of their packets."""


class RoboSenseSolid(PacketFamily):
    """RoboSense sensors whose packets contain the direction of each point."""

    title = "RoboSense RS-M1, RS-E1"

    def recognises(self, payload: NDArray[np.uint8]) -> bool:
        """Return whether a UDP payload, shape (L,), is a data packet."""
        return len(payload) in _MODELS and payload[:4].tobytes() == _ID

    def decoder(self, packets: Packets, options: DecoderOptions) -> "SolidDecoder":  # noqa: ARG002 - all is in packets
        """Return a decoder for the sensor that sent these packets; `InputError` if none of them has data."""
        model = _MODELS.get(packets.payloads.shape[1])
        if model is None or not any(map(self.recognises, packets.payloads)):
            raise InputError("RoboSense: no data packets of an RS-M1 or RS-E1")
        return SolidDecoder(model)


class SolidDecoder:
    """Decoder for the packets of one sensor. A frame ends where the numbers of packets begin again."""

    places_end = NO_END

    def __init__(self, model: SolidModel) -> None:
        details = {"angles": "in the packets", "intensity": "reflectivity, 0 to 255"}
        self.facts = SensorFacts(model.name, details | EXPERIMENTAL)
        self._model, self._clock = model, SensorClock(self.facts)
        self._parts: list[NDArray[np.void]] = []
        self._size = self._end_ns = self._longest = 0
        self._number: int | None = None
        self._begins_late = False

    def places(self, packets: Packets) -> Ints:
        """Return the times of data packets, shape (P,), and -1 for device information."""
        data = view_packets(packets.payloads, self._model.packet)
        return header_times(data, is_utc=True) if len(data) else np.full(len(packets), -1)

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete. Invalid packets are counted and raise no error."""
        if packets.payloads.shape[1] != self._model.packet.itemsize:
            return  # device information
        data = view_packets(packets.payloads, self._model.packet)
        valid = data["id"] == _ID
        self.facts.bad_packets += int((~valid).sum())
        data, recorded_ns = data[valid], packets.times_ns[valid]
        if not len(data):
            return
        times_ns = header_times(data, is_utc=True)
        times_ns = times_ns + self._clock.shifts(times_ns, recorded_ns)
        begin = 0
        for start in self._starts(data["number"].astype(int).tolist()):
            self._keep(data[begin:start], times_ns[begin:start])
            begin = start
            if self._parts:
                yield self._frame(partial=False)
        self._keep(data[begin:], times_ns[begin:])
        if self._size > _MAX_POINTS:
            yield self._frame(partial=True)

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the last frame."""
        if self._parts:
            yield self._frame(partial=self._number is None or self._number < self._longest)

    def _starts(self, numbers: list[int]) -> list[int]:
        """Return the positions of the packets that begin a frame, and count lost packets between the others."""
        starts = []
        for position, number in enumerate(numbers):
            if self._number is None:
                self._begins_late = number > 1
            elif number < self._number - _LATE:
                starts.append(position)
                self._longest = max(self._longest, self._number)
            elif number > self._number:
                self.facts.lost_packets += number - self._number - 1
            else:  # late, or twice
                late = number < self._number
                self.facts.lost_packets = max(self.facts.lost_packets - late, 0)
                continue
            self._number = number
        return starts

    def _keep(self, data: NDArray[np.void], times_ns: Ints) -> None:
        """Add the points of packets, shape (P,), to the current frame."""
        if not len(data):
            return
        blocks = data["blocks"]
        channels = blocks["channels"]
        range_m = channels["distance"].astype(np.float32) * _UNIT_M
        late_ns = blocks["late_us"].astype(np.int64) * 1000
        point_ns = np.broadcast_to((times_ns[:, None] + late_ns)[..., None], range_m.shape)
        hit = (range_m >= np.float32(self._model.least_m)) & (range_m <= _MOST_M)
        xyz = self._model.positions(channels[hit], range_m[hit])
        ring = np.broadcast_to(np.arange(range_m.shape[-1]), range_m.shape)[hit]
        points = make_points(xyz, channels["intensity"][hit], ring, point_ns[hit] / 1e9)
        self._parts.append(points)
        self._size += len(points)
        self._end_ns = int(point_ns[-1, -1, -1])

    def _frame(self, *, partial: bool) -> PacketFrame:
        points = np.concatenate(self._parts)
        partial |= self._begins_late
        self._parts, self._size, self._begins_late = [], 0, False
        return PacketFrame(points, self._end_ns, partial=partial)
