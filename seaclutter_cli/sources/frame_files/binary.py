"""``.bin`` files of points without a header: KITTI, and the data sets CANOE and Pohang Canal.

The content tells them apart: points of CANOE have the time in microseconds since 1970, those of Pohang Canal their
range in millimetres.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.sources.frame_files.kitti import kitti_cloud

Points = NDArray[np.void]

CANOE = np.dtype(
    [
        *((axis, "<f8") for axis in "xyz"),
        *(("intensity", "<u2"), ("timestamp", "<u8"), ("reflectivity", "<u2"), ("ambient", "<u2")),
    ]
)
"""A point of CANOE (github.com/utiasASRL/pycanoe, DATA_REFERENCE.md); its time is in microseconds."""
POHANG = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z", "intensity")),
        *(("t", "<u4"), ("reflectivity", "<u2"), ("ambient", "<u2"), ("range", "<u4")),
    ]
)
"""A point of Pohang Canal, as the Ouster driver publishes it: nanoseconds in the scan, range in millimetres."""

_FIRST_US, _LAST_US = 946_684_800_000_000, 4_102_444_800_000_000
"""The years 2000 and 2100."""
_LOOKED_AT = 4096
_MIN_RETURNS, _MIN_SHARE = 3, 0.9


def read_bin(path: Path) -> Cloud:
    """Return the points of a file: KITTI (x, y, z, intensity), CANOE or Pohang Canal.

    Raises
    ------
    CloudError
        If the file has none of these layouts.
    """
    content = path.read_bytes()
    for dtype, fits in _LAYOUTS:
        if content and len(content) % dtype.itemsize == 0:
            points = np.frombuffer(content, dtype)
            step = max(len(points) // _LOOKED_AT, 1)
            if fits(points[::step]):
                return from_array(points)
    return kitti_cloud(content)


def _has_times(points: Points) -> bool:
    times = points["timestamp"]
    return bool(((times >= _FIRST_US) & (times < _LAST_US)).all())


def _has_ranges(points: Points) -> bool:
    """Return whether the ranges are those of the coordinates, within 2 % or 0.2 m."""
    with np.errstate(invalid="ignore", over="ignore"):
        distance: Any = np.sqrt(sum(points[axis].astype(np.float64) ** 2 for axis in "xyz"))
        range_m = points["range"] / 1000
        returns = distance > 0
        same = np.abs(distance - range_m) <= 0.2 + 0.02 * distance
    return int(np.count_nonzero(returns)) >= _MIN_RETURNS and float(same[returns].mean()) >= _MIN_SHARE


_LAYOUTS: tuple[tuple[np.dtype[np.void], Callable[[Points], bool]], ...] = ((CANOE, _has_times), (POHANG, _has_ranges))
