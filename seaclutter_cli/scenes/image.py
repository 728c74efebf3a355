"""Top views of frames: what the scene classifier looks at."""

import numpy as np
from numpy.typing import NDArray

IMAGE_SIZE = 224
"""Rows and columns of a top view."""

_BLOCK = 16384


def top_view(xyz: NDArray[np.float64], extent_m: float) -> NDArray[np.uint8]:
    """Return a frame as seen from above: which cells of a square around the lidar hold a point.

    Parameters
    ----------
    xyz : ndarray, shape (3, N), float64
        Coordinates in metres; x points forward, which is up in the image, y to the left. Points with a coordinate that
        is not finite, and those exactly at the origin, are no returns and not seen.
    extent_m : float
        Half the side of the square; > 0.

    Returns
    -------
    ndarray, shape (224, 224), uint8
        1 where there is a point, else 0; all 0 if there is none. The upper and the left edge of a cell belong to it.

    Notes
    -----
    The binary image of S3 (its point cloud to image converter), computed in single precision: a cell's edge is as good
    some micrometres further on.

    Examples
    --------
    >>> np.argwhere(top_view(np.array([[50.0, 90], [0, 0], [1, 1]]), 60)).tolist()
    [[18, 112]]
    """
    return mark_cells(xyz, extent_m, IMAGE_SIZE)


def mark_cells(xyz: NDArray[np.float64], extent_m: float, size: int) -> NDArray[np.uint8]:
    """Return a `top_view` of any even size: uint8, shape (size, size)."""
    image = np.zeros(size * size, np.uint8)
    middle, in_middle = (size + 1) * (size // 2), 0
    # Arrays of a whole frame would be new memory from the system each time, which costs more than the work itself.
    for start in range(0, xyz.shape[1], _BLOCK):
        cells = _cells(xyz[:, start : start + _BLOCK], extent_m, size)
        image[cells] = 1
        in_middle += int(np.count_nonzero(cells == middle))
    if in_middle:
        at_origin = np.flatnonzero(xyz[0] == 0)
        image[middle] = in_middle > np.count_nonzero(~xyz[:, at_origin].any(axis=0))
    return image.reshape(size, size)


def _cells(xyz: NDArray[np.float64], extent_m: float, size: int) -> NDArray[np.int32]:
    """Return the cells of the points that lie in the square, counted along the rows."""
    with np.errstate(invalid="ignore", over="ignore"):
        place = xyz[:2].astype(np.float32)
        np.subtract(np.float32(extent_m), place, out=place)
        place *= np.float32(size / (2 * extent_m))
        row, column = place
        inside = np.minimum(row, column) >= 0  # not where either is NaN
        inside &= np.maximum(row, column) < size
        inside &= np.isfinite(xyz[2])
    seen = np.flatnonzero(inside)
    cells: NDArray[np.int32] = row.take(seen).astype(np.int32)
    cells *= size
    cells += column.take(seen).astype(np.int32)
    return cells
