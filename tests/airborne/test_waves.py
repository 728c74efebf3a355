"""Waves of tiles: their estimated height and length, and the surface that follows them."""

import numpy as np
import pytest

from seaclutter_cli.airborne.separation import separate
from seaclutter_cli.airborne.surface import OTHER, SeparationParams
from seaclutter_cli.grids.cells import smoothed, touching
from seaclutter_cli.grids.elevation import ElevationGrid

SIDES = (300, 200)


def field(height, length, direction=0.6, seed=1, sides=SIDES):
    """Return a sea of many waves near one length and direction, one point per square metre, shape (3, N)."""
    rng = np.random.default_rng(seed)
    x, y = (side.ravel() + 0.5 for side in np.mgrid[: sides[0], : sides[1]].astype(float))
    z = np.zeros(len(x))
    for _ in range(40):
        k, angle = 2 * np.pi / (length * rng.normal(1, 0.08)), direction + rng.normal(0, 0.2)
        z += np.sin(k * (np.cos(angle) * x + np.sin(angle) * y) + rng.uniform(0, 7))
    return np.stack((x, y, z * height / 4 / z.std() + rng.normal(0, 0.03, len(x))))


def inside(xyz, x, y):
    return (xyz[0] >= x[0]) & (xyz[0] < x[1]) & (xyz[1] >= y[0]) & (xyz[1] < y[1])


@pytest.mark.parametrize(("height", "length"), [(0.6, 25.0), (1.1, 40.0)])
def test_height_and_length(height, length):
    found = separate([field(height, length)], SeparationParams()).sea
    assert found.wave_height_m == pytest.approx(height, rel=0.2)
    assert found.wave_length_m == pytest.approx(length, rel=0.25)
    assert abs(found.level_m) < 0.1 * height


def test_swell_that_is_longer_than_a_quarter_of_a_block():
    xyz = field(1.5, 150.0, sides=(512.0, 256.0))
    found = separate(
        [xyz], SeparationParams(), {"intensity": np.random.default_rng(1).gamma(2.0, 50, xyz.shape[1])}.get
    )
    assert found.sea.wave_length_m == pytest.approx(150.0, rel=0.25)
    assert (found.classification == OTHER).mean() < 0.005


@pytest.mark.parametrize(("height", "length"), [(0.5, 30.0), (1.5, 100.0)])
def test_the_highest_crests_of_swell_are_followed(height, length):
    """The opened surface follows such a swell, but not its highest crests."""
    found = separate([field(height, length, seed=8)], SeparationParams())
    assert found.sea.surface == "followed"
    assert (found.classification == OTHER).mean() < 0.001


def test_objects_do_not_raise_the_waves():
    xyz = field(1.1, 40.0)
    alone = separate([xyz], SeparationParams()).sea
    for at in range(20, 280, 50):
        xyz[2, inside(xyz, (at, at + 15), (60, 140))] += 8
    assert separate([xyz], SeparationParams()).sea.wave_height_m == pytest.approx(alone.wave_height_m, rel=0.15)


def test_calm_water_is_separated_as_with_half_a_metre():
    xyz = field(0.25, 60.0)
    xyz[2, inside(xyz, (40, 55), (20, 90))] += 0.8
    auto, fixed = (separate([xyz], SeparationParams(height_m=height)) for height in ("auto", 0.5))
    assert auto.sea.wave_height_m == pytest.approx(0.25, abs=0.08)
    np.testing.assert_array_equal(auto.classification, fixed.classification)
    np.testing.assert_array_equal(auto.height_m, fixed.height_m)


@pytest.mark.parametrize(("echoes", "surface"), [(1, "opened"), (10, "followed")])
def test_many_echoes_per_cell_show_crests_that_their_lowest_does_not(echoes, surface):
    parts = [field(0.22, 15.0, seed=1) + np.random.default_rng(n).normal(0, [[0], [0], [0.05]]) for n in range(echoes)]
    found = separate([np.concatenate(parts, axis=1)], SeparationParams())
    assert found.sea.surface == surface
    assert (found.classification == OTHER).mean() < 1e-3


@pytest.mark.parametrize(("height", "length"), [(0.7, 25.0), (1.2, 40.0), (1.5, 35.0)])
def test_ships_and_islands_rise_out_of_rough_water(height, length):
    xyz = field(height, length, seed=4)
    ship, island = inside(xyz, (40, 55), (20, 90)), inside(xyz, (150, 220), (60, 130))
    xyz[2, ship] += 5
    xyz[2, island] = 6
    found = separate([xyz], SeparationParams())
    assert found.sea.surface == "followed"
    other = found.classification == OTHER
    assert other[ship].all()
    assert other[island].mean() > 0.99
    assert other[~ship & ~island].mean() < 0.003
    assert (separate([xyz], SeparationParams(height_m=0.5)).classification == OTHER)[~ship & ~island].mean() > 0.05


def test_heights_are_above_the_waves():
    xyz = field(1.5, 50.0)
    assert np.abs(separate([xyz], SeparationParams()).height_m).std() < 0.15 < 0.3 < xyz[2].std()


def test_a_low_object_is_found_by_its_brightness():
    xyz = field(1.2, 40.0)
    mat = inside(xyz, (100, 112), (50, 62))
    xyz[2, mat] += 0.7
    intensity = np.random.default_rng(1).gamma(2.0, 100.0, xyz.shape[1])
    intensity[mat] *= 20
    bright = separate([xyz], SeparationParams(), {"intensity": intensity}.get).classification == OTHER
    plain = separate([xyz], SeparationParams()).classification == OTHER
    assert bright[mat].mean() > 0.9 > plain[mat].mean()
    assert bright[~mat].mean() < 0.005


def test_bright_water_is_no_object():
    xyz = field(1.2, 40.0)
    intensity = np.random.default_rng(1).gamma(2.0, 100.0, xyz.shape[1])
    intensity[inside(xyz, (100, 112), (50, 62))] *= 20
    assert (separate([xyz], SeparationParams(), {"intensity": intensity}.get).classification == OTHER).mean() < 0.005


def test_parts_of_the_points_do_not_matter():
    xyz = field(1.2, 40.0)
    intensity = np.random.default_rng(1).gamma(2.0, 100.0, xyz.shape[1])
    damaged = xyz.copy()
    damaged[2, 7], intensity[9] = np.nan, np.nan
    whole, parts = (
        separate(p, SeparationParams(), {"intensity": intensity}.get) for p in ([damaged], np.split(damaged, 8, axis=1))
    )
    np.testing.assert_array_equal(whole.classification, parts.classification)
    assert (whole.classification == OTHER).mean() < 0.005


@pytest.mark.parametrize("width", [1.5, 3.0])
def test_means_do_not_depend_on_blocks(width):
    from scipy import ndimage

    xyz = field(1.2, 40.0)
    grid = ElevationGrid(1.0)
    cells = grid.add(xyz)
    used = np.isfinite(grid.lowest)
    image = xyz[2].reshape(SIDES)
    kernel = ndimage.gaussian_filter1d((np.arange(11) == 5).astype(float), width, radius=5, mode="constant")
    if width > 2:  # two boxes of 7 cells: variance 2 (7 ** 2 - 1) / 12 = 8
        kernel = np.convolve(np.ones(7) / 7, np.ones(7) / 7)
        assert kernel @ (np.arange(13) - 6) ** 2 == pytest.approx(8.0)
    kernel = np.outer(kernel, kernel)
    weight = ndimage.convolve(np.ones(SIDES), kernel, mode="constant")
    expected = ndimage.convolve(image, kernel, mode="constant") / weight
    mean, share = (values.ravel()[cells].reshape(SIDES) for values in smoothed(grid, grid.lowest, used, width))
    np.testing.assert_allclose(mean, expected, atol=1e-9)
    np.testing.assert_allclose(share, weight, atol=1e-9)
    mask = np.zeros(used.size, np.bool_)
    high = image > 0.5
    mask[cells[high.ravel()]] = True
    expected = ndimage.binary_dilation(high, np.ones((3, 3)))
    np.testing.assert_array_equal(touching(grid, mask.reshape(used.shape)).ravel()[cells].reshape(SIDES), expected)


def two_strips():
    """Return two overlapping strips of one sea, seconds apart, with a ship in the overlap, and each point's strip."""
    one, other = field(1.3, 45.0, seed=6), field(1.3, 45.0, seed=7)
    one, other = one[:, one[1] < 120], other[:, other[1] > 80]
    xyz = np.concatenate((one, other), axis=1)
    xyz[2, inside(xyz, (40, 55), (85, 115))] += 3
    return xyz, np.repeat([0, 1], (one.shape[1], other.shape[1]))


@pytest.mark.parametrize("names", [("point_source_id",), ("gps_time",), ()])
def test_strips_show_the_water_at_two_moments(names):
    xyz, strip = two_strips()
    columns = {"point_source_id": strip + 4, "gps_time": 1e8 + 200.0 * strip + xyz[0] / 60}
    found = separate([xyz], SeparationParams(), {name: columns[name] for name in names}.get)
    ship = inside(xyz, (40, 55), (85, 115))
    wrong = ((found.classification == OTHER) != ship)[inside(xyz, (0, 300), (80, 120))].mean()
    assert wrong < 0.005 if names else wrong > 0.02


def test_strips_without_points_in_the_tile_do_not_matter():
    xyz, strip = two_strips()
    damaged = np.concatenate((xyz, np.full((3, 5000), np.nan)), axis=1)
    strips = np.concatenate((strip, np.full(5000, 9)))
    one, other = (
        separate([points], SeparationParams(), {"point_source_id": ids}.get)
        for points, ids in ((xyz, strip), (damaged, strips))
    )
    np.testing.assert_array_equal(one.classification, other.classification[: xyz.shape[1]])


def test_a_wide_low_mat_is_found_by_all_of_its_cells():
    xyz = field(1.2, 40.0)
    mat = inside(xyz, (100, 125), (50, 70))
    xyz[2, mat] += 0.2
    intensity = np.random.default_rng(1).gamma(2.0, 100.0, xyz.shape[1])
    intensity[mat] *= 20
    other = separate([xyz], SeparationParams(), {"intensity": intensity}.get).classification == OTHER
    assert other[mat].mean() > 0.8
    assert other[~mat].mean() < 0.002


def test_steep_water_is_sea_however_many_echoes_a_cell_has():
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 120, (2, 25 * 120**2))
    waves = [(2 * np.pi / (14 * rng.normal(1, 0.1)), angle) for angle in rng.normal(0.6, 0.3, 20)]
    z = sum(np.sin(k * (np.cos(angle) * x + np.sin(angle) * y) + rng.uniform(0, 7)) for k, angle in waves)
    xyz = np.stack((x, y, 1.6 / 4 * z / z.std() + rng.normal(0, 0.03, len(z))))
    ship = inside(xyz, (50, 60), (50, 80))
    xyz[2, ship] = 2
    other = separate([xyz], SeparationParams()).classification == OTHER
    assert other[ship].all()
    assert other[~ship].mean() < 0.0005
