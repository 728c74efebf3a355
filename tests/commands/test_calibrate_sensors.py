"""`calibrate` and `info` agree on the sensor, and a calibration is of one sensor only."""

import json
from functools import partial

import numpy as np
import pytest

from seaclutter_cli.config import load_config
from tests.commands.test_filter import POINT, write_log
from tests.paths import ROOT
from tests.running import execute


def clouds_of(*more):
    """Return clouds of 32 rings with additional fields."""

    def make(number):
        cloud = np.zeros(2000, [*POINT, ("ring", "<u2"), *((name, "<f4") for name in more)])
        rng = np.random.default_rng(number)
        cloud["x"], cloud["intensity"] = rng.uniform(10, 40, 2000), rng.integers(0, 200, 2000)
        cloud["ring"] = np.arange(2000) % 32
        return cloud

    return make


invoke = partial(execute, "calibrate")


def sensors(command, *arguments):
    result = execute(command, *arguments, "--json", code=0)
    return json.loads(result.stdout)


@pytest.mark.parametrize("fields", [("time",), ("timestamp",), ("t", "reflectivity", "range"), ()])
def test_the_sensor_is_that_of_info(tmp_path, fields):
    log = write_log(tmp_path / "log.mcap", make=clouds_of(*fields))
    found = sensors("calibrate", log, "-o", tmp_path / "c.yaml")["sensors"]
    assert found == sensors("info", log)[0]["clouds"]["/points"]["sensors"]
    assert bool(found) == bool(fields)


@pytest.mark.parametrize("name", ["sea.mcap", "rs-lidar-32.pcap"])
def test_a_stated_sensor_is_written(tmp_path, name):
    log = ROOT / "samples" / name
    result = invoke(log, "-o", tmp_path / "c.yaml")
    assert "Sensor RS-LiDAR-32; intensity field" in result.stdout
    assert load_config(tmp_path / "c.yaml").sensor.model == "RS-LiDAR-32"
    assert sensors("info", log)[0]["sensors"]["/points"]["model"] == "RS-LiDAR-32"


def test_two_sensors_are_refused(tmp_path):
    one = write_log(tmp_path / "one.mcap", make=clouds_of("time"))
    other = write_log(tmp_path / "two.mcap", make=clouds_of("timestamp"))
    result = invoke(one, other, "-o", tmp_path / "c.yaml", code=1)
    assert not (tmp_path / "c.yaml").exists()
    assert "two, /points: sensor resembles" in result.stderr
    assert "in one, /points; thresholds are valid for one sensor" in result.stderr
    assert result.stderr.count("Error: ") == 1


def test_recordings_without_a_known_sensor_join_any(tmp_path):
    unknown = write_log(tmp_path / "one.mcap", make=clouds_of())
    invoke(unknown, ROOT / "samples" / "rs-lidar-32.pcap", "-o", tmp_path / "c.yaml", code=0)
    assert load_config(tmp_path / "c.yaml").sensor.intensity == "calibrated by the sensor (mode 3)"
