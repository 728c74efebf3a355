"""Clock of a RoboSense sensor against that of whoever recorded it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

DAY_NS = 86400 * 10**9
_LAST_S = 9_000_000_000


def header_times(packets: NDArray[Any], *, helios: bool) -> NDArray[np.int64]:
    """Return the times in the headers of data packets, shape (P,), as nanoseconds of UTC; 0 where there is none."""
    if helios:
        time = packets["helios_time"]
        seconds = time["high"].astype(np.int64) << 32 | time["low"]
        return np.where(seconds < _LAST_S, seconds, 0) * 10**9 + time["microseconds"].astype(np.int64) * 1000
    time = packets["classic_time"]
    year, month, day, hour, minute, second = time["date"].astype(np.int64).T
    months = ((year + 30) * 12 + month - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]").astype(np.int64) + day - 1
    seconds = days * 86400 + hour * 3600 + minute * 60 + second
    sound = (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31) & (hour < 24) & (minute < 60) & (second <= 60)
    microseconds = time["milliseconds"].astype(np.int64) * 1000 + time["microseconds"]
    return np.where(sound & (seconds < _LAST_S), seconds * 10**9 + microseconds * 1000, 0)


def are_off(header_ns: NDArray[np.int64], record_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell which times of a sensor are more than a day from those of the recording, where it has any."""
    off: NDArray[np.bool_] = (np.abs(header_ns - record_ns) > DAY_NS) & (record_ns != 0)
    return off


class RobosenseClock:
    """Unix time of packets. Where a sensor's clock is wrong, it tells only the time from the start of a turn.

    Parameters
    ----------
    packet_ns : int
        Time from the first firing of a packet to its sending.

    Notes
    -----
    State: by how much the clock is to be set right in the turn that goes on.
    """

    def __init__(self, packet_ns: int) -> None:
        self._packet_ns = packet_ns
        self._shift_ns: int | None = None

    def times(
        self, header_ns: NDArray[np.int64], record_ns: NDArray[np.int64], turn: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return when the first laser of each packet fired.

        Parameters
        ----------
        header_ns, record_ns : ndarray, shape (P,), int64
            Times of the sensor and of the recording; the latter 0 where it is not known.
        turn : ndarray, shape (P,), int64
            Turn of each packet's first block, ascending; 0 for the one that goes on.
        """
        sent_ns = record_ns - self._packet_ns
        wrong = are_off(header_ns, record_ns)
        if not wrong.any():
            self._shift_ns = None
            return header_ns
        turns, first, inverse = np.unique(turn[wrong], return_index=True, return_inverse=True)
        shifts = (sent_ns - header_ns)[wrong][first]
        if turns[0] == 0 and self._shift_ns is not None:
            shifts[0] = self._shift_ns
        self._shift_ns = int(shifts[-1]) if turns[-1] == turn[-1] else None
        times = header_ns.copy()
        times[wrong] += shifts[inverse]
        return np.where(are_off(times, record_ns), sent_ns, times)
