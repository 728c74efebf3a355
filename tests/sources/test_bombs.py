"""Logs that expand to more than the limits are damage, and cost no memory."""

import random
import struct
import tracemalloc

import pytest
import zstandard

from seaclutter_cli.errors import InputError
from seaclutter_cli.records import Message
from seaclutter_cli.sources.formats import open_source
from tests.sources.bombs import (
    BAG_MESSAGE,
    FILES,
    MESSAGE,
    SIZE,
    bag,
    bag_record,
    channel,
    chunk,
    connection,
    mcap,
    record,
    schema,
    write_db3,
)


@pytest.fixture
def _low_limits(monkeypatch):
    for name, value in (("CHUNK_MIB", 1), ("MESSAGE_MIB", 1), ("CHUNK_MESSAGES", 1000)):
        monkeypatch.setenv(f"SEACLUTTER_MAX_{name}", str(value))


def read(path):
    """Return the number of messages, the damage, and the peak of memory in bytes."""
    tracemalloc.start()
    source = open_source(path)
    found = sum(isinstance(item, Message) for item in source.records())
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    source.close()
    return found, source.damage, peak


@pytest.mark.usefixtures("_low_limits")
@pytest.mark.parametrize("name", FILES)
def test_a_bomb_is_damage(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(FILES[name]())
    found, damage, peak = read(path)
    assert damage
    assert found <= 1000
    assert peak < (48e6 if name == "liar.bag" else 12e6)


@pytest.mark.usefixtures("_low_limits")
@pytest.mark.parametrize("name", ["zstd.mcap", "lz4.mcap", "none.mcap", "bz2.bag", "lz4.bag"])
def test_damage_names_the_limit_and_the_variable(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(FILES[name]())
    _, damage, _ = read(path)
    assert any("above the limit of 1 MiB (SEACLUTTER_MAX_CHUNK_MIB)" in item.problem for item in damage)


@pytest.mark.usefixtures("_low_limits")
@pytest.mark.parametrize("name", ["messages.mcap", "messages.bag"])
def test_messages_up_to_the_limit_are_read(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(FILES[name]())
    found, damage, _ = read(path)
    assert found == 1000
    assert any("SEACLUTTER_MAX_CHUNK_MESSAGES" in item.problem for item in damage)


@pytest.mark.parametrize("name", ["x.mcap", "x.bag"])
def test_large_chunks_and_messages_of_real_logs_pass(tmp_path, name):
    data, path = random.Random(1).randbytes(2**20) * 32, tmp_path / name
    if name == "x.mcap":
        message = record(5, struct.pack("<HIQQ", 1, 0, 5, 5) + data)
        path.write_bytes(mcap(chunk(schema() + channel() + message * 2, b"lz4")))
    else:
        message = bag_record(data, b"op=\x02", b"conn=\0\0\0\0", b"time=" + bytes(8))
        path.write_bytes(bag(b"lz4", connection(0) + message * 2))
    assert path.stat().st_size > 60e6
    found, damage, _ = read(path)
    assert found == 2
    assert not any("above the limit" in item.problem for item in damage)


@pytest.mark.parametrize("name", ["x.mcap", "x.bag"])
@pytest.mark.parametrize(("size", "found"), [(7 * 2**20, 2), (9 * 2**20, 1)])
def test_a_small_file_has_no_large_messages(tmp_path, name, size, found):
    path = tmp_path / name
    if name == "x.mcap":
        large = record(5, struct.pack("<HIQQ", 1, 0, 5, 5) + bytes(size - 22))
        path.write_bytes(mcap(chunk(schema() + channel() + MESSAGE + large)))
    else:
        large = bag_record(bytes(size), b"op=\x02", b"conn=\0\0\0\0", b"time=" + bytes(8))
        path.write_bytes(bag(b"lz4", connection(0) + BAG_MESSAGE + large))
    read_messages, damage, _ = read(path)
    assert read_messages == found
    large = [item for item in damage if "above the limit of 8 MiB in a file of" in item.problem]
    assert [item.lost_messages for item in large] == [1] * (2 - found)
    assert all("SEACLUTTER_MAX_FILE_RATIO" in item.problem for item in large)


@pytest.mark.usefixtures("_low_limits")
@pytest.mark.parametrize("data", [zstandard.compress(bytes(SIZE)), bytes(2 * 2**20)])
def test_a_large_message_of_a_database_is_damage(tmp_path, data):
    found, (damage,), peak = read(write_db3(tmp_path / "x.db3", data))
    assert (found, damage.lost_messages) == (0, 1)
    assert "SEACLUTTER_MAX_MESSAGE_MIB" in damage.problem
    assert peak < 8e6


@pytest.mark.usefixtures("_low_limits")
def test_skippable_frames_are_skipped(tmp_path):
    packer = zstandard.ZstdCompressor(write_content_size=False).compressobj()
    data = packer.compress(bytes(1000)) + packer.flush() + struct.pack("<II", 0x184D2A50, 2**19) + bytes(2**19)
    found, damage, peak = read(write_db3(tmp_path / "x.db3", data))
    assert (found, damage) == (1, [])
    assert peak < 12e6


def test_a_compressed_database_is_unpacked_up_to_the_limit(tmp_path):
    database = write_db3(tmp_path / "x.db3", b"abcd")
    path = tmp_path / "y.db3.zstd"
    path.write_bytes(zstandard.compress(database.read_bytes()) + zstandard.compress(bytes(SIZE)))
    found, (damage,), _ = read(path)
    assert found == 1
    assert "SEACLUTTER_MAX_FILE_RATIO" in damage.problem


ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) "


@pytest.mark.parametrize(
    "messages",
    [
        f"CREATE VIEW messages AS {ENDLESS} SELECT 1 AS topic_id, x AS timestamp, x AS data FROM c WHERE x < 0",
        "CREATE VIEW messages AS SELECT 1 AS id, 1 AS topic_id, 1 AS timestamp, zeroblob(900000000) AS data",
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data AS (zeroblob(900000000)))",
        f"CREATE TABLE messages(data); DROP TABLE topics; CREATE VIEW topics AS {ENDLESS} SELECT x FROM c WHERE x < 0",
        "CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)",
    ],
)
def test_only_tables_that_store_data_are_read(tmp_path, messages):
    with pytest.raises(InputError, match="no tables of topics and messages"):
        open_source(write_db3(tmp_path / "x.db3", None, messages))


def test_a_view_of_definitions_is_not_read(tmp_path):
    view = f"CREATE VIEW message_definitions AS {ENDLESS} SELECT x AS topic_type FROM c WHERE x < 0"
    tables = f"CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data); {view}"
    assert read(write_db3(tmp_path / "x.db3", b"abcd", tables))[:2] == (1, [])
