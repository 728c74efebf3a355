"""Logs with a fitting configuration give no warning."""

import pytest

from tests.paths import ROOT, shared
from tests.running import execute

NOMINAL_ANGLES = "nominal angles are used"
"""The recording lacks the angles of its lidar, and this is said."""


def invoke(*arguments):
    result = execute(*arguments, code=0)
    return [line for line in result.stderr.splitlines() if "Warning" in line and NOMINAL_ANGLES not in line]


@pytest.mark.parametrize("method", ["joint", "confirmed"])
@pytest.mark.parametrize("name", ["sea.mcap", "rs-lidar-32.pcap"])
def test_samples_at_sea(tmp_path, name, method):
    assert invoke("filter", ROOT / "samples" / name, "-o", tmp_path / "f.mcap", "-m", method) == []


@pytest.mark.parametrize("name", ["samples", "wads-36"])
def test_snow(tmp_path, name):
    log = ROOT / "samples" / "snow.mcap" if name == "samples" else shared(name) / "velodyne"
    assert invoke("filter", log, "-o", tmp_path / "f.mcap", "-c", "snow") == []


@pytest.mark.parametrize(
    "name",
    [
        *("nebula/vlp16", "nebula/vlp32", "nebula/xt32"),
        *("ouster/OS-1-32-G_v2.1.1_1024x10.pcap", "ouster/OS-1-128_v2.3.0_1024x10_lb_n3.pcap"),
    ],
)
def test_recordings_of_other_sensors(tmp_path, name):
    """The defaults give one warning about the sensor, thresholds of its own none."""
    log = shared(name)
    (warning,) = invoke("filter", log, "-o", tmp_path / "f.mcap")
    assert "the thresholds are for RS-LiDAR-32, but the log is from" in warning
    invoke("calibrate", log, "-o", tmp_path / "own.yaml")
    assert invoke("filter", log, "-o", tmp_path / "f.mcap", "-c", tmp_path / "own.yaml", "--force") == []
