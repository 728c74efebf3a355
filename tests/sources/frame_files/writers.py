"""Small frame files of every format, written independently of the readers under test."""

import csv
import io

import numpy as np
import pytest
from pypcd4.pypcd4 import Encoding, PointCloud

from seaclutter_cli.sources.frame_files import FRAME_READERS

XYZI = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4")]
FOUR = [(name, "F", 4, 1) for name in ("x", "y", "z", "intensity")]


def sample(size=50, dtype=XYZI):
    rng = np.random.default_rng(7)
    points = np.empty(size, dtype)
    for name in points.dtype.names:
        points[name] = np.round(rng.uniform(0, 100, points[name].shape), 2)
    return points


def read(path, content=None):
    if content is not None:
        path.write_bytes(content)
    return FRAME_READERS[path.suffix](path)


def pcd_header(fields, points, encoding, *, height=1, **lines):
    """Return a PCD header; ``fields`` are rows of name, type letter, size and count."""
    columns = [" ".join(map(str, column)) for column in zip(*fields, strict=True)]
    header = {
        "VERSION": "0.7",
        "FIELDS": columns[0],
        "SIZE": columns[2],
        "TYPE": columns[1],
        "COUNT": columns[3],
        "WIDTH": points // height,
        "HEIGHT": height,
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": points,
        "DATA": encoding,
    } | lines
    text = "".join(f"{key} {value}\n" for key, value in header.items() if value is not None)
    return ("# .PCD v0.7 - Point Cloud Data file format\n" + text).encode()


def ply(points, encoding="binary_little_endian", before="", after="", body_before=b"", body_after=b""):
    names = {"f4": "float", "f8": "double", "u1": "uchar", "i1": "char", "u2": "ushort", "i2": "short"}
    names |= {"u4": "uint", "i4": "int"}
    properties = [f"property {names[points.dtype[n].str[1:]]} {n}\n" for n in points.dtype.names]
    header = f"ply\nformat {encoding} 1.0\ncomment made by hand\n{before}element vertex {len(points)}\n"
    header += "".join(properties) + after + "end_header\n"
    if encoding == "ascii":
        body = "".join(" ".join(repr(v) for v in row) + "\n" for row in points.tolist()).encode()
    else:
        order = ">" if encoding == "binary_big_endian" else "<"
        body = points.astype(points.dtype.newbyteorder(order)).tobytes()
    return header.encode() + body_before + body + body_after


def las(points, suffix, point_format=3):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=point_format)
    header.scales = [0.01] * 3
    header.add_extra_dim(laspy.ExtraBytesParams("echo", "u2"))
    header.add_extra_dim(laspy.ExtraBytesParams("normal", "3f4"))
    out = laspy.LasData(header)
    out.x, out.y, out.z = (points[axis].astype("f8") for axis in "xyz")
    out.intensity = points["intensity"].astype("u2")
    out.classification = np.full(len(points), 5, "u1")
    out.echo = np.arange(len(points), dtype="u2")
    out.normal = np.ones((len(points), 3), "f4")
    file = io.BytesIO()
    out.write(file, do_compress=suffix == ".laz")
    return file.getvalue()


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def npz(points):
    stream = io.BytesIO()
    np.savez_compressed(stream, **{name: points[name] for name in points.dtype.names})
    return stream.getvalue()


def text(points, *, names=True, delimiter=","):
    file = io.StringIO()
    writer = csv.writer(file, delimiter=delimiter)
    writer.writerows([points.dtype.names] * names + points.tolist())
    return file.getvalue().encode()


def pcd(points, encoding=Encoding.BINARY):
    file = io.BytesIO()
    columns = [points[name] for name in points.dtype.names]
    types = [points.dtype[name] for name in points.dtype.names]
    PointCloud.from_points(columns, points.dtype.names, types).save(file, encoding)
    return file.getvalue()


WRITERS = {
    ".pcd": pcd,
    ".ply": ply,
    ".las": lambda points: las(points, ".las"),
    ".laz": lambda points: las(points, ".laz"),
    ".bin": lambda points: points.tobytes(),
    ".npy": lambda points: npy(np.stack([points[name] for name in points.dtype.names], axis=1)),
    ".npz": npz,
    ".csv": text,
}
