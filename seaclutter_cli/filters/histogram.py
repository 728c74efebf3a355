"""Distribution of intensities in one pass and bounded memory: exact where possible, otherwise within 0.1 % of rank."""

import math
from fractions import Fraction
from typing import Self

import numpy as np

from seaclutter_cli.arrays import Floats, Ints

_DISTINCT = 1 << 16
_PENDING = 1 << 16
_BATCHES = 1 << 10
_LEVEL = 1 << 14

Distribution = tuple[Floats, Ints]
"""Values in ascending order and the count of each."""


class IntensityHistogram:
    r"""Distribution of intensities in at most 5 MB: exact up to 65536 distinct ones, then with bounded rank error.

    Excess values move to a hierarchy of levels, where a value of level h represents :math:`2^h` values. When a level
    has 16384 values or more, they are sorted and every second one moves up a level [1]_. This changes a rank by at most
    :math:`2^h`, up or down depending on whether the first or the second of each pair moves; the two alternate. For n
    values the error is at most :math:`n \log_2(n / 2^{14}) / 2^{15}`, below 0.1 % for fewer than 10^13.

    The summary is deterministic: the same values in the same order give the same summary.

    References
    ----------
    .. [1] Manku, Rajagopalan, Lindsay (1998). "Approximate medians and other quantiles in one pass and with limited
       memory". SIGMOD. doi:10.1145/276304.276342
    """

    def __init__(self) -> None:
        self._values = np.zeros(0)
        self._counts = np.zeros(0, np.int64)
        self._pending: list[Floats] = []
        self._levels: list[Floats] = []
        self._thinned: list[int] = []
        self._added_error = 0
        self.all_whole = True
        """Whether every intensity so far is a whole number."""

    def add(self, values: Floats) -> None:
        """Count finite values, shape (N,)."""
        self.all_whole = self.all_whole and bool((values == np.floor(values)).all())
        if len(values):
            self._pending.append(values)
        if sum(map(len, self._pending)) >= _PENDING or len(self._pending) >= _BATCHES:
            self._count()

    def __iadd__(self, other: Self) -> Self:
        """Add the values of another histogram: exact if there are few distinct ones, otherwise the errors add up."""
        self.all_whole = self.all_whole and other.all_whole
        self._count()
        other._count()
        self._merge(other._values, other._counts)
        self._added_error += other.rank_error
        for level, values in enumerate(other._levels):
            self._put(level, values)
        self._thin_levels()
        return self

    @property
    def rank_error(self) -> int:
        """Maximum error of a rank in values."""
        return self._added_error + sum((times + 1) // 2 << level for level, times in enumerate(self._thinned))

    @property
    def points(self) -> int:
        """Number of values."""
        return int(self.distribution()[1].sum())

    def distribution(self) -> Distribution:
        """Return the values and how many values each represents; the sum is exact."""
        self._count()
        weights = [np.full(len(values), 1 << level, np.int64) for level, values in enumerate(self._levels)]
        values, counts = np.concatenate([self._values, *self._levels]), np.concatenate([self._counts, *weights])
        order = np.argsort(values, kind="stable")
        return values[order], counts[order]

    def threshold(self, filter_rate: float, *, whole: bool | None = None) -> float:
        """Return the smallest threshold T for which at least ``filter_rate`` of the intensities are below T.

        T is the next whole number, or the next floating-point number, above the greatest intensity to remove; by
        default a whole number if all intensities are. It is 0 for an empty histogram.
        """
        values, counts = self.distribution()
        if not len(values):
            return 0.0
        below = np.cumsum(counts)
        # 0.8 means exactly 4/5; the float is slightly greater, which would shift the rank among many points.
        needed = math.ceil(Fraction(repr(float(filter_rate))) * int(below[-1]))
        if needed <= 0:
            return float(values[0])
        last = float(values[np.searchsorted(below, needed)])
        following = math.nextafter(last, math.inf)
        return max(last + 1, following) if (self.all_whole if whole is None else whole) else following

    def _count(self) -> None:
        """Count the pending values; if there are too many distinct values, move them to the levels."""
        if not self._pending:
            return
        values, counts = np.unique(np.concatenate(self._pending), return_counts=True)
        self._pending = []
        self._merge(values, counts)

    def _merge(self, values: Floats, counts: Ints) -> None:
        """Add distinct values in ascending order and their counts."""
        index = np.searchsorted(self._values, values)
        known = np.append(self._values, np.nan)[index] == values
        self._counts[index[known]] += counts[known]
        self._values = np.insert(self._values, index[~known], values[~known])
        self._counts = np.insert(self._counts, index[~known], counts[~known])
        if len(self._values) <= _DISTINCT:
            return
        # The binary digits of a count select the levels: a count of 5 is one value each on levels 2 and 0.
        for level in range(int(self._counts.max()).bit_length()):
            self._put(level, self._values[(self._counts >> level) & 1 == 1])
        self._values, self._counts = np.zeros(0), np.zeros(0, np.int64)
        self._thin_levels()

    def _thin_levels(self) -> None:
        level = 0
        while level < len(self._levels):
            if len(self._levels[level]) >= _LEVEL:
                values = np.sort(self._levels[level])
                paired = len(values) // 2 * 2
                self._put(level + 1, values[self._thinned[level] % 2 : paired : 2])
                self._levels[level] = values[paired:].copy()
                self._thinned[level] += 1
            level += 1

    def _put(self, level: int, values: Floats) -> None:
        if level == len(self._levels):
            self._levels.append(np.zeros(0))
            self._thinned.append(0)
        self._levels[level] = np.append(self._levels[level], values)
