"""Blocks of RoboSense data packets: validity, firing times and rotation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.robosense.device import Device
from seaclutter_cli.sensors.robosense.models import BLOCKS
from seaclutter_cli.sensors.robosense.packets import BLOCK_ID

BLIND = 100
"""Azimuth step between blocks, in hundredths of a degree, above which a blind sector separates them."""


@dataclass(frozen=True)
class Blocks:
    """B blocks in order.

    Parameters
    ----------
    azimuth, step : ndarray, shape (B,), int64
        Azimuth at the start of each block and rotation until the next, in hundredths of a degree.
    times_ns : ndarray, shape (B,), int64
        Start times in nanoseconds of Unix time.
    second : ndarray, shape (B,), bool
        Whether each block contains second returns.
    channels : ndarray, shape (B,)
        Raw bytes of distances and intensities.
    """

    azimuth: NDArray[np.int64]
    step: NDArray[np.int64]
    times_ns: NDArray[np.int64]
    second: NDArray[np.bool_]
    channels: NDArray[Any]

    def __len__(self) -> int:
        return len(self.azimuth)

    def part(self, start: int, end: int) -> "Blocks":
        """Return a range of blocks, as views."""
        return Blocks(*(column[start:end] for column in self._columns()))

    def copy(self) -> "Blocks":
        """Return a copy that does not keep the packets in memory."""
        return Blocks(*(column.copy() for column in self._columns()))

    def _columns(self) -> tuple[NDArray[Any], ...]:
        return self.azimuth, self.step, self.times_ns, self.second, self.channels


def join(parts: Sequence[Blocks]) -> Blocks:
    """Return the concatenation of parts."""
    if len(parts) == 1:
        return parts[0]
    return Blocks(*(np.concatenate(columns) for columns in zip(*(part._columns() for part in parts), strict=True)))  # noqa: SLF001


def valid_blocks(blocks: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which blocks, shape (P, 12), are valid: azimuth below 360° and no invalid id up to the block."""
    return np.logical_and.accumulate(blocks["id"] == BLOCK_ID, axis=1) & (blocks["azimuth"] < 36000)


def steps(azimuth: NDArray[np.int64], device: Device) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rotation during each block, and its start time relative to the first block of its packet.

    Parameters
    ----------
    azimuth : ndarray, shape (P, 12), int64
        Azimuths of the blocks in hundredths of a degree.
    device : Device
        The sensor.

    Returns
    -------
    step, time_ns : ndarray, shape (P, 12), int64
        Rotation in hundredths of a degree, and start time in nanoseconds.
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
    """Return which blocks of P packets contain second returns, shape (P, 12)."""
    odd = np.arange(BLOCKS) % 2 == 1
    return np.broadcast_to(odd & device.paired, (packets, BLOCKS))
