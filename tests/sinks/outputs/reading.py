"""Outputs of every format, read by independent libraries."""

import json
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import laspy
import numpy as np
from mcap.reader import make_reader
from pypcd4 import PointCloud
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.reading import frames
from seaclutter_cli.selection import Selection
from seaclutter_cli.sources.formats import open_source

TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
STORES = {"ros1": get_typestore(Stores.ROS1_NOETIC), "cdr": get_typestore(Stores.LATEST)}


class Read(NamedTuple):
    """A frame: log time, or stamp where a format has only one time; stamp; and columns by name."""

    time_ns: int
    stamp_ns: int
    columns: dict[str, np.ndarray]


def by_this_program(path: Path) -> list[Read]:
    """Return the frames that this program reads."""
    source = open_source(path)
    found = []
    for frame in frames(source, Selection()):
        points = frame.cloud.points
        columns = {name: np.array(points[name]) for name in points.dtype.names}
        found.append(Read(frame.message.log_time_ns, frame.stamp_ns, columns))
    assert not source.damage, source.damage
    source.close()
    return found


def columns_of(message: Any) -> dict[str, np.ndarray]:
    """Return the fields of a PointCloud2 message of rosbags."""
    dtype = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": [
                (("<", ">")[message.is_bigendian] + TYPES[field.datatype - 1], (field.count,))
                if field.count > 1
                else ("<", ">")[message.is_bigendian] + TYPES[field.datatype - 1]
                for field in message.fields
            ],
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
    points = np.frombuffer(message.data.tobytes(), dtype, message.width * message.height)
    return {name: points[name] for name in dtype.names}


def stamp_of(message: Any) -> int:
    stamp = message.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec


def by_rosbags(path: Path) -> list[Read]:
    with AnyReader([path]) as reader:
        wanted = [one for one in reader.connections if one.msgtype == "sensor_msgs/msg/PointCloud2"]
        found = []
        for connection, time_ns, data in reader.messages(wanted):
            message = reader.deserialize(data, connection.msgtype)
            found.append(Read(time_ns, stamp_of(message), columns_of(message)))
        return found


def by_mcap(path: Path) -> list[Read]:
    found = []
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            if "PointCloud2" in (schema.name if schema else ""):
                store, encoding = STORES[channel.message_encoding], channel.message_encoding
                decode = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
                cloud = decode(message.data, "sensor_msgs/msg/PointCloud2")
                found.append(Read(message.log_time, stamp_of(cloud), columns_of(cloud)))
    return found


def by_pypcd4(path: Path) -> list[Read]:
    return from_folder(path, ".pcd", pcd_columns)


def pcd_columns(file: Path) -> dict[str, np.ndarray]:
    points = PointCloud.from_path(file).pc_data
    return {name: points[name] for name in points.dtype.names}


def by_laspy(path: Path) -> list[Read]:
    return from_folder(path, path.name.removeprefix("out_") and f".{path.name[-3:]}", las_columns)


def las_columns(file: Path) -> dict[str, np.ndarray]:
    las = laspy.read(file)
    assert las.header.global_encoding.wkt  # required by LAS 1.4 for these point formats; PDAL complains without
    names = [name for name in las.point_format.dimension_names if name not in ("X", "Y", "Z")]
    return {name: np.array(las[name]) for name in ("x", "y", "z", *names)}


def by_numpy(path: Path) -> list[Read]:
    return from_folder(path, ".npz", npz_columns)


def npz_columns(file: Path) -> dict[str, np.ndarray]:
    with np.load(file, allow_pickle=False) as archive:
        axes = archive["x"].ndim
        return {
            name: archive[name].reshape(-1, *archive[name].shape[axes:])
            for name in archive.files
            if archive[name].shape[:axes] == archive["x"].shape
        }


def from_folder(path: Path, suffix: str, read: Any) -> list[Read]:
    times = [int(Decimal(line) * 10**9) for line in (path / "times.txt").read_text().split()]
    files = sorted(path.glob(f"*{suffix}"))
    assert json.loads((path / "seaclutter.json").read_text())["metadata"]
    return [Read(time, time, read(file)) for time, file in zip(times, files, strict=True)]


READERS = {
    "mcap": by_mcap,
    "bag": by_rosbags,
    "rosbag2-db3": by_rosbags,
    "rosbag2-mcap": by_rosbags,
    "pcd": by_pypcd4,
    "las": by_laspy,
    "laz": by_laspy,
    "npz": by_numpy,
}
