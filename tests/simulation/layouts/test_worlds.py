import pytest

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.layouts import find_scene
from seaclutter_cli.simulation.layouts.worlds import FAMILIES, RANGES, clearance_m, draw_world
from seaclutter_cli.simulation.lidar import LIDARS
from seaclutter_cli.simulation.marine.recording import Renderer
from seaclutter_cli.simulation.marine.scene import load_scene, parse_scene
from tests.simulation.yaml_text import through_yaml


@pytest.mark.parametrize("family", FAMILIES)
def test_a_world_of_every_family_is_valid_and_says_what_it_is(family):
    world = draw_world(3, family)
    assert parse_scene(through_yaml(world.as_dict()), "again") == world
    assert draw_world(3, family) == world
    assert draw_world(4, family) != world
    assert world.physics.families[0] == family
    assert set(world.physics.families) <= set(FAMILIES)
    assert world.lidar.rate_hz in (5, 10, 20)


@pytest.fixture(scope="module")
def worlds():
    return [draw_world(seed) for seed in range(150)]


def test_worlds_span_all_lidars_rates_and_heights(worlds):
    assert {len(world.lidar.rings) for world in worlds} == {16, 32, 64, 128}
    assert {world.lidar.rate_hz for world in worlds} == {5, 10, 20}
    assert {world.lidar.wavelength_nm for world in worlds} == {865, 905, 1550}
    heights = [world.vessel.lidar_height_m for world in worlds]
    assert 1 <= min(heights) < 1.3
    assert 6.5 < max(heights) <= 8
    assert {world.physics.families[0] for world in worlds} == set(FAMILIES)


def test_own_ship_meets_nothing(worlds):
    for world in worlds[:60]:
        assert world.objects
        assert all(clearance_m(world, item) > 0 for item in world.objects)


def test_families_change_parameters_that_have_ranges():
    extra = {"rain_mm_h", "drop_reflectivity", "spray", "wash_m", "blooming"}  # of no other world
    assert {key for family in FAMILIES.values() for key in family.ranges} <= set(RANGES) | extra


@pytest.mark.parametrize("family", ["wakes", "harbour", "rain", "few beams"])
def test_worlds_have_water_and_bodies(family):
    labels = Renderer(draw_world(11, family)).frame(2).points["label"]
    assert (labels == 0).any()
    assert (labels > 0).any()


def test_wide_physics_of_a_scene_keeps_its_objects():
    wide, plain = find_scene("departure", 4, wide=True), load_scene("departure")
    assert wide.objects == plain.objects
    assert wide.physics is not None
    assert wide == find_scene("departure", 4, wide=True)
    assert find_scene("random", 4, wide=True) == draw_world(4)
    assert find_scene("random", 4) == find_scene("random", 4)
    assert find_scene("random", 4).physics is None
    assert wide.recording.lidar in LIDARS


def test_land_has_no_wide_physics():
    with pytest.raises(ConfigError, match="on land"):
        find_scene("apple", wide=True)
