"""Small ROS 1 bags, written and read by the rosbags library as an independent reference."""

import random
import struct

from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.sources.rosbag1.source import BagSource

TYPES = get_typestore(Stores.ROS1_NOETIC)
BZ2, LZ4 = Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4
COMPRESSIONS = [None, BZ2, LZ4]
START = 1_600_000_000 * 10**9
CLOUD, IMU = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Imu"
LOW_BITS = bytes(value % 8 for value in range(256))
"""Translation of random bytes to bytes that can be compressed."""


def write_bag(path, compression=None, *, messages=60, size=300, chunk=2000, times=None):
    """Write a bag with messages of two topics, roughly seven per chunk, and return its path."""
    path.unlink(missing_ok=True)
    noise = random.Random(1)
    writer = Writer(path)
    writer.chunk_threshold = chunk
    if compression:
        writer.set_compression(compression)
    with writer:
        connections = [
            writer.add_connection("/points", CLOUD, typestore=TYPES, callerid="/driver", latching=0),
            writer.add_connection("/imu", IMU, typestore=TYPES),
        ]
        for number in range(messages):
            time_ns = START + (times[number] if times else number * 1000)
            data = struct.pack("<I", number) + noise.randbytes(size + number % 7).translate(LOW_BITS)
            writer.write(connections[number % 2], time_ns, data)
    return path


def read(path, *, twice=True):
    """Return messages and damage of a bag, and check that a second pass gives the same."""
    source = BagSource(path)
    messages = [(m.log_time_ns, m.channel.topic, bytes(m.data)) for m in source.records()]
    damage = list(source.damage)
    if twice:
        assert messages == [(m.log_time_ns, m.channel.topic, bytes(m.data)) for m in source.records()]
        assert source.damage == damage
    source.close()
    return messages, damage


def reference(path):
    with Reader(path) as reader:
        return [(time, connection.topic, bytes(data)) for connection, time, data in reader.messages()]


def chunk_spans(path):
    """Return offset and end of every chunk, and the number of messages in it."""
    with Reader(path) as reader:
        return [
            (
                info.pos,
                reader.chunks[info.pos].datapos + reader.chunks[info.pos].datasize,
                sum(info.connection_counts.values()),
            )
            for info in reader.chunk_infos
        ]
