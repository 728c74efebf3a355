"""Simulated tiles agree with their scenes."""

from dataclasses import replace

import numpy as np
import pytest

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.simulation.airborne.recording import TileRenderer, record_tile, simulate_strips, strips
from seaclutter_cli.simulation.airborne.scene import (
    AirborneParams,
    builtin_tiles,
    load_tile_scene,
    parse_tile_scene,
    save_tile_scene,
)
from seaclutter_cli.simulation.airborne.shapes import KINDS, STEP_M
from seaclutter_cli.truth import OBJECT_CLASSES


def scene(objects=(), size=(120, 100), **sections):
    tile = {"size_m": list(size), "seed": 3, **sections.pop("tile", {})}
    return parse_tile_scene({"tile": tile, "objects": list(objects), **sections}, "here")


def points_of(one):
    return np.concatenate(list(simulate_strips(one)))


@pytest.fixture(scope="module")
def small():
    one = load_tile_scene("small")
    return one, points_of(one)


@pytest.mark.parametrize("name", builtin_tiles())
def test_built_in_tiles_load(name, tmp_path):
    one = load_tile_scene(name)
    objects = one.placed_objects()
    assert len(objects) == len(one.objects) > 0
    save_tile_scene(one, tmp_path / "s.yaml")
    assert load_tile_scene(str(tmp_path / "s.yaml")) == one
    assert one.tile.description


def test_tiles_of_the_paper():
    assert set(KINDS) == set(OBJECT_CLASSES)
    for name in set(builtin_tiles()) - {"small"}:
        assert load_tile_scene(name).tile.size_m == (875, 695)
    kinds = [item.kind for item in load_tile_scene("fig3").objects]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {"ship": 4, "aquaculture": 2, "garbage patch": 1}


def test_every_object_is_at_its_position(small):
    one, points = small
    for item in one.placed_objects():
        own = points[points["object_id"] == item.number]
        assert len(own) > 50, item
        assert set(own["object_class"]) == {item.code}
        x, y = (
            own[axis] - origin - at for axis, origin, at in zip("xy", one.tile.origin_m, item.position_m, strict=True)
        )
        c, s = np.cos(item.heading), np.sin(item.heading)
        for along, side in zip((c * x + s * y, c * y - s * x), item.size_m, strict=False):
            assert np.abs(along).max() < side / 2 + 1.5
        assert own["z"].max() < 1.9 * item.size_m[2] + 1
        assert own["z"].max() > 0.45 * item.size_m[2]


def test_the_file_conforms_to_the_format(tmp_path):
    laspy = pytest.importorskip("laspy")
    record_tile(scene([{"kind": "reef", "position_m": [60, 50]}]), tmp_path / "t.laz")
    header = laspy.read(tmp_path / "t.laz").header
    assert (header.point_format.id, str(header.version), header.global_encoding.wkt) == (6, "1.4", True)


def test_truth_is_consistent(small):
    _, points = small
    sea = points["object_id"] == 0
    assert (points["object_class"][sea] == 0).all()
    assert set(points["classification"][sea]) <= {9, 7, 18}
    assert set(points["classification"][~sea]) == {1}
    assert 0.85 < sea.mean() < 0.98
    assert np.abs(points["z"][points["classification"] == 9]).max() < 0.6


def test_echoes_are_numbered(small):
    _, points = small
    assert set(points["number_of_returns"]) == {1, 2, 3}
    assert (points["return_number"] <= points["number_of_returns"]).all()
    several = points[points["number_of_returns"] > 1]
    assert (several["object_id"] > 0).mean() > 0.4
    last = points["return_number"] == points["number_of_returns"]
    pulses = np.flatnonzero(last)
    np.testing.assert_array_equal(np.diff(np.append(-1, pulses)), points["number_of_returns"][pulses])
    first = np.flatnonzero((points["return_number"][:-1] == 1) & (points["number_of_returns"][:-1] > 1))
    assert (points["z"][first] > points["z"][first + 1]).mean() > 0.98


def test_a_single_return_per_pulse():
    island = {"kind": "island", "position_m": [60, 50], "size_m": [60, 50, 12]}
    points = points_of(scene([island], lidar={"max_returns": 1}))
    assert set(points["number_of_returns"]) == {1}


def test_swell_has_its_height():
    water = {"wave_m": 0.0, "swell_m": 1.2, "stray_echo_share": 0}
    z = points_of(scene(water=water, size=(400, 300)))["z"]
    assert 4 * z.std() == pytest.approx(1.2, rel=0.3)
    assert 4 * points_of(scene(water={**water, "swell_m": 0.0}))["z"].std() < 0.2


def test_calm_water_is_dark_and_often_without_echo_at_oblique_angles():
    points = points_of(scene(size=(300, 230), lidar={"height_m": 200, "scan_angle_deg": 60, "overlap": 0}))
    askance = np.abs(points["scan_angle"]) > 24
    below = np.abs(points["scan_angle"]) < 6
    assert np.median(points["intensity"][below]) > 3 * np.median(points["intensity"][askance])
    pulses = 2.0 * 300 * (np.tan(np.radians(30)) - np.tan(np.radians(24))) * 200 * 2
    assert (askance.sum() / pulses) < 0.9


def test_a_tall_ship_hides_water_at_oblique_angles():
    ship = {"kind": "ship", "position_m": [100, 190], "heading_deg": 0, "size_m": [90, 14, 20], "reflectivity": 0.4}
    lidar = {"height_m": 200, "scan_angle_deg": 60, "overlap": 0}
    points = points_of(scene([ship], size=(200, 230), lidar=lidar))
    sea = points[points["object_id"] == 0]
    y = sea["y"][np.abs(sea["x"] - 512_100) < 30] - 3_458_000
    before, behind = ((y > 180 - 6) & (y < 182)).sum(), ((y > 198) & (y < 206)).sum()
    assert behind < 0.75 * before


@pytest.mark.parametrize("kind", KINDS)
def test_random_objects_vary(kind):
    one = scene([{"kind": kind}] * 6, size=(1500, 1500))
    objects = one.placed_objects()
    sizes = np.array([item.size_m for item in objects])
    assert (np.ptp(sizes, axis=0) > 0.05 * sizes.mean(axis=0)).all()
    assert len({item.reflectivity for item in objects}) == 6
    low, high = KINDS[kind].smallest, KINDS[kind].largest
    assert ((sizes >= low) & (sizes <= high)).all()
    patch = KINDS[kind].make(np.random.default_rng(1), objects[0].size_m, 0.3)
    assert patch.shape == tuple(round(side / STEP_M) for side in objects[0].size_m[:2])
    there = np.isfinite(patch["top"])
    assert 0.005 < there.mean() < 0.98
    assert ((patch["cover"] > 0) & (patch["cover"] <= 1)).all()
    assert (patch["reflectivity"][there] > 0).all()


def test_objects_keep_clear_of_each_other():
    one = scene([{"kind": "ship"}] * 12, size=(875, 695))
    objects = one.placed_objects()
    for i, here in enumerate(objects):
        for there in objects[:i]:
            gap = np.hypot(here.position_m[0] - there.position_m[0], here.position_m[1] - there.position_m[1])
            assert gap > 0.5 * (here.size_m[1] + there.size_m[1]) + 25


def test_strips_depend_only_on_their_number():
    one = scene([{"kind": "reef"}], lidar={"height_m": 200, "scan_angle_deg": 10})
    renderer = TileRenderer(one)
    assert len(renderer.lines) == 4
    expected = renderer.strip(2).tobytes()
    assert TileRenderer(one).strip(2).tobytes() == expected
    assert TileRenderer(one.with_tile(seed=4)).strip(2).tobytes() != expected


def test_strips_cover_the_tile():
    assert strips(AirborneParams(height_m=3000, scan_angle_deg=60), (875.0, 695.0)) == [347.5]
    points = points_of(scene(size=(150, 260), lidar={"height_m": 200, "pulses_m2": 1.0}))
    y = points["y"] - 3_458_000
    assert len(np.unique(points["point_source_id"])) == 2
    counts, _ = np.histogram(y, 13, (0, 260))
    assert counts.min() > 0.4 * 20 * 150


def test_files_are_reproducible_and_contain_the_echoes(tmp_path):
    laspy = pytest.importorskip("laspy")
    one = scene([{"kind": "seaweed"}], lidar={"pulses_m2": 0.5})
    for name in ("a.laz", "b.laz"):
        record_tile(one, tmp_path / name)
    assert (tmp_path / "a.laz").read_bytes() == (tmp_path / "b.laz").read_bytes()
    las, points = laspy.read(tmp_path / "a.laz"), points_of(one)
    for axis in "xyz":
        np.testing.assert_allclose(np.asarray(las[axis]), points[axis], atol=0.00051)
    for name in ("intensity", "return_number", "number_of_returns", "classification", "object_class", "object_id"):
        np.testing.assert_array_equal(np.asarray(las[name]), points[name])
    np.testing.assert_allclose(las.header.maxs, [points[axis].max() for axis in "xyz"], atol=0.001)
    np.testing.assert_allclose(np.asarray(las.scan_angle) * 0.006, points["scan_angle"], atol=0.0061)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        ({"objects": [{"kind": "whale"}]}, "objects.0.kind: unknown class 'whale'"),
        ({"random": {"whale": 2}}, "random.whale: unknown class"),
        ({"random": {"ship": -1}}, "random.ship: must be a whole number"),
        ({"random": [1]}, "random: must be a section with keys, got a list"),
        ({"objects": {}}, ""),
        ({"objects": {"a": 1}}, "objects: must be a list"),
        ({"objects": [3]}, "objects.0: must be a section"),
        ({"lidar": {"height_m": 100}}, "lidar.height_m: must be a number from 200 to 3000"),
        ({"lidar": {"max_returns": 4}}, "lidar.max_returns"),
        ({"vessel": {}}, "vessel: unknown section"),
        ({"tile": 3}, "tile: must be a section"),
    ],
)
def test_errors_of_invalid_tile_scenes(raw, message):
    if not message:
        assert parse_tile_scene(raw, "here").objects == ()
        return
    with pytest.raises(ConfigError) as caught:
        parse_tile_scene(raw, "here")
    assert message in str(caught.value)


def test_no_room_is_an_error():
    with pytest.raises(ConfigError, match="no room for another island"):
        scene([{"kind": "island", "size_m": [90, 80, 9]}] * 4).placed_objects()


def test_objects_with_a_position_keep_it_and_their_number():
    one = scene(
        [{"kind": "reef"}, {"kind": "ship", "position_m": [60, 50], "heading_deg": 90, "size_m": [40, 8, 9]}],
        (300, 300),
    )
    ship = replace(one, tile=replace(one.tile, seed=9)).placed_objects()[1]
    assert (ship.position_m, ship.number, round(ship.heading, 3)) == ((60, 50), 2, 1.571)
