"""``seaclutter mask``, and the use of its files."""

import json
from functools import partial

import pytest

from tests.paths import ROOT
from tests.running import execute

SEA = ROOT / "samples" / "sea.mcap"
MOORED = """
recording: {frames: 24, lidar: VLP-16}
vessel: {speed_ms: 0}
objects:
  - {track_id: 1, shape: quay_wall, size_m: [80, 1, 4], path: [[0, 30]], ignore: true}
  - {track_id: 2, shape: quay_wall, size_m: [80, 1, 4], path: [[0, -6]], ignore: true}
"""


run = partial(execute, code=0)


def test_a_mask_is_written_and_used(tmp_path):
    mask, picture = tmp_path / "mask.csv", tmp_path / "mask.png"
    result = run("mask", SEA, "-o", mask, "--plot", picture)
    assert "Own structure in 92 directions" in result.stdout
    assert "Azimuths: -180° to -160°, 160° to 180°" in result.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
    settings = ("-s", f"filter.mask={mask}", "-s", "filter.start_m=1", "-s", "filter.ring_width_m=69", "-s",
                "filter.initial_thresholds=[5]")  # fmt: skip
    filtered = json.loads(run("filter", SEA, "-o", tmp_path / "out.mcap", "--json", *settings).stdout)
    assert filtered[0]["topics"]["/points"]["excluded"] > 1000
    run("report", SEA, "-n", 5, "-o", tmp_path / "r.html", *settings)
    assert "own structure" in (tmp_path / "r.html").read_text(encoding="utf-8")
    again = run("filter", SEA, "-o", mask, "--force", *settings, code=2)
    assert "filter.mask" in again.stderr


def test_a_moored_vessel_gets_a_warning_and_no_mask(tmp_path):
    (tmp_path / "moored.yaml").write_text(MOORED)
    run("simulate", tmp_path / "moored.yaml", "-o", tmp_path / "moored.mcap", "-q")
    result = run("mask", tmp_path / "moored.mcap", "-o", tmp_path / "mask.csv", "--plot", tmp_path / "mask.svg")
    assert "as for a vessel at rest or between straight walls" in result.stderr
    assert "mask.csv: not written, because there is nothing to mask" in result.stderr
    assert "No own structure found within 20 m in 24 frames." in result.stdout
    assert not (tmp_path / "mask.csv").exists()
    assert (tmp_path / "mask.svg").exists()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--reach", "0"), "is not in the range 1<=x<=100"),
        (("--plot", "mask.pdf"), "must end in .png or .svg"),
        (("-t", "/none"), "no point-cloud topic /none"),
    ],
)
def test_wrong_options(tmp_path, monkeypatch, words, text):
    monkeypatch.chdir(tmp_path)
    assert text in run("mask", SEA, "-o", "mask.csv", *words, code=2).stderr
    assert not list(tmp_path.iterdir())


def test_few_frames_are_named(tmp_path):
    result = run("mask", SEA, "-n", 5, "-o", tmp_path / "mask.csv")
    assert "only 5 frames; what is constant shows in 20 and more" in result.stderr
    existing = tmp_path / "there.csv"
    existing.write_text("mine")
    assert "exists" in run("mask", SEA, "-o", existing, code=2).stderr
    assert existing.read_text() == "mine"
