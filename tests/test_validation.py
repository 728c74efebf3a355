"""Renamed keys: the former names still load, with a warning that gives the current name."""

import warnings
from dataclasses import dataclass, fields

import pytest
import yaml

from seaclutter_cli.airborne.settings import load_settings
from seaclutter_cli.errors import RenamedKeyWarning
from seaclutter_cli.params import key
from seaclutter_cli.simulation.airborne.scene import builtin_tiles, load_tile_scene, parse_tile_scene
from seaclutter_cli.simulation.marine.scene import builtin_scenes, load_scene, parse_scene
from seaclutter_cli.validation import build
from tests.running import execute


@dataclass(frozen=True)
class Params:
    width_m: float = key(2.0, formerly="broad_m")


def test_the_former_name_sets_the_current_key():
    problems = []
    with pytest.warns(RenamedKeyWarning, match="box.broad_m: this key is now called width_m"):
        assert build(Params, {"broad_m": 3.0}, "box", "box", problems) == Params(3.0)
    assert problems == []


@pytest.mark.parametrize("values", [{"broad_m": 3.0, "width_m": 3.0}, {"broad": 3.0}])
def test_both_names_together_and_unknown_names_are_errors(values):
    problems = []
    build(Params, values, "box", "box", problems)
    assert "unknown key" in problems[0]


def test_scenes_of_the_first_release_load():
    path = builtin_scenes()["apple"]
    former = {
        f.name: f.metadata["formerly"]
        for part in _parts(load_scene("apple"))
        for f in fields(part)
        if f.metadata.get("formerly")
    }
    assert {"wave_response", "description", "false_return_share"} <= set(former)
    text = path.read_text()
    for name, old in former.items():
        text = text.replace(f"{name}:", f"{old}:")
    with pytest.warns(RenamedKeyWarning):
        scene = parse_scene(yaml.safe_load(text), "old")
    assert scene == load_scene("apple")


@pytest.mark.parametrize("name", [*builtin_scenes(), *builtin_tiles()])
def test_built_in_scenes_use_current_names(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error", RenamedKeyWarning)
        load_scene(name) if name in builtin_scenes() else load_tile_scene(name)


def _parts(scene):
    return [scene.recording, scene.terrain, scene.vessel, scene.noise, scene.objects[0]]


def test_tiles_and_settings_of_the_first_release_load():
    with pytest.warns(RenamedKeyWarning, match="at_m"):
        scene = parse_tile_scene({"tile": {"about": "old"}, "objects": [{"kind": "ship", "at_m": [50.0, 60.0]}]}, "old")
    assert scene.tile.description == "old"
    with pytest.warns(RenamedKeyWarning, match="held_out"):
        assert load_settings(None, ["forest.held_out=0.5"]).forest.test_share == 0.5


def test_the_program_warns_once(tmp_path):
    (tmp_path / "old.yaml").write_text("recording: {about: old, frames: 1}\nvessel: {sway: 0.2}\nobjects: []\n")
    result = execute("simulate", tmp_path / "old.yaml", "-o", tmp_path / "l.mcap", code=0)
    assert result.stderr.count("this key is now called") == 2
    assert "Warning: vessel.sway: this key is now called wave_response\n" in result.stderr
