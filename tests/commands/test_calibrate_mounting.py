"""Tests of ``seaclutter calibrate -m confirmed``: thresholds, the mounting of the lidar, logs without intensities."""

import pytest

from seaclutter_cli.config import load_config
from seaclutter_cli.water import Mounting
from tests.commands.test_calibrate import data, invoke
from tests.commands.test_filter import invoke as invoke_filter
from tests.commands.test_filter import write_log
from tests.commands.test_filter_water import sea


@pytest.fixture
def out(tmp_path):
    return tmp_path / "new.yaml"


def calibrated(tmp_path, out, mounting, *arguments):
    log = write_log(tmp_path / "log.mcap", make=sea(Mounting(*mounting)))
    return log, data(log, "-m", "confirmed", *arguments, "-o", out)


@pytest.mark.parametrize("mounting", [(180, 0), (0, 25), (170, -10)])
def test_the_mounting_is_written_with_the_way_it_was_found(tmp_path, out, mounting):
    log, found = calibrated(tmp_path, out, mounting)
    roll, pitch = mounting
    assert found["mounting"] == {"roll_deg": roll, "pitch_deg": pitch}
    config = load_config(out)
    assert config.method == "confirmed"
    assert (config.filter.mounting_roll_deg, config.filter.mounting_pitch_deg) == mounting
    text = out.read_text().replace("\n# ", " ")
    assert f"Mounting: roll {roll}°, pitch {pitch}°, from the attitude of the water in the first seconds; " in text
    result = invoke_filter(log, "-c", out, "-o", tmp_path / "f.mcap")
    assert result.exit_code == 0, result.output
    assert "mounted" not in result.stderr


@pytest.mark.parametrize(("mounting", "arguments"), [((0, 0), ()), ((180, 0), ("-s", "filter.mounting_roll_deg=180"))])
def test_a_correct_mounting_is_kept(tmp_path, out, mounting, arguments):
    _, found = calibrated(tmp_path, out, mounting, *arguments)
    assert "mounting" not in found
    assert load_config(out).filter.mounting == Mounting(*mounting)
    assert "Mounting:" not in out.read_text()


def test_thresholds_do_not_depend_on_the_mounting(tmp_path, out):
    _, level = calibrated(tmp_path, out, (0, 0))
    _, inverted = calibrated(tmp_path, out, (180, 0), "--force")
    assert [ring["threshold"] for ring in inverted["rings"]] == [ring["threshold"] for ring in level["rings"]]


def test_a_calibration_can_start_from_its_own_result(tmp_path, out):
    log, _ = calibrated(tmp_path, out, (180, 0))
    again = tmp_path / "again.yaml"
    assert "mounting" not in data(log, "-c", out, "-o", again)
    assert load_config(again) == load_config(out)


def test_other_methods_have_no_mounting(tmp_path, out):
    log = write_log(tmp_path / "log.mcap", make=sea(Mounting(180)))
    assert "mounting" not in data(log, "-o", out)
    assert "mounting" not in out.read_text()


def test_without_intensities_there_is_nothing_to_calibrate(tmp_path, out):
    log = write_log(tmp_path / "log.mcap", make=sea())
    result = invoke(log, "-m", "confirmed", "-s", "filter.use_intensity=false", "-o", out)
    assert result.exit_code == 2
    assert "use_intensity: false" in result.stderr
    assert not out.exists()
