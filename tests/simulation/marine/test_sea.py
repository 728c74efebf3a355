import numpy as np
import pytest
from scipy.integrate import quad

from seaclutter_cli.simulation.marine.physics import whitecap_share
from seaclutter_cli.simulation.marine.sea import GRAVITY, Sea, SeaParams, jonswap


def sea(seed=1, **params):
    return Sea(SeaParams(**params), np.random.default_rng(seed))


@pytest.mark.parametrize("enhancement", [1.0, 3.3, 7.0])
@pytest.mark.parametrize("height_m", [0.1, 1.0, 4.0])
def test_the_spectrum_has_the_given_height(enhancement, height_m):
    area, _ = quad(lambda omega: jonswap(np.array([omega]), height_m, 1.1, enhancement)[0], 0.3, 60, limit=400)
    assert 4 * np.sqrt(area) == pytest.approx(height_m, rel=0.03)


def test_without_enhancement_it_is_the_spectrum_of_pierson_and_moskowitz():
    wind = 9.0
    omega = np.linspace(0.5, 4, 50)
    peak = 0.877 * GRAVITY / wind
    height = 0.21 * wind**2 / GRAVITY
    published = 8.1e-3 * GRAVITY**2 / omega**5 * np.exp(-0.74 * (GRAVITY / (wind * omega)) ** 4)
    np.testing.assert_allclose(jonswap(omega, height, peak, 1.0), published, rtol=0.05)


@pytest.mark.parametrize("sea_state", [1, 2, 3])
def test_waves_are_as_high_as_the_sea_state_says(sea_state):
    params = SeaParams(sea_state=sea_state)
    heights = [4 * sea(seed, sea_state=sea_state).at(10.0).heights.std() for seed in range(12)]
    assert np.mean(heights) == pytest.approx(params.significant_height_m, rel=0.12)


def test_sea_state_zero_is_flat():
    flat = sea(sea_state=0).at(3.0)
    assert not flat.heights.any()


def test_waves_travel_in_their_direction():
    water = sea(direction_deg=0, spreading=20)
    now, later = water.at(0.0).heights, water.at(0.3).heights
    shifts = [np.corrcoef(np.roll(now, shift, axis=0).ravel(), later.ravel())[0, 1] for shift in range(-6, 7)]
    assert np.argmax(shifts) > 6


def test_swell_is_the_long_part_of_the_surface():
    water = sea(sea_state=3)
    surface = water.at(5.0)
    x = np.arange(0.0, 100.0, surface.cell_m)
    height, slope_x, _ = water.swell(1.0).at(x, np.zeros_like(x), np.full_like(x, 5.0))
    assert np.corrcoef(height, surface.height(x, np.zeros_like(x)))[0, 1] > 0.9
    np.testing.assert_allclose(np.gradient(height, x)[1:-1], slope_x[1:-1], atol=0.02)


def test_slopes_are_differences_of_heights():
    surface = sea().at(1.0)
    step = surface.cell_m
    x, y = np.array([3.2, -40.0]), np.array([17.0, 900.0])
    along_x, along_y = surface.slope(x, y)
    np.testing.assert_allclose(along_x, (surface.height(x + step, y) - surface.height(x - step, y)) / (2 * step))
    np.testing.assert_allclose(along_y, (surface.height(x, y + step) - surface.height(x, y - step)) / (2 * step))


def test_each_seed_gives_a_different_sea():
    assert np.array_equal(sea(4).at(2.0).heights, sea(4).at(2.0).heights)
    assert not np.array_equal(sea(4).at(2.0).heights, sea(5).at(2.0).heights)


def test_whitecaps_grow_with_the_sea():
    shares = [whitecap_share(SeaParams(sea_state=state).wind_ms) for state in range(7)]
    assert shares == sorted(shares)
    assert shares[0] == 0
