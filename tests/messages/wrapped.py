"""Messages of clouds in other forms than PointCloud2, serialised by rosbags, which shares no code with the program."""

import gzip
import struct
import zlib
from functools import cache
from pathlib import Path

import numpy as np
import zstandard
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests import logs

DATA = Path(__file__).parent / "data"
DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
FOXGLOVE_TYPES = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}
COMPRESSED = "point_cloud_interfaces/msg/CompressedPointCloud2"
FOXGLOVE = "foxglove_msgs/msg/PointCloud"
SCAN, ECHOES = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/MultiEchoLaserScan"
LIVOX, LIVOX_POINT = "livox_ros_driver2/msg/CustomMsg", "livox_ros_driver2/msg/CustomPoint"
DEFINITIONS = {
    LIVOX_POINT: """
        uint32 offset_time
        float32 x
        float32 y
        float32 z
        uint8 reflectivity
        uint8 tag
        uint8 line""",
    LIVOX: """
        std_msgs/Header header
        uint64 timebase
        uint32 point_num
        uint8 lidar_id
        uint8[3] rsvd
        livox_ros_driver2/CustomPoint[] points""",
    COMPRESSED: """
        std_msgs/Header header
        uint32 height
        uint32 width
        sensor_msgs/PointField[] fields
        bool is_bigendian
        uint32 point_step
        uint32 row_step
        uint8[] compressed_data
        bool is_dense
        string format""",
    "foxglove_msgs/msg/PackedElementField": "string name\nuint32 offset\nuint8 type",
    FOXGLOVE: """
        builtin_interfaces/Time timestamp
        string frame_id
        geometry_msgs/Pose pose
        uint32 point_stride
        foxglove_msgs/PackedElementField[] fields
        uint8[] data""",
}
PACK = {
    "zstd": zstandard.compress,
    "zlib": lambda data: gzip.compress(data, mtime=0),
    "raw zlib": zlib.compress,
}
PLANE = (-3.0, 3.0, 0.05, 1e-4, 0.1, 0.5, 60.0)
"""angle_min, angle_max, angle_increment, time_increment, scan_time, range_min, range_max."""


@cache
def store(encoding):
    """Return the types of ROS 1 or ROS 2, with those that they lack."""
    found = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        found.register(get_types_from_msg("\n".join(line.strip() for line in text.splitlines()), name))
    return found


def serialised(encoding, kind, *values, little=True):
    """Return a message of a type with these values."""
    types = store(encoding)
    message = types.types[kind](*values)
    if encoding == "ros1":
        return bytes(types.serialize_ros1(message, kind))
    return bytes(types.serialize_cdr(message, kind, little_endian=little))


def deserialised(encoding, kind, data):
    """Return a message as rosbags reads it."""
    types = store(encoding)
    return (types.deserialize_ros1 if encoding == "ros1" else types.deserialize_cdr)(data, kind)


def time_of(encoding, stamp_ns):
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    if encoding == "ros1":  # rosbags packs seconds as signed numbers for both versions
        seconds = struct.unpack("<i", struct.pack("<I", seconds))[0]
    return store(encoding).types["builtin_interfaces/msg/Time"](seconds, nanoseconds)


def header(encoding, stamp_ns, frame_id, sequence=3):
    number = {"seq": sequence} if encoding == "ros1" else {}
    return store(encoding).types["std_msgs/msg/Header"](**number, stamp=time_of(encoding, stamp_ns), frame_id=frame_id)


def compressed(plain, encoding, form, packed, *, little=True):
    """Return a compressed cloud; ``packed`` are the compressed bytes."""
    field = store(encoding).types["sensor_msgs/msg/PointField"]
    return serialised(
        encoding,
        COMPRESSED,
        header(encoding, plain.stamp_ns, plain.frame_id),
        plain.height,
        plain.width,
        [field(f.name, f.offset, DATATYPES[f.type], f.count) for f in plain.fields],
        plain.big_endian,
        plain.point_step,
        plain.row_step,
        np.frombuffer(packed, np.uint8),
        plain.dense,
        form,
        little=little,
    )


def foxglove(plain, encoding, pose=(1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8), *, little=True):
    """Return a cloud of Foxglove as a ROS message."""
    types = store(encoding).types
    place = types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](*pose[:3]), types["geometry_msgs/msg/Quaternion"](*pose[3:])
    )
    field = types["foxglove_msgs/msg/PackedElementField"]
    fields = [field(f.name, f.offset, FOXGLOVE_TYPES[f.type]) for f in plain.fields]
    data = np.frombuffer(plain.data, np.uint8)
    stamp = time_of(encoding, plain.stamp_ns)
    return serialised(encoding, FOXGLOVE, stamp, plain.frame_id, place, plain.point_step, fields, data, little=little)


def scan(encoding, ranges, intensities, *, plane=PLANE, stamp_ns=logs.START_NS, little=True):
    """Return a scan with one echo a beam."""
    values = [np.array(column, np.float32) for column in (ranges, intensities)]
    return serialised(encoding, SCAN, header(encoding, stamp_ns, "scanner"), *plane, *values, little=little)


def echoes(encoding, ranges, intensities, *, plane=PLANE, stamp_ns=logs.START_NS, little=True):
    """Return a scan with lists of echoes."""
    echo = store(encoding).types["sensor_msgs/msg/LaserEcho"]
    lists = [[echo(np.array(values, np.float32)) for values in column] for column in (ranges, intensities)]
    return serialised(encoding, ECHOES, header(encoding, stamp_ns, "scanner"), *plane, *lists, little=little)


def livox(encoding, points, *, stamp_ns=logs.START_NS, frame_id="livox_frame", little=True):
    """Return a Livox message of points with offset_time, x, y, z, reflectivity, tag and line."""
    kind = store(encoding).types[LIVOX_POINT]
    made = [kind(*point) for point in points.tolist()]
    reserved = np.array([7, 8, 9], np.uint8)
    head = header(encoding, stamp_ns, frame_id), stamp_ns - 1000, len(made), 192, reserved
    return serialised(encoding, LIVOX, *head, made, little=little)


LIVOX_FIELDS = [("offset_time", "u4"), ("x", "f4"), ("y", "f4"), ("z", "f4"), ("reflectivity", "u1")]
LIVOX_FIELDS += [("tag", "u1"), ("line", "u1")]


def livox_points(points):
    """Return points with coordinates and intensity as Livox points, 10 µs apart."""
    found = np.zeros(len(points), LIVOX_FIELDS)
    for axis in "xyz":
        found[axis] = points[axis]
    found["reflectivity"] = points["intensity"]
    found["offset_time"], found["tag"] = np.arange(len(points)) * 10_000, 16
    found["line"] = np.arange(len(points)) % 4
    return found


def topic(name, kind, encoding="cdr"):
    """Return a topic of a type."""
    ros = 2 if encoding == "cdr" else 1
    text, _ = store(encoding).generate_msgdef(kind, ros_version=ros)
    schema = (kind if ros == 2 else kind.replace("/msg/", "/"), f"ros{ros}msg", text.encode())
    return logs.Topic(name, encoding, schema)


def sea_messages(form, frames=3, points=60, encoding="cdr"):
    """Return the frames of `logs.cloud_messages` in another form, a key of `KINDS`."""
    found = []
    for number in range(frames):
        stamp_ns = logs.START_NS + number * logs.PERIOD_NS - 5_000_000
        cloud = logs.sea_points(points, (0, number))
        found.append(_message(form, cloud, stamp_ns, encoding))
    return found


def _message(form, points, stamp_ns, encoding):
    from tests.messages.clouds import Field, Plain

    fields = tuple(Field(name, offset, dtype.str[1:]) for name, (dtype, offset) in points.dtype.fields.items())
    step, data = points.dtype.itemsize, points.tobytes()
    plain = Plain(1, len(points), fields, step, len(data), False, data, False, stamp_ns, "lidar")
    if form in PACK:
        return compressed(plain, encoding, form, PACK[form](data))
    if form == "draco":
        drawn = draco_plain(stamp_ns)
        return compressed(drawn, encoding, "draco", (DATA / "sequential.drc").read_bytes())
    if form == "foxglove":
        return foxglove(plain, encoding)
    if form == "livox":
        return livox(encoding, livox_points(points), stamp_ns=stamp_ns)
    ranges = np.hypot(points["x"], points["y"])
    if form == "scan":
        return scan(encoding, ranges, points["intensity"], stamp_ns=stamp_ns)
    pairs = [[value, value + 3] for value in ranges], [[value, value / 2] for value in points["intensity"]]
    return echoes(encoding, *pairs, stamp_ns=stamp_ns)


KINDS = {"zstd": COMPRESSED, "zlib": COMPRESSED, "draco": COMPRESSED, "foxglove": FOXGLOVE, "scan": SCAN}
KINDS |= {"echoes": ECHOES, "livox": LIVOX}


def sea_log(path, form, encoding="cdr", topic_name="/points", others=()):
    """Write an MCAP log of frames in a form, with further topics and messages."""
    messages = sea_messages(form, encoding=encoding)
    entries = [
        logs.Entry(topic_name, logs.START_NS + number * logs.PERIOD_NS, message)
        for number, message in enumerate(messages)
    ]
    topics = [topic(topic_name, KINDS[form], encoding), *(described for described, _ in others)]
    for _, more in others:
        entries += more
    entries.sort(key=lambda entry: entry.log_time_ns)
    return logs.write_log(path, topics, entries, profile="ros1" if encoding == "ros1" else "ros2")


DRACO_POINTS = 100


def draco_points():
    """Return the points of the Draco files, which a program linked to the library made as the plugin does.

    It adds an attribute for each field, with the type of the plugin's table, and encodes: ``sequential.drc`` with its
    own choice of a method (which is exact), ``kd_tree.drc`` with 14 bits and without the times.
    """
    number = np.arange(DRACO_POINTS)
    points = np.zeros(DRACO_POINTS, logs.POINT)
    points["x"], points["y"] = 10 + number * 0.25, np.sin(number) * 20
    points["z"], points["intensity"] = -2 + 0.01 * number, number % 256
    points["ring"], points["timestamp"] = number % 32, 1.7e9 + number * 1e-4
    return points


def draco_plain(stamp_ns=logs.START_NS, *, without=()):
    """Return the cloud of the Draco files; its data are not compressed."""
    from tests.messages.clouds import Field, Plain

    points = draco_points()
    fields = tuple(
        Field(name, offset, dtype.str[1:])
        for name, (dtype, offset) in points.dtype.fields.items()
        if name not in without
    )
    step = points.dtype.itemsize
    return Plain(1, len(points), fields, step, points.nbytes, False, points.tobytes(), True, stamp_ns, "lidar")
