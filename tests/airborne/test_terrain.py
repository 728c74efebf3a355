"""Terrain without water."""

import numpy as np
import pytest

from seaclutter_cli.airborne.echoes import Echoes
from seaclutter_cli.airborne.grid import ElevationGrid
from seaclutter_cli.airborne.part_waves import PartWaves
from seaclutter_cli.airborne.quarters import LocalWaves
from seaclutter_cli.airborne.squares import squares_of
from seaclutter_cli.airborne.terrain import without_banks
from tests.airborne.coasts import hummocks, shares


def rising(share, rng, count=60_000):
    """Return ground; a share of the echoes, everywhere, is from crowns that hide none of it."""
    x, y = rng.uniform(0, 150, count), rng.uniform(0, 120, count)
    high = rng.random(count) < share
    return np.stack((x, y, np.where(high, rng.uniform(5, 15, count), hummocks(x, y))))


@pytest.mark.parametrize(("share", "is_wood"), [(0.2, True), (0.01, False)])
def test_what_rises_everywhere_is_a_wood(share, is_wood):
    """A few birds or drops above each square are none."""
    xyz = rising(share, np.random.default_rng(4))
    on_land, _ = shares(xyz, np.ones(xyz.shape[1], np.bool_), {"number_of_returns": np.ones(xyz.shape[1], int)})
    assert (on_land == 1) == is_wood


def test_heights_above_the_ground_below_trees_are_no_lake():
    """The ground is perfectly level, and crowns are above most of it."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(0, 150, 80_000), rng.uniform(0, 120, 80_000)
    wood = np.sin(x / 9) * np.sin(y / 7) > -0.6
    z = np.where(wood & (rng.random(len(x)) < 0.5), rng.uniform(3, 20, len(x)), 0.0)
    columns = {"intensity": rng.normal(200, 40, len(x)), "number_of_returns": np.ones(len(x), int)}
    assert shares(np.stack((x, y, z)), np.ones(len(x), np.bool_), columns)[0] == 1


@pytest.mark.parametrize(("bank_m", "width", "parts"), [(3.3, 32, 1), (0.6, 32, 2), (3.3, 96, 2)])
def test_the_banks_of_a_canal_are_no_crests(bank_m, width, parts):
    """Waves of another part, all of which reflects like a mirror, are not affected, nor are those in a wide canal."""
    x, y = (side.ravel() + 0.5 for side in np.mgrid[:256, :128])
    canal = (x >= 128) | (np.abs(y - 64) < width / 2)
    grid = ElevationGrid(1.0)
    grid.add(np.stack((x, y, np.where(canal, 0.4, bank_m))))
    squares = squares_of(grid, grid.lowest, np.isfinite(grid.lowest))
    is_canal = squares.level_m < 0.5
    none = np.zeros(len(is_canal))
    seen = Echoes(np.where(is_canal, 0.9, 0.2), none, none, none, none, none > 0, none.astype(np.int8))
    waves = [
        PartWaves((0, 0), 16384, level, 0.87, 1.0, [(16384, 1.0)], 85.0, is_sea=True, is_level=True)
        for level in (bank_m, 0.4)
    ]
    local = without_banks(squares, seen, LocalWaves(np.array([[64.0, 192.0], [64.0, 64.0]]), waves, 0, 0, 32768))
    assert local.centers.shape == (2, parts)
    assert list(local.parts) == waves[-parts:]
