"""Statistics of processing times in constant memory."""

import math

import numpy as np
from numpy.typing import NDArray

_MIN_S = 1e-7
_STEP = 1.01
_BINS = 2400


class Durations:
    """Histogram of durations with bins of 1 %, from 0.1 µs to half an hour; one without durations takes no memory."""

    def __init__(self) -> None:
        self._counts: NDArray[np.int64] | None = None

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of durations in each bin."""
        if self._counts is None:
            self._counts = np.zeros(_BINS, np.int64)
        return self._counts

    @property
    def is_empty(self) -> bool:
        """Whether there is no duration."""
        return self._counts is None

    def add(self, seconds: float) -> None:
        """Add a duration."""
        index = math.log(max(seconds, _MIN_S) / _MIN_S) / math.log(_STEP)
        self.counts[min(int(index), _BINS - 1)] += 1

    def update(self, other: "Durations") -> None:
        """Add the counts of another histogram."""
        if not other.is_empty:
            self.counts[:] += other.counts

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
        if self.is_empty:
            return None
        below = np.cumsum(self.counts)
        index = int(np.searchsorted(below, max(1, math.ceil(share * int(below[-1]) - 1e-9))))
        return float(_MIN_S * _STEP ** (index + 0.5))
