"""Unix time of Hesai and Ouster packets, from the sensor clock and the recording times."""

import numpy as np
from numpy.typing import NDArray

_DAY_NS = 86_400_000_000_000
_DRIFT_NS = 1_000_000_000


class SensorClock:
    """Correction of sensor clocks that are not set.

    A clock within a day of the recording time is used as it is. Otherwise, only time differences are used, relative to
    the recording time of a reference packet. A new reference is chosen if the clocks diverge by more than a second.

    Notes
    -----
    State: the current correction.
    """

    def __init__(self) -> None:
        self._shift_ns: int | None = None

    @property
    def is_wrong(self) -> bool:
        """Whether the last packet needed a correction."""
        return self._shift_ns is not None

    def shifts(self, sensor_ns: NDArray[np.int64], recorded_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the corrections to add to the times of packets, shape (P,), in nanoseconds.

        Parameters
        ----------
        sensor_ns, recorded_ns : ndarray, shape (P,), int64
            Time of each packet by the sensor clock and by the recorder's clock.
        """
        behind = recorded_ns - sensor_ns
        right = (behind > -_DAY_NS) & (behind < _DAY_NS)
        found = np.zeros(len(behind), np.int64)
        start = 0
        while start < len(behind):
            shift = self._begin(int(behind[start]), right=bool(right[start]))
            rest = behind[start:]
            other = ~right[start:] if shift is None else right[start:] | (abs(rest - shift) > _DRIFT_NS)
            end = start + int(other.argmax()) if other.any() else len(behind)
            found[start : max(end, start + 1)] = shift or 0
            start = max(end, start + 1)
        return found

    def _begin(self, behind_ns: int, *, right: bool) -> int | None:
        """Return the correction that starts at a packet; None if the clock is correct."""
        if right:
            self._shift_ns = None
        elif self._shift_ns is None or abs(behind_ns - self._shift_ns) > _DRIFT_NS:
            self._shift_ns = behind_ns
        return self._shift_ns
