"""Peculiarities of recordings and their records: bags, MCAP files, folders, split files."""

import json
from functools import partial

import numpy as np
import yaml
import zstandard

from tests.logs import PERIOD_NS, START_NS, Entry, Topic, cloud_message, cloud_topic, write_log
from tests.peculiarities.case import Case, sea

TYPE, TEXT = cloud_topic("/points").schema[0], cloud_topic("/points").schema[2]
ROSBAG2 = "https://github.com/ros2/rosbag2/"
PACKED = f"{ROSBAG2}tree/rolling/rosbag2_compression: compression_mode message and file; only metadata.yaml names them"


def structured(points):
    return points.view([(name, "<f4") for name in ("x", "y", "z", "intensity")])[:, 0]


def entries(numbers=range(3), **changes):
    times = {number: START_NS + number * PERIOD_NS for number in numbers}
    return [
        Entry("/points", time_ns, cloud_message("ros2", structured(sea(number)), time_ns, **changes))
        for number, time_ns in times.items()
    ]


def stuck(folder):
    """Write a log of six clouds of 0.1 s, all with the stamp of the first."""
    rows = [entry._replace(data=entries((0,))[0].data) for entry in entries(range(6))]
    return write_log(folder / "log.mcap", [cloud_topic("/points")], rows)


def registered(folder):
    rows = [entry._replace(data=entry.data.replace(b"lidar\0", b"world\0")) for entry in entries()]
    return write_log(folder / "log.mcap", [cloud_topic("/points")], rows)


def log(folder, definition=TEXT, name=TYPE, **changes):
    topic = Topic("/points", "cdr", (name, "ros2msg", definition))
    return write_log(folder / "log.mcap", [topic], entries(**changes))


def crashed(folder):
    """Return a folder whose last file its ``metadata.yaml`` lacks."""
    path = folder / "run_2026_01_02-10_00_00"
    path.mkdir()
    names = [f"{number}_run_2026_01_02-10_00_{10 * number:02d}.mcap" for number in range(3)]
    for number, name in enumerate(names):
        write_log(path / name, [cloud_topic("/points")], entries([number]))
    info = {"version": 9, "storage_identifier": "mcap", "relative_file_paths": names[:2], "message_count": 2}
    (path / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": info}))
    return path


def posed(folder):
    message = json.loads(cloud_message("json", structured(sea()), START_NS))
    message["pose"] = {"position": {"x": 1, "y": 2, "z": 12}, "orientation": {"x": 0, "y": 0, "z": 1, "w": 0}}
    entry = Entry("/points", START_NS, json.dumps(message).encode())
    return write_log(folder / "log.mcap", [cloud_topic("/points", "json")], [entry], profile="")


def with_empty(folder):
    empty = cloud_message("ros2", structured(sea(0, 0)), START_NS, fields=[], width=0, point_step=0, row_step=0)
    late = Entry("/points", START_NS + 3 * PERIOD_NS, empty)
    return write_log(folder / "log.mcap", [cloud_topic("/points")], [*entries(), late])


def packed(folder, name="log.mcap.zstd"):
    """Write a log that is compressed as a whole, as ``zstd log.mcap`` does."""
    path = folder / name
    path.write_bytes(zstandard.compress(log(folder).read_bytes()))
    (folder / "log.mcap").unlink()
    return path


def packed_folder(folder):
    for number in range(2):
        part = write_log(
            folder / "part.mcap", [cloud_topic("/points")], entries(range(2 * number, min(2 * number + 2, 3)))
        )
        (folder / f"log_{number}.mcap.zstd").write_bytes(zstandard.compress(part.read_bytes()))
    (folder / "part.mcap").unlink()
    return folder


def packed_messages(folder):
    """Write a log whose messages rosbag2 compressed, without the folder that says so."""
    rows = [entry._replace(data=zstandard.compress(entry.data)) for entry in entries()]
    return write_log(folder / "log.mcap", [cloud_topic("/points")], rows)


def two_recorders(folder):
    """Write the logs of two recorders that ran at the same time, with the same topic."""
    write_log(folder / "port.mcap", [cloud_topic("/points")], entries((0, 2)))
    write_log(folder / "starboard.mcap", [cloud_topic("/points")], entries((1,)))
    return folder


def stepping(folder):
    """Write a log of three clouds whose stamps go backwards."""
    late = enumerate(entries((2, 1, 0)))
    rows = [entry._replace(log_time_ns=START_NS + number * PERIOD_NS) for number, entry in late]
    return write_log(folder / "log.mcap", [cloud_topic("/points")], rows)


def twice(folder):
    """Write a log of a cloud with two fields x, the second of which is 0."""
    points = np.zeros(len(sea()), [*structured(sea()).dtype.descr, ("q", "<f4")])
    for name in structured(sea()).dtype.names:
        points[name] = structured(sea())[name]
    data = cloud_message("ros2", points, START_NS).replace(b"\2\0\0\0q\0", b"\2\0\0\0x\0")
    return write_log(folder / "log.mcap", [cloud_topic("/points")], [Entry("/points", START_NS, data)])


SEA = [sea(number) for number in range(3)]
CASES = [
    Case(
        name="files named N_NAME_TIME after a crash",
        source=f"{ROSBAG2}pull/2265",
        build=crashed,
        frames=SEA,
    ),
    Case(
        name="messages in zstd outside their folder",
        source=PACKED,
        build=packed_messages,
        frames=SEA,
        to=("mcap", "bag"),
    ),
    Case(name=".mcap.zstd", source=f"{ROSBAG2}issues/1096", build=packed, frames=SEA, to=("mcap", "bag")),
    Case(name="files .mcap.zstd in a folder", source=PACKED, build=packed_folder, frames=SEA),
    *(
        Case(
            name=f"definition: {name}",
            source="https://github.com/foxglove/mcap/issues: schemas that bridges wrote, whose text tools ignore",
            build=partial(log, definition=text),
            frames=SEA,
            to=("bag", "rosbag2-db3"),
        )
        for name, text in {"empty": b"", "name": TYPE.encode(), "CRLF": TEXT.replace(b"\n", b"\r\n")}.items()
    ),
    Case(
        name="type without msg",
        source=f"{ROSBAG2}issues: the first versions of ROS 2 named types as ROS 1 does",
        build=partial(log, name="sensor_msgs/PointCloud2"),
        frames=SEA,
        to=("mcap", "bag"),
    ),
    Case(
        name="type with a name of DDS",
        source="https://docs.foxglove.dev: bridges of DDS name types as DDS does, sensor_msgs::msg::dds_::PointCloud2_",
        build=partial(log, name="sensor_msgs::msg::dds_::PointCloud2_"),
        refused="no point clouds that can be read.*types with names of DDS are not read: record with rosbag2",
        refused_by=("info", "filter"),
    ),
    *(
        Case(
            name=f"logs of two recorders, {name}",
            source="https://github.com/ros2/rosbag2/issues: merge bags of several machines; equal topics need names",
            build=two_recorders,
            words=("--merge", "-t", f"/{name}/points"),
            topic=f"/{name}/points",
            frames=[SEA[number] for number in numbers],
            to=("mcap", "bag"),
        )
        for name, numbers in {"port": (0, 2), "starboard": (1,)}.items()
    ),
    Case(
        name="stamps that stand still",
        source="https://github.com/ros-drivers/velodyne/issues: stamps of a lidar without GPS, or of a stopped clock",
        build=stuck,
        frames=[SEA[0]] * 6,
        says=dict.fromkeys(("info", "filter"), "frames with the stamp of the one before"),
    ),
    Case(
        name="stamps that stand still, joined",
        source="https://github.com/Livox-SDK/livox_ros_driver2/issues: all scans have the time at which it started",
        build=stuck,
        frames=[np.concatenate([SEA[0]] * 2)] * 3,
        words=("--integrate", "200"),
        says=dict.fromkeys(("info", "filter", "convert"), "frames with the stamp of the one before"),
    ),
    *(
        Case(
            name=f"stamps that step back{joined}",
            source="https://github.com/ros-drivers/velodyne/issues: a clock that is set back, drivers with threads",
            build=stepping,
            frames=SEA[::-1],
            words=words,
            says=dict.fromkeys(commands, "frames with an earlier stamp than the one before"),
        )
        for joined, words, commands in (
            ("", (), ("info", "filter", "evaluate")),
            (", joined", ("--integrate", "50"), ("info", "filter", "evaluate", "convert")),
        )
    ),
    Case(
        name="wrong row_step",
        source="https://github.com/ros-perception/perception_pcl/issues: clouds with the row_step of one point",
        build=partial(log, height=4, width=10, row_step=16),
        frames=SEA,
        says={"filter": "wrong row_step", "info": "wrong row_step"},
    ),
    Case(
        name="clouds in a fixed frame",
        source="https://github.com/hku-mars/FAST_LIO: /cloud_registered is in the frame camera_init",
        build=registered,
        frames=SEA,
        says=dict.fromkeys(
            ("info", "filter", "evaluate"), "clouds in the fixed frame 'world', not in that of the lidar"
        ),
    ),
    Case(
        name="two fields of one name",
        source="https://github.com/ros-perception/perception_pcl/issues: concatenated fields repeat x, y and z",
        build=twice,
        frames=[sea()],
        to=("mcap", "bag"),
        says=dict.fromkeys(("info", "filter", "evaluate"), "/points has several fields 'x': the first one is read"),
    ),
    Case(
        name="cloud without points and fields",
        source="Drivers publish clouds without points and fields while a lidar starts.",
        build=with_empty,
        frames=[*SEA, sea(0, 0)],
        to=("mcap", "bag"),
    ),
    Case(
        name="cloud with a pose",
        source="https://docs.foxglove.dev/docs/visualization/message-schemas/point-cloud: points relative to a pose",
        build=posed,
        frames=[sea() * (-1, -1, 1, 1) + (1, 2, 12, 0)],
        to=("pcd", "bag"),
        atol=1e-5,
        says={"convert": "pose, which was applied|poses of clouds, which were applied"},
    ),
]
