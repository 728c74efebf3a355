"""Packets of a sensor and the interface of their decoders."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.records import SensorFacts

CALIBRATION_SUFFIXES: Mapping[str, str] = {"ouster": ".json"}
"""Suffix of the calibration file that usually accompanies a capture, by family."""


@dataclass(frozen=True)
class Packets:
    """P packets of one sensor in order of arrival, all of the same length.

    Parameters
    ----------
    times_ns : ndarray, shape (P,), int64
        Recording times in nanoseconds of Unix time.
    payloads : ndarray, shape (P, L), uint8
        UDP payloads of L bytes.
    """

    times_ns: NDArray[np.int64]
    payloads: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.times_ns)


@dataclass(frozen=True)
class PacketFrame:
    """Points of one revolution.

    Parameters
    ----------
    points : ndarray, shape (N,)
        Structured: x, y, z in metres and intensity as float32, ring as uint16, timestamp in seconds of Unix time as
        float64, and ``return_number`` as uint8 if the sensor sends two returns; in firing order.
    stamp_ns : int
        Stamp of the frame in nanoseconds of Unix time.
    height : int
        Number of rows of an organised frame; 1 otherwise.
    partial : bool
        Whether the recording begins or ends within the revolution.
    """

    points: NDArray[np.void]
    stamp_ns: int
    height: int = 1
    partial: bool = False


@dataclass(frozen=True)
class DecoderOptions:
    """Settings that packets do not contain.

    Parameters
    ----------
    calibration : Path or None
        File with the unit's angles (RoboSense, Hesai, Velodyne) or metadata (Ouster), if the recording lacks them.
    model : str or None
        Sensor model, for packets that several models share.
    recorded : bytes or None
        Metadata (Ouster) or angle correction file (Hesai) that the recording contains; ``calibration`` precedes it.
    info : ndarray, shape (I, M), uint8, or None
        Calibration packets of the sensor, if their length is not that of its data packets.
    """

    calibration: Path | None = None
    model: str | None = None
    recorded: bytes | None = None
    info: NDArray[np.uint8] | None = None


def of_other_length(calibrations: Sequence[NDArray[np.uint8]], length: int) -> NDArray[np.uint8] | None:
    """Return the calibration packets whose length is not that of data packets, shape (I, M); None without any."""
    others = [payload for payload in calibrations if len(payload) != length]
    return np.stack(others) if others else None


class PacketDecoder(Protocol):
    """Decoder for the packets of one sensor; keeps the incomplete revolution between calls."""

    facts: SensorFacts

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete. Invalid packets are counted and raise no error."""
        ...

    def finish(self) -> Iterator[PacketFrame]:
        """Yield the remaining points as a partial frame."""
        ...


class PacketFamily(Protocol):
    """Sensors of one maker that share a decoder."""

    title: str
    """Name shown to users."""
    scan_types: Mapping[str, str]
    """ROS message types that contain packets (``velodyne_msgs/msg/VelodyneScan``), each with its packet field."""

    def recognises(self, payload: NDArray[np.uint8]) -> bool:
        """Return whether a UDP payload, shape (L,), is a data or calibration packet of this family."""
        ...

    def decoder(self, packets: Packets, options: DecoderOptions) -> PacketDecoder:
        """Return a decoder for the sensor that sent these packets; `InputError` if information is missing."""
        ...


def point_dtype(*, returns: bool = False) -> np.dtype[Any]:
    """Return the dtype of decoded points: RoboSense's driver layout, plus ``return_number`` for two returns."""
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")]
    return np.dtype([*fields, ("return_number", "u1")] if returns else fields)


@runtime_checkable
class SelfCalibrating(Protocol):
    """A family whose sensors send their calibration in packets."""

    def is_calibration(self, payloads: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which UDP payloads, shape (P, L), contain a calibration."""
        ...
