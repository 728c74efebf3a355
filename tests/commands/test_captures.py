"""Tests of commands on packet captures, and of warnings about thresholds for another sensor."""

import json

import pytest

from seaclutter_cli.config import load_config
from seaclutter_cli.sensors.robosense.packets import INFO_ID
from tests.running import execute


def run(*arguments):
    result = execute(*arguments)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exc_info
    return result


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trial")
    assert run("simulate", "buoy_speedboat", "--format", "pcap", "-n", 6, "-o", folder / "trial.pcap").exit_code == 0
    return folder / "trial.pcap"


def uncalibrated(capture, target):
    """Copy a capture, marked as having uncalibrated intensities."""
    data = bytearray(capture.read_bytes())
    index = data.find(INFO_ID)
    while index >= 0:
        data[index + 291] = 0
        index = data.find(INFO_ID, index + 1)
    target.write_bytes(data)
    return target


def test_filter_and_evaluate_give_the_same_results_on_packets_and_points(trial, tmp_path):
    run("simulate", "buoy_speedboat", "-n", 6, "-o", tmp_path / "trial.mcap")
    counts = []
    for log in (trial, tmp_path / "trial.mcap"):
        filtered = json.loads(run("filter", log, "-o", tmp_path / "f.mcap", "--json", "--force").stdout)
        labels = log.with_suffix(".labels.csv")
        evaluated = json.loads(run("evaluate", log, "--labels", labels, "--json").stdout)["methods"]["joint"]
        counts.append((filtered[0]["topics"]["/points"]["points_in"], evaluated["targets"] - evaluated["not_visible"]))
        assert evaluated["frames"] == 6
        assert evaluated["targets"] == 12
    assert counts[0] == counts[1]


def test_a_calibration_records_its_sensor(trial, tmp_path):
    config = tmp_path / "my.yaml"
    result = run("calibrate", trial, "--labels", trial.with_suffix(".labels.csv"), "-o", config)
    assert result.exit_code == 0, result.output
    sensor = load_config(config).sensor
    assert sensor.model == "RS-LiDAR-32"
    assert "calibrated" in sensor.intensity
    assert "the thresholds are for" not in run("filter", trial, "-c", config, "-o", tmp_path / "f.mcap").stderr
    other = uncalibrated(trial, tmp_path / "other.pcap")
    for arguments in (
        ("filter", other, "-o", tmp_path / "g.mcap"),
        ("evaluate", other, "--labels", trial.with_suffix(".labels.csv")),
    ):
        result = run(*arguments, "-c", config)
        assert result.exit_code == 0
        assert "the thresholds are for intensities of the kind 'calibrated" in result.stderr


def test_a_configuration_for_another_sensor(trial, tmp_path):
    result = run("filter", trial, "-o", tmp_path / "f.mcap", "-s", "sensor.model=VLP-16")
    assert "for VLP-16, but the log is from RS-LiDAR-32" in result.stderr
