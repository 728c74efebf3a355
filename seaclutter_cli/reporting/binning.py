"""Series over frames, reduced to the number of bins that a screen can show."""

import numpy as np
from numpy.typing import NDArray

Series = NDArray[np.float32]
MAX_BINS = 600


def bin_starts(frames: int) -> NDArray[np.int64]:
    """Return the first frame of each bin, shape (B,), int64; all bins but the last have the same length."""
    size = max(1, -(-frames // MAX_BINS))
    return np.arange(0, frames, size)


def binned(values: Series, starts: NDArray[np.int64]) -> tuple[Series, Series, Series]:
    """Return mean, minimum and maximum of each bin; NaN for bins without known values.

    Parameters
    ----------
    values : ndarray, shape (frames, K), float32
        Series over the frames; NaN where unknown.
    starts : ndarray, shape (B,), int64
        First frame of each bin.

    Returns
    -------
    tuple of ndarray, each of shape (B, K), float32

    Examples
    --------
    >>> mean, low, high = binned(np.array([[1.0], [3], [np.nan]], np.float32), np.array([0, 2]))
    >>> mean.ravel(), low.ravel(), high.ravel()
    (array([ 2., nan], dtype=float32), array([ 1., nan], dtype=float32), array([ 3., nan], dtype=float32))
    """
    if not len(starts):
        empty = np.empty((0, values.shape[1]), np.float32)
        return empty, empty, empty
    known = np.isfinite(values)
    count = np.add.reduceat(known, starts, axis=0, dtype=np.int64)
    total = np.add.reduceat(np.where(known, values, 0).astype(np.float64), starts, axis=0)
    mean = np.where(count, total / np.maximum(count, 1), np.nan)
    low, high = (
        np.where(count, reduce.reduceat(np.where(known, values, neutral), starts, axis=0), np.nan)
        for reduce, neutral in ((np.minimum, np.inf), (np.maximum, -np.inf))
    )
    return mean.astype(np.float32), low.astype(np.float32), high.astype(np.float32)
