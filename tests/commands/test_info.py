"""Tests of ``seaclutter info``: figures against NumPy, and hints on logs that need them."""

import json
from functools import partial

import numpy as np
import pytest
from mcap.writer import Writer

from seaclutter_cli.cloud import from_array
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from tests.commands.test_filter import SECOND_NS, TYPE, points, write_log
from tests.paths import ROOT, shared
from tests.running import execute

invoke = partial(execute, "info")


def survey(*arguments, code=0):
    result = invoke(*arguments, "--json", code=code)
    return json.loads(result.stdout)


def test_the_figures_match_the_points(tmp_path):
    def make(number):
        cloud = points(number, size=100 + 10 * number)
        cloud["x"][0] = np.nan
        return cloud

    (content,) = survey(write_log(tmp_path / "log.mcap", make=make))
    cloud = content["clouds"]["/points"]
    valid = np.concatenate([make(number)[1:] for number in range(5)])
    assert content["duration_s"] == 4
    assert content["start_ns"] == 100 * SECOND_NS
    assert {topic["topic"]: topic["messages"] for topic in content["topics"]} == {"/points": 5, "/note": 5}
    assert cloud["frames"] == 5
    assert cloud["rate_hz"] == 1
    assert cloud["points"] == {"min": 100, "median": 120, "max": 140}
    assert [field["name"] for field in cloud["fields"]] == ["x", "y", "z", "intensity"]
    assert cloud["intensity_field"] == "intensity"
    assert cloud["intensity"] == [valid["intensity"].min(), valid["intensity"].max()]
    distance = np.sqrt(sum(valid[axis].astype(np.float64) ** 2 for axis in "xyz"))
    assert cloud["range_m"] == pytest.approx([distance.min(), distance.max()])
    assert cloud["invalid_share"] == pytest.approx(5 / 600)
    assert content["needs"] == []


@pytest.mark.parametrize(
    ("options", "need", "code"),
    [
        ({"topics": ("/port", "/starboard")}, "choose from: -t /port -t /starboard", 0),
        ({"make": lambda number: points(number, top=1)}, "do not fit the default thresholds", 0),
        ({"make": lambda number: points(number)[["x", "y", "z"]]}, "--intensity-field", 0),
        ({"make": lambda number: points(number)[["x", "y", "intensity"]]}, "no field 'z'", 1),
        ({"topics": ()}, "there are no point clouds", 1),
    ],
)
def test_settings_that_a_filter_run_needs(tmp_path, options, need, code):
    """Where no clouds can be read, the exit status says so, too."""
    log = write_log(tmp_path / "log.mcap", **options)
    (content,) = survey(log, code=code)
    assert any(need in line for line in content["needs"])
    assert need in invoke(log, code=code).stdout


def test_samples_of_the_simulator_are_recognised():
    (content,) = survey(ROOT / "samples" / "sea.mcap")
    assert content["sensors"]["/points"]["model"] == "RS-LiDAR-32"
    printed = invoke(ROOT / "samples" / "sea.mcap").stdout
    assert "sensor     RS-LiDAR-32; origin: simulated" in printed
    assert "packets" not in printed


@pytest.mark.parametrize("size", [0, 10])
def test_clouds_without_a_valid_point(tmp_path, size):
    log = write_log(tmp_path / "log.mcap", make=lambda _: np.full(size, np.nan, points(0).dtype))
    (content,) = survey(log)
    assert content["clouds"]["/points"]["range_m"] is None
    assert content["needs"] == ["/points: the clouds contain no valid point, so there is nothing to filter"]
    printed = invoke(log).stdout
    assert "inf" not in printed
    assert "  range      none\n" in printed


def test_the_rate_is_that_of_whole_revolutions(tmp_path):
    """A recording of packets begins and ends within a revolution."""
    times_ns = np.array([100.07, 100.1, 100.2, 100.3, 100.4, 100.41]) * SECOND_NS
    stamps = iter(times_ns.astype(np.int64).tolist())
    log = tmp_path / "log.mcap"
    with log.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = ros2_schema(TYPE)
        channel = writer.register_channel(
            "/points", "cdr", writer.register_schema(schema.name, schema.encoding, schema.data)
        )
        for index, stamp in enumerate(stamps):
            data = CODECS[TYPE, "cdr"].encode(from_array(points(index), stamp_ns=stamp))
            writer.add_message(channel, stamp, data, stamp, index)
        writer.finish()
    assert survey(log)[0]["clouds"]["/points"]["rate_hz"] == 10


def test_a_log_without_frames(tmp_path):
    result = invoke(write_log(tmp_path / "log.mcap", frames=0), code=0)
    assert "frames     0" in result.stdout


@pytest.mark.parametrize(("name", "sensor"), [("vlp16", "VelodyneScan"), ("xt32", "PandarScan")])
def test_packet_topics_are_listed(name, sensor):
    (content,) = survey(shared(f"nebula/{name}"))
    decoded = {topic["type"]: topic["decoded"] for topic in content["topics"]}
    assert decoded.pop("sensor_msgs/msg/PointCloud2")
    assert not any(decoded.values())
    assert "decoded from packets\n" in invoke(shared(f"nebula/{name}")).stdout
    assert next(iter(content["clouds"].values()))["rate_hz"] == pytest.approx(10, abs=0.1)
    assert any(sensor in (topic["type"] or "") for topic in content["topics"])


def test_equal_kinds_of_damage_are_one_line(tmp_path):
    rows = {0: "1,2,3,4", 1: "1,2", 2: "1,2", 3: "1,2"}
    for number, row in rows.items():
        (tmp_path / f"{number}.csv").write_text(f"x,y,z,intensity\n{row}\n")
    (line,) = [line for line in invoke(tmp_path, code=3).stderr.splitlines() if line.startswith("Damaged")]
    assert line.endswith("(and 2 more like this; -v lists all)")
    assert invoke(tmp_path, "-v", code=3).stderr.count("Damaged: ") == 3
