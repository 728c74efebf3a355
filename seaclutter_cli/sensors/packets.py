"""Packets of a sensor, the interface of their decoders, and what decoders share."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Bytes, Floats, Ints, Mask, Rows
from seaclutter_cli.documents import read_document
from seaclutter_cli.records import SensorFacts

CALIBRATION_SUFFIXES: Mapping[str, str] = {"ouster": ".json"}
"""Suffix of the calibration file that usually accompanies a capture, by family."""

EXPERIMENTAL = {"decoder": "experimental, not checked with packets of a real sensor"}
"""Fact about sensors of which no real packets were available."""

DAY_NS = 86_400 * 10**9
_DRIFT_NS = 1_000_000_000
_MAX_GAP = 100_000


@dataclass(frozen=True)
class Packets:
    """P packets of one sensor in order of arrival, all of the same length.

    ``times_ns``, shape (P,), are recording times in nanoseconds of Unix time; ``payloads``, shape (P, L), are UDP
    payloads of L bytes.
    """

    times_ns: Ints
    payloads: Bytes

    def __len__(self) -> int:
        return len(self.times_ns)

    def __getitem__(self, rows: Any) -> "Packets":
        return Packets(self.times_ns[rows], self.payloads[rows])

    @classmethod
    def joined(cls, parts: Sequence["Packets"]) -> "Packets":
        """Return the packets of all parts."""
        return cls(np.concatenate([part.times_ns for part in parts]), np.concatenate([part.payloads for part in parts]))


@dataclass(frozen=True)
class PacketFrame:
    """Points of one revolution, stamped in nanoseconds of Unix time.

    Points, shape (N,), are structured: x, y, z in metres and intensity as float32, ring as uint16, timestamp in seconds
    of Unix time as float64, and ``return_number`` as uint8 if the sensor sends two returns; in firing order. A
    frame is partial if the recording begins or ends within the revolution.
    """

    points: Rows
    stamp_ns: int
    partial: bool = False


@dataclass(frozen=True)
class DecoderOptions:
    """Settings that packets do not contain.

    ``calibration`` is a file with the unit's angles (RoboSense, Hesai, Velodyne) or metadata (Ouster), if the recording
    lacks them; it precedes ``recorded``, the metadata (Ouster) or angle correction file (Hesai) that the recording
    contains. ``model`` is for packets that several models share. ``info``, shape (I, M), are calibration packets of the
    sensor, if their length is not that of its data packets.
    """

    calibration: Path | None = None
    model: str | None = None
    recorded: bytes | None = None
    info: Bytes | None = None

    @property
    def unit(self) -> tuple[bytes, str] | None:
        """Calibration of the unit, and the name of its file or what stands for it; None without one."""
        if self.calibration is not None:
            return read_document(self.calibration), str(self.calibration)
        return None if self.recorded is None else (self.recorded, "recorded with the packets")


class PacketDecoder(Protocol):
    """Decoder for the packets of one sensor; keeps the incomplete revolution between calls."""

    facts: SensorFacts
    places_end: int
    """End of the range of places, after which they begin again."""

    def places(self, packets: Packets) -> Ints:
        """Return the place of each packet among those of the sensor, shape (P,): a number or a time; -1 without one."""

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete. Invalid packets are counted and raise no error."""

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the remaining points as a partial frame."""


class PacketFamily(ABC):
    """Sensors of one maker that share a decoder."""

    title: str
    """Name shown to users."""
    calibrates = False
    """Whether the sensors send their calibration in packets."""

    @abstractmethod
    def recognises(self, payload: Bytes) -> bool:
        """Return whether a UDP payload, shape (L,), is a data or calibration packet of this family."""

    def is_calibration(self, payloads: Bytes) -> Mask:
        """Return which UDP payloads, shape (P, L), contain a calibration."""
        return np.zeros(len(payloads), np.bool_)

    @abstractmethod
    def decoder(self, packets: Packets, options: DecoderOptions) -> PacketDecoder:
        """Return a decoder for the sensor that sent these packets; `InputError` if information is missing."""


NO_END = 1 << 62
"""End of the range of places that do not begin again."""


def view_packets(payloads: Bytes, layout: np.dtype[Any]) -> Rows:
    """Return payloads, shape (P, L), as packets of a layout, shape (P,); none if they have another length."""
    if payloads.shape[1] != layout.itemsize:
        return np.empty(0, layout)
    return np.ascontiguousarray(payloads).view(layout)[:, 0]


def unix_seconds(*civil: Ints) -> Ints:
    """Return seconds of Unix time, given arrays of years, months, days, hours, minutes and seconds."""
    year, month, day, hour, minute, second = civil
    months = ((year - 1970) * 12 + month - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]").astype(np.int64) + day - 1
    return np.asarray(days * 86_400 + hour * 3600 + minute * 60 + second)


def point_dtype(*, returns: bool = False) -> np.dtype[Any]:
    """Return the dtype of decoded points: RoboSense's driver layout, plus ``return_number`` for two returns."""
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")]
    return np.dtype([*fields, ("return_number", "u1")] if returns else fields)


def make_points(xyz: Iterable[NDArray[Any]], intensity: Any, ring: Any, times_s: Floats, number: Any = None) -> Rows:
    """Return points, shape (N,), of `point_dtype`, with return numbers if there are any."""
    points = np.empty(len(times_s), point_dtype(returns=number is not None))
    for name, values in zip(points.dtype.names or (), (*xyz, intensity, ring, times_s, number), strict=False):
        points[name] = values
    return points


class SensorClock:
    """Correction of a sensor clock that is not set, which is noted among facts about the sensor.

    A clock within a day of the recording time, or without a known one, is used as it is. Otherwise, only time
    differences are used, relative to the recording time of a reference packet. A new reference is chosen if the clocks
    diverge by more than a second.
    """

    def __init__(self, facts: SensorFacts | None = None) -> None:
        self._facts = facts
        self._shift_ns: int | None = None

    def shifts(self, sensor_ns: Ints, recorded_ns: Ints) -> Ints:
        """Return the corrections to add to the sensor's times of packets, given the recorder's, all in nanoseconds."""
        behind = recorded_ns - sensor_ns
        right = ((behind > -DAY_NS) & (behind < DAY_NS)) | (recorded_ns <= 0)
        found = [*map(self._shift, behind.tolist(), right.tolist())]
        if self._facts is not None and self._shift_ns is not None:
            self._facts.details["clock"] = "not synchronised, shifted to the recording time"
        return np.array(found, np.int64)

    def _shift(self, behind_ns: int, right: bool) -> int:
        """Return the correction of a packet: that of the one before, unless its clock is right or diverges from it."""
        if right:
            self._shift_ns = None
        elif self._shift_ns is None or abs(behind_ns - self._shift_ns) > _DRIFT_NS:
            self._shift_ns = behind_ns
        return self._shift_ns or 0


class LossCounter:
    """Counter of packets ``lost`` in a number that grows constantly and wraps; jumps of over 100,000 restart it."""

    def __init__(self, wrap: int = NO_END) -> None:
        self.lost = 0
        self._wrap = wrap
        self._last: int | None = None
        self._position = self._top = self._received = 0

    def add(self, numbers: Ints, period: float = 1.0) -> None:
        """Add the numbers of the next packets, shape (P,), which grow by ``period`` from packet to packet."""
        first = int(numbers[0]) if self._last is None else self._last
        half = self._wrap // 2
        steps = np.rint(((np.diff(numbers, prepend=first) + half) % self._wrap - half) / period)
        if self._last is None:
            steps[0] = 1
        positions = self._position + np.cumsum(np.where(abs(steps) > _MAX_GAP, 1, steps))
        self._top = max(self._top, int(positions.max()))
        self._position, self._last = int(positions[-1]), int(numbers[-1])
        self._received += len(numbers)
        self.lost = max(self._top - self._received, 0)
