"""Nearest of some positions in a plane."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_FEW_PAIRS = 1 << 20
_STEP = 1 << 10


def nearest(positions: NDArray[Any], queries: NDArray[Any]) -> NDArray[np.intp]:
    """Return the index of the position nearest to each query, shape (Q,).

    Parameters
    ----------
    positions : ndarray, shape (2, P)
        At least one.
    queries : ndarray, shape (2, Q)
        Where to search from.

    Examples
    --------
    >>> nearest(np.array([[0, 5], [0, 5]]), np.array([[1, 4, 9], [1, 4, 9]]))
    array([0, 1, 1])
    """
    if positions.shape[1] * queries.shape[1] > _FEW_PAIRS:
        from scipy.spatial import cKDTree  # slow to import

        return np.asarray(cKDTree(positions.T).query(queries.T)[1], np.intp)
    found = np.empty(queries.shape[1], np.intp)
    for start in range(0, len(found), _STEP):
        offset = queries[:, start : start + _STEP, None] - positions[:, None]
        found[start : start + _STEP] = np.argmin((offset**2).sum(axis=0), axis=1)
    return found
