"""Synthetic logs for speed measurements: RS-LiDAR-32 frames of 57,600 points of 26 bytes, and an IMU.

The ``mcap`` library writes them. They do not resemble the sea: speed depends on the number of points, on how well
their bytes compress, and on the share that passes the intensity thresholds.
"""

import struct
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from seaclutter_cli.cloud import from_array
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema

BEAMS, COLUMNS = 32, 1800
POINTS = BEAMS * COLUMNS
START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 100_000_000

POINT = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "timestamp"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f8"],
        "offsets": [0, 4, 8, 12, 16, 18],
        "itemsize": 26,
    }
)
SHARES = {"sea": 0.03, "harbour": 0.40}
"""Share of the points that are in the range rings and above the thresholds, for a day at sea and a harbour."""

EXTENTS = (((1.0, 70.5), 10.5), ((9.5, 150.0), 69.5))
"""Minimum and maximum ranges in metres, each of near points, far points, and points in the range rings."""


def frame(number: int, share: float) -> NDArray[np.void]:
    """Return a frame: 10 % no return, 5 % own ship, 15 % beyond the range rings, the rest inside, ``share`` bright."""
    rng = np.random.default_rng(number)
    azimuth = np.repeat(np.arange(COLUMNS) * np.radians(0.2), BEAMS)
    elevation = np.tile(np.radians(np.linspace(-16, 15, BEAMS)), COLUMNS)
    kind = np.random.default_rng(1).permutation(POINTS) / POINTS
    low, high = (np.select([kind < 0.15, kind < 0.30], near_far, ring) for near_far, ring in EXTENTS)
    range_m = low + (high - low) * np.random.default_rng(0).random(POINTS) + rng.normal(0, 0.02, POINTS)
    points = np.zeros(POINTS, POINT)
    points["x"] = range_m * np.cos(elevation) * np.cos(azimuth)
    points["y"] = range_m * np.cos(elevation) * np.sin(azimuth)
    points["z"] = range_m * np.sin(elevation)
    points["intensity"] = np.where(kind >= 1 - share, rng.integers(60, 256, POINTS), rng.integers(0, 4, POINTS))
    points["ring"] = np.tile(np.arange(BEAMS), COLUMNS)
    points["timestamp"] = (START_NS + number * PERIOD_NS) / 1e9 + azimuth / (20 * np.pi)
    for axis in "xyz":
        points[axis][kind < 0.10] = np.nan
    return points


def write_log(path: Path, frames: int, share: float) -> None:
    """Write a log unless it exists."""
    if path.exists():
        return
    codec = CODECS["sensor_msgs/msg/PointCloud2", "cdr"]
    part = path.with_suffix(".part")
    with part.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        channels = {}
        for topic, kind in (("/points", "PointCloud2"), ("/imu", "Imu")):
            schema = ros2_schema(f"sensor_msgs/msg/{kind}")
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[topic] = writer.register_channel(topic, "cdr", number)
        for number in range(frames):
            stamp = START_NS + number * PERIOD_NS
            cloud = from_array(frame(number, share), stamp_ns=stamp)
            writer.add_message(channels["/points"], stamp, codec.encode(cloud), stamp, number)
            for tick in range(10):
                time_ns = stamp + tick * PERIOD_NS // 10
                imu = b"\0\1\0\0" + struct.pack("<II", *divmod(time_ns, 10**9)) + bytes(304)
                writer.add_message(channels["/imu"], time_ns, imu, time_ns, number * 10 + tick)
        writer.finish()
    part.rename(path)


def share_above_threshold(share: float) -> float:
    """Return the share of the points of the first frame that pass the ring thresholds."""
    from seaclutter_cli.frame import Frame

    method = FILTERS["ring_intensity"]
    rings = method(method.Params()).step(Frame(from_array(frame(0, share)))).rings
    return float((rings.points - rings.low_intensity).sum() / POINTS)
