"""Packets of a sensor, and what turns them into frames."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.records import SensorFacts


@dataclass(frozen=True)
class Packets:
    """Some packets of one sensor in the order of their arrival, P of them, all of one length.

    Parameters
    ----------
    times_ns : ndarray, shape (P,), int64
        When each was recorded, in nanoseconds of Unix time.
    payloads : ndarray, shape (P, L), uint8
        UDP payloads of L bytes.
    """

    times_ns: NDArray[np.int64]
    payloads: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.times_ns)


@dataclass(frozen=True)
class PacketFrame:
    """One turn of a sensor.

    Parameters
    ----------
    points : ndarray, shape (N,)
        Structured: x, y, z in metres and intensity as float32, ring as uint16, timestamp in seconds of Unix time as
        float64, and ``return_number`` as uint8 where the sensor gives two; in the order of firing.
    stamp_ns : int
        Stamp of the frame.
    height : int
        Rows, where the frame is organised; 1 otherwise.
    partial : bool
        Whether the recording begins or ends within the turn.
    """

    points: NDArray[np.void]
    stamp_ns: int
    height: int = 1
    partial: bool = False


@dataclass(frozen=True)
class DecoderOptions:
    """What packets cannot tell.

    Parameters
    ----------
    calibration : Path or None
        Angles of the unit (RoboSense, Hesai) or its metadata (Ouster), where the recording lacks them.
    model : str or None
        Sensor model, where packets of several look alike.
    """

    calibration: Path | None = None
    model: str | None = None


class PacketDecoder(Protocol):
    """Decodes the packets of one sensor; keeps the turn that is not complete yet."""

    facts: SensorFacts

    def add(self, packets: Packets) -> Iterator[PacketFrame]:
        """Yield the frames that these packets complete. Bad packets are counted, never raised."""
        ...

    def finish(self) -> Iterator[PacketFrame]:
        """Yield what is left, as a partial frame."""
        ...


class PacketFamily(Protocol):
    """The sensors of one maker, as far as one decoder covers them."""

    title: str
    """What it is, for people."""
    scan_types: Mapping[str, str]
    """ROS message types that hold packets (``velodyne_msgs/msg/VelodyneScan``), and the field that has them."""

    def recognises(self, payload: NDArray[np.uint8]) -> bool:
        """Tell by its content whether a UDP payload, shape (L,), is a packet of this family, data or calibration."""
        ...

    def decoder(self, packets: Packets, options: DecoderOptions) -> PacketDecoder:
        """Return a decoder for a sensor, told by some of its packets; `InputError` if it needs to know more."""
        ...


def point_dtype(*, returns: bool = False) -> np.dtype[Any]:
    """Return the dtype of decoded points: RoboSense's driver layout, with the number of the return if there are two."""
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")]
    return np.dtype([*fields, ("return_number", "u1")] if returns else fields)
