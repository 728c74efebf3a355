"""Land of simulated tiles: outlines, elevations and water levels that can be computed by hand."""

import numpy as np
import pytest

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.airborne.coast import BUILDING, GROUND, VEGETATION, make_coast
from seaclutter_cli.simulation.airborne.recording import simulate_strips
from seaclutter_cli.simulation.airborne.scene import (
    LANDS,
    LandParams,
    load_tile_scene,
    parse_tile_scene,
    save_tile_scene,
)

WATER = 9
BARE = {"relief_m": 0, "ragged_m": 0, "trees": 0, "houses": 0}
STILL = {"wave_m": 0, "swell_m": 0, "stray_echo_share": 0}


def scene(*lands, size=(240, 180), objects=(), **sections):
    tile = {"size_m": list(size), "seed": 3, "gap_m": 10}
    water = {**STILL, **sections.pop("water", {})}
    return parse_tile_scene(
        {"tile": tile, "land": list(lands), "objects": list(objects), "water": water, **sections}, "here"
    )


def points_of(one):
    points = np.concatenate(list(simulate_strips(one)))
    points["x"] -= one.tile.origin_m[0]
    points["y"] -= one.tile.origin_m[1]
    return points


def land(kind, position, size, **values):
    return {"kind": kind, "position_m": list(position), "size_m": list(size), **BARE, **values}


def test_a_beach_rises_evenly_from_the_shoreline():
    points = points_of(scene(land("beach", (340, 90), (400, 400), slope=0.05, height_m=3.0)))
    dry = points["x"] > 141  # the shoreline is at 340 - 200
    assert (points["classification"][dry] == GROUND).mean() > 0.999
    assert (points["classification"][points["x"] < 139] == WATER).all()
    expected = np.minimum(0.05 * (points["x"] - 140), 3.0)
    assert np.abs(points["z"] - expected)[dry].max() < 0.3
    assert np.median(np.abs(points["z"] - expected)[dry]) < 0.05


def test_a_heading_turns_the_land():
    points = points_of(scene(land("cliff", (120, 90), (120, 40), heading_deg=90, height_m=6.0)))
    high = points["z"] > 5
    assert points["x"][high].min() == pytest.approx(100, abs=1)
    assert points["x"][high].max() == pytest.approx(140, abs=1)
    assert points["y"][high].min() == pytest.approx(30, abs=1)
    assert points["y"][high].max() == pytest.approx(150, abs=1)
    assert ((points["z"] > 0.3) & (points["z"] < 5.7)).sum() < 0.001 * len(points)


def test_a_polder_is_dry_below_the_sea():
    points = points_of(scene(land("polder", (220, 90), (240, 400), height_m=-2.0, crest_m=4.0)))
    inside = points["x"] > 140  # dike: 12 m up, 4 m crest, 18 m down, from 100
    assert (points["classification"][inside] == GROUND).all()
    assert np.median(points["z"][inside]) == pytest.approx(-2, abs=0.02)
    crest = (points["x"] > 113) & (points["x"] < 115)
    assert np.median(points["z"][crest]) == pytest.approx(4, abs=0.05)
    assert (points["classification"][points["x"] < 99] == WATER).all()


def test_a_basin_has_its_own_level_and_sheltered_waves():
    basin = land("basin", (180, 90), (160, 400), height_m=1.5, crest_m=3.0)
    points = points_of(scene(basin, water={"wave_m": 0.6, "wave_period_s": 3.0}))
    water = points["classification"] == WATER
    inside, outside = (
        points["z"][water & (at(points["x"], limit))] for at, limit in ((np.greater, 105), (np.less, 95))
    )
    assert np.median(inside) == pytest.approx(1.5, abs=0.05)
    assert np.median(outside) == pytest.approx(0, abs=0.1)
    assert inside.std() < 0.4 * outside.std()
    wall = points["classification"] == GROUND
    assert points["x"][wall].min() > 99
    assert points["x"][wall].max() < 103.5
    assert np.median(points["z"][wall]) == pytest.approx(3, abs=0.05)


def test_an_island_is_an_ellipse():
    points = points_of(scene(land("island", (120, 90), (160, 100), slope=0.5, height_m=2.0)))
    share = (points["classification"] == GROUND).mean()
    assert share == pytest.approx(np.pi * 80 * 50 / (240 * 180), rel=0.04)


def test_later_land_covers_what_is_before():
    dam = land("cliff", (120, 90), (80, 400), height_m=4.0)
    lock = land("basin", (120, 90), (60, 20), height_m=1.0, crest_m=4.0)
    chamber = points_of(scene(dam, lock))
    inside = (np.abs(chamber["x"] - 120) < 26) & (np.abs(chamber["y"] - 90) < 6)
    assert (chamber["classification"][inside] == WATER).all()
    assert np.median(chamber["z"][inside]) == pytest.approx(1, abs=0.05)
    covered = points_of(scene(lock, dam))
    assert (covered["classification"][(np.abs(covered["x"] - 120) < 38)] == GROUND).all()


def test_waves_are_lower_in_shallow_water():
    shelf = land("beach", (290, 90), (300, 400), slope=0.01, height_m=3.0)  # 0.4 m deep at 100 m
    points = points_of(scene(shelf, water={"wave_m": 1.5, "wave_period_s": 4.0}))
    water = points["classification"] == WATER
    deep, shallow = (points["z"][water & (np.abs(points["x"] - at) < 8)].std() for at in (10, 122))
    assert shallow < 0.4 * deep


def test_walls_are_where_they_are_at_oblique_angles():
    wall = land("basin", (120, 90), (120, 100), height_m=0.0, crest_m=12.0)
    points = points_of(scene(wall, lidar={"height_m": 200, "scan_angle_deg": 60}))
    high = points[points["z"] > 11]
    edge = np.minimum(60 - np.abs(high["x"] - 120), 50 - np.abs(high["y"] - 90))
    assert len(high) > 300
    assert edge.min() > -1
    assert edge.max() < 3.5
    # The wall hides the water as far as 3.3 m behind it.
    behind = (points["y"] > 140.5) & (points["y"] < 142.5) & (np.abs(points["x"] - 120) < 55)
    before = (points["y"] > 120) & (points["y"] < 122) & (np.abs(points["x"] - 120) < 55)
    assert behind.sum() < 0.1 * before.sum()


def test_trees_and_houses_stand_on_the_ground():
    meadow = land("cliff", (120, 90), (300, 300), height_m=3.0, trees=0.3, houses=0.5)
    points = points_of(scene(meadow))
    code, z = points["classification"], points["z"]
    assert set(code) == {GROUND, VEGETATION, BUILDING}
    assert np.abs(z[code == GROUND] - 3).max() < 3
    assert np.median(z[code == GROUND]) == pytest.approx(3, abs=0.05)
    assert z[code == BUILDING].max() < 3 + 9.5
    assert np.median(z[code == BUILDING]) > 3 + 4
    assert 4 < np.median(z[code == VEGETATION]) < 18
    leaves = points["number_of_returns"][code == VEGETATION]
    assert (leaves > 1).mean() > 0.3
    assert (points["number_of_returns"][code == GROUND] > 1).mean() < 0.5
    assert (points["object_class"] == 0).all()


def test_ground_scatters_evenly_and_water_glitters():
    points = points_of(scene(land("cliff", (180, 90), (120, 400), height_m=3.0)))
    cell = (points["x"] // 4).astype(int) * 100 + (points["y"] // 4).astype(int)

    def variation(code):
        values = [
            points["intensity"][(points["classification"] == code) & (cell == one)] for one in np.unique(cell)[::9]
        ]
        return np.median([own.std() / own.mean() for own in values if len(own) > 10])

    assert variation(GROUND) < 0.3
    assert variation(WATER) > 0.6


def test_random_objects_are_in_the_water():
    lands = land("beach", (300, 90), (300, 400)), land("island", (60, 60), (60, 40))
    objects = [{"kind": "reef"}] * 3
    for seed in range(5):
        one = scene(*lands, objects=objects).with_tile(seed=seed)
        for item in one.placed_objects():
            for params in one.land:
                assert params.distance(*map(np.array, item.position_m)) < -10


def test_no_water_for_an_object_is_an_error():
    with pytest.raises(ConfigError, match="no room for another reef"):
        scene(land("cliff", (120, 90), (300, 300)), objects=[{"kind": "reef"}]).placed_objects()


def test_threads_and_order_do_not_change_a_strip_with_land(tmp_path):
    one = scene({"kind": "beach", "position_m": [120, 150], "size_m": [300, 90]}, lidar={"height_m": 200})
    assert points_of(one).tobytes() == points_of(one).tobytes()
    assert points_of(one).tobytes() != points_of(one.with_tile(seed=4)).tobytes()
    save_tile_scene(one, tmp_path / "s.yaml")
    assert load_tile_scene(str(tmp_path / "s.yaml")) == one


@pytest.mark.parametrize("kind", LANDS)
def test_values_of_the_kind_fill_those_that_are_null(kind):
    params = LandParams(kind=kind, position_m=(1, 2), size_m=(3, 4), relief_m=0.7)
    values = params.relief
    assert values.relief_m == 0.7
    assert values.height_m == LANDS[kind].typical.height_m


def test_large_tiles_have_coarser_maps(monkeypatch):
    monkeypatch.setattr("seaclutter_cli.simulation.airborne.coast._MOST_CELLS", 50_000)
    params = LandParams(kind="polder", position_m=(150, 150), size_m=(200, 200))
    coast = make_coast([params], (300.0, 300.0), 1.0, 1)
    assert coast.ground.size < 5.1e4
    assert coast.step_m > 1


@pytest.mark.parametrize(
    ("land", "message"),
    [
        ({"kind": "swamp", "position_m": [1, 2], "size_m": [3, 4]}, "land.0.kind: unknown kind of land 'swamp'"),
        ({"kind": "beach", "size_m": [3, 4]}, "land.0.position_m: is missing"),
        ({"kind": "beach", "position_m": [1, 2], "size_m": [3, 0]}, "land.0.size_m"),
        ({"kind": "beach", "position_m": [1, 2], "size_m": [3, 4], "trees": 2}, "land.0.trees: must be"),
        ({"kind": "beach", "position_m": [1, 2], "size_m": [3, 4], "hight_m": 2}, "land.0.hight_m: unknown key"),
        (3, "land.0: must be a section"),
    ],
)
def test_errors_of_invalid_land(land, message):
    with pytest.raises(ConfigError) as caught:
        scene(land)
    assert message in str(caught.value)
