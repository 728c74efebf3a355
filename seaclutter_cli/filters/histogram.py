"""Exact distribution of intensities in bounded memory."""

import numpy as np
from numpy.typing import NDArray

_WHOLE_LIMIT = 1 << 16
_FLOAT_BITS = 22


class IntensityHistogram:
    """Counts of intensities: exact for whole numbers from 0 to 65535, else in bins of 1/8000 of the value.

    A float32 bit pattern, read as a whole number, sorts like the value; its upper 22 bits are the bin. Memory is 32 MB
    at most, of which only touched pages are real.
    """

    def __init__(self) -> None:
        self._whole = np.zeros(_WHOLE_LIMIT, np.int64)
        self._bins: NDArray[np.int64] | None = None

    def add(self, intensity: NDArray[np.float64]) -> None:
        """Count finite intensities, shape (N,)."""
        if self._bins is None and _all_whole(intensity):
            self._whole += np.bincount(intensity.astype(np.int64), minlength=_WHOLE_LIMIT)
            return
        if self._bins is None:
            self._bins = np.zeros(1 << _FLOAT_BITS, np.int64)
            seen = np.flatnonzero(self._whole)
            np.add.at(self._bins, _bin(seen.astype(np.float64)), self._whole[seen])
        bins, counts = np.unique(_bin(intensity), return_counts=True)
        self._bins[bins] += counts

    def threshold(self, filter_rate: float) -> float:
        """Return the smallest threshold T for which at least ``filter_rate`` of the intensities are below T.

        Parameters
        ----------
        filter_rate : float
            Share to be below the threshold, from 0 to 1.

        Returns
        -------
        float
            A whole number if all intensities are; else the upper edge of a bin. 0 if nothing was counted.

        Examples
        --------
        >>> histogram = IntensityHistogram()
        >>> histogram.add(np.array([1.0, 1, 2, 7, 9]))
        >>> histogram.threshold(0.8)
        8.0
        """
        counts = self._whole if self._bins is None else self._bins
        below = np.cumsum(counts)
        needed = np.ceil(filter_rate * below[-1] - 1e-9)
        if below[-1] == 0:
            return 0.0
        # Up to which value, included, points are to go; for a rate of 0, up to before the least.
        last = int(np.searchsorted(below, max(needed, 1))) - (needed <= 0)
        return float(last + 1) if self._bins is None else _upper_edge(last)


def _all_whole(intensity: NDArray[np.float64]) -> bool:
    if not len(intensity):
        return True
    return bool(intensity.min() >= 0 and intensity.max() < _WHOLE_LIMIT and (intensity == np.floor(intensity)).all())


def _bin(intensity: NDArray[np.float64]) -> NDArray[np.int64]:
    limit = np.finfo(np.float32).max
    bits = (np.clip(intensity, -limit, limit).astype(np.float32) + np.float32(0)).view(np.uint32).astype(np.int64)
    ordered = np.where(bits >> 31, 0xFFFFFFFF - bits, bits | 0x80000000)
    return ordered >> (32 - _FLOAT_BITS)


def _upper_edge(index: int) -> float:
    ordered = (index + 1) << (32 - _FLOAT_BITS)
    bits = ordered & 0x7FFFFFFF if ordered >> 31 else 0xFFFFFFFF - ordered
    return float(np.array(bits, np.uint32).view(np.float32))
