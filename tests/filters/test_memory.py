"""Memory that filters take for each point."""

import tracemalloc

import numpy as np
import pytest

from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import Frame

POINTS, FEW, FRAMES = 150_000, 1000, 3
MAX_BYTES_PER_POINT = 320


def dense_frame(index, points):
    """Return a block of points 0.3 m apart without any water, which all belong to one object."""
    number = np.arange(points)
    xyz = np.stack([11 + number % 128 * 0.3, number // 128 % 128 * 0.3 - 20, number // 16384 * 0.05 - 2], 1)
    stamp_ns = 10**18 + index * 10**8
    return Frame.of_arrays(xyz.astype(np.float32), np.full(points, 200, np.uint8), stamp_ns=stamp_ns, index=index)


def peak(name, points):
    method = FILTERS[name](FILTERS[name].Params())
    tracemalloc.start()
    for index in range(FRAMES if name == "confirmed" else 1):
        frame = dense_frame(index, points)
        if method.needs_first_pass:
            method.observe(frame)
        method.process(frame)
        del frame
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most


@pytest.mark.parametrize("name", FILTERS)
def test_memory_grows_little_with_points(name, monkeypatch):
    """State that does not depend on the points, such as the directions in which own ship may be, is not counted."""
    monkeypatch.setenv("SEACLUTTER_THREADS", "1")
    assert (peak(name, POINTS) - peak(name, FEW)) / (POINTS - FEW) < MAX_BYTES_PER_POINT
