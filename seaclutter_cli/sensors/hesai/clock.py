"""Clocks of Hesai and Ouster sensors against that of whoever recorded them."""

import numpy as np
from numpy.typing import NDArray

_DAY_NS = 86_400_000_000_000
_DRIFT_NS = 1_000_000_000


class SensorClock:
    """Sets sensors right that do not know the time of day.

    A clock within a day of the recorder's is taken as it is. From another only differences are taken, from a packet on
    whose recorded time stands for it; anew where both clocks come apart by more than a second.

    Notes
    -----
    State: by how much the clock is set right.
    """

    def __init__(self) -> None:
        self._shift_ns: int | None = None

    @property
    def is_wrong(self) -> bool:
        """Whether the last clock seen had to be set right."""
        return self._shift_ns is not None

    def shifts(self, sensor_ns: NDArray[np.int64], recorded_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return what is to be added to the times of packets, shape (P,), in nanoseconds.

        Parameters
        ----------
        sensor_ns, recorded_ns : ndarray, shape (P,), int64
            When each packet was sent by either clock.
        """
        behind = recorded_ns - sensor_ns
        right = (behind > -_DAY_NS) & (behind < _DAY_NS)
        found = np.zeros(len(behind), np.int64)
        place = 0
        while place < len(behind):
            shift = self._begin(int(behind[place]), right=bool(right[place]))
            rest = behind[place:]
            other = ~right[place:] if shift is None else right[place:] | (abs(rest - shift) > _DRIFT_NS)
            end = place + int(other.argmax()) if other.any() else len(behind)
            found[place : max(end, place + 1)] = shift or 0
            place = max(end, place + 1)
        return found

    def _begin(self, behind_ns: int, *, right: bool) -> int | None:
        """Return the shift from a packet on; None if there is to be none."""
        if right:
            self._shift_ns = None
        elif self._shift_ns is None or abs(behind_ns - self._shift_ns) > _DRIFT_NS:
            self._shift_ns = behind_ns
        return self._shift_ns
