"""Times of RoboSense packets: Unix time from the sensor clock and the recording times, and gaps of lost packets."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.sensors.packets import DAY_NS
from seaclutter_cli.sensors.robosense.device import Device
from seaclutter_cli.sensors.robosense.points import BLIND

_CLOCK_JUMP_NS = 3600 * 10**9
_MAX_S = 9_000_000_000


def header_times(packets: NDArray[Any], *, is_utc: bool) -> NDArray[np.int64]:
    """Return the header times of data packets, shape (P,), in nanoseconds of UTC; 0 for invalid times."""
    time = packets["time"]
    if is_utc:
        seconds = time["high"].astype(np.int64) << 32 | time["low"]
        return np.where(seconds < _MAX_S, seconds, 0) * 10**9 + time["microseconds"].astype(np.int64) * 1000
    year, month, day, hour, minute, second = time["date"].astype(np.int64).T
    months = ((year + 30) * 12 + month - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]").astype(np.int64) + day - 1
    seconds = days * 86400 + hour * 3600 + minute * 60 + second
    valid = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31) & (hour < 24) & (minute < 60) & (second <= 60)
    microseconds = time["milliseconds"].astype(np.int64) * 1000 + time["microseconds"]
    return np.where(valid & (seconds < _MAX_S), seconds * 10**9 + microseconds * 1000, 0)


def wrong_times(header_ns: NDArray[np.int64], record_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which sensor times differ from known recording times by more than a day."""
    off: NDArray[np.bool_] = (np.abs(header_ns - record_ns) > DAY_NS) & (record_ns != 0)
    return off


class RobosenseClock:
    """Converter from sensor time to Unix time.

    If the sensor clock is wrong, only the time since the start of a revolution is used. ``packet_ns`` is the time from
    the first firing of a packet to its transmission.

    Notes
    -----
    State: the clock correction of the current revolution.
    """

    def __init__(self, packet_ns: int) -> None:
        self._packet_ns = packet_ns
        self._shift_ns: int | None = None

    def times(
        self, header_ns: NDArray[np.int64], record_ns: NDArray[np.int64], revolution: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the time at which the first laser of each packet fired, in nanoseconds of Unix time.

        Parameters
        ----------
        header_ns, record_ns : ndarray, shape (P,), int64
            Sensor and recording times; an unknown recording time is 0.
        revolution : ndarray, shape (P,), int64
            Revolution of each packet's first block, ascending; 0 for the current revolution.
        """
        sent_ns = record_ns - self._packet_ns
        wrong = wrong_times(header_ns, record_ns)
        if not wrong.any():
            self._shift_ns = None
            return header_ns
        revolutions, first, inverse = np.unique(revolution[wrong], return_index=True, return_inverse=True)
        shifts = (sent_ns - header_ns)[wrong][first]
        if revolutions[0] == 0 and self._shift_ns is not None:
            shifts[0] = self._shift_ns
        self._shift_ns = int(shifts[-1]) if revolutions[-1] == revolution[-1] else None
        times = header_ns.copy()
        times[wrong] += shifts[inverse]
        return np.where(wrong_times(times, record_ns), sent_ns, times)


class RobosenseLosses:
    """Counter of lost packets. A gap of more than an hour is treated as a clock adjustment.

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
