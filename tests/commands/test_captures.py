"""Captures through the whole command line: all commands work on them, and thresholds know what sensor they are for."""

import json

import pytest
from click.testing import CliRunner

from seaclutter_cli.commands import cli
from seaclutter_cli.config import load_config
from seaclutter_cli.sensors.robosense.packets import INFO_ID


def run(*arguments):
    result = CliRunner().invoke(cli, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exc_info
    return result


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trial")
    assert run("simulate", "buoy_speedboat", "--format", "pcap", "-n", 6, "-o", folder / "trial.pcap").exit_code == 0
    return folder / "trial.pcap"


def uncalibrated(capture, target):
    """Copy a capture as if the sensor did not calibrate its intensities."""
    data = bytearray(capture.read_bytes())
    place = data.find(INFO_ID)
    while place >= 0:
        data[place + 291] = 0
        place = data.find(INFO_ID, place + 1)
    target.write_bytes(data)
    return target


def test_info_names_the_sensor(trial):
    (content,) = json.loads(run("info", trial, "--json").stdout)
    assert content["sensors"]["/points"]["model"] == "RS-LiDAR-32"
    assert content["clouds"]["/points"]["frames"] == 6
    assert content["sensors"]["/points"]["lost_packets"] == 0


def test_filter_and_evaluate_give_what_they_give_on_the_points(trial, tmp_path):
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


def test_a_calibration_knows_its_sensor(trial, tmp_path):
    config = tmp_path / "my.yaml"
    result = run("calibrate", trial, "--labels", trial.with_suffix(".labels.csv"), "-o", config)
    assert result.exit_code == 0, result.output
    sensor = load_config(config).sensor
    assert sensor.model == "RS-LiDAR-32"
    assert "calibrated" in sensor.intensity
    assert "thresholds were found" not in run("filter", trial, "-c", config, "-o", tmp_path / "f.mcap").stderr
    other = uncalibrated(trial, tmp_path / "other.pcap")
    for arguments in (
        ("filter", other, "-o", tmp_path / "g.mcap"),
        ("evaluate", other, "--labels", trial.with_suffix(".labels.csv")),
    ):
        result = run(*arguments, "-c", config)
        assert result.exit_code == 0
        assert "thresholds were found where intensities are calibrated" in result.stderr


def test_a_configuration_of_another_sensor(trial, tmp_path):
    result = run("filter", trial, "-o", tmp_path / "f.mcap", "-s", "sensor.model=VLP-16")
    assert "made for VLP-16, the log is of RS-LiDAR-32" in result.stderr
