"""KITTI ``.bin``: nothing but x, y, z and intensity, as SemanticKITTI and WADS have them too."""

from pathlib import Path

import numpy as np

from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.errors import CloudError

_POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])


def read_kitti(path: Path) -> Cloud:
    """Return the points of a KITTI file: x, y, z in metres and intensity, float32. An empty file is an empty cloud.

    Raises
    ------
    CloudError
        If the size does not fit points of 16 bytes.
    """
    content = path.read_bytes()
    if len(content) % _POINT.itemsize:
        raise CloudError(
            f"{len(content)} bytes are no whole number of KITTI points (16 bytes: x, y, z, intensity as float32)"
        )
    return from_array(np.frombuffer(content, _POINT))
