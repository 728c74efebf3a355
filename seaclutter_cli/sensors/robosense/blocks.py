"""Blocks of RoboSense data packets: validity, firing times and rotation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.robosense.device import Device
from seaclutter_cli.sensors.robosense.models import PacketFormat

_WHOLE = 0xFFFF
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


def valid_blocks(blocks: NDArray[Any], layout: PacketFormat) -> NDArray[np.bool_]:
    """Return which blocks, shape (P, B), are valid: azimuth below 360° and no invalid id up to the block."""
    mask, value = layout.block_id
    ids = blocks["id"] if mask == _WHOLE else blocks["id"] & mask
    return np.logical_and.accumulate(ids == value, axis=1) & (blocks["azimuth"] < 36000)


def steps(azimuth: NDArray[np.int64], device: Device) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rotation during each block, and its start time relative to the first block of its packet.

    Parameters
    ----------
    azimuth : ndarray, shape (P, B), int64
        Azimuths of the blocks in hundredths of a degree.
    device : Device
        The sensor.

    Returns
    -------
    step, time_ns : ndarray, shape (P, B), int64
        Rotation in hundredths of a degree, and start time in nanoseconds.
    """
    if device.paired and azimuth.shape[1] % 2:
        return _steps_of_one_and_a_half(azimuth, device)
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


def _steps_of_one_and_a_half(azimuth: NDArray[np.int64], device: Device) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the result of `steps` for packets of three blocks: a pair and half a pair, or the other way round."""
    step = azimuth[:, 2] - azimuth[:, 0]
    step += np.where(step < 0, 36000, 0)
    blind = step > BLIND
    step[blind] = device.step
    late_ns = np.where(blind, device.gap_ns, device.step_ns)
    begins_with_pair = azimuth[:, 0] == azimuth[:, 1]
    steps, time_ns = np.full(azimuth.shape, device.step, np.int64), np.zeros(azimuth.shape, np.int64)
    steps[:, 0], time_ns[:, 2] = step, late_ns
    steps[begins_with_pair, 1] = step[begins_with_pair]
    time_ns[~begins_with_pair, 1] = late_ns[~begins_with_pair]
    return steps, time_ns


def second_returns(azimuth: NDArray[np.int64], device: Device, before: int) -> NDArray[np.bool_]:
    """Return which blocks of P packets contain second returns, shape (P, B).

    Parameters
    ----------
    azimuth : ndarray, shape (P, B), int64
        Azimuths of the blocks in hundredths of a degree.
    device : Device
        The sensor.
    before : int
        Azimuth of the block before.
    """
    blocks = azimuth.shape[1]
    if device.paired and blocks % 2:
        # Pairs extend from one packet into the next.
        return np.asarray(np.diff(azimuth.ravel(), prepend=before) == 0).reshape(azimuth.shape)
    return np.broadcast_to((np.arange(blocks) % 2 == 1) & device.paired, azimuth.shape)
