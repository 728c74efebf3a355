"""Blocks of RoboSense data packets: which are sound, when they were fired, how far the sensor turned in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.robosense.device import Device
from seaclutter_cli.sensors.robosense.models import BLOCKS
from seaclutter_cli.sensors.robosense.packets import BLOCK_ID

BLIND = 100
"""Step from block to block, in hundredths of a degree, above which the sensor was blind between them."""


@dataclass(frozen=True)
class Blocks:
    """Some blocks in order, B of them.

    Parameters
    ----------
    azimuth, step : ndarray, shape (B,), int64
        Where each begins and how far it turns until the next, in hundredths of a degree.
    times_ns : ndarray, shape (B,), int64
        When each begins.
    second : ndarray, shape (B,), bool
        Whether it holds second returns.
    channels : ndarray, shape (B,)
        Bytes of distances and intensities.
    """

    azimuth: NDArray[np.int64]
    step: NDArray[np.int64]
    times_ns: NDArray[np.int64]
    second: NDArray[np.bool_]
    channels: NDArray[Any]

    def __len__(self) -> int:
        return len(self.azimuth)

    def part(self, start: int, end: int) -> "Blocks":
        """Return the blocks of a range, as views."""
        return Blocks(*(column[start:end] for column in self._columns()))

    def copy(self) -> "Blocks":
        """Return blocks that do not hold on to the packets they came from."""
        return Blocks(*(column.copy() for column in self._columns()))

    def _columns(self) -> tuple[NDArray[Any], ...]:
        return self.azimuth, self.step, self.times_ns, self.second, self.channels


def join(parts: Sequence[Blocks]) -> Blocks:
    """Return parts as one."""
    if len(parts) == 1:
        return parts[0]
    return Blocks(*(np.concatenate(columns) for columns in zip(*(part._columns() for part in parts), strict=True)))  # noqa: SLF001


def sound_blocks(blocks: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which blocks, shape (P, 12), can be used: one that is none ends its packet; azimuths are below 360."""
    return np.logical_and.accumulate(blocks["id"] == BLOCK_ID, axis=1) & (blocks["azimuth"] < 36000)


def steps(azimuth: NDArray[np.int64], device: Device) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return how far the sensor turns in each block, and when the block begins after its packet's first.

    Parameters
    ----------
    azimuth : ndarray, shape (P, 12), int64
        Azimuths of the blocks.
    device : Device
        The sensor.

    Returns
    -------
    step, time_ns : ndarray, shape (P, 12), int64
        Hundredths of a degree, and nanoseconds.
    """
    stride = 2 if device.paired else 1
    first = azimuth[:, ::stride]
    step = np.diff(first, axis=1)
    step += np.where(step < 0, 36000, 0)
    blind = step > BLIND
    step[blind] = device.step
    time_ns = np.zeros(first.shape, np.int64)
    np.cumsum(np.where(blind, device.gap_ns, device.step_ns), axis=1, out=time_ns[:, 1:])
    last = np.full((len(first), 1), device.step, np.int64)
    step = np.concatenate([step, last], axis=1)
    return np.repeat(step, stride, axis=1), np.repeat(time_ns, stride, axis=1)


def second_returns(packets: int, device: Device) -> NDArray[np.bool_]:
    """Return which blocks of packets hold second returns, shape (P, 12)."""
    odd = np.arange(BLOCKS) % 2 == 1
    return np.broadcast_to(odd & device.paired, (packets, BLOCKS))
