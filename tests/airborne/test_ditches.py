"""Ditches in land, which are narrower than the squares that distinguish water from land."""

import numpy as np
import pytest

from seaclutter_cli.airborne.ditches import ditch_levels
from seaclutter_cli.airborne.gridded import GriddedPoints
from seaclutter_cli.airborne.separation import GROUND, WATER, separate
from seaclutter_cli.airborne.surface import SeparationParams
from tests.airborne.coasts import waves

SIZE = 360.0, 200.0
WIDTH_M, DEPTH_M, LEVEL_M = 4.0, 0.5, 1.0


def across(x, y):
    """Return the distance from the axis of a ditch that winds over the edge of a block of cells."""
    return np.abs(y - 100 - 12 * np.sin(x / 30))


def field(rng, x):
    return LEVEL_M + 0.03 * np.sin(x / 9) + rng.normal(0, 0.02, len(x))


def polder(depth_m=DEPTH_M, width_m=WIDTH_M, first_m=0.0, bottom=lambda x, y: np.zeros(len(x)), count=4):
    """Return the points of a field with a ditch from ``first_m`` on, and which are in the ditch."""
    rng = np.random.default_rng(8)
    x, y = (rng.uniform(0, side, int(count * SIZE[0] * SIZE[1])) for side in SIZE)
    ditch = (across(x, y) < width_m / 2) & (x >= first_m)
    water = LEVEL_M - depth_m + bottom(x, y) + rng.normal(0, 0.01, len(x))
    return np.stack((x, y, np.where(ditch, water, field(rng, x)))), ditch


def found_in(xyz, *, variation=None, land=True, water=False):
    """Return the level of the ditch at each point; NaN elsewhere."""
    points = GriddedPoints.of([xyz], 1.0)
    grid = points.grid
    everywhere = np.full(grid.lowest.shape, land)
    some = np.full(grid.lowest.shape, water)
    varies = None if variation is None else np.full(grid.lowest.shape, variation)
    return ditch_levels(grid, grid.lowest, everywhere, some, lambda: varies).reshape(-1)[points.cells[0]]


@pytest.mark.parametrize("width", [2.4, 4.0, 7.0])
def test_a_ditch_has_one_level_also_across_blocks(width):
    xyz, _ = polder(width_m=width)
    level = found_in(xyz)
    inner = across(*xyz[:2]) < width / 2 - 0.5
    assert np.isfinite(level[inner]).mean() > 0.98
    assert not np.isfinite(level[across(*xyz[:2]) > width / 2 + 1.5]).any()
    assert len(np.unique(level[np.isfinite(level)])) == 1
    assert np.nanmedian(level) == pytest.approx(LEVEL_M - DEPTH_M, abs=0.03)


@pytest.mark.parametrize(
    "made",
    [
        pytest.param({"depth_m": 0.15}, id="shallow"),
        pytest.param({"width_m": 14.0}, id="wide"),
        pytest.param({"first_m": SIZE[0] - 15}, id="short"),
        pytest.param({"bottom": lambda x, y: x / 500}, id="sloping"),
        pytest.param({"bottom": lambda x, y: 0.1 * np.sin(x / 3) * np.sin(y / 2)}, id="uneven"),
    ],
)
def test_other_hollows_are_no_ditches(made):
    assert not np.isfinite(found_in(polder(**made)[0])).any()


def test_an_alley_at_the_level_of_the_ground_around_is_no_ditch():
    xyz, _ = polder(depth_m=0.0)
    wall = (across(*xyz[:2]) > 2) & (across(*xyz[:2]) < 6)
    assert not np.isfinite(found_in(np.stack((*xyz[:2], np.where(wall, 4.0, xyz[2]))))).any()


@pytest.mark.parametrize(
    ("variation", "water", "is_ditch"), [(0.2, False, False), (0.2, True, True), (0.7, False, True)]
)
def test_what_reflects_like_ground_is_no_ditch_unless_the_water_of_the_tile_does(variation, water, is_ditch):
    assert np.isfinite(found_in(polder()[0], variation=variation, water=water)).any() == is_ditch


def test_ditches_are_looked_for_in_land_alone():
    assert not np.isfinite(found_in(polder()[0], land=False)).any()
    assert not len(found_in(np.zeros((3, 0))))


def test_a_ditch_ends_at_the_edge_of_a_tile():
    xyz, _ = polder()
    inner = across(*xyz[:2]) < WIDTH_M / 2 - 0.5
    at_edge = inner & ((xyz[0] < 2) | (xyz[0] > SIZE[0] - 2))
    assert np.isfinite(found_in(xyz)[at_edge]).mean() > 0.95


def polder_by_the_sea(height_m):
    """Return points, which are in a ditch, on land, and their attributes."""
    rng = np.random.default_rng(5)
    xyz, ditch = polder()
    x, y = rng.uniform(0, SIZE[0], 300_000), rng.uniform(SIZE[1], 2 * SIZE[1], 300_000)
    dike = y < SIZE[1] + 10
    sea = np.stack((x, y, np.where(dike, 4.0 + rng.normal(0, 0.05, len(x)), waves(rng, x, y, height_m, 12.0))))
    land, ditch = np.concatenate((~ditch, dike)), np.concatenate((ditch, np.zeros(len(x), bool)))
    light = np.where(land, rng.normal(200, 20, len(land)), rng.exponential(60, len(land))).clip(0)
    columns = {"intensity": light, "number_of_returns": np.ones(len(land), int)}
    return np.concatenate((xyz, sea), axis=1), ditch, land, columns


@pytest.mark.parametrize("height", [0.1, 1.0])
@pytest.mark.parametrize("land_class", ["keep", "class2"])
def test_ditches_of_a_polder_are_water_and_its_fields_and_banks_are_land(height, land_class):
    """The sea beside it is calm or rough."""
    xyz, ditch, land, columns = polder_by_the_sea(height)
    found = separate([xyz], SeparationParams(land=land_class), columns.get)
    is_water = found.classification == WATER
    assert is_water[ditch].mean() > 0.95
    assert is_water[~land & ~ditch].mean() > 0.99
    assert is_water[land].mean() < 0.005
    near = across(*xyz[:2]) < 4
    assert found.land.contain(xyz[:2, near & land]).mean() > 0.99
    if land_class == "class2":
        assert (found.classification[near & land & ~is_water] == GROUND).mean() > 0.9
