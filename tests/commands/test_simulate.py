import json

import pytest

from tests.running import execute as run


def test_a_built_in_scene(tmp_path):
    log = tmp_path / "a b.mcap"
    result = run("simulate", "buoy_speedboat", "-o", log, "-n", 2, code=0)
    assert "buoy, track 1" in result.stdout
    assert log.exists()
    assert (tmp_path / "a b.labels.csv").exists()
    assert all(len(line) <= 80 for line in result.stdout.splitlines()[1:])
    filtered = run("filter", log, "-o", tmp_path / "f.mcap", "--json")
    assert json.loads(filtered.stdout)[0]["topics"]["/points"]["frames"] == 2


def test_seed_and_lidar_from_the_command_line(tmp_path):
    logs = [tmp_path / f"{name}.mcap" for name in "abc"]
    for log, seed in zip(logs, (1, 1, 2), strict=True):
        result = run("simulate", "calm", "-o", log, "-n", 1, "--seed", seed, "--lidar", "VLP-16", "--json")
        assert json.loads(result.stdout)["frames"] == 1
    assert logs[0].read_bytes() == logs[1].read_bytes() != logs[2].read_bytes()


def test_a_scene_file(tmp_path):
    (tmp_path / "my.yaml").write_text("recording: {frames: 1}\nobjects: []\n")
    run("simulate", tmp_path / "my.yaml", "-o", tmp_path / "a.mcap", code=0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sea: {waves: 3}\n", "sea.waves: unknown key"),
        ("sea: [\n", "not valid YAML"),
        ("- 1\n", "must contain sections"),
    ],
)
def test_a_wrong_scene_file(tmp_path, text, message):
    (tmp_path / "my.yaml").write_text(text)
    result = run("simulate", tmp_path / "my.yaml", "-o", tmp_path / "a.mcap", code=2)
    assert message in result.stderr
    assert not (tmp_path / "a.mcap").exists()


def test_wrong_command_lines(tmp_path):
    run("simulate", "nowhere", "-o", tmp_path / "a.mcap", code=2)
    assert "must end in .mcap" in run("simulate", "calm", "-o", tmp_path / "a.bag").stderr
    assert "unknown lidar" in run("simulate", "calm", "-o", tmp_path / "a.mcap", "--lidar", "X").stderr
    (tmp_path / "a.labels.csv").write_text("mine")
    result = run("simulate", "calm", "-o", tmp_path / "a.mcap", "-n", 1)
    assert (result.exit_code, (tmp_path / "a.labels.csv").read_text()) == (2, "mine")


def test_a_world_of_wide_physics_names_its_families_and_can_be_saved(tmp_path):
    logs, scene_file = [tmp_path / f"{name}.mcap" for name in "ab"], tmp_path / "scene.yaml"
    options = ("--physics", "wide", "--seed", 3, "-n", 1, "--scene-file", scene_file)
    run("simulate", "random", "-o", logs[0], *options, code=0)
    assert "families" in scene_file.read_text()
    run("simulate", scene_file, "-o", logs[1], code=0)
    assert logs[0].read_bytes() == logs[1].read_bytes()
    run("simulate", "apple", "-o", tmp_path / "c.mcap", "--physics", "wide", code=2)


def test_many_targets_are_counted_by_class(tmp_path):
    result = run("simulate", "poplar", "-o", tmp_path / "a.mcap", "-n", 1)
    assert "poplar (80 objects)" in result.stdout
    assert len(result.stdout.splitlines()) < 10
