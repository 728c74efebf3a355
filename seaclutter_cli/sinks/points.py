"""Writers for single point clouds: PCD, PLY, MCAP."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli import __version__
from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel
from seaclutter_cli.sinks.atomic import AtomicFile, OutputGroup
from seaclutter_cli.sinks.mcap_writer import McapWriter

_TYPE = "sensor_msgs/msg/PointCloud2"
_PLY = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint", "f4": "float"}
_PLY_NAMES = {**_PLY, "f8": "double"}
_PCD_KINDS = {"i": "I", "u": "U", "f": "F"}


def with_columns(cloud: Cloud, columns: Mapping[str, NDArray[Any]]) -> Cloud:
    """Return an unorganised cloud with columns of shape (N,) added or, if fields of that name exist, replaced."""
    points = cloud.points
    names = list(points.dtype.names or ())
    layout: list[Any] = [(name, points.dtype[name]) for name in names if name not in columns]
    layout += [(name, values.dtype) for name, values in columns.items()]
    out = np.empty(len(points), layout)
    for name in out.dtype.names or ():
        out[name] = columns[name] if name in columns else points[name]
    return replace(from_array(out), stamp_ns=cloud.stamp_ns, frame_id=cloud.frame_id)


def write_pcd(path: Path, cloud: Cloud, group: OutputGroup | None = None) -> None:
    """Write a binary PCD file.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    _write(path, pcd_header(cloud), cloud, group)


def pcd_header(cloud: Cloud) -> str:
    """Return the header of a binary PCD file with the points of a packed cloud."""
    fields = cloud.fields
    rows = {
        "FIELDS": [field.name for field in fields],
        "SIZE": [field.type[1] for field in fields],
        "TYPE": [_PCD_KINDS[field.type[0]] for field in fields],
        "COUNT": [str(max(field.count, 1)) for field in fields],
    }
    lines = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7"]
    lines += [f"{key} {' '.join(values)}" for key, values in rows.items()]
    shape = [f"WIDTH {cloud.width}", f"HEIGHT {cloud.height}", "VIEWPOINT 0 0 0 1 0 0 0"]
    return "\n".join([*lines, *shape, f"POINTS {cloud.size}", "DATA binary"]) + "\n"


def write_ply(path: Path, cloud: Cloud, group: OutputGroup | None = None) -> None:
    """Write a binary PLY file; each value of a field with several values becomes a property."""
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {cloud.size}"]
    for field in cloud.fields:
        names = [field.name] if field.count <= 1 else [f"{field.name}_{number}" for number in range(field.count)]
        lines += [f"property {_PLY_NAMES[field.type]} {name}" for name in names]
    _write(path, "\n".join([*lines, "end_header"]) + "\n", cloud, group)


def write_mcap(path: Path, cloud: Cloud, group: OutputGroup | None = None) -> None:
    """Write an MCAP file with one ROS 2 PointCloud2 message on ``/points``."""
    with AtomicFile(path, group) as file:
        writer = McapWriter(file.stream, profile="ros2", library=f"seaclutter {__version__}", compression="zstd")
        try:
            writer.add_channel(Channel(1, "/points", "cdr", ros2_schema(_TYPE)))
            writer.write(1, cloud.stamp_ns, cloud.stamp_ns, 0, CODECS[_TYPE, "cdr"].encode(cloud))
            writer.finish()
        except BaseException:
            writer.abort()
            raise


def _write(path: Path, header: str, cloud: Cloud, group: OutputGroup | None) -> None:
    with AtomicFile(path, group) as file:
        file.stream.write(header.encode())
        file.stream.write(cloud.data)


POINT_WRITERS: Mapping[str, Callable[[Path, Cloud, OutputGroup | None], None]] = {
    ".pcd": write_pcd,
    ".ply": write_ply,
    ".mcap": write_mcap,
}
"""Writers for unorganised, packed clouds by file extension. To add a format, add a line here."""
