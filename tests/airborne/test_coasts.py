"""Coasts, quays, locks and polders with and without intensities."""

import numpy as np
import pytest

from tests.airborne.coasts import COASTS, SIZE, sea_only, shares, tile

WITHOUT_INTENSITIES = [
    ("cliff", 0.1, 15.0, 0.95, 0.02), ("cliff", 1.2, 40.0, 0.95, 0.02), ("cliff", 1.5, 80.0, 0.9, 0.05),
    ("beach 1 in 30", 0.1, 15.0, 0.9, 0.05),
]  # fmt: skip


@pytest.mark.parametrize("height", [1.0, 2.0])
def test_a_quay_beside_waves_without_intensities_is_land(height):
    xyz, land, _ = tile(
        lambda x, y, _: np.where(x > 240, height + 0.05 * np.sin(x / 17), -5.0), height=1.5, length=40.0
    )
    on_land, on_water = shares(xyz, land, {})
    assert on_land > 0.97
    assert on_water < 0.02


@pytest.mark.parametrize(
    ("coast", "height", "length", "most_water"),
    [
        ("cliff", 0.1, 15.0, 0.02),
        ("cliff", 1.2, 40.0, 0.02),
        ("beach 1 in 30", 1.2, 40.0, 0.05),
        ("beach 1 in 100", 0.5, 60.0, 0.05),
        ("dike and low polder", 0.5, 60.0, 0.05),
    ],
)
def test_coasts(coast, height, length, most_water):
    land, water = shares(*tile(COASTS[coast], height=height, length=length))
    assert land > 0.95
    assert water < most_water


def test_basins_of_a_lock_are_water_though_nothing_reflects():
    """Both are even; the ground of the lock itself is not."""
    xyz, land, _ = tile(
        lambda x, _y, bumps: np.where(np.abs(x - 200) < 30, 3.8 + bumps / 3, -5),
        level=lambda x, _: np.where(x < 200, 0, 2),
    )
    upper = ~land & (xyz[0] > 200)
    xyz[2, upper] = np.random.default_rng(2).normal(2, 0.03, np.count_nonzero(upper))
    on_land, on_water = shares(xyz, land, {})
    assert on_land > 0.99
    assert on_water < 0.02


def test_a_third_of_a_tile_is_sea_beside_fields_though_nothing_reflects():
    """Most parts of the tile contain both, so that waves show in few of them; still water is as high as the fields."""
    rng = np.random.default_rng(3)
    xyz, *_ = tile(lambda x, _y, _b: np.where(x < 125, -5.0, 5 - np.abs(x - 140) / 3), height=1.1, length=30.0)
    inland = xyz[0] >= 155
    bumps = [np.sin(rng.normal(0, 1 / 25, 2) @ xyz[:2] + rng.uniform(0, 7)) for _ in range(12)]
    xyz[2, inland] = (1.0 + 0.02 * np.sum(bumps, axis=0) + rng.normal(0, 0.03, len(inland)))[inland]
    xyz[0] += 100
    on_land, on_water = shares(xyz, xyz[0] > 226, {})
    assert on_land > 0.97
    assert on_water < 0.02


@pytest.mark.parametrize(("ground", "height", "length"), [(sea_only, 0.1, 15.0), (COASTS["cliff"], 1.2, 40.0)])
def test_water_that_reflects_like_ground_in_a_part_of_it(ground, height, length):
    """Water reflects most below the aircraft; the sensor records nothing below a threshold."""
    xyz, land, columns = tile(ground, height=height, length=length)
    from_nadir = (xyz[1] - SIZE[1] / 3) / SIZE[1]
    intensity = np.where(land, columns["intensity"], columns["intensity"] * np.exp(-((4 * from_nadir) ** 2)))
    recorded = np.maximum(intensity, np.quantile(intensity, 0.5))
    on_land, on_water = shares(xyz, land, columns | {"intensity": recorded})
    assert on_land > 0.97
    assert on_water < 0.02


@pytest.mark.parametrize(("coast", "height", "length", "least_land", "most_water"), WITHOUT_INTENSITIES)
def test_a_coast_without_intensities_shows_by_its_shape(coast, height, length, least_land, most_water):
    xyz, land, _ = tile(COASTS[coast], height=height, length=length)
    on_land, on_water = shares(xyz, land, {})
    assert on_land > least_land
    assert on_water < most_water
