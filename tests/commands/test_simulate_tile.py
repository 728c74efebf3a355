import json
from functools import partial

import pytest

from tests.running import execute

SCENE = """
tile: {size_m: [90, 80], seed: 2}
lidar: {pulses_m2: 0.5}
objects: [{kind: reef, position_m: [40, 40]}]
"""


run = partial(execute, "simulate")


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    return tmp_path / "scene.yaml"


def test_a_scene_file(tmp_path, scene):
    result = run(scene, "-o", tmp_path / "a.laz", code=0)
    assert "reef" in result.stdout
    found = json.loads(run(scene, "-o", tmp_path / "b.las", "--seed", 5, "--json").stdout)
    assert found["objects"][0]["class"] == "reef"
    assert found["objects"][0]["points"] > 10
    assert found["sea"] > 2000


def test_a_scene_that_is_saved_makes_the_same_tile(tmp_path, scene):
    scene.write_text(SCENE.replace("[90, 80]", "[200, 160]") + "random: {ship: 1}\n")
    for path, out in ((scene, "a.laz"), (tmp_path / "saved.yaml", "b.laz")):
        run(path, "-o", tmp_path / out, "--scene-file", tmp_path / f"{out}.yaml", "--seed", 7, code=0)
        (tmp_path / "saved.yaml").write_bytes((tmp_path / "a.laz.yaml").read_bytes())
    assert (tmp_path / "a.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()


def test_wrong_command_lines(tmp_path, scene):
    (tmp_path / "a.laz").write_text("mine")
    assert "--force" in run(scene, "-o", tmp_path / "a.laz").stderr
    for options in (("-n", 3), ("--physics", "wide")):
        assert "not available for tiles" in run(scene, "-o", tmp_path / "b.laz", *options).stderr
    assert "no such tile scene; built-in ones: " in run("nowhere", "-o", tmp_path / "b.laz").stderr
    for name in (scene, "small"):
        result = run(name, "-o", tmp_path / "b.mcap")
        assert (result.exit_code, "must end in .las or .laz" in result.stderr) == (2, True)
    assert "is part of the input" in run(scene, "-o", tmp_path / "b.laz", "--scene-file", scene, "--force").stderr
    run("calm", "-o", tmp_path / "b.laz", code=2)
    assert not (tmp_path / "b.laz").exists()
