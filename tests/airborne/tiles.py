"""Small tiles for tests, written with laspy."""

import struct

import numpy as np
import pytest

GEO_KEYS = struct.pack("<8H", 1, 1, 0, 1, 1024, 0, 1, 1) + bytes(16)


def sea(rng, size=4000, extent=(60.0, 50.0), wave=0.05):
    """Return points of calm water, shape (N, 3)."""
    return np.column_stack(
        [rng.uniform(0, extent[0], size), rng.uniform(0, extent[1], size), rng.normal(0, wave, size)]
    )


def box(rng, x, y, z, size=400):
    """Return random points in a box; each side is given as (low, high)."""
    return np.column_stack([rng.uniform(*side, size) for side in (x, y, z)])


def write(path, xyz, *, point_format=6, classification=None, extra=(), scale=0.001, offset=(500_000, 4_000_000, 0)):
    """Write a LAS or LAZ file; ``extra`` contains names, types and values of additional dimensions."""
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.2")
    header.scales, header.offsets = [scale] * 3, offset
    header.system_identifier, header.generating_software = "test lidar", "test"
    header.vlrs.append(laspy.VLR("seaclutter", 7, "kept", b"abc"))
    header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "one key, and room for two more", GEO_KEYS))
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


def write_labelled(path):
    """Write a small tile with two objects of each of two classes."""
    rng = np.random.default_rng(4)
    parts = [sea(rng, 600, (60.0, 50.0))]
    parts += [box(rng, (8 + 20 * n, 12 + 20 * n), (8, 12), (1, 4), 60) for n in range(2)]
    parts += [box(rng, (8 + 20 * n, 12 + 20 * n), (28, 32), (1, 4), 60) for n in range(2)]
    sizes = [len(part) for part in parts]
    classes, objects = np.repeat([0, 1, 1, 2, 2], sizes), np.repeat([0, 1, 2, 3, 4], sizes)
    extra = [("object_class", "u1", classes), ("object_id", "u2", objects)]
    return write(path, np.concatenate(parts), extra=extra)


def raw_records(path):
    """Return the header of a file and its records before and after the points, as bytes, without laspy."""
    data = path.read_bytes()
    size, (count,) = int.from_bytes(data[94:96], "little"), struct.unpack_from("<I", data, 100)
    before = _records(data, size, count, "<xx16sHH32s")
    after = _records(data, *struct.unpack_from("<QI", data, 235), "<xx16sHQ32s") if data[25] > 3 else []
    return data[:size], [one for one in before if one[1] != 22204], after


def _records(data, at, count, layout):
    out = []
    for _ in range(count):
        user, number, length, description = struct.unpack_from(layout, data, at)
        at += struct.calcsize(layout)
        out.append((user.rstrip(b"\0"), number, description.rstrip(b"\0"), data[at : at + length]))
        at += length
    return out


def read(path):
    return pytest.importorskip("laspy").read(path)
