"""Separation of sea and non-sea points: waves, edges, empty cells, islands."""

from dataclasses import replace

import numpy as np
import pytest

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.surface import NEVER, OTHER, WATER, SeparationParams
from seaclutter_cli.errors import InputError

PLAIN = SeparationParams(height_m=0.5, island_m=None, land="ignore")


def plane(width=120, height=100, z=lambda x, y: 0 * x):
    """Return one point in the centre of each cell of 1 m, shape (3, N)."""
    x, y = (side.ravel() + 0.5 for side in np.mgrid[:width, :height].astype(float))
    return np.stack((x, y, z(x, y)))


def other(xyz, params=PLAIN):
    return separate([xyz], params).classification == OTHER


def inside(xyz, x, y):
    return (xyz[0] >= x[0]) & (xyz[0] < x[1]) & (xyz[1] >= y[0]) & (xyz[1] < y[1])


def raised(xyz, where, by):
    out = xyz.copy()
    out[2, where] += by
    return out


def test_an_object_narrower_than_the_window_is_non_sea_regardless_of_its_length():
    flat = plane()
    ship = inside(flat, (40, 60), (10, 90))
    np.testing.assert_array_equal(other(raised(flat, ship, 3.0)), ship)


def test_a_wider_object_is_sea_unless_it_is_an_island():
    flat = plane()
    island = inside(flat, (40, 80), (30, 70))
    assert not other(raised(flat, island, 3.0)).any()
    np.testing.assert_array_equal(other(raised(flat, island, 3.0), SeparationParams()), island)


def test_a_low_shore_belongs_to_a_peak_that_is_narrower_than_the_window():
    """Only the shore remains in the opened surface, lower than ``island_m``."""
    flat = plane()
    shore, peak = inside(flat, (40, 80), (30, 70)), inside(flat, (52, 68), (42, 58))
    found = other(raised(raised(flat, shore, 1.5), peak, 3.0), SeparationParams())
    np.testing.assert_array_equal(found, shore)


def test_a_ship_does_not_make_an_island_of_the_sea():
    flat = plane(z=lambda x, y: 0.3 * np.sin(2 * np.pi * x / 80))
    ship = inside(flat, (16, 28), (20, 60))
    np.testing.assert_array_equal(other(raised(flat, ship, 9.0), SeparationParams(land="ignore")), ship)


@pytest.mark.parametrize(("land", "found"), [("keep", True), ("ignore", False)])
def test_a_low_wide_bank_is_land_by_its_shape_not_by_its_height(land, found):
    flat = plane()
    bank = inside(flat, (40, 80), (30, 70))
    np.testing.assert_array_equal(other(raised(flat, bank, 1.5), SeparationParams(land=land)), bank & found)


@pytest.mark.parametrize(("land", "lowest"), [("keep", 0.2), ("ignore", 0.5)])
def test_the_shore_of_an_island_belongs_to_it(land, lowest):
    """Down to the threshold, or to the bank if land is looked for."""
    cone = plane(z=lambda x, y: np.maximum(0, 8 - 0.2 * np.hypot(x - 60, y - 50)))
    np.testing.assert_array_equal(other(cone, SeparationParams(land=land)), cone[2] > lowest)


def test_heights_over_land_are_above_the_level_of_the_sea():
    flat = plane()
    island = inside(flat, (40, 80), (30, 70))
    found = separate([raised(flat, island, 3.0)], SeparationParams())
    np.testing.assert_allclose(found.height_m[island], 3.0, atol=0.26)


def test_long_swell_is_sea_and_a_wide_window_cuts_its_crests():
    swell = plane(z=lambda x, y: 0.6 * np.sin(2 * np.pi * x / 80))
    assert not other(swell).any()
    assert other(swell, replace(PLAIN, window_m=90.0)).mean() > 0.2


def test_a_shadow_beside_a_ship_does_not_widen_it():
    flat = plane()
    ship = inside(flat, (40, 56), (20, 80))
    visible = ~inside(flat, (56, 68), (20, 80))
    np.testing.assert_array_equal(other(raised(flat, ship, 3.0)[:, visible]), ship[visible])


def test_a_point_in_four_of_ten_cells_is_enough():
    rng = np.random.default_rng(1)
    flat = plane(z=lambda x, y: 0.3 * np.sin(2 * np.pi * x / 60))
    ship = inside(flat, (40, 50), (20, 80))
    visible = rng.random(flat.shape[1]) < 0.4
    np.testing.assert_array_equal(other(raised(flat, ship, 3.0)[:, visible]), ship[visible])


def test_an_object_cut_by_the_edge_is_separated_by_the_part_inside():
    flat = plane()
    for side in ((0, 12), (108, 120)):
        ship = inside(flat, side, (20, 80))
        np.testing.assert_array_equal(other(raised(flat, ship, 3.0)), ship)


@pytest.mark.parametrize("at", [(60.5, 50.5), (60.5, 95.5), (2.5, 3.5)])
def test_an_echo_from_below_the_surface_is_ignored(at):
    """Near the edge, no window avoids it."""
    flat = plane()
    deep = np.append(flat, [[at[0]], [at[1]], [-20.0]], axis=1)
    found = separate([deep], PLAIN)
    assert (found.classification == WATER).all()
    assert found.height_m[-1] == -20


def test_many_echoes_from_below_do_not_become_the_surface():
    rng = np.random.default_rng(6)
    x, y = rng.uniform(0, 250, 150_000), rng.uniform(0, 200, 150_000)
    ship = (np.abs(x - 100) < 30) & (np.abs(y - 90) < 6)
    below = ~ship & (rng.random(len(x)) < 0.01)
    z = np.where(ship, 4.0, rng.normal(0, 0.03, len(x))) - below * rng.uniform(0.3, 5, len(x))
    found = separate([np.stack((x, y, z))], SeparationParams())
    assert found.classification[ship & (z > 3)].min() == found.classification[ship].max() == OTHER
    assert np.mean(found.classification[~ship & ~below] == OTHER) < 0.002


def test_water_beside_a_few_points_of_a_ship_is_not_a_pit():
    flat = plane(30, 30)
    ship = inside(flat, (10, 12), (10, 12))
    visible = ship | ((flat[0] == 12.5) & (flat[1] == 12.5)) | (flat[0] > 16)
    np.testing.assert_array_equal(other(raised(flat, ship, 5.0)[:, visible]), ship[visible])


def test_points_without_finite_coordinates_are_never_classified():
    flat = plane(40, 40)
    flat[1, 7], flat[2, 9] = np.nan, np.inf
    found = separate([flat[:, :500], flat[:, 500:]], PLAIN)
    assert set(np.flatnonzero(found.classification == NEVER)) == {7, 9}
    assert (found.classification[[0, 1]] == WATER).all()
    assert np.isnan(found.height_m[[7, 9]]).all()


@pytest.mark.parametrize("xyz", [np.empty((3, 0)), np.full((3, 5), np.nan)])
def test_no_points(xyz):
    with pytest.raises(InputError, match="no points"):
        separate([xyz], PLAIN)


def test_parameters_that_do_not_fit():
    with pytest.raises(ValueError, match="must not exceed 1000 cells"):
        SeparationParams(cell_m=0.01)
    with pytest.raises(ValueError, match="island_m"):
        SeparationParams(island_m=0.2)


def calm_water(deviation_m):
    rng = np.random.default_rng(8)
    x, y = rng.uniform(0, 256, (2, 6 * 256**2))
    return np.stack((x, y, 0.05 * np.sin(2 * np.pi * x / 60) + rng.normal(0, deviation_m, len(x))))


@pytest.mark.parametrize(
    ("deviation_m", "height_m"), [(0.01, 0.35), (0.04, 0.38), (0.05, 0.47)], ids=["still", "ripples", "chop"]
)
def test_waves_decide_the_height_of_objects_on_calm_water(deviation_m, height_m):
    found = separate([calm_water(deviation_m)], SeparationParams())
    assert found.sea.surface == "opened"
    assert found.sea.object_height_m == pytest.approx(height_m, abs=0.015)
    assert (found.classification == WATER).all()


def test_a_pontoon_on_still_water_is_an_object():
    water = calm_water(0.01)
    pontoon = inside(water, (100, 130), (100, 104))
    water = raised(water, pontoon, 0.42)
    np.testing.assert_array_equal(other(water, SeparationParams()), pontoon)
    assert not other(water).any()
