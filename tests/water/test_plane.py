"""The mean plane of the water in single frames."""

import numpy as np
import pytest

from seaclutter_cli.water.plane import MIN_SUPPORT, Plane, PolarCells, fit_plane


def spread(rng, size, level_m, noise_m=0.05, slope=(0.0, 0.0)):
    x, y = rng.uniform(-40, 40, (2, size))
    return np.stack((x, y, level_m + slope[0] * x + slope[1] * y + rng.normal(0, noise_m, size)))


@pytest.mark.parametrize("start", [None, Plane(-2.2, 0.0, 0.01)])
@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.05, -0.08)])
def test_the_plane_below_the_lidar(start, slope):
    points = spread(np.random.default_rng(1), 4000, -2.5, noise_m=0.0, slope=slope)
    cells = PolarCells.of(points)
    plane, weight = fit_plane(cells, start)
    assert plane.level_m == pytest.approx(-2.5, abs=1e-3)
    assert (plane.slope_x, plane.slope_y) == pytest.approx(slope, abs=2e-3)
    assert (weight / cells.trust).min() > 0.1


@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_a_bridge_overhead_does_not_hide_the_water(noise_m):
    rng = np.random.default_rng(2)
    bridge = spread(rng, 20_000, 5.0, noise_m)
    water = spread(rng, 150, -2.5)
    points = np.hstack((water, bridge[:, np.abs(bridge[1]) > 8]))
    plane, _ = fit_plane(PolarCells.of(points), None)
    assert plane.level_m == pytest.approx(-2.5, abs=0.1)


def test_a_plane_overhead_is_returned_if_there_is_no_other():
    plane, _ = fit_plane(PolarCells.of(spread(np.random.default_rng(3), 5000, 5.0)), None)
    assert plane.level_m == pytest.approx(5.0, abs=0.1)


def test_the_lowest_point_of_each_cell_is_the_first_of_equal_ones():
    x = np.array([10.0, 10.1, 10.2, -20.0])
    cells = PolarCells.of(np.stack((x, np.zeros(4), np.array([-1.0, -2.0, -2.0, -3.0]))))
    np.testing.assert_array_equal(np.sort(cells.lowest[0]), [-20.0, 10.1])
    assert len(cells.number) == 2
    assert not cells.enough


def test_few_flat_echoes_near_the_lidar_win_over_mirrored_ones_below_quays():
    """The water is seen at 5 to 12 m only; the quays on both sides have images 1.5 m to 4 m below it."""
    rng = np.random.default_rng(4)
    bearing, distance = rng.uniform(-np.pi, np.pi, 90), rng.uniform(5, 12, 90)
    near = np.stack((distance * np.cos(bearing), distance * np.sin(bearing), rng.normal(-1.2, 0.03, 90)))
    x, side = rng.uniform(-40, 40, 1500), rng.choice((-1, 1), 1500)
    mirrored = np.stack((x, side * rng.uniform(14, 16, 1500), rng.uniform(-5.2, -2.7, 1500)))
    tops = -2.4 - mirrored[2]
    quays = np.vstack((mirrored[:2], tops, tops))
    plane, _ = fit_plane(PolarCells.of(np.hstack((near, mirrored)), quays), None)
    assert plane.level_m == pytest.approx(-1.2, abs=0.2)
    assert abs(plane.slope_x) + abs(plane.slope_y) < 0.05


def test_a_plane_that_only_some_far_cells_support_is_tilted_as_they_are():
    """A lidar 6 m up sees the water in eight cells from 30 m on, which are hardly trusted."""
    bearing, distance = (axis.ravel() for axis in np.meshgrid(np.radians(np.arange(8) * 45 + 5), (30.5, 30.6, 30.7)))
    x, y = distance * np.cos(bearing), distance * np.sin(bearing)
    cells = PolarCells.of(np.stack((x, y, -6 + 0.04 * x - 0.02 * y)))
    assert cells.trust.sum() < MIN_SUPPORT
    plane, _ = fit_plane(cells, None)
    assert (plane.level_m, plane.slope_x, plane.slope_y) == pytest.approx((-6, 0.04, -0.02), abs=0.01)


def test_cells_are_trusted_by_flat_echoes_and_nearness():
    def trust(distance_m, *heights):
        xyz = np.array([(distance_m, 0.01 * k, z) for k, z in enumerate(heights)]).T
        return PolarCells.of(xyz).trust.item()

    assert trust(6, -2, -2, -2) > trust(6, -2, -2) > trust(6, -2) == trust(6, -2, -1)
    assert trust(6, -2, -2, -2) == trust(6, -2, -2, -2, -2) > trust(30, -2, -2, -2)


def test_fog_around_the_lidar_is_not_taken_for_the_water():
    """It fills the air within 12 m, while the water 5.6 m below is seen by few echoes."""
    rng = np.random.default_rng(6)
    bearing, distance = rng.uniform(-np.pi, np.pi, 3000), rng.uniform(5, 12, 3000)
    fog = np.stack((distance * np.cos(bearing), distance * np.sin(bearing), rng.uniform(-3, 3, 3000)))
    water = spread(rng, 400, -5.6)
    beyond = np.hypot(*water[:2]) > 12
    plane, _ = fit_plane(PolarCells.of(np.hstack((fog, water[:, beyond])), np.empty((4, 0))), None)
    assert plane.level_m == pytest.approx(-5.6, abs=0.1)


def test_cells_that_hold_bodies_are_hardly_trusted():
    water = np.array([(10.0, 0.0, -2.0), (-10.0, 0.5, -2.0)]).T
    alone, beside = PolarCells.of(water), PolarCells.of(water, np.array([[10.5], [0.0], [1.0], [1.0]]))
    ratio = beside.trust[:2] / alone.trust
    assert sorted(ratio.tolist()) == [pytest.approx(0.1), 1.0]


def test_boats_stand_in_the_water_and_their_decks_are_not_taken_for_it():
    """In a marina that hides all water, decks 1 m high are the lowest flat echoes; a tenth of the hulls is mirrored."""
    rng = np.random.default_rng(5)
    decks = spread(rng, 3000, -4.2, noise_m=0.1)
    feet = spread(rng, 3000, -5.2, noise_m=0.02)
    feet[2, rng.random(3000) < 0.05] -= 1.5
    cabins = spread(rng, 1000, -3.2)
    feet, cabins = np.vstack((feet, feet[2] + 2)), np.vstack((cabins, cabins[2]))
    cells = PolarCells.of(decks, np.hstack((feet, cabins)))
    plane, weight = fit_plane(cells, None)
    assert plane.level_m == pytest.approx(-5.2, abs=0.1)
    assert np.count_nonzero(cells.in_water(weight)) < 30


def level_deviation(points):
    cells = PolarCells.of(points)
    return np.sqrt(cells.covariance(*fit_plane(cells, None))[0, 0])


def test_the_level_is_uncertain_by_noise_few_echoes_and_those_of_one_side_only():
    calm, rough = (spread(np.random.default_rng(7), 3000, -2.5, noise_m) for noise_m in (0.02, 0.2))
    ahead = rough[:, rough[0] > 5]
    assert level_deviation(calm) < 0.01
    assert 5 * level_deviation(calm) < level_deviation(rough) < 0.1
    assert level_deviation(rough[:, :300]) > 2 * level_deviation(rough)
    assert level_deviation(ahead) > 2 * level_deviation(rough[:, : ahead.shape[1]])


def around(rng, size, level_m, sectors):
    """Return points at 6 to 30 m, each in one of some sectors of 10°, at the height of its sector."""
    number = rng.integers(len(sectors), size=size)
    bearing, distance = np.radians(10 * (sectors[number] + rng.random(size))), rng.uniform(6, 30, size)
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), level_m[number]))


@pytest.mark.parametrize("start", [None, Plane(-1.7, 0.0, 0.0)])
def test_calm_water_is_at_one_height_whatever_stands_in_it(start):
    """Two thirds of the directions have decks and pontoons, 0.3 m to 1.2 m above the water."""
    rng = np.random.default_rng(5)
    water = around(rng, 600, np.full(12, -2.0), np.arange(0, 36, 3))
    decks = around(rng, 1200, rng.uniform(-1.7, -0.8, 24), np.setdiff1d(np.arange(36), np.arange(0, 36, 3)))
    points = np.hstack((water, decks)) + rng.normal(0, 0.02, (3, 1800))
    cells = PolarCells.of(points)
    plane, weight = fit_plane(cells, start)
    assert plane.level_m == pytest.approx(-2, abs=0.1)
    assert (cells.lowest[2, weight > 0] < -1.5).all()


def test_rough_water_is_at_many_heights():
    rng = np.random.default_rng(6)
    x, y, _ = around(rng, 400, np.zeros(36), np.arange(36))
    cells = PolarCells.of(np.stack((x, y, rng.normal(-2, 0.3, 400))))
    _, weight = fit_plane(cells, None)
    assert (weight > 0).mean() > 0.9


def basin(seed):
    """Return single echoes of calm water 1.4 m below the lidar, and rows of three on hulls, quays and their images."""
    rng = np.random.default_rng(seed)
    water, rows = np.radians(36 * np.arange(10) + 2), np.radians(30 * np.arange(12) + 17)
    bearing = np.concatenate((water, np.add.outer(rows, [0, 0.01, 0.02]).ravel()))
    distance = np.concatenate((rng.uniform(7, 12, 10), np.repeat(rng.uniform(14, 32, 12), 3)))
    z = np.concatenate((rng.normal(-1.4, 0.01, 10), np.repeat(rng.uniform(-2.6, -0.2, 12), 3)))
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), z))


def test_calm_water_amid_hulls_and_images_keeps_its_plane():
    known = Plane(-1.4, 0.0, 0.0)
    levels = [fit_plane(PolarCells.of(basin(seed)), known)[0].level_m for seed in range(20)]
    assert np.median(np.abs(np.subtract(levels, -1.4))) < 0.1
