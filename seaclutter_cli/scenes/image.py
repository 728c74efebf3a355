"""Top views of frames, the input of the scene classifier."""

import numpy as np
from numpy.typing import NDArray

IMAGE_SIZE = 224
"""Number of rows, and of columns, of a top view."""

_BLOCK = 16384


def top_view(xyz: NDArray[np.float64], extent_m: float) -> NDArray[np.uint8]:
    """Return the top view of a frame: the cells of a square around the lidar that contain a point.

    Parameters
    ----------
    xyz : ndarray, shape (3, N), float64
        Coordinates in metres; x points forward, which is up in the image, y to the left. Points with a coordinate that
        is not finite, and points exactly at the origin, are not returns and are ignored.
    extent_m : float
        Half the side of the square in metres; > 0.

    Returns
    -------
    ndarray, shape (224, 224), uint8
        1 where there is a point, otherwise 0. The upper and the left edge of a cell belong to it.

    Notes
    -----
    This is the binary image of [Bi] (point cloud to image converter). It is computed in single precision, which may
    shift the edge of a cell by some micrometres.

    Examples
    --------
    >>> np.argwhere(top_view(np.array([[50.0, 90], [0, 0], [1, 1]]), 60)).tolist()
    [[18, 112]]
    """
    return mark_cells(xyz, extent_m, IMAGE_SIZE)


def mark_cells(xyz: NDArray[np.float64], extent_m: float, size: int) -> NDArray[np.uint8]:
    """Return a `top_view` of any even size, shape (size, size), uint8."""
    image = np.zeros(size * size, np.uint8)
    middle, in_middle = (size + 1) * (size // 2), 0
    # In blocks, because allocating arrays for a whole frame each time costs more than the computation.
    for start in range(0, xyz.shape[1], _BLOCK):
        cells = _cells(xyz[:, start : start + _BLOCK], extent_m, size)
        image[cells] = 1
        in_middle += int(np.count_nonzero(cells == middle))
    if in_middle:
        at_origin = np.flatnonzero(xyz[0] == 0)
        image[middle] = in_middle > np.count_nonzero(~xyz[:, at_origin].any(axis=0))
    return image.reshape(size, size)


def _cells(xyz: NDArray[np.float64], extent_m: float, size: int) -> NDArray[np.int32]:
    """Return the row-major indices of the cells of the points inside the square."""
    with np.errstate(invalid="ignore", over="ignore"):
        position = xyz[:2].astype(np.float32)
        np.subtract(np.float32(extent_m), position, out=position)
        position *= np.float32(size / (2 * extent_m))
        row, column = position
        inside = np.minimum(row, column) >= 0  # False where either is NaN
        inside &= np.maximum(row, column) < size
        inside &= np.isfinite(xyz[2])
    seen = np.flatnonzero(inside)
    cells: NDArray[np.int32] = row.take(seen).astype(np.int32)
    cells *= size
    cells += column.take(seen).astype(np.int32)
    return cells
