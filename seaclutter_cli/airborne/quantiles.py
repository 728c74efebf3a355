"""Quantiles of groups of values."""

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float64]


def quantile_of_each(values: Values, group: NDArray[np.int64], groups: int, share: float, least: int = 1) -> Values:
    """Return a quantile of the values of each group, as one of them; NaN if it has fewer than ``least``.

    Parameters
    ----------
    values : ndarray, shape (N,), float64
        Values.
    group : ndarray, shape (N,), int64
        Group of each, less than ``groups``.
    groups : int
        Number of groups G.
    share : float
        Share of the values that are lower.
    least : int
        Number of values that a group needs.

    Returns
    -------
    ndarray, shape (G,), float64

    Examples
    --------
    >>> quantile_of_each(np.array([3.0, 1, 2, 7]), np.array([0, 0, 0, 2]), 3, 0.5)
    array([ 2., nan,  7.])
    """
    count = np.bincount(group, minlength=groups)
    place = np.cumsum(count) - count + np.floor(share * np.maximum(count - 1, 0)).astype(np.int64)
    ordered = np.append(values[np.lexsort((values, group))], np.nan)
    return np.where(count >= least, ordered[np.minimum(place, len(values))], np.nan)
