"""Small tiles for the tests, made with laspy."""

import numpy as np
import pytest


def sea(rng, size=4000, extent=(60.0, 50.0), wave=0.05):
    """Return points of calm water, shape (N, 3)."""
    return np.column_stack(
        [rng.uniform(0, extent[0], size), rng.uniform(0, extent[1], size), rng.normal(0, wave, size)]
    )


def box(rng, x, y, z, size=400):
    """Return points of the top of a box, each side given as (low, high)."""
    return np.column_stack([rng.uniform(*side, size) for side in (x, y, z)])


def write(path, xyz, *, point_format=6, classification=None, extra=(), scale=0.001, offset=(500_000, 4_000_000, 0)):
    """Write a LAS or LAZ file; ``extra`` are names, types and values of further dimensions."""
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.2")
    header.scales, header.offsets = [scale] * 3, offset
    header.system_identifier, header.generating_software = "test lidar", "test"
    header.vlrs.append(laspy.VLR("seaclutter", 7, "kept", b"abc"))
    for name, kind, _ in extra:
        header.add_extra_dim(laspy.ExtraBytesParams(name, kind))
    out = laspy.LasData(header)
    out.x, out.y, out.z = (xyz + np.array(offset)).T
    rng = np.random.default_rng(1)
    out.intensity = rng.integers(0, 2000, len(xyz))
    out.return_number = rng.integers(1, 3, len(xyz))
    out.number_of_returns = np.full(len(xyz), 2)
    out.gps_time = np.arange(len(xyz)) * 1e-5
    out.point_source_id = np.full(len(xyz), 12)
    out.synthetic = rng.integers(0, 2, len(xyz))
    if classification is not None:
        out.classification = classification
    for name, _, values in extra:
        out[name] = values
    if point_format > 5:
        out.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("seaclutter", 9, "behind", b"xyz" * 100)])
    out.write(path)
    return path


def read(path):
    return pytest.importorskip("laspy").read(path)
