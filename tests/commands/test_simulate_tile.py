import json

import pytest
from click.testing import CliRunner

from seaclutter_cli.commands import cli

SCENE = """
tile: {size_m: [90, 80], seed: 2}
lidar: {pulses_m2: 0.5}
objects: [{kind: reef, at_m: [40, 40]}]
"""


def run(*arguments):
    return CliRunner().invoke(cli, ["simulate", *map(str, arguments)])


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    return tmp_path / "scene.yaml"


def test_a_scene_file(tmp_path, scene):
    result = run(scene, "-o", tmp_path / "a.laz")
    assert result.exit_code == 0, result.output
    assert "reef" in result.stdout
    told = json.loads(run(scene, "-o", tmp_path / "b.las", "--seed", 5, "--json").stdout)
    assert told["objects"][0]["class"] == "reef"
    assert told["objects"][0]["points"] > 10
    assert told["sea"] > 2000


def test_wrong_command_lines(tmp_path, scene):
    (tmp_path / "a.laz").write_text("mine")
    assert "--force" in run(scene, "-o", tmp_path / "a.laz").stderr
    assert "tiles have none" in run(scene, "-o", tmp_path / "b.laz", "-n", 3).stderr
    assert "there is no such tile scene; built in are" in run("nowhere", "-o", tmp_path / "b.laz").stderr
    assert "unknown section" in run(scene, "-o", tmp_path / "b.mcap").stderr
    assert run("calm", "-o", tmp_path / "b.laz").exit_code == 2
    assert not (tmp_path / "b.laz").exists()
