"""Clouds in other messages than PointCloud2, from recordings of every kind into filtered logs and out of them."""

import json
from functools import partial

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer

import seaclutter
from tests import logs
from tests.messages import wrapped
from tests.pairs import covering
from tests.running import execute

FORMS = ("zstd", "zlib", "draco", "foxglove", "scan", "echoes", "livox")


run = partial(execute, code=0)


def bag(path, form):
    with BagWriter(path) as writer:
        connection = writer.add_connection("/points", wrapped.KINDS[form], typestore=wrapped.store("ros1"))
        for number, data in enumerate(wrapped.sea_messages(form, encoding="ros1")):
            writer.write(connection, logs.START_NS + number * logs.PERIOD_NS, data)


def folder(path, form, plugin):
    with Bag2Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
        connection = writer.add_connection("/points", wrapped.KINDS[form], typestore=wrapped.store("cdr"))
        for number, data in enumerate(wrapped.sea_messages(form)):
            writer.write(connection, logs.START_NS + number * logs.PERIOD_NS, data)


RECORDINGS = {
    "log.mcap": wrapped.sea_log,
    "ros1.mcap": lambda path, form: wrapped.sea_log(path, form, "ros1"),
    "log.bag": bag,
    "db3": lambda path, form: folder(path, form, "SQLITE3"),
    "mcap": lambda path, form: folder(path, form, "MCAP"),
}


def frames(path, topic="/points"):
    with seaclutter.open_log(path) as log:
        return [frame.cloud.points for frame in log.frames(topic)]


@pytest.mark.parametrize(
    ("recording", "form"), [*covering(RECORDINGS, FORMS), *covering(RECORDINGS, (FORMS[-1], *FORMS[:-1]))]
)
def test_the_filtered_log_has_the_messages_of_the_log(tmp_path, recording, form):
    RECORDINGS[recording](tmp_path / recording, form)
    out = tmp_path / "out.mcap"
    run("filter", tmp_path / recording, "-o", out, "-m", "global_intensity", "-s", "filter.threshold=20", "-s",
        "filter.start_m=5", "--keep-raw", "--with-removed")  # fmt: skip
    with seaclutter.open_log(out) as log:
        assert log.topics == ("/points", "/points/filtered", "/points/removed")
        channels = {channel.topic: channel.schema.name for channel in log._source.channels}
    assert channels["/points/filtered"] == channels["/points"]
    has_fixed_fields = form in ("scan", "echoes", "livox")
    assert channels["/points/removed"].endswith(
        "/PointCloud2" if has_fixed_fields else wrapped.KINDS[form].split("/")[-1]
    )
    raw, kept, removed = (frames(out, f"/points{part}") for part in ("", "/filtered", "/removed"))
    for whole, some, rest in zip(raw, kept, removed, strict=True):
        valid = some[np.isfinite(some["x"])]
        assert 0 < len(valid) < len(whole)
        assert len(valid) + len(rest) == len(whole)
        assert set(map(repr, valid.tolist())) <= set(map(repr, whole.tolist()))
        assert set(rest["reason"].tolist()) <= {1, 2, 3}
        intensity = valid["reflectivity" if form == "livox" else "intensity"]
        assert (intensity >= 20).all() or (np.hypot(valid["x"], valid["y"]) >= 70).any()


@pytest.mark.parametrize("form", FORMS)
def test_values_are_those_of_plain_clouds(tmp_path, form):
    wrapped.sea_log(tmp_path / "log.mcap", form)
    for number, found in enumerate(frames(tmp_path / "log.mcap")):
        expected = wrapped.draco_points() if form == "draco" else logs.sea_points(60, (0, number))
        if form in ("scan", "echoes"):
            points, expected = found[np.isfinite(found["x"])], np.hypot(expected["x"], expected["y"])
            least, most = wrapped.PLANE[5:]
            every = np.stack((expected, expected + 3), axis=1) if form == "echoes" else expected
            every = every[(every >= least) & (every <= most)]
            np.testing.assert_allclose(np.hypot(points["x"], points["y"]), every, rtol=1e-6)
        else:
            expected = wrapped.livox_points(expected) if form == "livox" else expected
            for name in found.dtype.names:
                np.testing.assert_array_equal(found[name], expected[name])


def test_draco_clouds_are_written_in_zstd_with_one_line(tmp_path):
    wrapped.sea_log(tmp_path / "log.mcap", "draco")
    result = run("filter", tmp_path / "log.mcap", "-o", tmp_path / "out.mcap", "-m", "ror")
    assert result.stderr.count("are written as the same messages with zstd compression") == 1
    with seaclutter.open_log(tmp_path / "out.mcap") as log:
        assert {frame.cloud.extra.format for frame in log.frames()} == {"zstd"}


def cloudini(path, others=()):
    plain = wrapped.draco_plain()
    data = wrapped.compressed(plain, "cdr", "cloudini", b"CLOUDINI_V03...")
    entries = [logs.Entry("/points/cloudini", logs.START_NS + k * logs.PERIOD_NS, data) for k in range(3)]
    more = [entry for _, messages in others for entry in messages]
    topics = [wrapped.topic("/points/cloudini", wrapped.COMPRESSED), *(described for described, _ in others)]
    return logs.write_log(path, topics, sorted([*entries, *more], key=lambda entry: entry.log_time_ns))


def test_info_names_a_compression_that_is_not_supported(tmp_path):
    path = cloudini(tmp_path / "log.mcap")
    text = "clouds compressed with 'cloudini' are not supported; convert the log with cloudini_rosbag_converter"
    result = run("info", path, code=1)
    assert f"log, /points/cloudini: {text}" in result.stdout
    assert "point_cloud_interfaces/msg/CompressedPointCloud2" in result.stdout
    assert any(text in need for need in json.loads(run("info", path, "--json", code=1).stdout)[0]["needs"])
    result = run("filter", path, "-o", tmp_path / "out.mcap", code=1)
    assert [line for line in result.stderr.splitlines() if line.startswith("Error:")] == [
        f"Error: log, /points/cloudini: {text} of cloudini_ros"
    ]
    assert not (tmp_path / "out.mcap").exists()


def with_clouds(form, topic):
    """Return a topic of plain clouds and its messages."""
    messages = logs.cloud_messages("ros2", 3, 60)
    entries = [logs.Entry(topic, logs.START_NS + k * logs.PERIOD_NS, data) for k, data in enumerate(messages)]
    return logs.cloud_topic(topic), entries


@pytest.mark.parametrize("form", [form for form in FORMS if form != "livox"])
def test_plain_clouds_are_meant_if_no_topic_is_named(tmp_path, form):
    path, name = tmp_path / "log.mcap", "/other"
    wrapped.sea_log(path, form, topic_name=name, others=[with_clouds("ros2", "/points")])
    run("filter", path, "-o", tmp_path / "out.mcap")
    with seaclutter.open_log(tmp_path / "out.mcap") as log:
        assert [frame.topic for frame in log.frames()] == ["/points"] * 3
        assert log.topics == ("/other", "/points")
    assert "several" not in run("info", path).stdout
    run("filter", path, "-o", tmp_path / "named.mcap", "-t", name)
    again = run("filter", tmp_path / "out.mcap", "-o", tmp_path / "again.mcap")
    assert "filtered by joint" in again.stderr


@pytest.mark.parametrize("method", ["confirmed", "sea_surface"])
def test_methods_that_need_heights_say_so_once(tmp_path, method):
    wrapped.sea_log(tmp_path / "log.mcap", "scan")
    line = f"all points are at one height, as in laser scans; {method} needs heights, so use another method"
    result = run("filter", tmp_path / "log.mcap", "-o", tmp_path / "out.mcap", "-m", method)
    assert result.stderr.count(line) == 1
    result = run("filter", tmp_path / "log.mcap", "-o", tmp_path / "other.mcap", "-m", "ror")
    assert "height" not in result.stderr


def test_fields_with_several_values(tmp_path):
    kind = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("normal", "<f4", 3), ("intensity", "<u2"), ("echoes", "<u1", 5)]
    points = np.zeros(40, kind)
    rng = np.random.default_rng(0)
    for name in points.dtype.names:
        points[name] = rng.integers(1, 60, points[name].shape)
    path, out = tmp_path / "frames", tmp_path / "out.mcap"
    path.mkdir()
    np.save(path / "0.npy", points)
    run("filter", path, "-o", out, "--with-removed", "--keep-raw")
    raw, kept, removed = (frames(out, f"/points{part}")[0] for part in ("", "/filtered", "/removed"))
    assert raw.tobytes() == points.tobytes()
    names = list(points.dtype.names)
    parts = sorted(str(point) for part in (kept, removed) for point in part[names])
    assert parts == sorted(map(str, raw))
    assert "normal f4x3" in run("info", out, "-t", "/points").stdout
    points = points.astype([("x", "<f4", 3), *kind[1:]])
    np.save(path / "0.npy", points)
    result = run("filter", path, "-o", out, "--force", code=1)
    assert "field 'x' has 3 values per point; it must have one" in result.stderr
