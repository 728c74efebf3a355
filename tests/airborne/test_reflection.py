"""Water that is dark, bright, or reflects like ground in a part of it."""

import numpy as np
import pytest

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


def test_a_dark_road_and_two_kinds_of_fields_do_not_hide_a_dark_sea():
    """The steep dike between the sea and the road along it has no square with echoes of the ground alone."""

    def coast(x, y, _bumps):
        flank = np.abs(x - 185)
        return np.select([x < 170, flank < 15], [-5.0, 5 - flank / 4], 1.2 + 0.03 * parcels(x, y))

    xyz, land, columns = tile(coast)
    rng = np.random.default_rng(1)
    columns["intensity"] = recorded(rng, land, 15, np.where(xyz[1] < 150, 70, 130))
    road = (xyz[0] > 200) & (xyz[0] < 216)
    columns["intensity"][road] = rng.normal(20, 5, road.sum()).clip(1)
    on_land, on_water = shares(xyz, land, columns)
    assert on_land > 0.98
    assert on_water < 0.01


def test_strips_of_different_gain_show_one_sea():
    xyz, land, columns = tile(sea_only, height=0.1, length=30.0)
    gain = np.where(xyz[0] < SIZE[0] / 2, 1.0, 4.0)
    columns["intensity"] = gain * recorded(np.random.default_rng(1), land, 30, 120)
    assert shares(xyz, land, columns)[1] < 0.005


def test_water_of_recorded_logarithms_varies_more_than_its_banks():
    """Both are equally bright; squares along the edge of the creek contain both, and vary nearly like water."""

    def creek(x, y, bumps):
        across = np.abs(y - 150 - 40 * np.sin(x / 40)) - 25
        return np.where(across < 0, -5.0, 0.8 + 0.004 * across + 0.4 * bumps)

    xyz, land, columns = tile(creek)
    columns["intensity"] = 100 + np.where(land, 8, 50) * np.random.default_rng(1).normal(0, 1, len(land))
    on_land, on_water = shares(xyz, land, columns)
    assert on_land > 0.98
    assert on_water < 0.02


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


def test_water_of_which_a_part_reflects_like_ground_is_no_land():
    """It is one surface, so intensities tell nothing."""
    rng = np.random.default_rng(7)
    x, y = rng.uniform(0, 300, 400_000), rng.uniform(0, 200, 400_000)
    land = x < 80
    mirror = x > 170
    intensity = np.where(mirror, rng.exponential(60, len(x)), rng.normal(60, 8, len(x))).clip(1)
    z = np.where(land, 4.0 + 0.5 * np.sin(x / 3) * np.sin(y / 4), rng.normal(0, 0.02, len(x)))
    columns = {"intensity": intensity, "number_of_returns": np.ones(len(x), int)}
    on_land, on_water = shares(np.stack((x, y, z)), land, columns)
    assert on_land > 0.99
    assert on_water < 0.02


def test_trusted_water_is_no_land_though_it_reflects_like_ground():
    """A strip beside land; most of its points have class 9, and the others follow them."""
    rng = np.random.default_rng(7)
    x, y = rng.uniform(0, 300, 400_000), rng.uniform(0, 200, 400_000)
    land, strip = x < 80, (x >= 80) & (x < 88) & (y < 120)
    intensity = np.where(strip, rng.normal(60, 6, len(x)), rng.exponential(60, len(x))).clip(1)
    intensity[land] = rng.normal(200, 20, np.count_nonzero(land))
    z = np.where(land, 4.0 + 0.5 * np.sin(x / 3) * np.sin(y / 4), rng.normal(0, 0.02, len(x)))
    own = strip & (rng.random(len(x)) < 0.3)
    classes = np.where(land | own, 0, 9).astype(np.uint8)
    columns = {"intensity": intensity, "number_of_returns": np.ones(len(x), int), "classification": classes}
    _, on_strip = shares(np.stack((x, y, z)), ~own, columns, trust_classes=(9,))
    assert on_strip < 0.02
