import numpy as np
import pytest

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.airborne.scene import builtin_tiles
from seaclutter_cli.simulation.layouts import LAYOUTS, find_scene, scene_class
from seaclutter_cli.simulation.marine.scene import builtin_scenes, load_scene, parse_scene
from tests.simulation.yaml_text import through_yaml

SEEDS = range(2)


def made(name, seed):
    return LAYOUTS[name].make(np.random.default_rng(seed))


def test_a_name_means_one_scene():
    names = [*builtin_scenes(), *builtin_tiles(), *LAYOUTS]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("name", LAYOUTS)
class TestEveryLayout:
    def test_makes_valid_scenes_of_its_class(self, name):
        for seed in SEEDS:
            scene = made(name, seed)
            assert parse_scene(through_yaml(scene.as_dict()), "again") == scene
            assert scene_class(scene) == LAYOUTS[name].scene_class

    def test_makes_a_different_scene_for_each_seed(self, name):
        scenes = [made(name, seed) for seed in SEEDS]
        assert made(name, SEEDS[-1]) == scenes[-1]
        assert len({str(scene.objects) + str(scene.vessel) for scene in scenes}) == len(SEEDS)


def test_find_scene_finds_layouts_and_scenes():
    assert find_scene("river") == made("river", 1)
    assert find_scene("river", 4) == made("river", 4)
    assert find_scene("calm", 9) == load_scene("calm").with_recording(seed=9)
    with pytest.raises(ConfigError, match=r"built-in scenes: .*departure.*layouts: .*river"):
        find_scene("rivers")
