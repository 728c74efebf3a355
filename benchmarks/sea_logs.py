"""What the simulators of labelled logs at sea share: their command line, messages of ROS 2, and labels."""

import argparse
import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from ideal import unseen
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.cloud import from_array
from seaclutter_cli.labels.csv import COLUMNS
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.runs.options.logs import parse_seeds
from seaclutter_cli.truth import Boxes

CLOUD, IMU = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Imu"
FIELD_TYPES = {"f4": 7, "f8": 8, "u2": 4, "u1": 2}
STORE = get_typestore(Stores.ROS2_HUMBLE)
POINT = np.dtype([*((name, "f4") for name in ("x", "y", "z", "intensity", "t")), ("ring", "u2"), ("label", "u2")])

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


def write_labelled(
    log: Path, frames: Iterable[tuple[Array, Boxes]], world: dict[str, str], start_ns: int, period_s: float
) -> None:
    """Write clouds of labelled points, their boxes and the metadata of their world, unless the log is there."""
    part, labels = log.with_suffix(".part"), log.with_suffix(".labels.csv")
    if log.exists():
        return
    codec, schema = CODECS[CLOUD, "cdr"], ros2_schema(CLOUD)
    with part.open("wb") as stream, labels.open("w", newline="") as table:
        writer, lines = Writer(stream, compression=CompressionType.ZSTD), csv.writer(table, lineterminator="\n")
        lines.writerow(COLUMNS)
        writer.start(profile="ros2")
        kind = writer.register_schema(schema.name, schema.encoding, schema.data)
        topic = writer.register_channel("/points", "cdr", kind)
        for number, (points, boxes) in enumerate(frames):
            stamp = start_ns + round(number * period_s * 1e9)
            writer.add_message(topic, stamp, codec.encode(from_array(points, stamp_ns=stamp)), stamp, number)
            lines.writerows(_label_rows(number, points, boxes))
        writer.add_metadata("world", world)
        writer.finish()
    part.rename(log)


def _label_rows(number: int, points: Array, boxes: Boxes) -> Iterator[list[Any]]:
    """Yield the labels of a frame; targets that a filter without faults would miss are ignored."""
    faint = unseen(points, boxes)
    for row, (track, kind) in enumerate(zip(boxes.tracks, boxes.classes, strict=True)):
        values = *boxes.centers[row], *boxes.sizes[row], boxes.yaws[row]
        yield [number, track, "ignore" if track in faint else kind, *(f"{value:.3f}" for value in values)]
    if not boxes.tracks:
        yield [number, "", "none", *[""] * 7]


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
