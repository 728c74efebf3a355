"""The same frames give the same output in every log format."""

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from pypcd4 import Encoding, PointCloud
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.cloud import from_array
from seaclutter_cli.messages import CODECS
from tests.running import execute

STORE = get_typestore(Stores.LATEST)
TYPE = "sensor_msgs/msg/PointCloud2"
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 100_000_000
FRAMES = 4
POINT = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")]


def frame(number):
    """Return a frame of 400 points: weak clutter, two targets, single bright drops, some invalid points."""
    rng = np.random.default_rng(number)
    points = np.zeros(400, POINT)
    points["x"], points["y"] = rng.uniform(-60, 60, (2, 400))
    points["z"] = rng.normal(0, 0.3, 400)
    points["intensity"] = rng.integers(0, 40, 400)
    for first, center in ((100, (20, 5)), (160, (-30, 30))):
        target = slice(first, first + 60)
        points["x"][target], points["y"][target] = (rng.normal(axis, 0.4, 60) for axis in center)
        points["intensity"][target] = rng.integers(60, 255, 60)
    for axis in "xyz":
        points[axis] = np.round(points[axis] * 64) / 64  # exact in text
    points["x"][:5] = np.nan
    points[5:8] = 0
    return points


def message(number):
    stamp = START_NS + number * PERIOD_NS
    cloud = from_array(frame(number), stamp_ns=stamp)
    return stamp, CODECS[TYPE, "cdr"].encode(cloud)


def write_mcap(path, compression):
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, chunk_size=8000)
        writer.start(profile="ros2")
        text = STORE.generate_msgdef(TYPE, ros_version=2)[0]
        schema = writer.register_schema(TYPE, "ros2msg", text.encode())
        channel = writer.register_channel("/points", "cdr", schema)
        for number in range(FRAMES):
            stamp, data = message(number)
            writer.add_message(channel, stamp, data, stamp, number)
        writer.finish()
    return path


def write_bag(path):
    with BagWriter(path) as writer:
        connection = writer.add_connection("/points", TYPE, typestore=STORE)
        for number in range(FRAMES):
            stamp, data = message(number)
            writer.write(connection, stamp, STORE.cdr_to_ros1(data, TYPE))
    return path


def write_rosbag2(path, plugin):
    with Bag2Writer(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/points", TYPE, typestore=STORE)
        for number in range(FRAMES):
            stamp, data = message(number)
            writer.write(connection, stamp, data)
    return path


def write_pcd(path, encoding):
    path.mkdir()
    for number in range(FRAMES):
        columns = [frame(number)[name] for name, _ in POINT]
        cloud = PointCloud.from_points(np.stack(columns, axis=1), [name for name, _ in POINT], [np.float32] * 4)
        cloud.save(path / f"{START_NS + number * PERIOD_NS}.pcd", encoding=encoding)
    return path


FORMATS = {
    "mcap-zstd": lambda folder: write_mcap(folder / "log.mcap", CompressionType.ZSTD),
    "mcap-lz4": lambda folder: write_mcap(folder / "log.mcap", CompressionType.LZ4),
    "mcap-none": lambda folder: write_mcap(folder / "log.mcap", CompressionType.NONE),
    "bag": lambda folder: write_bag(folder / "log.bag"),
    "db3-folder": lambda folder: write_rosbag2(folder / "log", StoragePlugin.SQLITE3),
    "db3-file": lambda folder: write_rosbag2(folder / "log", StoragePlugin.SQLITE3) / "log.db3",
    "rosbag2-mcap": lambda folder: write_rosbag2(folder / "log", StoragePlugin.MCAP),
    "pcd-binary": lambda folder: write_pcd(folder / "log", Encoding.BINARY),
    "pcd-ascii": lambda folder: write_pcd(folder / "log", Encoding.ASCII),
    "pcd-compressed": lambda folder: write_pcd(folder / "log", Encoding.BINARY_COMPRESSED),
}


def run(log, folder, *options):
    table, out = folder / "frames.csv", folder / "out.mcap"
    arguments = ["filter", str(log), "-o", str(out), "--csv", str(table), "-s", "filter.near=keep", *options]
    execute(*arguments, code=0)
    lines = [line.split(",", 2)[2] for line in table.read_text().splitlines()]  # without recording and topic
    clouds = []
    with out.open("rb") as stream:
        for _, channel, record in make_reader(stream, validate_crcs=True).iter_messages(topics=["/points"]):
            schema = "sensor_msgs/PointCloud2" if channel.message_encoding == "ros1" else TYPE
            clouds.append(CODECS[schema, channel.message_encoding].decode(record.data).points)
    return lines, clouds


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    folder = tmp_path_factory.mktemp("expected")
    lines, clouds = run(FORMATS["mcap-zstd"](folder), folder)
    assert len(clouds) == FRAMES
    assert 0 < sum(map(len, clouds)) < FRAMES * 400
    return lines, clouds


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_points(name, expected, tmp_path):
    lines, clouds = run(FORMATS[name](tmp_path), tmp_path)
    assert lines == expected[0]
    for cloud, other in zip(clouds, expected[1], strict=True):
        assert cloud.tobytes() == other.tobytes()
