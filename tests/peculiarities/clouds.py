"""Peculiarities of clouds in files and messages."""

import numpy as np

from tests.peculiarities.case import Case, sea


def kitti(folder):
    path = folder / "000000.bin"
    path.write_bytes(sea().tobytes())
    return path


def unnamed_columns(folder):
    path = folder / "0.npy"
    np.save(path, sea())
    return path


CASES = [
    Case(
        name="KITTI",
        source="https://www.cvlibs.net/datasets/kitti/: x, y, z and intensity in float32, without a header",
        build=kitti,
        frames=[sea()],
        to=("mcap", "npz"),
    ),
    Case(
        name="array without names",
        source="Arrays that notebooks save have columns, but no names of them.",
        build=unnamed_columns,
        frames=[sea()],
    ),
]
