"""Distribution of intensities in bounded memory and one pass: exact as far as possible, else within 0.1 % of rank."""

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

_WHOLE_LIMIT = 1 << 16
_DISTINCT = 1 << 16
_PENDING = 1 << 16
_BATCHES = 1 << 10
_LEVEL = 1 << 14

Distribution = tuple[NDArray[np.float64], NDArray[np.int64]]
"""Values in ascending order, and how often each occurs."""


class IntensityHistogram:
    """Counts of intensities.

    Exact for whole numbers from 0 to 65535, and for all others up to 65536 distinct ones; beyond that `QuantileSketch`
    keeps thresholds within 0.1 % of rank. Memory is 1 MB or less for whole numbers, 5 MB at most for others.
    """

    def __init__(self) -> None:
        self._whole = np.zeros(0, np.int64)
        self._others = QuantileSketch()
        self.all_whole = True
        """Whether every intensity so far is a whole number."""

    def add(self, intensity: NDArray[np.float64]) -> None:
        """Count finite intensities, shape (N,)."""
        whole = intensity == np.floor(intensity)
        self.all_whole = self.all_whole and bool(whole.all())
        counted = whole & (intensity >= 0) & (intensity < _WHOLE_LIMIT)
        counts = np.bincount(intensity[counted].astype(np.int64), minlength=len(self._whole))
        counts[: len(self._whole)] += self._whole
        self._whole = counts
        self._others.add(intensity[~counted])

    @property
    def rank_error(self) -> int:
        """Most points by which a rank can be wrong; 0 as long as all is exact."""
        return self._others.rank_error

    def distribution(self) -> Distribution:
        """Return the values and their counts; the sum of the counts is exact."""
        seen = np.flatnonzero(self._whole)
        values, counts = self._others.distribution()
        return _ascending(np.append(seen, values), np.append(self._whole[seen], counts))

    def threshold(self, filter_rate: float, *, whole: bool | None = None) -> float:
        """Return the smallest threshold T for which at least ``filter_rate`` of the intensities are below T.

        Parameters
        ----------
        filter_rate : float
            Share to be below the threshold, from 0 to 1.
        whole : bool, optional
            Whether T is to be a whole number; by default it is if all intensities are.

        Returns
        -------
        float
            The next whole number, or the next floating-point number, above the last intensity that is to go. 0 if
            nothing was counted.

        Examples
        --------
        >>> histogram = IntensityHistogram()
        >>> histogram.add(np.array([1.0, 1, 2, 7, 9]))
        >>> histogram.threshold(0.8)
        8.0
        """
        values, counts = self.distribution()
        if not len(values):
            return 0.0
        below = np.cumsum(counts)
        # As written, 0.8 is 4/5; the nearest floating-point number is a bit more, which counts among many points.
        needed = math.ceil(Fraction(repr(float(filter_rate))) * int(below[-1]))
        if needed <= 0:
            return float(values[0])
        last = float(values[np.searchsorted(below, needed)])
        following = math.nextafter(last, math.inf)
        return max(last + 1, following) if (self.all_whole if whole is None else whole) else following


class QuantileSketch:
    r"""Distribution of any values: exact up to 65536 distinct ones, then a summary of guaranteed rank error.

    Values that are too many are handed to a ladder of levels, on which a value of level h stands for :math:`2^h`
    values. When a level has 16384 values or more, they are sorted and every other one moves up a level [1]_. That
    changes a rank by :math:`2^h` at most, up or down as the first or the second of each pair moves, and the two take
    turns: for n values the error is at most :math:`n \log_2(n / 2^{14}) / 2^{15}`, below 0.1 % for less than 10^13.

    No randomness: the same values in the same order give the same summary.

    References
    ----------
    .. [1] Manku, Rajagopalan, Lindsay (1998). "Approximate medians and other quantiles in one pass and with limited
       memory". SIGMOD. doi:10.1145/276304.276342
    """

    def __init__(self) -> None:
        self._values = np.zeros(0)
        self._counts = np.zeros(0, np.int64)
        self._pending: list[NDArray[np.float64]] = []
        self._waiting = 0
        self._levels: list[NDArray[np.float64]] = []
        self._thinned: list[int] = []

    def add(self, values: NDArray[np.float64]) -> None:
        """Count finite values, shape (N,)."""
        if len(values):
            self._pending.append(values)
            self._waiting += len(values)
        if self._waiting >= _PENDING or len(self._pending) >= _BATCHES:
            self._count()

    @property
    def rank_error(self) -> int:
        """Most values by which a rank can be wrong."""
        return sum((times + 1) // 2 << level for level, times in enumerate(self._thinned))

    @property
    def nbytes(self) -> int:
        """Bytes held."""
        held = (self._values, self._counts, *self._pending, *self._levels)
        return sum(array.nbytes for array in held)

    def distribution(self) -> Distribution:
        """Return the values and how many each stands for; the sum is exact."""
        self._count()
        weights = [np.full(len(values), 1 << level, np.int64) for level, values in enumerate(self._levels)]
        return _ascending(np.concatenate([self._values, *self._levels]), np.concatenate([self._counts, *weights]))

    def _count(self) -> None:
        """Count what is pending; if the distinct values are too many, hand them to the levels."""
        if not self._pending:
            return
        values, counts = np.unique(np.concatenate(self._pending), return_counts=True)
        self._pending, self._waiting = [], 0
        place = np.searchsorted(self._values, values)
        known = np.append(self._values, np.nan)[place] == values
        self._counts[place[known]] += counts[known]
        self._values = np.insert(self._values, place[~known], values[~known])
        self._counts = np.insert(self._counts, place[~known], counts[~known])
        if len(self._values) > _DISTINCT:
            self._hand_over()

    def _hand_over(self) -> None:
        # A count of 5 is one value on the level of 4 and one on that of 1.
        for level in range(int(self._counts.max()).bit_length()):
            self._put(level, self._values[(self._counts >> level) & 1 == 1])
        self._values, self._counts = np.zeros(0), np.zeros(0, np.int64)
        level = 0
        while level < len(self._levels):
            if len(self._levels[level]) >= _LEVEL:
                self._thin(level)
            level += 1

    def _put(self, level: int, values: NDArray[np.float64]) -> None:
        if level == len(self._levels):
            self._levels.append(np.zeros(0))
            self._thinned.append(0)
        self._levels[level] = np.append(self._levels[level], values)

    def _thin(self, level: int) -> None:
        values = np.sort(self._levels[level])
        paired = len(values) // 2 * 2
        self._put(level + 1, values[self._thinned[level] % 2 : paired : 2])
        self._levels[level] = values[paired:].copy()
        self._thinned[level] += 1


def _ascending(values: NDArray[np.float64], counts: NDArray[np.int64]) -> Distribution:
    order = np.argsort(values, kind="stable")
    return values[order], counts[order]
