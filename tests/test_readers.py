"""Independent readers read a filtered MCAP file completely: mcap, rosbags, and @mcap/core for JavaScript."""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from tests.logs import CLOUD_KINDS, LAYOUTS, cloud_log
from tests.paths import SAMPLE
from tests.sinks.runs import contents, decode, filter_log

FOLDER = Path(__file__).parent / "readers"
NO_REGISTRY = r"code (ENOTFOUND|EAI_AGAIN|ECONN\w+|ETIMEDOUT|ENETUNREACH|ENOTCACHED|ERR_SOCKET\w+|E40[134]|E5\d\d)"


@pytest.fixture(scope="module")
def filtered(tmp_path_factory):
    """Return filtered logs of every cloud encoding and compression."""
    folder = tmp_path_factory.mktemp("filtered")
    logs = {f"{kind} {layout}": (kind, LAYOUTS[layout]) for kind in CLOUD_KINDS for layout in ("zstd", "lz4", "none")}
    paths = {name: folder / f"{name}.mcap" for name in logs}
    for name, (kind, layout) in logs.items():
        raw = cloud_log(folder / f"raw {name}.mcap", layout, kind=kind, frames=10, points=1500)
        filter_log(raw, paths[name], keep_raw=True, with_removed=True)
    paths["sample"] = folder / "sample.mcap"
    filter_log(SAMPLE, paths["sample"], method="ring_intensity", overrides=["filter.initial_thresholds=[1, 1, 1, 1]"])
    return paths


NAMES = pytest.mark.parametrize("name", [f"{k} {c}" for k in CLOUD_KINDS for c in ("zstd", "lz4", "none")] + ["sample"])
ROS2_NAMES = pytest.mark.parametrize("name", ["ros2 zstd", "ros2 lz4", "ros2 none", "sample"])


@NAMES
def test_mcap_with_and_without_the_index(filtered, name):
    found = contents(filtered[name])
    counts = {topic: len(entries) for topic, entries in found.topics.items()}
    if name != "sample":
        clouds = dict.fromkeys(("/points", "/points/filtered", "/points/removed", "/seaclutter/diagnostics"), 10)
        assert counts == {**clouds, "/imu": 20}
    assert found.statistics.message_count == sum(counts.values()) > 0
    with filtered[name].open("rb") as stream:
        order = [(m.log_time, c.topic) for _, c, m in NonSeekingReader(stream, validate_crcs=True).iter_messages()]
    assert sorted(order) == sorted(found.order)
    assert order == found.order, "messages must be in the order of their log time"


@ROS2_NAMES
def test_rosbags(filtered, name):
    expected = contents(filtered[name])
    with AnyReader([filtered[name]]) as reader:
        found = {topic: [] for topic in expected.topics}
        for connection, time_ns, data in reader.messages():
            found[connection.topic].append((time_ns, bytes(data)))
            if connection.topic != "/imu":  # not real messages
                message = reader.deserialize(data, connection.msgtype)
            if connection.msgtype.endswith("/PointCloud2"):
                assert message.data.tobytes() == decode(bytes(data)).data
        assert reader.message_count == expected.statistics.message_count
        assert {c.topic: c.msgcount for c in reader.connections} == {t: len(found[t]) for t in found}
    assert found == {topic: [(e.log_time, e.data) for e in entries] for topic, entries in expected.topics.items()}


@ROS2_NAMES
def test_rosbags_by_topic(filtered, name):
    with Reader(filtered[name]) as reader:
        chosen = [c for c in reader.connections if c.topic == "/seaclutter/diagnostics"]
        assert len(list(reader.messages(connections=chosen))) == chosen[0].msgcount > 0


@pytest.fixture(scope="module")
def read_in_javascript(filtered, tmp_path_factory):
    """Return the content of the filtered logs as read by the JavaScript library."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if not (node and npm):
        pytest.skip("node and npm are not installed")
    folder = tmp_path_factory.mktemp("javascript")
    for name in ("package.json", "package-lock.json", "read.mjs"):
        shutil.copy(FOLDER / name, folder)
    options = ("--ignore-scripts", "--no-audit", "--no-fund", "--fetch-retries=1")
    install = subprocess.run([npm, "ci", *options], cwd=folder, capture_output=True, text=True, check=False)
    if install.returncode and re.search(NO_REGISTRY, install.stderr):
        pytest.skip("the npm registry cannot be reached")
    assert not install.returncode, install.stderr
    program = [node, "read.mjs", *map(str, filtered.values())]
    done = subprocess.run(program, cwd=folder, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    return dict(zip(filtered, json.loads(done.stdout), strict=True))


@NAMES
@pytest.mark.parametrize("way", ["indexed", "streamed"])
def test_javascript(filtered, read_in_javascript, name, way):
    expected, found = contents(filtered[name]), read_in_javascript[name][way]
    assert found["profile"] == expected.profile
    assert found["topics"] == {topic: list(map(line_of, entries)) for topic, entries in expected.topics.items()}
    assert found["attachments"] == [
        [name, kind, str(log_time), str(create_time), sha256(data)]
        for log_time, create_time, name, kind, data in expected.attachments
    ]
    assert [tuple(record) for record in found["metadata"]] == expected.metadata
    assert found.get("announced", expected.statistics.message_count) == sum(map(len, found["topics"].values()))


def line_of(entry):
    return f"{entry.log_time} {entry.publish_time} {entry.sequence} {sha256(entry.data)}"


def sha256(data):
    return hashlib.sha256(data).hexdigest()
