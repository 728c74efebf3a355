import errno
import json
import os
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.errors import InputError
from seaclutter_cli.messages import find_codec
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.sources.frame_files.folder import FolderSource, is_frame_folder
from seaclutter_cli.sources.frame_files.sidecars import parse_time
from tests.paths import SHARED_DATA

DATA = SHARED_DATA
S = 1_000_000_000
real_data = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are missing")


def put(path, value=0.0, size=3):
    """Write a small KITTI frame, or a CSV or PCD of the same points."""
    points = np.full((size, 4), value, "<f4")
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".csv":
        np.savetxt(path, points, delimiter=",", header="x,y,z,intensity", comments="")
    elif path.suffix.lower() == ".pcd":
        header = "VERSION .7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nWIDTH {0}\nHEIGHT 1\nPOINTS {0}\n"
        path.write_bytes(f"{header}DATA binary\n".format(size).encode() + points.tobytes())
    else:
        path.write_bytes(points.tobytes())


def stamps(source):
    return [message.log_time_ns for message in source.records()]


def first_values(source):
    """Return the x of the first point of every frame, which identifies its file."""
    codec = find_codec(source.channels[0])
    return [codec.decode(message.data).points["x"][0] for message in source.records()]


def test_messages_are_ros2_point_clouds(tmp_path):
    for index in range(3):
        put(tmp_path / f"{index:06d}.bin", index, size=index)
    source = FolderSource(tmp_path, rate_hz=5)
    assert (source.name, source.format) == (tmp_path.name, "folder of BIN")
    assert (source.profile, source.compression) == ("ros2", None)
    (channel,) = source.channels
    assert (channel.id, channel.topic, channel.message_encoding) == (1, "/points", "cdr")
    assert source.counts == {1: 3}
    store = get_typestore(Stores.ROS2_JAZZY)  # an independent reader
    for index, message in enumerate(source.records()):
        cloud = store.deserialize_cdr(bytes(message.data), "sensor_msgs/msg/PointCloud2")
        assert message.channel == channel
        assert message.log_time_ns == message.publish_time_ns == index * S // 5
        assert message.sequence == index
        assert cloud.header.stamp.sec * S + cloud.header.stamp.nanosec == message.log_time_ns
        assert cloud.header.frame_id == "lidar"
        assert (cloud.height, cloud.width, cloud.point_step) == (1, index, 16)
        assert [field.name for field in cloud.fields] == ["x", "y", "z", "intensity"]
        assert cloud.data.tobytes() == np.full((index, 4), index, "<f4").tobytes()
    assert source.damage == []
    source.close()


def test_records_can_be_read_again(tmp_path):
    put(tmp_path / "0.bin")
    (tmp_path / "1.bin").write_bytes(b"broken")
    source = FolderSource(tmp_path)
    assert [list(source.records()) for _ in range(2)] == [list(source.records())] * 2
    assert len(source.damage) == 1


def test_schema_contains_all_definitions():
    schema = ros2_schema("sensor_msgs/msg/PointCloud2")
    assert (schema.name, schema.encoding) == ("sensor_msgs/msg/PointCloud2", "ros2msg")
    for name in ("std_msgs/Header", "builtin_interfaces/Time", "sensor_msgs/PointField"):
        assert f"MSG: {name}" in schema.data.decode()
    assert ros2_schema("sensor_msgs/msg/PointCloud2") is schema


# Which files


def test_natural_order(tmp_path):
    for name, value in {"frame10": 10, "frame2": 2, "frame1": 1, "Frame3": 0, "frame2b": 3}.items():
        put(tmp_path / f"{name}.bin", value)
    assert first_values(FolderSource(tmp_path)) == [0, 1, 2, 3, 10]


def test_other_files_are_ignored(tmp_path):
    put(tmp_path / "0.bin")
    put(tmp_path / "1.BIN", 1)
    for name in ("README.md", "labels.csv", "run.labels.csv", "poses.csv", "0.label", ".DS_Store", "._0.bin", ".0.pcd"):
        (tmp_path / name).write_text("x")
    (tmp_path / "old.bin").mkdir()
    assert first_values(FolderSource(tmp_path)) == [0, 1]


def test_several_formats_are_an_error(tmp_path):
    put(tmp_path / "0.bin")
    put(tmp_path / "0.csv")
    put(tmp_path / "1.csv")
    assert is_frame_folder(tmp_path)
    with pytest.raises(InputError, match=r"several formats \(1 \.bin, 2 \.csv\)"):
        FolderSource(tmp_path)


def test_no_frames_are_an_error(tmp_path):
    (tmp_path / "notes.txt").write_text("x")
    assert not is_frame_folder(tmp_path)
    with pytest.raises(InputError, match="no frames"):
        FolderSource(tmp_path)
    with pytest.raises(InputError, match="not a frame file"):
        FolderSource(tmp_path / "notes.txt")
    with pytest.raises(InputError, match="No such file"):
        FolderSource(tmp_path / "missing")
    assert not is_frame_folder(tmp_path / "missing")
    assert not is_frame_folder(tmp_path / "notes.txt")


def test_tables_of_results_are_not_frames(tmp_path):
    (tmp_path / "frames.csv").write_text("recording,frame,targets\na,0,1\n")
    (tmp_path / "settings.csv").write_bytes(b"\xff\xfe\x00")
    assert not is_frame_folder(tmp_path)
    put(tmp_path / "z.csv")
    assert is_frame_folder(tmp_path)


def test_forbidden_folder_is_an_input_error(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied", path)

    monkeypatch.setattr(os, "scandir", refuse)
    with pytest.raises(InputError, match="Permission denied"):
        FolderSource(tmp_path)
    assert not is_frame_folder(tmp_path)


def test_single_files(tmp_path):
    put(tmp_path / "1673400472.138016.pcd")
    put(tmp_path / "other.bin")
    source = FolderSource(tmp_path / "1673400472.138016.pcd")
    assert (source.name, source.format, source.counts) == ("1673400472.138016", "PCD file", {1: 1})
    assert stamps(source) == [1673400472138016000]
    assert stamps(FolderSource(tmp_path / "other.bin")) == [0]


def test_name_of_the_current_folder(tmp_path, monkeypatch):
    put(tmp_path / "run.2024" / "0.bin")
    monkeypatch.chdir(tmp_path / "run.2024")
    assert FolderSource(Path()).name == "run.2024"


@pytest.mark.skipif(sys.platform == "win32", reason="names and links that Windows does not allow")
def test_odd_names_and_links(tmp_path):
    folder = tmp_path / "a [1]* ünï 海"
    put(folder / "frame [2] ä.bin", 2)
    put(folder / "frame [10] ?.bin", 10)
    put(tmp_path / "elsewhere.bin", 3)
    (folder / "frame [3].bin").symlink_to(tmp_path / "elsewhere.bin")
    (folder / "frame [4].bin").symlink_to(tmp_path / "gone.bin")
    (tmp_path / "link").symlink_to(folder, target_is_directory=True)
    for path in (folder, tmp_path / "link"):
        source = FolderSource(path)
        assert source.name == path.name
        assert first_values(source) == [2, 3, 10]
        assert [damage.path.name for damage in source.damage] == ["frame [4].bin"]
        assert "No such file" in source.damage[0].problem


# Damage and memory


def test_damaged_frames_are_left_out_and_reported(tmp_path):
    for index in range(4):
        put(tmp_path / f"{index}.bin", index)
    (tmp_path / "1.bin").write_bytes(bytes(17))
    source = FolderSource(tmp_path)
    assert [(message.sequence, message.log_time_ns) for message in source.records()] == [
        *((0, 0), (2, S // 5), (3, 3 * S // 10)),
    ]
    (damage,) = source.damage
    assert (damage.path, damage.offset, damage.lost_bytes, damage.lost_messages) == (tmp_path / "1.bin", None, 17, 1)
    assert source.counts == {1: 4}


def test_frames_that_vanish_are_reported(tmp_path):
    put(tmp_path / "0.bin")
    source = FolderSource(tmp_path)
    (tmp_path / "0.bin").unlink()
    assert list(source.records()) == []
    assert "No such file" in str(source.damage[0])


def test_memory_does_not_grow_with_the_folder(tmp_path):
    for index in range(40):
        put(tmp_path / f"{index}.bin", index, size=16_000)  # 256 kB
    source = FolderSource(tmp_path)
    tracemalloc.start()
    assert sum(1 for _ in source.records()) == 40
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5 * 256_000


# Stamps


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["1673400472138016708", "1673400472238016708"], [1673400472138016708, 1673400472238016708]),
        (["1673400472138016", "1673400472238016"], [1673400472138016000, 1673400472238016000]),
        (["1673400472138", "1673400472238"], [1673400472138000000, 1673400472238000000]),
        (["1673400472.138016", "1673400472.238"], [1673400472138016000, 1673400472238000000]),
        (["1673400472.9", "1673400472.10"], [1673400472100000000, 1673400472900000000]),
        (["cloud_1673400472138016708", "cloud_1673400472238016708"], [1673400472138016708, 1673400472238016708]),
    ],
)
def test_stamps_in_names(tmp_path, names, expected):
    for name in names:
        put(tmp_path / f"{name}.bin")
    assert stamps(FolderSource(tmp_path)) == expected


@pytest.mark.parametrize(
    "names",
    [
        ["000000", "000001"],
        ["0000000000", "0000000001"],
        ["1673400472", "1673400473"],
        ["0000000000000000001", "0000000000000000002"],  # 19 digits, but a number
        ["1673400472138016708", "frame"],
        ["1673400472138", "1673400472138017"],
        ["a_1673400472138", "b_1673400472138"],
        ["9000000000000000000", "9000000000000000001"],  # exceeds the range of a stamp
        ["20240101120000", "20240101120001"],
    ],
)
def test_names_that_are_not_times(tmp_path, names):
    for name in names:
        put(tmp_path / f"{name}.bin")
    assert stamps(FolderSource(tmp_path)) == [0, S // 10]


@pytest.mark.parametrize(
    ("rate_hz", "index", "expected"),
    [(10.0, 3, 3 * S // 10), (0.1, 7, 70 * S), (3.0, 2, 666_666_667), (12.5, 5, 4 * S // 10), (1e-3, 8, 8000 * S)],
)
def test_stamps_from_the_rate_are_exact(tmp_path, rate_hz, index, expected):
    for number in range(9):
        put(tmp_path / f"{number}.bin")
    assert stamps(FolderSource(tmp_path, rate_hz=rate_hz))[index] == expected


def seepersea(folder, times):
    for index, time in enumerate(times):
        put(folder / "point_clouds" / f"{index:06d}.pcd", index)
        (folder / "timestamp").mkdir(exist_ok=True)
        (folder / "timestamp" / f"{index:06d}.txt").write_text(time)
        (folder / "annotations").mkdir(exist_ok=True)
        (folder / "annotations" / f"{index:06d}.json").write_text(json.dumps({"labels": []}))
    (folder / "notes.csv").write_text("a,b\n1,2\n")


@pytest.mark.parametrize(
    "times", [["1673400472.138016\n", "1673400472.238"], ["1673400472138016000", "1673400472238000000 "]]
)
def test_seepersea(tmp_path, times):
    seepersea(tmp_path, times)
    assert is_frame_folder(tmp_path)
    for path in (tmp_path, tmp_path / "point_clouds"):
        source = FolderSource(path)
        assert source.format == "folder of PCD"
        assert stamps(source) == [1673400472138016000, 1673400472238000000]
        assert source.damage == []


@pytest.mark.parametrize(
    "first", ["lidar: 1673400472.5 camera: 1673400472.6", "secs: 1673400472\nnsecs: 500000000", "2023-01-11 01:27:52.5"]
)
def test_seepersea_other_forms_of_times(tmp_path, first):
    seepersea(tmp_path, [first, "1673400473.5"])
    assert stamps(FolderSource(tmp_path)) == [1673400472500000000, 1673400473500000000]


@pytest.mark.parametrize("times", [["1", "1"], ["2", "1"], ["1", "soon"], ["1", ""]])
def test_invalid_times_are_reported_and_not_used(tmp_path, times):
    seepersea(tmp_path, times)
    source = FolderSource(tmp_path)
    assert stamps(source) == [0, S // 10]
    assert "000001" in source.warnings[0]
    assert "10 frames per second" in source.warnings[0]


def test_seepersea_without_a_time_for_a_frame(tmp_path):
    seepersea(tmp_path, ["1", "2"])
    (tmp_path / "timestamp" / "000001.txt").unlink()
    source = FolderSource(tmp_path)
    assert stamps(source) == [0, S // 10]
    assert "000001.txt: No such file" in source.warnings[0]


@pytest.mark.parametrize("inner", ["velodyne", "velodyne_points/data"])
@pytest.mark.parametrize(
    ("name", "lines"),
    [
        ("times.txt", ["0.000000e+00", "1.037875e-01"]),
        ("timestamps.txt", ["1970-01-01 00:00:00.000000000", "1970-01-01 00:00:00.103787500", ""]),
    ],
)
def test_kitti_layouts(tmp_path, inner, name, lines):
    folder = tmp_path / inner
    put(folder / "0000000000.bin")
    put(folder / "0000000001.bin")
    (folder.parent / name).write_text("\n".join(lines))
    assert is_frame_folder(tmp_path)
    for path in (tmp_path, folder):
        assert stamps(FolderSource(path)) == [0, 103_787_500]


def test_kitti_frames_that_were_left_out_keep_their_times(tmp_path):
    for number in (0, 3, 4):
        put(tmp_path / "velodyne" / f"{number:06d}.bin")
    (tmp_path / "times.txt").write_text("0\n0.1\n0.2\n0.3\n0.4\n")
    assert stamps(FolderSource(tmp_path)) == [0, 3 * S // 10, 4 * S // 10]


def test_kitti_with_too_few_times(tmp_path):
    for number in range(3):
        put(tmp_path / "velodyne" / f"{number:06d}.bin")
    (tmp_path / "times.txt").write_text("0\n0.1\n")
    source = FolderSource(tmp_path)
    assert stamps(source) == [0, S // 10, 2 * S // 10]
    assert "2 times for 3 frames" in source.warnings[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1673400472", 1673400472 * S),
        (" 1673400472.123456789\n", 1673400472123456789),
        ("2011-09-26 13:02:25.964389445", 1317042145964389445),
        ("2011-09-26T13:02:25Z", 1317042145 * S),
        ("2011-09-26T15:02:25.5+02:00", 1317042145500000000),
        ("0", 0),
        *((text, None) for text in ("", "nan", "inf", "1e999999", "2011-13-26 13:02:25", "2147483648", "x")),
        ("1e-999999", 0),
        ("-1", -S),
    ],
)
def test_parse_time(text, expected):
    assert parse_time(text) == expected


# Real data


@real_data
@pytest.mark.parametrize(
    ("name", "stamp_ns"),
    [("vlp16", 1673400472138016708), ("vlp32", 1713492677464078412), ("xt32", 1673400678101968885)],
)
def test_real_pcd_folder(name, stamp_ns):
    source = FolderSource(DATA / "nebula" / name)
    (message,) = source.records()
    assert message.log_time_ns == stamp_ns
    assert find_codec(message.channel).decode(message.data).stamp_ns == stamp_ns
