"""Warnings of `calibrate` about logs that give poor thresholds."""

import json

import numpy as np
import pytest

import seaclutter
from tests.commands.test_calibrate import sea
from tests.commands.test_filter import POINT, write_log
from tests.paths import ROOT
from tests.running import execute

SEA = ROOT / "samples" / "sea.mcap"
TARGETS = "objects rise out of the water"


def invoke(tmp_path, *arguments):
    return execute("calibrate", *arguments, "-o", tmp_path / "c.yaml", "--force")


@pytest.fixture(scope="module")
def clutter(tmp_path_factory):
    """Return the sample without its targets, at one frame per second."""
    with seaclutter.open_log(SEA) as log:
        clouds = [frame.cloud.points[frame.cloud.points["label"] == 0].copy() for frame in log.frames()]
    return write_log(tmp_path_factory.mktemp("log") / "clutter.mcap", frames=60, make=lambda number: clouds[number])


def test_targets_without_labels_are_noticed(tmp_path):
    result = invoke(tmp_path, SEA)
    (line,) = (line for line in result.stderr.splitlines() if TARGETS in line)
    assert "of 20 examined frames" in line
    assert "--labels" in line
    found = json.loads(invoke(tmp_path, SEA, "--json").stdout)
    assert [TARGETS in text for text in found["warnings"]] == [True, False]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_several_recordings_count_together(tmp_path, clutter, jobs):
    result = invoke(tmp_path, clutter, SEA, "-j", jobs)
    assert "of 26 examined frames" in result.stderr  # two seconds of each 20


@pytest.mark.parametrize("method", ["joint", "confirmed"])
def test_clutter_alone_gives_no_warning(tmp_path, clutter, method):
    assert invoke(tmp_path, clutter, "-m", method).stderr == ""


def test_labelled_targets_give_no_warning(tmp_path):
    assert invoke(tmp_path, SEA, "--labels", ROOT / "samples" / "sea.labels.csv").stderr == ""


def test_logs_without_water_give_no_warning(tmp_path):
    assert invoke(tmp_path, write_log(tmp_path / "log.mcap", make=sea)).stderr == ""


def test_saturation(tmp_path):
    result = invoke(tmp_path, SEA)
    assert "10 to 25 m: too many points have the highest intensity, 255" in result.stderr
    row = next(line for line in result.stdout.splitlines() if "10 to 25 m" in line)
    assert row.split()[5:] == ["255", "68.2", "%", "saturated"]


def test_few_points_in_all(tmp_path):
    cloud = np.zeros(99, POINT)
    cloud["x"], cloud["intensity"] = np.linspace(12, 35, 99), np.arange(99) % 7
    result = invoke(tmp_path, write_log(tmp_path / "log.mcap", frames=1, make=lambda _: cloud))
    assert "the thresholds are from 99 clutter points only" in result.stderr
    assert result.stdout.count("few points: rings 1 to 2") == 2
