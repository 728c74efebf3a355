"""What the simulators of labelled logs at sea share: their command line, and messages of ROS 2."""

import argparse
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.runs.options.logs import parse_seeds

CLOUD, IMU = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Imu"
FIELD_TYPES = {"f4": 7, "f8": 8, "u2": 4, "u1": 2}
STORE = get_typestore(Stores.ROS2_HUMBLE)

Array = NDArray[Any]


def parser_of(script: str, description: str, families: Iterable[str]) -> argparse.ArgumentParser:
    """Return a parser with the options that all simulators have; the description is the first line of a text."""
    names = list(families)
    parser = argparse.ArgumentParser(prog=f"benchmarks/{script}", description=description.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="folder for the logs")
    parser.add_argument("--seeds", type=parse_seeds, default=(1,), help="such as 1..40 or 3,7")
    parser.add_argument("--families", nargs="+", choices=names, default=names, help="one log of each per seed")
    parser.add_argument("--jobs", type=int, default=1, help="number of processes")
    return parser


def record_all(record: Callable[..., None], logs: Iterable[tuple[Any, ...]], folder: Path, jobs: int) -> None:
    """Record logs, of each of which the arguments are given, in a folder that need not exist."""
    folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(jobs) as pool:
        list(pool.map(partial(record, folder=folder), *zip(*logs, strict=True)))


def channel(writer: Writer, topic: str, kind: str) -> int:
    """Return the number of a new channel."""
    schema = writer.register_schema(kind, "ros2msg", STORE.generate_msgdef(kind, ros_version=2)[0].encode())
    return writer.register_channel(topic, "cdr", schema)


def cloud_message(points: Array, stamp_ns: int) -> bytes:
    """Return a cloud of all fields of a structured array."""
    fields = [
        _message("sensor_msgs/msg/PointField", name, offset, FIELD_TYPES[kind.str[1:]], 1)
        for name, (kind, offset, *_) in (points.dtype.fields or {}).items()
    ]
    data, step = np.frombuffer(points.tobytes(), np.uint8), points.dtype.itemsize
    cloud = _message(CLOUD, _header(stamp_ns), 1, len(points), fields, False, step, step * len(points), data, True)
    return bytes(STORE.serialize_cdr(cloud, CLOUD))


def imu_message(
    attitude: Sequence[float] | None, rate: Sequence[float], force: Sequence[float], stamp_ns: int
) -> bytes:
    """Return attitude (a quaternion x, y, z, w; None if it is not known), rate in rad/s and force in m/s²."""
    unknown, none = np.zeros(9), np.zeros(9)
    if attitude is None:
        unknown[0], attitude = -1, (0, 0, 0, 1)
    facing = _message("geometry_msgs/msg/Quaternion", *map(float, attitude))
    spin, acceleration = (_message("geometry_msgs/msg/Vector3", *map(float, one)) for one in (rate, force))
    imu = _message(IMU, _header(stamp_ns), facing, unknown, spin, none, acceleration, none)
    return bytes(STORE.serialize_cdr(imu, IMU))


def _message(kind: str, *values: Any) -> Any:
    return STORE.types[kind](*values)


def _header(stamp_ns: int) -> Any:
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    return _message("std_msgs/msg/Header", _message("builtin_interfaces/msg/Time", seconds, nanoseconds), "lidar")
