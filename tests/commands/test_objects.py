"""``seaclutter objects``."""

import csv
import json
import struct
import sys
from functools import partial
from itertools import islice

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

import seaclutter
from seaclutter_cli.sinks.csv import csv_line
from seaclutter_cli.sinks.objects import COLUMNS, write_objects
from tests.paths import ROOT
from tests.running import execute

FIX = "sensor_msgs/msg/NavSatFix"
SEA = ROOT / "samples" / "sea.mcap"
FRAMES = 20

run = partial(execute, code=0)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("objects") / "objects.csv"
    shown = run("objects", SEA, "-n", FRAMES, "-o", path).stdout
    assert "2 objects" in shown
    assert "small craft" in shown
    assert all(len(line) <= 80 for line in shown.splitlines())
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_table_has_both_targets_in_all_frames(table):
    assert tuple(table[0]) == tuple(COLUMNS)
    seen = {(row["track_id"], row["frame"]) for row in table if row["state"] == "confirmed"}
    assert len(seen) == 2 * FRAMES
    assert len({track for track, _ in seen}) == 2
    assert {row["velocity"] for row in table} == {"own_ship"}


@pytest.mark.parametrize("command", [("objects",), ("suspects",), ("labels", "propose", "-o", "labels.csv")])
def test_settings_that_do_not_fit_the_log_are_named(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    beyond = "-m", "joint", "-s", "filter.start_m=900", "-s", "filter.end_m=999"
    assert "no points are left" in run(*command, SEA, "-n", 3, *beyond).stderr


def test_a_filtered_log_is_named(tmp_path):
    run("filter", SEA, "-n", 3, "-o", tmp_path / "f.mcap")
    assert "already filtered by joint" in run("objects", tmp_path / "f.mcap").stderr


def stamped(path, offset_ns, frames=40):
    """Write the first frames of the sample with other stamps, of number n later by ``offset_ns(n)``."""
    with SEA.open("rb") as file, path.open("wb") as output:
        writer = Writer(output)
        writer.start()
        found = islice(make_reader(file).iter_messages(topics="/points"), frames)
        for number, (schema, channel, message) in enumerate(found):
            if not number:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channel_id = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            seconds, nanos = struct.unpack_from("<iI", message.data, 4)
            stamp = struct.pack("<iI", *divmod(seconds * 10**9 + nanos + offset_ns(number), 10**9))
            data = message.data[:4] + stamp + message.data[12:]
            writer.add_message(channel_id, message.log_time, data, message.publish_time)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("offset_ns", "arguments", "expected"),
    [
        (lambda n: n % 2 * 10**10, ("-n", 12), "the stamps of 11 of 12 frames step back or by more than 5 s"),
        (lambda n: -(n % 2) * 3 * 10**8, ("-n", 12), "the stamps of 6 of 12 frames step back or by more than 5 s"),
        (lambda _: 0, ("-n", 3), "the frames span only 0.2 s"),
    ],
)
def test_what_leaves_objects_undecided_is_named(tmp_path, offset_ns, arguments, expected):
    log = stamped(tmp_path / "log.mcap", offset_ns)
    filtered = run("filter", log, *arguments, "-m", "confirmed", "-o", tmp_path / "f.mcap").stderr
    assert f"of the points kept are of objects that evidence does not decide; {expected}" in " ".join(filtered.split())
    for method in ("confirmed", "joint"):
        found = run("objects", log, *arguments, "-m", method).stderr
        assert method == "joint" or f"does not decide; {expected}" in " ".join(found.split())
        assert offset_ns(1) < 0 or f"of the boxes are of candidates; {expected}" in " ".join(found.split())
        suspected = run("suspects", log, *arguments, "-m", method).stderr
        assert f"clusters are not judged; {expected}" in " ".join(suspected.split())


def test_a_gap_leaves_nothing_undecided(tmp_path):
    log = stamped(tmp_path / "log.mcap", lambda n: (n > 15) * 2 * 10**10)
    assert "Warning" not in run("objects", log).stderr


def test_python_returns_the_same_table(table):
    found = seaclutter.find_objects(SEA, frames=FRAMES).table()
    assert found.dtype.names == tuple(COLUMNS)
    assert found["x_m"].tolist() == [float(row["x_m"]) for row in table]
    assert found["frame"].tolist() == [int(row["frame"]) for row in table]


def test_the_method_is_that_of_the_options():
    tracks = json.loads(run("objects", SEA, "-m", "joint", "-n", 30, "--json").stdout)["recordings"][0]["tracks"]
    assert len(tracks) == 2


@pytest.mark.parametrize(
    ("text", "method"), [("{memory_s: 5.0}", "confirmed"), ("{method: joint}", "joint"), ("", "confirmed")]
)
def test_a_configuration_that_names_no_method_is_one_of_confirmed(tmp_path, text, method):
    (tmp_path / "own.yaml").write_text(f"filter: {text}\n")
    found, expected = (
        json.loads(run("objects", SEA, *given, "-n", 10, "--json").stdout)["recordings"][0]["tracks"]
        for given in (("-c", tmp_path / "own.yaml"), ("-m", method))
    )
    assert found == expected != []


def test_filter_writes_the_same_table(tmp_path, table):
    files = "-o", tmp_path / "f.mcap", "--objects", tmp_path / "o.csv"
    run("filter", SEA, "-n", FRAMES, "-m", "confirmed", *files, "-q")
    with (tmp_path / "o.csv").open(newline="") as file:
        assert list(csv.DictReader(file)) == table


def test_parquet_has_the_same_rows(tmp_path, table):
    parquet = pytest.importorskip("pyarrow.parquet")
    run("objects", SEA, "-n", FRAMES, "-o", tmp_path / "o.parquet")
    found = parquet.read_table(tmp_path / "o.parquet").to_pylist()
    assert [str(row["x_m"]) for row in found] == [row["x_m"] for row in table]
    assert {row["latitude_deg"] for row in found} == {None}


def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    assert "seaclutter[parquet]" in run("objects", SEA, "-o", tmp_path / "o.parquet", code=1).stderr


def test_tracks_on_earth_need_a_position(tmp_path):
    assert "NavSatFix" in run("objects", SEA, "-n", 9, "-o", tmp_path / "o.geojson", code=1).stderr
    assert not list(tmp_path.iterdir())


def test_places_that_are_missing_although_there_are_fixes_are_named(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    log, types = stamped(tmp_path / "clouds.mcap", lambda _: 0, 10), store.types
    with log.open("rb") as file, (tmp_path / "log.mcap").open("wb") as output:
        writer = Writer(output)
        writer.start()
        topics = {}
        for schema, channel, message in make_reader(file).iter_messages():
            if not topics:
                topics["fix"] = writer.register_channel("/fix", "cdr", writer.register_schema(FIX, "ros2msg", b""))
                topics["points"] = writer.register_channel(
                    channel.topic, "cdr", writer.register_schema(schema.name, schema.encoding, schema.data)
                )
            stamp = types["builtin_interfaces/msg/Time"](*divmod(message.log_time, 10**9))
            head, status = types["std_msgs/msg/Header"](stamp, "gnss"), types["sensor_msgs/msg/NavSatStatus"](0, 1)
            fix = types[FIX](head, status, 60.0, 10.0, 0.0, np.zeros(9), 0)
            for name, data in (("fix", bytes(store.serialize_cdr(fix, FIX))), ("points", message.data)):
                writer.add_message(topics[name], message.log_time, data, message.publish_time)
        writer.finish()
    filtered = "filter", "-m", "confirmed", "-o", tmp_path / "f.mcap", "--objects", tmp_path / "o.csv"
    for name, *options in (("objects",), filtered):
        shown = " ".join(run(name, tmp_path / "log.mcap", *options).stderr.split())
        assert "no place on earth is known for 10 of 10 frames: no heading" in shown


def test_other_suffixes_are_refused(tmp_path):
    assert ".csv, .parquet, .geojson" in run("objects", SEA, "-o", tmp_path / "o.xlsx", code=2).stderr


def test_tracks_on_earth_are_lines(tmp_path):
    row = dict.fromkeys(COLUMNS, "1") | {"state": "confirmed", "topic": "/points", "recording": "a"}
    lines = [
        csv_line((row | {"stamp_ns": k * 5 * 10**8, "latitude_deg": 60 + k, "longitude_deg": 10}).values())
        for k in range(5)
    ]
    with (tmp_path / "o.geojson").open("wb") as stream:
        write_objects(tmp_path / "o.geojson", stream, lines)
    (feature,) = json.loads((tmp_path / "o.geojson").read_text())["features"]
    assert feature["geometry"] == {"type": "LineString", "coordinates": [[10, 60], [10, 62], [10, 64]]}
    assert feature["properties"]["track_id"] == 1
