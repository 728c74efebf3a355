"""`seaclutter suspects`: raw and filtered logs, tables, pictures, refusals."""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.lib import recfunctions

from seaclutter_cli.commands import cli
from seaclutter_cli.runs.suspects import COLUMNS
from tests.logs import PERIOD_NS, POINT, START_NS, Entry, cloud_message, cloud_topic, sea_points, write_log
from tests.paths import ROOT

SEA = ROOT / "samples" / "sea.mcap"
FRAMES = 30


def run(*arguments):
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def suspects(*arguments):
    result = run("suspects", *arguments, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)["recordings"]


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Return the suspects of the sample, with its table and pictures."""
    folder = tmp_path_factory.mktemp("suspects")
    files = "-o", folder / "s.csv", "--pictures", folder / "pictures"
    (found,) = suspects(SEA, "-m", "joint", "-n", FRAMES, *files, "--show", 1, "-j", 1)
    return found, folder


def test_the_buoy_that_joint_loses(raw):
    found, folder = raw
    assert (found["method"], found["topic"], found["frames"]) == ("joint", "/points", FRAMES)
    first = found["suspects"]["removed"][0]
    assert first["range_m"] == pytest.approx(44, abs=2)
    assert first["reasons"]
    with (folder / "s.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == sum(map(len, found["suspects"].values()))
    assert {path.name for path in (folder / "pictures").iterdir()} == {"removed-1.png", "kept-1.png"}


def test_a_filtered_log_has_the_same_suspects(raw, tmp_path):
    for name, options in (("a.mcap", ()), ("b.mcap", ("--keep-raw", "--no-diagnostics"))):
        assert run("filter", SEA, "-n", FRAMES, "-o", tmp_path / name, "--with-removed", *options).exit_code == 0
        (found,) = suspects(tmp_path / name)
        assert (found["method"], found["frames"]) == ("joint", FRAMES)
        removed, expected = (one["suspects"]["removed"] for one in (found, raw[0]))
        assert [(one["frame"], one["points"], one["reasons"]) for one in removed] == [
            (one["frame"], one["points"], one["reasons"]) for one in expected
        ]
    assert "only filters the remaining points" in run("suspects", tmp_path / "a.mcap", "-m", "sor").stderr


def test_a_configuration_in_the_working_folder_does_not_filter_a_filtered_log_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "seaclutter.yaml").write_text("filter: {method: sor}")
    assert run("filter", SEA, "-o", "a.mcap", "-m", "joint", "--with-removed", "-n", 20).exit_code == 0
    assert [one["method"] for one in suspects("a.mcap")] == ["joint"]


def test_the_text_names_the_rule(tmp_path):
    result = run("suspects", SEA, "-m", "joint", "-n", 40)
    assert result.exit_code == 0
    assert "removed, and may have been targets:" in result.stdout
    assert "outlier" in result.stdout
    assert all(len(line) <= 80 for line in result.stdout.splitlines())
    assert "targets: none" not in result.stdout


def test_empty_logs_are_said_and_frames_without_intensity_are_not_counted(tmp_path):
    full, empty = sea_points(2000), np.empty(0, POINT)
    bare = recfunctions.drop_fields(full, "intensity", usemask=False)
    for name, clouds in {"half": [full, bare] * 2, "empty": [empty] * 3}.items():
        entries = [
            Entry("/points", START_NS + k * PERIOD_NS, cloud_message("ros2", one, START_NS + k * PERIOD_NS))
            for k, one in enumerate(clouds)
        ]
        write_log(tmp_path / f"{name}.mcap", [cloud_topic("/points")], entries)
    half = run("suspects", tmp_path / "half.mcap", "-m", "joint")
    assert (half.exit_code, "half: joint on /points, 2 frames" in half.stdout) == (3, True)
    assert "/points: all clouds are empty" in run("suspects", tmp_path / "empty.mcap", "-m", "joint").stderr


def test_refusals(tmp_path):
    assert run("filter", SEA, "-o", tmp_path / "a.mcap", "-n", 2).exit_code == 0
    result = run("suspects", tmp_path / "a.mcap")
    assert (result.exit_code, "already filtered by joint, without the removed points" in result.stderr) == (1, True)
    (tmp_path / "file").touch()
    result = run("suspects", SEA, "--pictures", tmp_path / "file")
    assert (result.exit_code, "is a file" in result.stderr) == (2, True)
    result = run("suspects", SEA, "-o", tmp_path / "a.mcap")
    assert (result.exit_code, "already exists" in result.stderr) == (2, True)
