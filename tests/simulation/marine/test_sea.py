import numpy as np
import pytest
from scipy.integrate import quad

from seaclutter_cli.simulation.lidar import Echoes, Shots
from seaclutter_cli.simulation.marine.motion import Track, rotations
from seaclutter_cli.simulation.marine.physics import whitecap_share
from seaclutter_cli.simulation.marine.sea import GRAVITY, KELVIN, Sea, SeaParams, Wake, jonswap, patches


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
    height, slope_x, _ = water.swell(1.0)(x, np.zeros_like(x), np.full_like(x, 5.0))
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


def wake(speed_ms=8.0, path=((0.0, 0.0), (100.0, 0.0))):
    return Wake(Track(path, speed_ms, 0.0, 0.0), 8.0, 2.5, 8.0)


def test_a_track_follows_its_path():
    track = Track(((0.0, 0.0), (10.0, 0.0), (10.0, 20.0)), 2.0, 0.0, 1.0)
    x, y, heading = track.at(np.array([0.0, 1.0, 3.5, 6.0, 11.0, 100.0]))
    np.testing.assert_allclose(x, [-2, 0, 5, 10, 10, 10], atol=1e-9)
    np.testing.assert_allclose(y, [0, 0, 0, 0, 10, 188], atol=1e-9)
    np.testing.assert_allclose(np.degrees(heading), [0, 0, 0, 90, 90, 90])


def test_a_body_at_rest_keeps_its_heading():
    x, y, heading = Track(((3.0, 4.0),), 0.0, 30.0, 0.0).at(np.array([-5.0, 50.0]))
    assert (x.tolist(), y.tolist(), np.degrees(heading).round(9).tolist()) == ([3, 3], [4, 4], [30, 30])


def test_signs_of_pitch_and_roll():
    up = rotations(np.zeros(2), np.array([-0.1, 0]), np.array([0, 0.1]))
    assert (up[0] @ [1, 0, 0])[2] > 0
    assert (up[1] @ [0, 1, 0])[2] > 0
    np.testing.assert_allclose(up @ up.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-12)


def test_the_wake_is_behind_the_bow_and_within_kelvins_angle():
    grid_x, grid_y = (part.ravel() for part in np.meshgrid(np.arange(-60.0, 120, 0.5), np.arange(-60.0, 60.25, 0.5)))
    foam = wake().foam(grid_x, grid_y, 10.0)
    bow = 80 + 4
    strong = foam > 0.005
    assert strong.any()
    assert grid_x[strong].max() <= bow
    angles = np.arctan2(np.abs(grid_y[strong]) - 1.25 - 1.5, bow - grid_x[strong])
    assert angles.max() < KELVIN + 0.1
    by_place = foam.reshape(241, -1)
    np.testing.assert_allclose(by_place, by_place[::-1])


def test_foam_remains_behind_the_ship_and_fades():
    position = np.array([40.0]), np.array([0.0])
    peak = wake().foam(np.array([79.0]), np.zeros(1), 10.0)[0]
    times = (5.0, 7.0, 12.0, 20.0, 30.0)
    cover = [wake().foam(*position, time)[0] for time in times]
    assert cover[1] > 0.5 * peak
    assert cover[1:] == sorted(cover[1:], reverse=True)
    assert 0 < cover[-1] < 0.1 * peak
    assert wake().foam(*position, 4.0)[0] == 0


def test_a_faster_ship_leaves_more_foam():
    position = np.array([0.0]), np.array([0.0])
    covers = [wake(speed).foam(position[0] + speed * 4 - 8, position[1], 4.0)[0] for speed in (1.0, 3.0, 6.0)]
    assert covers == sorted(covers)
    assert covers[0] < 0.05 * covers[2]


@pytest.mark.parametrize(("speed", "sprays"), [(2.0, False), (9.0, True)])
def test_only_a_fast_ship_throws_up_spray(speed, sprays):
    azimuths = np.linspace(-np.pi, np.pi, 3600, endpoint=False)
    rays = np.stack((np.cos(azimuths), np.sin(azimuths), np.zeros(3600)), axis=1)
    ship = wake(speed)
    x, y, _ = ship.track.at(np.array([4.0]))
    shots = Shots(np.tile((x[0], y[0], 0.3), (3600, 1)), rays, azimuths)
    echoes = Echoes.empty(3600)
    ship.add_spray_echoes(shots, echoes, 4.0, 0.2, np.random.default_rng(1))
    assert np.isfinite(echoes.range_m).any() == sprays


def test_waves_of_the_wake_have_the_wavelength_of_kelvins_theory():
    behind = np.arange(5.0, 55, 0.05)
    x, y = 80 + 4 - behind, 1.25 + behind * np.tan(KELVIN)
    height = wake().height(x, y, 10.0)
    crests = behind[1:-1][(height[1:-1] > height[:-2]) & (height[1:-1] > height[2:])]
    assert np.diff(crests).mean() == pytest.approx(2 / 3 * 2 * np.pi * 8**2 / 9.81, rel=0.02)


def test_a_wake_follows_the_bends_of_the_path():
    path = ((0.0, 0.0), (40.0, 0.0), (40.0, 40.0))
    left = wake(path=path)
    cover = left.foam(np.array([20.0, 40.0, 60.0]), np.array([0.0, 12.0, 0.0]), 8.0)
    assert cover[0] > 0.01
    assert cover[1] > 0.01
    assert cover[2] < 1e-6


def test_patches_are_uniform_and_constant():
    x, y = np.random.default_rng(0).uniform(-500, 500, (2, 50_000))
    values = patches(x, y, 7)
    assert np.histogram(values, 10, (0, 1))[0] == pytest.approx(np.full(10, 5000), rel=0.08)
    assert np.array_equal(values, patches(x, y, 7))
    assert not np.array_equal(values, patches(x, y, 8))
