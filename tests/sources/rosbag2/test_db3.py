"""ROS 2 sqlite3 files, written and read by the rosbags library as an independent reference."""

import os
import random
import shutil
import sqlite3
import tempfile
import tracemalloc
from pathlib import Path

import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from seaclutter_cli.errors import InputError, SeaclutterError
from seaclutter_cli.sources.rosbag2 import database as database_rows
from seaclutter_cli.sources.rosbag2.db3 import Db3Source
from tests.paths import SHARED_DATA

DATA = SHARED_DATA / "nebula"
TYPES = get_typestore(Stores.LATEST)
START = 1_600_000_000 * 10**9
CLOUD, IMU = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Imu"

TOPICS = {
    1: "id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL",
    2: ", offered_qos_profiles TEXT NOT NULL",
    4: ", type_description_hash TEXT NOT NULL",
}


def payload(number, size=300):
    return b"\0\1\0\0" + random.Random(number).randbytes(size + number % 7)


def write_folder(folder, *, version=9, mode=CompressionMode.NONE, messages=40):
    """Write a rosbag2 folder, and return its storage file."""
    writer = Writer(folder, version=version, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = [
            writer.add_connection("/points", CLOUD, typestore=TYPES),
            writer.add_connection("/imu", IMU, typestore=TYPES),
        ]
        for number in range(messages):
            writer.write(connections[number % 2], START + number * 1000, payload(number))
    return next(folder.glob("*.db3*"))


def write_file(path, *, schema=3, messages=40, size=300, index=True, typename=CLOUD, encoding="cdr", times=None):
    """Write a storage file as the rosbag2 versions of each schema do."""
    database = sqlite3.connect(path)
    columns = "".join(text for version, text in TOPICS.items() if version <= schema)
    database.executescript(
        f"CREATE TABLE topics({columns});"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,"
        " data BLOB NOT NULL);" + "CREATE INDEX timestamp_idx ON messages (timestamp ASC);" * index
    )
    extra = ["- history: 3"] * (schema >= 2) + ["RIHS01_abc"] * (schema >= 4)
    for number, topic in enumerate(("/points", "/imu"), 1):
        row = [number, topic, typename if number == 1 else IMU, encoding, *extra]
        database.execute(f"INSERT INTO topics VALUES({', '.join('?' * len(row))})", row)
    for number in range(messages):
        time = times[number] if times else number * 1000
        row = (number % 2 + 1, START + time, payload(number, size))
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", row)
    database.commit()
    database.close()
    return path


def written(messages=40, size=300):
    return [
        (START + number * 1000, ("/points", "/imu")[number % 2], payload(number, size)) for number in range(messages)
    ]


def read(path):
    """Return messages and damage of a file, and check that a second pass gives the same."""
    source = Db3Source(path)
    messages = [(m.log_time_ns, m.channel.topic, bytes(m.data)) for m in source.records()]
    damage = list(source.damage)
    assert messages == [(m.log_time_ns, m.channel.topic, bytes(m.data)) for m in source.records()]
    assert damage == source.damage
    source.close()
    return messages, damage


@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.MESSAGE, CompressionMode.FILE])
def test_every_message_is_read_in_order(tmp_path, version, mode):
    path = write_folder(tmp_path / "bag", version=version, mode=mode)
    with Reader(tmp_path / "bag") as reader:
        expected = [(time, connection.topic, bytes(data)) for connection, time, data in reader.messages()]
    assert expected == written()
    assert read(path) == (expected, [])


def test_source_describes_the_file(tmp_path):
    source = Db3Source(write_folder(tmp_path / "bag"))
    assert (source.name, source.format, source.profile) == ("bag", "ROS 2 bag (sqlite3)", "ros2")
    assert source.counts == {1: 20, 2: 20}
    assert [(channel.id, channel.topic, channel.message_encoding) for channel in source.channels] == [
        (1, "/points", "cdr"),
        (2, "/imu", "cdr"),
    ]
    for channel, typename in zip(source.channels, (CLOUD, IMU), strict=True):
        assert (channel.schema.name, channel.schema.encoding) == (typename, "ros2msg")
        assert channel.schema.data.decode() == TYPES.generate_msgdef(typename, ros_version=2)[0]
        assert dict(channel.metadata)["topic_type_hash"] == TYPES.hash_rihs01(typename)
    assert not source.warnings


@pytest.mark.parametrize("schema", [1, 2, 3, 4])
def test_every_schema_version_is_read(tmp_path, schema):
    path = write_file(tmp_path / "x.db3", schema=schema)
    assert read(path) == (written(), [])
    source = Db3Source(path)
    channel = source.channels[0]
    assert channel.schema.data.decode() == TYPES.generate_msgdef(CLOUD, ros_version=2)[0]
    assert dict(channel.metadata).get("offered_qos_profiles") == ("- history: 3" if schema >= 2 else None)
    assert dict(channel.metadata).get("topic_type_hash") == ("RIHS01_abc" if schema >= 4 else None)


def test_unknown_types_are_named(tmp_path):
    source = Db3Source(write_file(tmp_path / "x.db3", typename="my_msgs/msg/Sonar"))
    schema = source.channels[0].schema
    assert (schema.name, schema.encoding, schema.data) == ("my_msgs/msg/Sonar", "ros2msg", b"")
    (warning,) = source.warnings
    assert "/points" in warning
    assert "my_msgs/msg/Sonar" in warning


def test_type_names_of_the_first_versions_are_completed(tmp_path):
    source = Db3Source(write_file(tmp_path / "x.db3", schema=1, typename="sensor_msgs/PointCloud2"))
    assert source.channels[0].schema.name == CLOUD


def test_other_serialization_formats_are_kept(tmp_path):
    source = Db3Source(write_file(tmp_path / "x.db3", encoding="protobuf"))
    assert {channel.message_encoding for channel in source.channels} == {"protobuf"}


def test_a_recording_that_states_no_serialization_format_has_that_of_ros_2(tmp_path):
    source = Db3Source(write_file(tmp_path / "x.db3", encoding=""))
    assert {channel.message_encoding for channel in source.channels} == {"cdr"}


@pytest.mark.parametrize("index", [True, False])
def test_messages_are_sorted_by_time_then_number(tmp_path, index):
    times = [number // 3 for number in random.Random(1).sample(range(40), 40)]
    messages, damage = read(write_file(tmp_path / "x.db3", times=times, index=index))
    order = sorted(range(40), key=lambda number: (times[number], number))
    assert [data for _, _, data in messages] == [payload(number) for number in order]
    assert not damage


@pytest.mark.parametrize("folder", ["a b", "50%20 done?", "#1 & 'two'", "ü"])
def test_odd_paths(tmp_path, folder, monkeypatch):
    if os.name == "nt" and "?" in folder:
        pytest.skip("not a Windows name")
    parent = tmp_path / folder
    parent.mkdir()
    path = write_file(parent / "x?mode=rw#.db3" if os.name != "nt" else parent / "x#.db3")
    assert read(path)[0] == written()
    monkeypatch.chdir(parent)
    assert read(Path(path.name))[0] == written()
    assert list(parent.iterdir()) == [path]


def test_read_only_folder_with_a_wal_database(tmp_path):
    folder = tmp_path / "ro"
    folder.mkdir()
    path = write_file(folder / "x.db3")
    database = sqlite3.connect(path)
    database.execute("PRAGMA journal_mode=WAL")
    database.close()
    folder.chmod(0o555)
    try:
        assert read(path) == (written(), [])
        assert list(folder.iterdir()) == [path]
    finally:
        folder.chmod(0o755)


def crashed(tmp_path):
    """Return the file of a recorder that crashed while its last messages were only in the write-ahead log."""
    path = write_file(tmp_path / "live.db3", messages=30)
    database = sqlite3.connect(path)
    database.execute("PRAGMA journal_mode=WAL")
    for number in range(30, 40):
        row = (number % 2 + 1, START + number * 1000, payload(number))
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", row)
    database.commit()
    left = tmp_path / "left"
    left.mkdir()
    for file in (path, path.with_name("live.db3-wal")):
        shutil.copy(file, left)
    database.close()
    return left / "live.db3"


def test_write_ahead_log_of_a_crash_is_read(tmp_path):
    path = crashed(tmp_path)
    before = {file.name: file.read_bytes() for file in path.parent.iterdir()}
    assert read(path) == (written(), [])
    assert {file.name: file.read_bytes() for file in path.parent.iterdir()} == before


def test_write_ahead_log_is_read_where_nothing_can_be_written(tmp_path, monkeypatch):
    path = crashed(tmp_path)
    connect = sqlite3.connect

    def refuse(address, **options):
        if "mode=ro" in address:
            raise sqlite3.OperationalError("unable to open database file")
        return connect(address, **options)

    monkeypatch.setattr(sqlite3, "connect", refuse)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert read(path) == (written(), [])
    assert not list(tmp_path.glob("seaclutter-*"))


def test_unfinished_transaction_of_a_crash_is_rolled_back(tmp_path):
    path = write_file(tmp_path / "live.db3")
    database = sqlite3.connect(path, isolation_level=None)
    database.execute("PRAGMA cache_size=2")
    database.execute("BEGIN")
    database.execute("DELETE FROM messages WHERE id % 2")
    for number in range(40):
        database.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)", (START + number, payload(1))
        )
    left = tmp_path / "left"
    left.mkdir()
    for file in (path, path.with_name("live.db3-journal")):
        shutil.copy(file, left)
    database.close()
    before = {file.name: file.read_bytes() for file in left.iterdir()}
    assert len(before["live.db3-journal"]) > 4096
    assert read(left / "live.db3") == (written(), [])
    assert {file.name: file.read_bytes() for file in left.iterdir()} == before


def test_compressed_file_is_unpacked_to_a_temporary_one(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    source = Db3Source(write_folder(tmp_path / "bag", mode=CompressionMode.FILE))
    assert (source.name, source.compression) == ("bag", "zstd")
    assert list(tmp_path.glob("seaclutter-*/bag.db3"))
    source.close()
    assert not list(tmp_path.glob("seaclutter-*"))


@pytest.fixture
def _short_search(monkeypatch):
    """Let the search for rows one by one end soon, which finds none that the two ends of these files do not show."""
    monkeypatch.setattr(database_rows, "_MAX_MISSES", 1000)


@pytest.mark.usefixtures("_short_search")
def test_truncated_compressed_file_is_read_to_its_end(tmp_path):
    path = write_folder(tmp_path / "bag", mode=CompressionMode.FILE, messages=2000)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 3 // 4])
    messages, damage = read(path)
    assert 800 < len(messages) < 2000
    assert messages == written(2000)[: len(messages)]
    assert "truncated" in damage[0].problem
    assert damage[0].path == path


def test_damaged_compressed_message_is_counted(tmp_path):
    path = write_folder(tmp_path / "bag", mode=CompressionMode.MESSAGE)
    database = sqlite3.connect(path)
    database.execute("UPDATE messages SET data = substr(data, 1, 20) WHERE id = 7")
    database.execute("UPDATE messages SET data = ? WHERE id = 9", (b"\x28\xb5\x2f\xfd\xe0" + b"\xff" * 8 + bytes(9),))
    database.execute("UPDATE messages SET topic_id = 99 WHERE id = 11")
    database.commit()
    database.close()
    messages, (damage,) = read(path)
    assert messages == [message for number, message in enumerate(written(), 1) if number not in {7, 9, 11}]
    assert damage.lost_messages == 3


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "recording"), (b"no database" * 100, "not a"), (b"SQLite format 3\0" + bytes(3000), "not a")],
)
def test_files_that_are_not_databases_are_refused_in_one_line(tmp_path, content, words):
    path = tmp_path / "x.db3"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        Db3Source(path)
    assert "\n" not in str(caught.value)


def test_other_databases_are_refused(tmp_path):
    path = tmp_path / "x.db3"
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE cats(name)")
    database.commit()
    database.close()
    with pytest.raises(InputError, match="not a ROS 2 recording"):
        Db3Source(path)


def test_missing_file_is_refused(tmp_path):
    for name in ("x.db3", "x.db3.zstd"):
        with pytest.raises(InputError):
            Db3Source(tmp_path / name)
    assert not list(tmp_path.iterdir())


def check_damaged(path, expected):
    try:
        messages, damage = read(path)
    except SeaclutterError:
        return None
    assert len(messages) <= len(expected)
    if len(messages) < len(expected):
        assert damage
    return messages, damage


@pytest.mark.usefixtures("_short_search")
@pytest.mark.parametrize("fill", [b"\0", b"\xff", b"\x0d"])
def test_each_page_overwritten(tmp_path, fill):
    """Messages on intact pages are read, and the others are counted."""
    path = write_file(tmp_path / "x.db3", messages=120)
    whole = path.read_bytes()
    broken = tmp_path / "broken.db3"
    lost = []
    for page in range(1, len(whole) // 4096):
        broken.write_bytes(whole[: page * 4096] + fill * 4096 + whole[(page + 1) * 4096 :])
        outcome = check_damaged(broken, written(120))
        if outcome is None:
            continue
        messages, damage = outcome
        lost.append(120 - len(messages))
        if messages:
            assert set(messages) <= set(written(120))
            assert sum(entry.lost_messages or 0 for entry in damage) == 120 - len(messages)
    assert len(lost) >= len(whole) // 4096 - 3
    assert sum(count <= 15 for count in lost) >= len(lost) - 2


def test_rows_on_both_sides_of_several_damaged_pages(tmp_path):
    path = write_file(tmp_path / "x.db3", messages=400, size=1000)
    data = bytearray(path.read_bytes())
    for page in (30, 31, 60):
        data[page * 4096 : (page + 1) * 4096] = bytes(4096)
    path.write_bytes(data)
    messages, (damage,) = read(path)
    assert messages == [message for message in written(400, 1000) if message in set(messages)]
    assert 360 < len(messages) < 400
    assert damage.lost_messages == 400 - len(messages)


def test_truncated_file_is_read_to_its_end(tmp_path):
    path = write_file(tmp_path / "x.db3", messages=400, size=1000)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    messages, damage = read(path)
    assert len(messages) > 100
    assert messages == written(400, 1000)[: len(messages)]
    assert damage


@pytest.mark.parametrize("index", [True, False])
def test_memory_does_not_grow_with_the_file(tmp_path, index):
    peaks = []
    for count in (8, 80):
        source = Db3Source(write_file(tmp_path / f"{count}.db3", messages=count, size=200_000, index=index))
        tracemalloc.start()
        for _ in source.records():
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0]


@pytest.mark.skipif(not DATA.exists(), reason="the real recordings are missing")
@pytest.mark.parametrize("name", ["vlp16", "vlp32", "xt32"])
def test_real_recordings(name):
    (path,) = (DATA / name).glob("*.db3")
    with Reader(path) as reader:
        expected = [(time, connection.topic, bytes(data)) for connection, time, data in reader.messages()]
    assert read(path) == (expected, [])
    assert len(expected) == {"vlp16": 4, "vlp32": 5, "xt32": 4}[name]
