"""Small logs that expand to large ones, for limits of 1 MiB and 1000 messages."""

import bz2
import sqlite3
import struct

import lz4.frame
import zstandard

SIZE = 64 * 2**20
MAGIC, BAG_MAGIC = b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n"
MESSAGE = struct.pack("<BQHIQQ", 5, 22, 1, 0, 5, 5)


def text(value):
    return struct.pack("<I", len(value)) + value


def record(op, content):
    return struct.pack("<BQ", op, len(content)) + content


def schema(number=1, data=b"x"):
    return record(3, struct.pack("<H", number) + text(b"sensor_msgs/msg/PointCloud2") + text(b"ros2msg") + text(data))


def channel(number=1):
    names = text(b"/points") + text(b"cdr")
    return record(4, struct.pack("<HH", number, number) + names + struct.pack("<I", 0))


def chunk(records, compression=b"zstd"):
    packed = {b"zstd": zstandard.compress, b"lz4": lz4.frame.compress, b"": bytes}[compression](records)
    head = struct.pack("<QQQI", 0, 10, len(records), 0) + text(compression)
    return record(6, head + struct.pack("<Q", len(packed)) + packed)


def mcap(*chunks):
    end = record(15, bytes(4)) + record(2, bytes(20)) + MAGIC
    return MAGIC + record(1, text(b"ros2") + text(b"x")) + b"".join(chunks) + end


def large(compression):
    return chunk(schema() + channel() + bytes(SIZE), compression)


def fields(*items):
    return text(b"".join(map(text, items)))


def bag_record(data, *items):
    return fields(*items) + text(data)


def bag(compression, content, declared=None):
    packed = {b"bz2": bz2.compress, b"lz4": lz4.frame.compress}[compression](content)
    size = struct.pack("<I", len(content) if declared is None else declared)
    return BAG_MAGIC + bag_record(packed, b"op=\x05", b"compression=" + compression, b"size=" + size)


def connection(number, definition=b""):
    described = b"".join(map(text, (b"topic=/p", b"type=a/B", b"md5sum=0", b"message_definition=" + definition)))
    return bag_record(described, b"op=\x07", b"conn=" + struct.pack("<I", number), b"topic=/p")


BAG_MESSAGE = bag_record(b"", b"op=\x02", b"conn=\0\0\0\0", b"time=" + bytes(8))

FILES = {
    "zstd.mcap": lambda: mcap(large(b"zstd")),
    "zstd-cut.mcap": lambda: (MAGIC + large(b"zstd"))[:-6],
    "lz4.mcap": lambda: mcap(large(b"lz4")),
    "lz4-cut.mcap": lambda: (MAGIC + large(b"lz4"))[:-6],
    "none.mcap": lambda: mcap(chunk(schema() + channel() + bytes(2 * 2**20), b"")),
    "messages.mcap": lambda: mcap(chunk(schema() + channel() + MESSAGE * 5000)),
    "schemas.mcap": lambda: mcap(*(chunk(schema(n, bytes(900_000)) + channel(n) + MESSAGE) for n in range(1, 40))),
    "bz2.bag": lambda: bag(b"bz2", bytes(SIZE)),
    "lz4.bag": lambda: bag(b"lz4", bytes(SIZE)),
    "liar.bag": lambda: bag(b"bz2", bytes(SIZE), declared=1000),
    "messages.bag": lambda: bag(b"bz2", connection(0) + BAG_MESSAGE * 5000),
    "connections.bag": lambda: bag(b"bz2", b"".join(map(connection, range(5000)))),
}


def write_db3(path, data, messages="CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)"):
    """Write a database with one message, or with something else in place of the messages."""
    database = sqlite3.connect(path)
    database.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);"
        f"INSERT INTO topics VALUES(1, '/points', 'sensor_msgs/msg/PointCloud2', 'cdr'); {messages};"
    )
    if data is not None:
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 5, ?)", (data,))
    database.commit()
    database.close()
    return path
