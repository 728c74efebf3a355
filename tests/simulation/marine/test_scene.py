import re
from dataclasses import fields

import pytest
import yaml

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.lidar import LIDARS
from seaclutter_cli.simulation.marine.scene import (
    SceneObjectParams,
    builtin_scenes,
    load_scene,
    parse_scene,
    save_scene,
)
from seaclutter_cli.validation import plain
from tests.simulation.yaml_text import through_yaml

BUOY = {"track_id": 1, "shape": "buoy", "size_m": [1, 1, 1]}


@pytest.mark.parametrize("name", builtin_scenes())
def test_every_built_in_scene_loads_and_has_a_description(name):
    scene = load_scene(name)
    assert len(scene.recording.description) > 20
    assert parse_scene(through_yaml(scene.as_dict()), "again") == scene


def test_the_documented_scenes_exist():
    promised = {"calm", "clutter_only", "buoy_speedboat", "departure", "occlusion", "passing_speedboat", "harbour"}
    confined, plantations = {"lock", "narrow_channel", "moored_rows"}, {"apple", "poplar", "willow"}
    assert promised | confined | plantations | {"rough"} <= set(builtin_scenes())
    assert load_scene("departure").recording.frames == 196
    assert not load_scene("clutter_only").objects


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        ({"see": {}}, "see: unknown section"),
        ({"sea": {"sea_sate": 2}}, "sea.sea_sate: unknown key"),
        ({"sea": {"sea_state": 9}}, "sea.sea_state"),
        ({"sea": [1]}, "sea: must be a section with keys, got a list"),
        ({"recording": {"lidar": "VLP-15"}}, "unknown lidar 'VLP-15'; did you mean 'VLP-16'? allowed: RS-LiDAR-32"),
        ({"recording": {"frames": 0}}, "recording.frames"),
        ({"vessel": {"path": []}}, "vessel.path"),
        ({"sea": {}, "ground": {}}, "sea and ground: a scene can have only one of these sections"),
        ({"ground": {"sea_state": 2}}, "ground.sea_state: unknown key"),
        ({"noise": {"false_return_share": 2}}, "noise.false_return_share"),
        ({"noise": {"lost": 2}}, "noise.lost: unknown key"),
        ({"objects": {"buoy": 1}}, "objects: must be a list, got a section"),
        ({"objects": [3]}, "objects.0: must be a section with keys"),
        ({"objects": [BUOY | {"shape": "whale"}]}, "objects.0.shape: unknown shape 'whale'"),
        ({"objects": [{"shape": "buoy"}]}, "objects.0.track_id: is missing"),
        ({"objects": [BUOY | {"size_m": [1, 2]}]}, "objects.0.size_m"),
        ({"objects": [BUOY | {"size_m": [1, 2, 0]}]}, "objects.0.size_m.2"),
        ({"objects": [BUOY, BUOY]}, "track_id 1 is used more than once"),
        ({"objects": [BUOY | {"track_id": 65535}]}, "objects.0.track_id"),
    ],
)
def test_errors_of_invalid_scenes(raw, message):
    with pytest.raises(ConfigError, match=r"s\.yaml") as caught:
        parse_scene(raw, "s.yaml")
    assert message in str(caught.value)


def test_all_problems_are_reported_at_once():
    raw = {"sea": {"a": 1}, "vessel": {"b": 1}, "objects": [BUOY | {"c": 1}]}
    with pytest.raises(ConfigError, match="3 problems"):
        parse_scene(raw, "s.yaml")


@pytest.mark.parametrize("name", builtin_scenes())
def test_a_saved_scene_is_the_same(name, tmp_path):
    save_scene(load_scene(name), tmp_path / "s.yaml")
    assert load_scene(str(tmp_path / "s.yaml")) == load_scene(name)


@pytest.mark.parametrize("name", ["calm", "apple"])
def test_a_saved_scene_has_all_keys_with_comments(name, tmp_path):
    scene = load_scene(name)
    save_scene(scene, tmp_path / "s.yaml")
    text = (tmp_path / "s.yaml").read_text(encoding="utf-8")
    sections = yaml.safe_load(text)
    assert [len(sections[name]) for name in scene.sections] == [len(fields(part)) for part in scene.sections.values()]
    for key in (key for part in scene.sections.values() for key in (field.name for field in fields(part))):
        assert re.search(rf"^  {key}: .* # \w.*\.$|^  # \w.*\.\n  {key}: ", text, re.MULTILINE), key
    for field in fields(SceneObjectParams):
        assert re.search(rf"^#   {field.name}:.* # \w.*\.$", text, re.MULTILINE), field.name


def test_a_saved_scene_names_the_noise_of_its_lidar(tmp_path):
    save_scene(load_scene("calm").with_recording(lidar="CE30-D"), tmp_path / "s.yaml")
    text = (tmp_path / "s.yaml").read_text(encoding="utf-8")
    assert "noise" not in yaml.safe_load(text)
    (section,) = re.findall(r"^# noise:.*\n(?:#   .*\n)+", text, re.MULTILINE)
    uncommented = re.sub(r"^# ", "", section, flags=re.MULTILINE)
    assert yaml.safe_load(uncommented)["noise"] == plain(LIDARS["CE30-D"].noise)


@pytest.mark.parametrize("raw", [{"see": {}}, {"vessel": {"a": 1, "b": 2}}])
def test_errors_point_to_the_reference(raw):
    with pytest.raises(ConfigError, match=r"docs/scene-keys\.md") as caught:
        parse_scene(raw, "s.yaml")
    assert ("\n" in str(caught.value)) == (raw != {"see": {}})


def test_a_misspelt_shape_gets_a_suggestion():
    with pytest.raises(ConfigError, match=r"did you mean 'speedboat'\? allowed: buoy, "):
        parse_scene({"objects": [BUOY | {"shape": "speadboat"}]}, "s.yaml")


def test_an_unknown_scene_is_an_error():
    with pytest.raises(ConfigError, match=r"built-in ones: .*departure"):
        load_scene("departur")
