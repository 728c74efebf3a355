"""ROS 2 recordings of one or several files, in both storage formats."""

import random
import shutil
import tempfile
from pathlib import Path

import pytest
import yaml
import zstandard
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Message
from seaclutter_cli.sources.mcap.source import McapSource
from seaclutter_cli.sources.rosbag1.source import BagSource
from seaclutter_cli.sources.rosbag2 import is_rosbag2_folder, open_rosbag2
from seaclutter_cli.sources.rosbag2.db3 import Db3Source
from seaclutter_cli.sources.shared.split import SplitSource, split_groups
from seaclutter_cli.sources.shared.unpacking import ZSTD_MAGIC
from tests.attacks import YAML_DOCUMENTS, YAML_VALUES
from tests.pairs import covering
from tests.paths import SHARED_DATA

DATA = SHARED_DATA / "nebula"
TYPES = get_typestore(Stores.LATEST)
START = 1_600_000_000 * 10**9
CLOUD, IMU = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Imu"
STORAGES = {".db3": StoragePlugin.SQLITE3, ".mcap": StoragePlugin.MCAP}
TOPICS = (("/points", CLOUD), ("/imu", IMU))
METADATA_ATTACKS = YAML_DOCUMENTS | {
    name: f"rosbag2_bagfile_information: {{message_count: {value}}}" for name, value in YAML_VALUES.items()
}


class Opener:
    """Opener of storage files that counts the open ones."""

    def __init__(self):
        self.open = 0
        self.most = 0

    def __call__(self, path):
        opened = {".db3": Db3Source, ".mcap": McapSource, ".bag": BagSource}[
            Path(path.name.removesuffix(".zstd")).suffix
        ](path)
        self.open += 1
        self.most = max(self.most, self.open)
        close = opened.close

        def closing():
            self.open -= 1
            close()

        opened.close = closing
        return opened


def opener(path):
    return Opener()(path)


def payload(number):
    return b"\0\1\0\0" + random.Random(number).randbytes(300 + number % 7)


def write_part(folder, suffix, *, numbers, topics=TOPICS, mode=CompressionMode.NONE, qos=()):
    """Write a folder with one storage file, and return the file."""
    writer = Writer(folder, version=9, storage_plugin=STORAGES[suffix])
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = [
            writer.add_connection(topic, typename, typestore=TYPES, offered_qos_profiles=qos)
            for topic, typename in topics
        ]
        for number in numbers:
            writer.write(connections[number % len(topics)], START + number * 1000, payload(number))
    (file,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    return file


def write_split(folder, suffix, parts, **options):
    """Write a split recording from the arguments of each part, and return its folder."""
    folder.mkdir()
    names = []
    for number, part in enumerate(parts):
        file = write_part(folder / "part", suffix, **part, **options)
        names.append(f"{folder.name}_{number}{''.join(file.suffixes)}")
        file.rename(folder / names[-1])
        metadata = yaml.safe_load((folder / "part" / "metadata.yaml").read_text())
        shutil.rmtree(folder / "part")
    info = metadata["rosbag2_bagfile_information"]
    info["relative_file_paths"] = names
    info["message_count"] = sum(len(part["numbers"]) for part in parts)
    info["files"] = [
        {"path": name, "message_count": len(part["numbers"])} for name, part in zip(names, parts, strict=True)
    ]
    save(folder, metadata)
    return folder


def load(folder):
    return yaml.safe_load((folder / "metadata.yaml").read_text())


def save(folder, metadata):
    (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata))


def messages_of(source):
    """Return the messages of a source, and check that a second pass gives the same."""
    found = [(m.log_time_ns, m.channel.topic, bytes(m.data)) for m in source.records() if isinstance(m, Message)]
    damage = list(source.damage)
    again = [(m.log_time_ns, m.channel.topic, bytes(m.data)) for m in source.records() if isinstance(m, Message)]
    assert (found, damage) == (again, source.damage)
    return found


def written(numbers, topics=TOPICS):
    return [(START + number * 1000, topics[number % len(topics)][0], payload(number)) for number in numbers]


THREE = [{"numbers": range(20)}, {"numbers": range(20, 50)}, {"numbers": range(50, 60)}]


@pytest.mark.parametrize("suffix", STORAGES)
@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.MESSAGE, CompressionMode.FILE])
def test_split_recording_is_one_stream(tmp_path, suffix, mode):
    folder = write_split(tmp_path / "bag", suffix, THREE, mode=mode)
    source = open_rosbag2(folder, opener)
    with Reader(folder) as reader:
        expected = [(time, connection.topic, bytes(data)) for connection, time, data in reader.messages()]
    assert expected == written(range(60))
    assert messages_of(source) == expected
    assert not source.damage
    assert (source.name, source.profile) == ("bag", "ros2")
    assert [channel.topic for channel in source.channels] == ["/points", "/imu"]
    assert {channel.topic: source.counts[channel.id] for channel in source.channels} == {"/points": 30, "/imu": 30}
    source.close()


def test_temporary_files_are_removed(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for suffix in STORAGES:
        source = open_rosbag2(write_split(tmp_path / suffix, suffix, THREE, mode=CompressionMode.FILE), opener)
        assert len(list(source.records())) >= 60
        assert len(list(tmp_path.glob("seaclutter-*"))) == 1
        source.close()
        assert not list(tmp_path.glob("seaclutter-*"))


INVALID_METADATA = ("", "{", "- 1", "rosbag2_bagfile_information:", "\0")
INVALID_METADATA += ("rosbag2_bagfile_information: {relative_file_paths: 7}",)


def test_one_file_is_open_at_a_time(tmp_path):
    count = Opener()
    source = open_rosbag2(write_split(tmp_path / "bag", ".db3", THREE), count)
    messages_of(source)
    assert source.counts
    assert (count.open, count.most) == (1, 1)
    source.close()
    assert count.open == 0


@pytest.mark.parametrize("suffix", STORAGES)
def test_equal_channels_are_merged_and_different_ones_are_not(tmp_path, suffix):
    lidar, other = ("/lidar", CLOUD), ("/points", IMU)
    parts = [
        {"numbers": range(20)},
        {"numbers": range(20, 40), "topics": (lidar, *TOPICS)},
        {"numbers": range(40, 50), "topics": (other,)},
    ]
    source = open_rosbag2(write_split(tmp_path / "bag", suffix, parts), opener)
    by_id = {channel.id: channel for channel in source.channels}
    assert [(channel.topic, channel.schema.name) for channel in source.channels] == [*TOPICS, lidar, other]
    assert len(by_id) == 4
    found = [message for message in source.records() if isinstance(message, Message)]
    assert all(by_id[message.channel.id] == message.channel for message in found)
    expected = written(range(20)) + written(range(20, 40), (lidar, *TOPICS)) + written(range(40, 50), (other,))
    assert [(m.log_time_ns, m.channel.topic, bytes(m.data)) for m in found] == expected
    assert sum(source.counts.values()) == 50


@pytest.mark.parametrize("suffix", STORAGES)
def test_metadata_that_differs_in_qos_loses_nothing(tmp_path, suffix):
    second = QosTime(1, 0)
    qos = Qos(
        QosHistory.KEEP_LAST, 5, QosReliability.BEST_EFFORT, QosDurability.VOLATILE, second, second,
        QosLiveliness.AUTOMATIC, second, False,
    )  # fmt: skip
    folder = write_split(tmp_path / "bag", suffix, THREE, qos=[qos])
    metadata = load(folder)
    info = metadata["rosbag2_bagfile_information"]
    for topic in info["topics_with_message_count"]:
        topic["topic_metadata"]["offered_qos_profiles"] = [{"history": "unknown"}]
    save(folder, metadata)
    assert messages_of(open_rosbag2(folder, opener)) == written(range(60))
    for key in set(info) - {"relative_file_paths"}:
        del info[key]
        save(folder, metadata)
        source = open_rosbag2(folder, opener)
        assert messages_of(source) == written(range(60))
        assert not source.damage


@pytest.mark.parametrize(("text", "suffix"), covering(INVALID_METADATA, STORAGES))
def test_recording_with_invalid_metadata_is_read(tmp_path, suffix, text):
    parts = [{"numbers": range(number * 2, number * 2 + 2)} for number in range(11)]
    folder = write_split(tmp_path / "bag", suffix, parts)
    (folder / "metadata.yaml").write_text(text)
    assert is_rosbag2_folder(folder)
    source = open_rosbag2(folder, opener)
    assert messages_of(source) == written(range(22))
    (damage,) = source.damage
    assert damage.path == folder / "metadata.yaml"


@pytest.mark.parametrize("text", METADATA_ATTACKS.values(), ids=METADATA_ATTACKS)
def test_recording_with_hostile_metadata_is_read(tmp_path, text):
    folder = write_split(tmp_path / "bag", ".mcap", [{"numbers": range(4)}])
    (folder / "metadata.yaml").write_text(text)
    source = open_rosbag2(folder, opener)
    assert messages_of(source) == written(range(4))
    (damage,) = source.damage
    assert damage.path == folder / "metadata.yaml"


def test_recording_without_metadata_is_read(tmp_path):
    parts = [{"numbers": range(number * 2, number * 2 + 2)} for number in range(11)]
    folder = write_split(tmp_path / "bag", ".mcap", parts)
    (folder / "metadata.yaml").unlink()
    assert is_rosbag2_folder(folder)
    source = open_rosbag2(folder, opener)
    assert messages_of(source) == written(range(22))
    assert not source.damage


def test_file_that_metadata_does_not_list_yet_is_read(tmp_path):
    folder = write_split(tmp_path / "bag", ".db3", THREE)
    metadata = load(folder)
    metadata["rosbag2_bagfile_information"]["relative_file_paths"].pop()
    metadata["rosbag2_bagfile_information"]["message_count"] = 50
    save(folder, metadata)
    shutil.copy(folder / "bag_0.db3", folder / "backup.db3")
    source = open_rosbag2(folder, opener)
    assert messages_of(source) == written(range(60))
    assert not source.damage


def test_missing_file_is_reported_with_its_messages(tmp_path):
    folder = write_split(tmp_path / "bag", ".mcap", THREE)
    (folder / "bag_1.mcap").unlink()
    source = open_rosbag2(folder, opener)
    assert messages_of(source) == written([*range(20), *range(50, 60)])
    (damage,) = source.damage
    assert (damage.path, damage.lost_messages) == (folder / "bag_1.mcap", 30)


def test_unreadable_file_is_reported_and_the_others_are_read(tmp_path):
    folder = write_split(tmp_path / "bag", ".db3", THREE)
    (folder / "bag_0.db3").write_bytes(b"nothing")
    source = open_rosbag2(folder, opener)
    assert messages_of(source) == written(range(20, 60))
    assert source.damage[0].path == folder / "bag_0.db3"
    assert sum(damage.lost_messages or 0 for damage in source.damage) == 20
    for name in ("bag_1.db3", "bag_2.db3"):
        (folder / name).write_bytes(b"")
    with pytest.raises(InputError, match="bag_0"):
        open_rosbag2(folder, opener)


def test_fewer_messages_than_listed_are_reported(tmp_path):
    folder = write_split(tmp_path / "bag", ".mcap", THREE)
    metadata = load(folder)
    metadata["rosbag2_bagfile_information"]["message_count"] = 63
    save(folder, metadata)
    source = open_rosbag2(folder, opener)
    assert messages_of(source) == written(range(60))
    (damage,) = source.damage
    assert (damage.path.name, damage.lost_messages) == ("metadata.yaml", 3)


@pytest.mark.parametrize("prefix", ["bag/", "bag\\", "../../elsewhere/"])
def test_folders_of_paths_in_metadata_are_ignored(tmp_path, prefix):
    folder = write_split(tmp_path / "bag", ".db3", THREE)
    metadata = load(folder)
    info = metadata["rosbag2_bagfile_information"]
    info["relative_file_paths"] = [prefix + name for name in info["relative_file_paths"]]
    save(folder, metadata)
    assert messages_of(open_rosbag2(folder, opener)) == written(range(60))


def test_unpacked_version_of_a_packed_file_is_read(tmp_path):
    folder = write_split(tmp_path / "bag", ".db3", THREE, mode=CompressionMode.FILE)
    packed = folder / "bag_1.db3.zstd"
    data = zstandard.ZstdDecompressor().decompressobj().decompress(packed.read_bytes())
    (folder / "bag_1.db3").write_bytes(data)
    packed.unlink()
    source = open_rosbag2(folder, opener)
    assert messages_of(source) == written(range(60))
    assert not source.damage


def test_damaged_packed_messages_are_counted(tmp_path):
    folder = write_split(tmp_path / "bag", ".mcap", THREE, mode=CompressionMode.MESSAGE)
    real = opener(folder / "bag_0.mcap")
    messages = [message for message in real.records() if isinstance(message, Message)]
    file = folder / "bag_0.mcap"
    content = bytearray(file.read_bytes())
    start = content.rindex(ZSTD_MAGIC, 0, content.index(messages[3].data)) + len(ZSTD_MAGIC)
    content[start : start + 8] = b"\xff" * 8
    file.write_bytes(content)
    source = open_rosbag2(folder, opener)
    found = messages_of(source)
    assert len(found) + sum(damage.lost_messages or 0 for damage in source.damage) == 60
    assert set(found) < set(written(range(60)))


def test_unknown_compression_is_refused(tmp_path):
    folder = write_split(tmp_path / "bag", ".db3", THREE)
    metadata = load(folder)
    metadata["rosbag2_bagfile_information"] |= {"compression_mode": "FILE", "compression_format": "brotli"}
    save(folder, metadata)
    with pytest.raises(InputError, match="brotli"):
        open_rosbag2(folder, opener)


def test_folder_without_storage_files_is_refused(tmp_path):
    folder = write_split(tmp_path / "bag", ".db3", THREE)
    for file in folder.glob("*.db3"):
        file.unlink()
    with pytest.raises(InputError, match=r"\.db3"):
        open_rosbag2(folder, opener)


def test_recognition_of_rosbag2_folders(tmp_path):
    assert not is_rosbag2_folder(tmp_path / "missing")
    frames = tmp_path / "frames"
    frames.mkdir()
    (frames / "metadata.yaml").write_text("camera: 1")
    assert not is_rosbag2_folder(frames)
    logs = tmp_path / "logs"
    logs.mkdir()
    assert not is_rosbag2_folder(logs)
    (logs / "run_0.mcap").touch()
    assert not is_rosbag2_folder(logs)
    (logs / "logs_0.mcap").touch()
    assert not is_rosbag2_folder(logs)
    (logs / "run_0.mcap").unlink()
    assert is_rosbag2_folder(logs)


def test_groups_of_split_files():
    names = [
        "b.mcap",
        "a_10.mcap",
        "a_0.mcap",
        "a_1.mcap",
        "a_1.db3",
        "c_1.mcap",
        "d_0.db3.zstd",
        "d_1.db3.zstd",
        "d_2.db3",
    ]
    names += [f"a_{number}.mcap" for number in range(2, 10)] + [
        "e_00.mcap",
        "e_0.bag",
        "e_1.bag.active",
        "f_0.mcap",
        "f_2.mcap",
    ]
    groups = [[file.name for file in group] for group in split_groups([Path("x") / name for name in names])]
    assert groups == [
        ["b.mcap"],
        [f"a_{number}.mcap" for number in range(11)],
        ["a_1.db3"],
        ["c_1.mcap"],
        ["d_0.db3.zstd", "d_1.db3.zstd", "d_2.db3"],
        ["e_00.mcap"],
        ["e_0.bag", "e_1.bag.active"],
        ["f_0.mcap"],
        ["f_2.mcap"],
    ]
    assert split_groups([Path("x/a_0.mcap"), Path("y/a_1.mcap")]) == [[Path("x/a_0.mcap")], [Path("y/a_1.mcap")]]
    assert split_groups([]) == []


def test_files_of_a_crashed_recorder(tmp_path):
    folder = write_split(tmp_path / "bag", ".mcap", THREE)
    (group,) = split_groups(sorted(folder.glob("*.mcap")))
    last = folder / "bag_2.mcap"
    last.write_bytes(last.read_bytes()[:-300])
    source = SplitSource(group, opener)
    found = messages_of(source)
    assert source.name == "bag"
    assert found == written(range(60))[: len(found)]
    assert len(found) >= 50
    assert {damage.path for damage in source.damage} == {last}


@pytest.mark.skipif(not DATA.exists(), reason="the real recordings are missing")
@pytest.mark.parametrize("name", ["vlp16", "vlp32", "xt32"])
def test_real_recordings(name):
    folder = DATA / name
    assert is_rosbag2_folder(folder)
    source = open_rosbag2(folder, opener)
    with Reader(folder) as reader:
        expected = [(time, connection.topic, bytes(data)) for connection, time, data in reader.messages()]
    assert messages_of(source) == expected
    assert not source.damage
    assert not source.warnings
    assert all(channel.schema.data for channel in source.channels)
    source.close()
