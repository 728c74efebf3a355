"""KITTI ``.bin`` files of x, y, z and intensity; SemanticKITTI and WADS use them too."""

import numpy as np

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError

_POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])


def kitti_cloud(content: bytes) -> Cloud:
    """Return the points of a KITTI file: x, y, z in metres and intensity, float32. An empty file gives an empty cloud.

    Raises
    ------
    CloudError
        If the file size is not a multiple of 16 bytes.
    """
    if len(content) % _POINT.itemsize:
        raise CloudError(
            f"{len(content)} bytes is not a multiple of 16, the size of a KITTI point (x, y, z, intensity as float32)"
        )
    return from_array(np.frombuffer(content, _POINT))
