"""Recordings with packet topics, written by the rosbags library as an independent writer."""

import struct

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

CONTAINERS = ("bag", "db3", "mcap")
DEFINITIONS = {
    "rslidar_msg/msg/RslidarPacket": "std_msgs/Header header\nuint8 is_difop\nuint8 is_frame_begin\nuint8[] data",
    "rslidar_msgs/msg/rslidarPacket": "builtin_interfaces/Time stamp\nuint8[1248] data",
    "rslidar_msgs/msg/rslidarScan": "std_msgs/Header header\nrslidar_msgs/rslidarPacket[] packets",
}


class Types:
    """Message classes of ROS 1 or ROS 2, with those of lidar drivers."""

    def __init__(self, container, definitions=DEFINITIONS):
        self.ros1 = container == "bag"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        for name, text in definitions.items():
            self.store.register(get_types_from_msg(text, name))

    def make(self, name, *values):
        return self.store.types[name](*values)

    def time(self, time_ns):
        return self.make("builtin_interfaces/msg/Time", *divmod(time_ns, 10**9))

    def header(self, time_ns, frame_id):
        values = (self.time(time_ns), frame_id)
        return self.make("std_msgs/msg/Header", *((7, *values) if self.ros1 else values))

    def bytes(self, message):
        name = message.__msgtype__
        serialize = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        return bytes(serialize(message, name))


def write(path, container, types, messages):
    """Write (topic, time, message) into a new recording, and return its path."""
    path = path / f"log_{container}"
    if container == "bag":
        path = path.with_suffix(".bag")
        writer = Writer1(path)
    else:
        plugin = {"db3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}[container]
        writer = Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        connections = {}
        for topic, time_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=types.store)
            writer.write(connections[topic], time_ns, types.bytes(message))
    return path


def captured(path):
    """Return times and payloads of the datagrams in a PCAP file with Ethernet and IPv4 headers of 42 bytes."""
    data, at, found = path.read_bytes(), 24, []
    factor = 1000 if struct.unpack_from("<I", data)[0] == 0xA1B2C3D4 else 1
    while at < len(data):
        seconds, rest, length, _ = struct.unpack_from("<IIII", data, at)
        found.append((seconds * 10**9 + rest * factor, data[at + 58 : at + 16 + length]))
        at += 16 + length
    return found


def array(payload):
    return np.frombuffer(payload, np.uint8)
