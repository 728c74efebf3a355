"""Search for the mounting: simulated waters of all kinds seen by lidars in all attitudes, land, and no water at all."""

import math
from functools import cache

import numpy as np
import pytest

from seaclutter_cli.simulation.marine.recording import Renderer
from seaclutter_cli.simulation.marine.scene import load_scene
from seaclutter_cli.water import Mounting, MountingSearch
from tests.filters.seas import water
from tests.pairs import covering

SCENES = (
    *("departure", "passing_speedboat", "buoy_speedboat", "occlusion", "calm", "rough", "harbour", "lock"),
    *("moored_rows", "narrow_channel"),
)
LAND = ("apple", "poplar", "willow")
STEP_S = 0.5
OWN_SHIP_M = 10.0
TILTED = [(15, 0), (0, -15), (30, 0), (0, 30), (20, 25), (-45, 0), (180, 0), (165, 0), (180, 20), (-150, -20)]


@cache
def scene_frames(name, count=7):
    """Return the valid points of frames half a second apart, shape (3, N) each, without own ship."""
    renderer = Renderer(load_scene(name).with_recording(frames=5 * count, seed=77))
    clouds = (renderer.frame(5 * index).points for index in range(count))
    points = [np.stack([cloud[axis] for axis in "xyz"]).astype(np.float64) for cloud in clouds]
    return [one[:, np.hypot(*one[:2]) >= OWN_SHIP_M] for one in points]


def searched(frames, mounting=(0, 0), given=(0, 0)):
    """Return what a search finds in frames seen by a lidar in an attitude."""
    actual, search = Mounting(*mounting), MountingSearch(Mounting(*given))
    for index, xyz in enumerate(frames):
        if search.wants(index * STEP_S):
            search.add(actual.unlevelled(xyz), index * STEP_S)
    return search.found()


def open_water(count=8, size=400):
    return [water(np.random.default_rng([6, index]), STEP_S * index, size)[:, :3].T for index in range(count)]


def box_walls(rng, size, *, half_m=12.0, low_m=-3.0, high_m=6.0):
    """Return points on the four walls of a square, shape (3, size)."""
    along, height = rng.uniform(-half_m, half_m, size), rng.uniform(low_m, high_m, size)
    side = rng.integers(0, 4, size)
    across = np.where(side < 2, half_m, -half_m)
    x, y = np.where(side % 2, along, across), np.where(side % 2, across, along)
    return np.stack([x, y, height])


@pytest.mark.parametrize(("name", "mounting"), covering(SCENES + LAND, [(0, 0), (5, -5)]))
def test_nothing_is_found_where_the_lidar_is_level(name, mounting):
    assert searched(scene_frames(name), mounting) is None


@pytest.mark.parametrize(
    ("name", "mounting"),
    covering(("calm", "rough", "harbour", "moored_rows", "narrow_channel", "calm", "rough"), TILTED),
)
def test_the_mounting_is_found_to_a_degree(name, mounting):
    found = searched(scene_frames(name), mounting)
    assert found is not None
    assert found.tilt_deg(Mounting(*mounting)) <= 1.5


@pytest.mark.parametrize("mounting", [(180, 0), (25, 0), (90, 0), (0, -90)])
def test_in_a_lock_nothing_wrong_is_found(mounting):
    """Its walls leave too little water in view for an answer."""
    assert searched(scene_frames("lock"), mounting) is None


@pytest.mark.parametrize("name", SCENES)
def test_walls_and_hulls_without_water_are_not_mistaken_for_it(name):
    above = [xyz[:, xyz[2] > -1.5] for xyz in scene_frames(name)]
    assert searched(above) is None


def test_walls_around_the_lidar_are_not_water():
    rng = np.random.default_rng(8)
    assert searched([box_walls(rng, 3000) for _ in range(8)]) is None


def test_a_bridge_over_water_is_not_water():
    rng = np.random.default_rng(9)
    deck = [np.stack([*rng.uniform(-40, 40, (2, 1500)), np.full(1500, 5.0)]) for _ in range(8)]
    assert searched([np.hstack(pair) for pair in zip(open_water(), deck, strict=True)]) is None


@pytest.mark.parametrize("mounting", [(180, 0), (25, 0)])
def test_a_field_of_view_of_120_degrees_is_enough(mounting):
    ahead = [xyz[:, np.abs(np.arctan2(xyz[1], xyz[0])) < math.pi / 3] for xyz in open_water()]
    assert searched(ahead, mounting).tilt_deg(Mounting(*mounting)) <= 1.5


def test_a_lidar_on_its_side_is_not_searched():
    assert searched(open_water(), (90, 0)) is None


def test_the_roll_of_own_ship_averages_out():
    def seen(roll_deg):
        return [
            Mounting(roll_deg + 8 * math.sin(2 * math.pi * index / 8)).unlevelled(xyz)
            for index, xyz in enumerate(open_water(16))
        ]

    assert searched(seen(20)) == Mounting(20, 0)
    assert searched(seen(0)) is None


class TestGivenMounting:
    def test_a_correct_one_is_confirmed(self):
        assert searched(open_water(), (180, 0), given=(180, 0)) is None
        assert searched(open_water(), (25, -10), given=(25, -10)) is None

    def test_a_wrong_one_is_corrected_and_the_result_is_not_relative_to_it(self):
        assert searched(open_water(), (0, 0), given=(180, 0)) == Mounting(0, 0)
        assert searched(open_water(), (90, 0), given=(60, 0)) == Mounting(90, 0)


class TestLittleData:
    def test_in_less_than_three_seconds_only_a_lidar_upside_down_is_found(self):
        assert searched(open_water(3), (180, 0)) == Mounting(180, 0)
        assert searched(open_water(3), (25, 0)) is None
        assert searched(open_water(7), (25, 0)) == Mounting(25, 0)

    def test_no_frames_and_empty_frames(self):
        assert searched([]) is None
        assert searched([np.empty((3, 0))] * 8) is None

    def test_few_points_are_no_water(self):
        assert searched([xyz[:, :12] for xyz in open_water()], (180, 0)) is None

    def test_one_frame_among_others_does_not_decide(self):
        frames = open_water(8)
        frames[3] = Mounting(180).unlevelled(frames[3])
        assert searched(frames) is None


@pytest.mark.parametrize(("mounting", "expected_s"), [((0, 0), 4), ((180, 0), 10)])
def test_the_search_takes_ten_seconds_or_less_if_nothing_is_suspicious(mounting, expected_s):
    search, (xyz,) = MountingSearch(Mounting()), open_water(1)
    times_s = []
    for time_s in np.arange(400) / 10:
        if search.wants(time_s):
            search.add(Mounting(*mounting).unlevelled(xyz), time_s)
            times_s.append(time_s)
    assert times_s == pytest.approx(np.arange(0, expected_s, STEP_S))
    assert search.complete


def test_a_clock_that_jumps_back_does_not_stop_the_search():
    search = MountingSearch(Mounting())
    search.add(open_water(1)[0], 100.0)
    assert not search.wants(100.2)
    assert search.wants(99.9)


def test_the_order_of_the_points_has_no_influence():
    frames = open_water()
    shuffled = [xyz[:, np.random.default_rng(3).permutation(xyz.shape[1])] for xyz in frames]
    assert searched(frames, (21.3, 0)) == searched(shuffled, (21.3, 0))


@pytest.fixture(scope="module")
def found_at_once():
    return searched(scene_frames("rough"), (30, 0))


@pytest.mark.parametrize("split", [1, 3, 6])
def test_the_frames_of_recordings_add_up(found_at_once, split):
    frames, mounting = scene_frames("rough"), Mounting(30, 0)
    total = MountingSearch(Mounting(0, 0))
    for part in (range(split), range(split, len(frames))):
        search = MountingSearch(Mounting(0, 0))
        for index in part:
            search.add(mounting.unlevelled(frames[index]), index * STEP_S)
        total += search
    assert total.found() == found_at_once is not None


def test_further_recordings_do_not_matter_once_there_are_enough_frames():
    level, tilted = MountingSearch(Mounting(0, 0)), MountingSearch(Mounting(0, 0))
    for search, mounting in ((level, Mounting(0, 0)), (tilted, Mounting(30, 0))):
        for index, xyz in enumerate(open_water(8)):
            search.add(mounting.unlevelled(xyz), index * STEP_S)
    assert tilted.found() is not None
    level += tilted
    assert level.found() is None
