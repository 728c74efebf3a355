"""Lost packets of a RoboSense sensor, counted by gaps in the sensor time."""

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.robosense.blocks import BLIND
from seaclutter_cli.sensors.robosense.device import Device

_CLOCK_JUMP_NS = 3600 * 10**9


class RobosenseLosses:
    """Counter of lost packets. A gap of more than an hour is treated as a clock adjustment.

    Parameters
    ----------
    device : Device
        The sensor.

    Notes
    -----
    State: time, duration and azimuths of the last packet.
    """

    def __init__(self, device: Device) -> None:
        self._device = device
        self._period_ns = device.step_ns * device.model.blocks // (2 if device.paired else 1)
        self._last: tuple[NDArray[np.int64], ...] | None = None
        self.packets = 0

    def add(self, times_ns: NDArray[np.int64], after_ns: NDArray[np.int64], azimuth: NDArray[np.int64]) -> None:
        """Add packets in order.

        Parameters
        ----------
        times_ns : ndarray, shape (P,), int64
            Start times by the sensor clock.
        after_ns, azimuth : ndarray, shape (P, B), int64
            Start time of each block relative to its packet; azimuth of each block in hundredths of a degree.
        """
        columns = (times_ns, after_ns[:, -1] + self._device.step_ns, azimuth[:, 0], azimuth[:, -1])
        if self._last is not None:
            columns = tuple(np.concatenate(pair) for pair in zip(self._last, columns, strict=True))  # type: ignore[assignment]
        self._last = tuple(column[-1:].copy() for column in columns)
        times_ns, length_ns, first, last = columns
        excess = np.diff(times_ns) - length_ns[:-1]
        blind = (first[1:] - last[:-1]) % 36000 > BLIND
        excess -= np.where(blind, min(self._device.gap_ns, _CLOCK_JUMP_NS), 0)
        counted = (excess > 0) & (excess < _CLOCK_JUMP_NS)
        self.packets += int(((excess[counted] + self._period_ns // 2) // self._period_ns).sum())
