"""How long frames take, in constant memory."""

import math

import numpy as np

_LEAST_S = 1e-7
_STEP = 1.01
_BINS = 2400


class Durations:
    """A histogram of seconds in steps of 1 %, from 0.1 µs to half an hour."""

    def __init__(self) -> None:
        self.counts = np.zeros(_BINS, np.int64)

    def add(self, seconds: float) -> None:
        """Count a duration."""
        place = math.log(max(seconds, _LEAST_S) / _LEAST_S) / math.log(_STEP)
        self.counts[min(int(place), _BINS - 1)] += 1

    def update(self, other: "Durations") -> None:
        """Add all that another one counted."""
        self.counts += other.counts

    def quantile(self, share: float) -> float | None:
        """Return the least duration that at least this share of all do not exceed, in seconds; None without any.

        Examples
        --------
        >>> durations = Durations()
        >>> for seconds in (0.001, 0.002, 0.1):
        ...     durations.add(seconds)
        >>> round(durations.quantile(0.5), 4)
        0.002
        """
        below = np.cumsum(self.counts)
        if not below[-1]:
            return None
        place = int(np.searchsorted(below, max(1, math.ceil(share * int(below[-1]) - 1e-9))))
        return float(_LEAST_S * _STEP ** (place + 0.5))
