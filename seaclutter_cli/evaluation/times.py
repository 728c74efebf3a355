"""Statistics of processing times in constant memory."""

import math

import numpy as np

_MIN_S = 1e-7
_STEP = 1.01
_BINS = 2400


class Durations:
    """Histogram of durations with bins of 1 %, from 0.1 µs to half an hour."""

    def __init__(self) -> None:
        self.counts = np.zeros(_BINS, np.int64)

    def add(self, seconds: float) -> None:
        """Add a duration."""
        index = math.log(max(seconds, _MIN_S) / _MIN_S) / math.log(_STEP)
        self.counts[min(int(index), _BINS - 1)] += 1

    def update(self, other: "Durations") -> None:
        """Add the counts of another histogram."""
        self.counts += other.counts

    def quantile(self, share: float) -> float | None:
        """Return the quantile for a share from 0 to 1, in seconds; None for an empty histogram.

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
        index = int(np.searchsorted(below, max(1, math.ceil(share * int(below[-1]) - 1e-9))))
        return float(_MIN_S * _STEP ** (index + 0.5))
