"""Tests of ``seaclutter info``: figures against NumPy, and hints on logs that need them."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from seaclutter_cli.commands import cli
from tests.commands.test_filter import SECOND_NS, points, write_log
from tests.paths import SAMPLE, shared


def invoke(*arguments):
    return CliRunner().invoke(cli, ["info", *map(str, arguments)])


def survey(*arguments):
    result = invoke(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
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
    ("options", "need"),
    [
        ({"topics": ("/port", "/starboard")}, "choose from: -t /port -t /starboard"),
        ({"make": lambda number: points(number, top=1)}, "do not fit the default thresholds"),
        ({"make": lambda number: points(number)[["x", "y", "z"]]}, "--intensity-field"),
        ({"make": lambda number: points(number)[["x", "y", "intensity"]]}, "no field 'z'"),
        ({"topics": ()}, "there are no point clouds"),
    ],
)
def test_settings_that_a_filter_run_needs(tmp_path, options, need):
    log = write_log(tmp_path / "log.mcap", **options)
    (content,) = survey(log)
    assert any(need in line for line in content["needs"])
    assert need in invoke(log).stdout


def test_frames_limits_the_input(tmp_path):
    (content,) = survey(write_log(tmp_path / "log.mcap"), "-n", "2")
    assert content["clouds"]["/points"]["frames"] == 2


def test_the_sample():
    (content,) = survey(SAMPLE)
    assert content["clouds"]["/points"]["points"] == {"min": 209297, "median": 209729, "max": 209997}


def test_a_log_without_frames(tmp_path):
    result = invoke(write_log(tmp_path / "log.mcap", frames=0))
    assert result.exit_code == 0
    assert "frames     0" in result.stdout


def test_a_file_that_is_not_a_log(tmp_path):
    (tmp_path / "no.mcap").write_bytes(b"nothing")
    result = invoke(tmp_path / "no.mcap")
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(("name", "sensor"), [("vlp16", "VelodyneScan"), ("xt32", "PandarScan")])
def test_packet_topics_are_listed(name, sensor):
    (content,) = survey(shared(f"nebula/{name}"))
    assert any(sensor in (topic["type"] or "") for topic in content["topics"])
