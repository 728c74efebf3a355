"""Echoes from the bottom of clear water, mats on water, and trees."""

import numpy as np
import pytest

from seaclutter_cli.airborne.bottom import bottom_of
from seaclutter_cli.airborne.gridded import GriddedPoints
from seaclutter_cli.airborne.separation import GROUND, OTHER, WATER, separate
from seaclutter_cli.airborne.surface import SeparationParams

SIZE = np.array([[200.0], [150.0]])
DEPTH_M = 4.0


def pulses(rng, elevation, second, share):
    """Return coordinates and columns of pulses, of which a share has a second echo."""
    xy = rng.uniform(0, 1, (2, 100_000)) * SIZE
    first = elevation(*xy)
    several = (rng.random(len(first)) < share) & (second(*xy) < first)
    xyz = np.hstack((np.vstack((xy, first)), np.vstack((xy, second(*xy)))[:, several]))
    return xyz, {
        "return_number": np.r_[np.ones(len(first)), np.full(several.sum(), 2)].astype(np.uint8),
        "number_of_returns": np.r_[1 + several, np.full(several.sum(), 2)].astype(np.uint8),
    }


def ship(x, y):
    return (np.abs(x - 120) < 30) & (np.abs(y - 70) < 7)


def clear_water(share, lone=0.0, wave=0.15):
    rng = np.random.default_rng(3)

    def surface(x, y):
        water = wave * np.sin(x / 3 + y / 5) + rng.normal(0, 0.03, len(x))
        return np.where(ship(x, y), 5.0, water)

    def bottom(x, y):
        return np.where(ship(x, y), 9.0, np.sin(x / 20) - DEPTH_M)

    xyz, columns = pulses(rng, surface, bottom, share)
    seen = np.flatnonzero((columns["number_of_returns"] == 2) & (columns["return_number"] == 1))
    kept = np.ones(xyz.shape[1], np.bool_)
    kept[seen[rng.random(len(seen)) < lone]] = False
    return xyz[:, kept], {name: values[kept] for name, values in columns.items()}


@pytest.mark.parametrize(("share", "lone"), [(0.1, 0.0), (0.4, 0.2), (0.9, 0.0)])
def test_a_bottom_under_the_sea_does_not_become_its_surface(share, lone):
    xyz, columns = clear_water(share, lone)
    found = separate(np.array_split(xyz, 3, axis=1), SeparationParams(), columns.get)
    on_ship = xyz[2] > 4
    assert (found.classification[on_ship] == OTHER).all()
    assert (found.classification[~on_ship] == WATER).all()
    below = xyz[2] < -2
    np.testing.assert_allclose(found.height_m[below], xyz[2, below], atol=0.2)


def test_squares_where_many_pulses_missed_the_surface_are_no_ground_beside_a_mat():
    xyz, columns = clear_water(0.4)
    square = np.floor(xyz[0] / 8) + 100 * np.floor(xyz[1] / 8)
    some = np.isin(square, np.random.default_rng(7).choice(np.unique(square), 40, replace=False))
    missed = some & (columns["number_of_returns"] == 1) & (np.random.default_rng(8).random(len(some)) < 0.7)
    xyz[2, missed & (xyz[2] < 1)] = -DEPTH_M
    found = separate([xyz], SeparationParams(), columns.get)
    assert (found.classification[xyz[2] < 1] == WATER).mean() > 0.999


def test_a_fixed_height_is_the_published_method():
    xyz, columns = clear_water(0.4)
    found = separate([xyz], SeparationParams(height_m=0.5), columns.get)
    assert np.mean(found.classification[np.abs(xyz[2]) < 0.5] == WATER) < 0.1


def test_a_trusted_bottom_keeps_its_class():
    xyz, columns = clear_water(0.4)
    columns["classification"] = np.where(xyz[2] < -2, GROUND, OTHER).astype(np.uint8)
    found = separate([xyz], SeparationParams(trust_classes=(2,)), columns.get)
    assert (found.classification[xyz[2] < -2] == GROUND).all()


def mat(x, y):
    return np.where((np.abs(x - 100) < 40) & (np.abs(y - 75) < 25), 1.0, 0.0)


def trees(x, y):
    return np.where(y > 75, 6 + 3 * np.sin(7 * x + 5 * y), 0.0)


@pytest.mark.parametrize("elevation", [mat, trees])
def test_mats_and_trees_are_no_water(elevation):
    rng = np.random.default_rng(4)
    xyz, columns = pulses(rng, elevation, lambda x, _y: np.full(len(x), -0.05), 0.4)
    only = columns["return_number"] == 2  # beside the mat, pulses have one echo
    single = np.zeros(len(only), np.bool_)
    single[: len(xyz[2]) - only.sum()] = elevation(*xyz[:2, ~only]) == 0
    columns["number_of_returns"][single] = 1
    assert bottom_of(GriddedPoints.of([xyz], 1.0), columns.get) is None


def test_without_numbers_of_returns_there_is_no_bottom():
    xyz, columns = clear_water(0.4)
    points = GriddedPoints.of([xyz], 1.0)
    assert bottom_of(points, {}.get) is None
    assert bottom_of(points, {"number_of_returns": columns["number_of_returns"]}.get) is None
