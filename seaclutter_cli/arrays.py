"""Types of arrays, whose shapes and units docstrings say, and groups of equal numbers in sorted ones.

For small arrays, this is several times faster than `numpy.diff`.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Indices = NDArray[np.intp]
Rows = NDArray[np.void]
Rng = np.random.Generator


def group_starts(ordered: NDArray[np.integer]) -> Ints:
    """Return the index of the first item of each group of equal numbers in a sorted array."""
    starts = np.empty(len(ordered), np.bool_)
    starts[:1] = True
    np.not_equal(ordered[1:], ordered[:-1], out=starts[1:])
    return starts.nonzero()[0]


def group_sizes(starts: Ints, end: int) -> Ints:
    """Return the number of items in each group, from the starts of the groups and the end of the last one."""
    sizes = np.empty_like(starts)
    np.subtract(starts[1:], starts[:-1], out=sizes[:-1])
    sizes[-1:] = end - starts[-1:]
    return sizes
