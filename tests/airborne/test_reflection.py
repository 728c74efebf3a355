"""Water that is dark, and ground that is bright."""

import numpy as np
import pytest

from seaclutter_cli.airborne.echoes import echoes_of
from seaclutter_cli.airborne.gridded import GriddedPoints
from seaclutter_cli.airborne.reflection import _limit_between
from seaclutter_cli.airborne.squares import squares_of
from tests.airborne.coasts import SIZE, relief, sea_only, shares, tile, waves


def parcels(x, y, seed=3):
    """Return fields of 60 m by 70 m, each with a level and a slope of its own."""
    rng = np.random.default_rng(seed)
    level, slope = rng.normal(0, 0.1, (8, 6)), rng.normal(0, 0.0012, (8, 6))
    own = (x // 60).astype(int), (y // 70).astype(int)
    return level[own] + slope[own] * (x % 60 - 30)


def rolling(x, y, seed):
    """Return ground that rolls over some tens of metres, as waves do."""
    rng = np.random.default_rng(seed)
    total = np.zeros(len(x))
    for _ in range(25):
        column, row = rng.normal(0, 1 / 15, 2)
        total += np.sin(column * x + row * y + rng.uniform(0, 7))
    return 0.14 * total


def polder(x, y, _bumps):
    """Return a dike between the sea and fields two metres below it."""
    return np.select([x < 170, x < 200], [-5.0, 4.0], -2 + parcels(x, y))


def recorded(rng, land, water, ground):
    """Return intensities of Gaussian echoes with these means."""
    spread = [rng.normal(1, 0.25, len(land)) for _ in range(2)]
    return np.where(land, ground * spread[0], water * spread[1]).clip(1)


@pytest.mark.parametrize(("height", "length"), [(0.1, 15.0), (1.0, 25.0)])
def test_a_polder_is_land_where_it_is_brighter_than_the_sea(height, length):
    xyz, land, columns = tile(polder, height=height, length=length)
    columns["intensity"] = recorded(np.random.default_rng(1), land, 30, 120)
    on_land, on_water = shares(xyz, land, columns)
    assert on_land > 0.98
    assert on_water < 0.03


@pytest.mark.parametrize("seed", [1, 2])
def test_the_upper_basin_of_a_lock_is_dark_amid_bright_banks(seed):
    """The banks roll as waves do, higher than the basin, which is half of all water."""

    def level(x, _):
        return np.where(x < 200, 3.0, 0.0)

    def lock(x, y, _bumps):
        wet = (np.abs(y - 150) < 40) & (np.abs(x - 200) > 10)
        return np.where(wet, -5, np.where(x < 200, 4.5, 1.5) + rolling(x, y, seed))

    xyz, land, columns = tile(lock, level=level)
    columns["intensity"] = recorded(np.random.default_rng(1), land, 30, 120)
    on_land, on_water = shares(xyz, land, columns)
    assert on_land > 0.98
    assert on_water < 0.02


@pytest.mark.parametrize("rise", [0.1, 1.2])
def test_a_dark_road_and_two_kinds_of_fields_do_not_hide_a_dark_sea(rise):
    """The steep dike between the sea and the road along it has no square with echoes of the ground alone."""

    def coast(x, y, _bumps):
        flank = np.abs(x - 185)
        return np.select([x < 170, flank < 15], [-5.0, 5 - flank / 4], rise + 0.03 * parcels(x, y))

    xyz, land, columns = tile(coast)
    rng = np.random.default_rng(1)
    columns["intensity"] = recorded(rng, land, 15, np.where(xyz[1] < 150, 70, 130))
    road = (xyz[0] > 200) & (xyz[0] < 216)
    columns["intensity"][road] = rng.normal(20, 5, road.sum()).clip(1)
    on_land, on_water = shares(xyz, land, columns)
    assert on_land > 0.98
    assert on_water < 0.01


@pytest.mark.parametrize("mean", [0.3, 3.0])
def test_whole_numbers_below_one_are_no_reflections(mean):
    """Their deviation is that of rounding."""
    xyz, land, _ = tile(sea_only)
    columns = {"intensity": np.random.default_rng(1).poisson(mean, len(land))}
    points = GriddedPoints.of([xyz], 1.0)
    squares = squares_of(points.grid, points.grid.lowest, np.isfinite(points.grid.lowest))
    seen = echoes_of(squares, points, np.full(points.grid.lowest.shape, 9.0), columns.get, None)
    assert np.isfinite(seen.variation).any() == (mean > 1)


@pytest.mark.parametrize("height", [0.1, 0.8])
def test_strips_of_different_gain_show_one_sea(height):
    xyz, land, columns = tile(sea_only, height=height, length=30.0)
    gain = np.where(xyz[0] < SIZE[0] / 2, 1.0, 4.0)
    columns["intensity"] = gain * recorded(np.random.default_rng(1), land, 30, 120)
    assert shares(xyz, land, columns)[1] < 0.005


def test_bright_water_beside_dark_ground_is_water():
    xyz, land, columns = tile(lambda x, _, bumps: np.where(x > 250, 15 + bumps, -5), height=0.5)
    columns["intensity"] = recorded(np.random.default_rng(1), land, 120, 30)
    on_land, on_water = shares(xyz, land, columns)
    assert on_land > 0.98
    assert on_water < 0.02


@pytest.mark.parametrize("bank", [0.25, 0.8])
def test_water_of_recorded_logarithms_varies_more_than_its_banks(bank):
    """Both are equally bright; squares along the edge of the creek contain both, and vary nearly like water."""

    def creek(x, y, bumps):
        across = np.abs(y - 150 - 40 * np.sin(x / 40)) - 25
        return np.where(across < 0, -5.0, bank + 0.004 * across + 0.4 * bumps)

    xyz, land, columns = tile(creek)
    columns["intensity"] = 100 + np.where(land, 8, 50) * np.random.default_rng(1).normal(0, 1, len(land))
    on_land, on_water = shares(xyz, land, columns)
    assert on_land > 0.98
    assert on_water < 0.02


@pytest.mark.parametrize("kind", ["normal", "uniform"])
def test_an_even_distribution_is_of_one_kind(kind):
    values = getattr(np.random.default_rng(2), kind)(size=5000)
    assert _limit_between(values, 0.4) == np.inf


def test_the_limit_lies_between_two_kinds():
    rng = np.random.default_rng(3)
    values = np.concatenate((rng.normal(3.4, 0.1, 300), rng.normal(4.8, 0.2, 900)))
    assert values[:300].max() < _limit_between(values, 0.4) < values[300:].min()
    assert _limit_between(values[:1], 0.4) == np.inf


def test_dark_water_whose_echoes_differ_by_chance_between_strips():
    """Half of its squares vary like a mirror, half like ground, in swell that two strips show at two moments."""
    rng, parts = np.random.default_rng(7), []
    for strip, near in enumerate((0, 300)):
        x, y = rng.uniform(0, 300, (2, 150_000))
        x, y = (values[np.abs(y - near) < 200] for values in (x, y))
        land = x < 140 + 10 * np.sin(y / 30)
        sea = waves(np.random.default_rng(70 + strip), x, y, 1.5, 80.0)
        z = np.where(land, 18 + relief(np.random.default_rng(9), x, y, 0.4), sea)
        dark = rng.gamma(3.3, 17 / 3.3, len(x))
        intensity = np.where(land, rng.normal(100, 15, len(x)), dark).clip(0, 255).round()
        parts.append((x, y, z, land, intensity, np.full(len(x), strip), 300 * strip + x / 60))
    x, y, z, land, intensity, strips, time = (np.concatenate(values) for values in zip(*parts, strict=True))
    columns = {"intensity": intensity, "point_source_id": strips, "gps_time": time}
    on_land, on_water = shares(np.stack((x, y, z)), land, columns)
    assert on_land > 0.99
    assert on_water < 0.01
