"""Terrain without water."""

from dataclasses import replace

import numpy as np
import pytest

from seaclutter_cli.airborne.echoes import Echoes
from seaclutter_cli.airborne.part_waves import PartWaves
from seaclutter_cli.airborne.quarters import LocalWaves
from seaclutter_cli.airborne.squares import squares_of
from seaclutter_cli.airborne.terrain import are_woods, may_be_waves, without_banks
from seaclutter_cli.grids.elevation import ElevationGrid
from tests.airborne.coasts import hummocks, shares


def squares_and_echoes(level):
    """Return the squares of an elevation of each metre, shape (n, m), and echoes of which all else is unknown."""
    x, y = (side.ravel() + 0.5 for side in np.mgrid[: level.shape[0], : level.shape[1]])
    grid = ElevationGrid(1.0)
    grid.add(np.stack((x, y, level.ravel())))
    squares = squares_of(grid, grid.lowest, np.isfinite(grid.lowest))
    none, nothing = np.zeros(len(squares.index)), np.full(len(squares.index), np.nan)
    echoes = {"variation": nothing, "brightness": nothing, "several": none, "tall": none, "change_m": nothing}
    return squares, Echoes(**{**echoes, "moving": none > 0, "known": none.astype(np.int8)})


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


def waves_at(*levels):
    """Return waves in two halves of a block, of 128 m each, at these levels."""
    waves = [
        PartWaves((0, 0), 16384, level, 0.87, 1.0, [(16384, 1.0)], 85.0, is_sea=True, is_level=True) for level in levels
    ]
    return LocalWaves(np.array([[64.0, 192.0], [64.0, 64.0]]), waves, 0, 0, 32768)


@pytest.mark.parametrize(("bank_m", "width", "parts"), [(3.3, 32, 1), (0.6, 32, 2), (3.3, 96, 2)])
def test_the_banks_of_a_canal_are_no_crests(bank_m, width, parts):
    """Waves of another part, all of which reflects like a mirror, are not affected, nor are those in a wide canal."""
    x, y = np.mgrid[:256, :128] + 0.5
    squares, seen = squares_and_echoes(np.where((x >= 128) | (np.abs(y - 64) < width / 2), 0.4, bank_m))
    waves = waves_at(bank_m, 0.4)
    local = without_banks(squares, replace(seen, variation=np.where(squares.level_m < 0.5, 0.9, 0.2)), waves)
    assert local.centers.shape == (2, parts)
    assert list(local.parts) == waves.parts[-parts:]


@pytest.mark.parametrize(("fields_m", "width", "kept"), [(3.3, 64, []), (0.6, 64, [0, 1]), (3.3, 16, [0])])
def test_fields_far_above_the_water_of_a_tile_are_no_crests(fields_m, width, kept):
    """The first part shows no water; that of the tile counts, unless it is a pond."""
    x, y = np.mgrid[:256, :128] + 0.5
    squares, seen = squares_and_echoes(np.where((x >= 256 - width) & (np.abs(y - 64) < 16), 0.4, fields_m))
    waves = waves_at(fields_m, 0.4)
    local = without_banks(squares, replace(seen, variation=np.where(squares.level_m < 0.5, 0.9, 0.2)), waves)
    assert list(local.parts) == [waves.parts[number] for number in kept]


@pytest.mark.parametrize(
    ("known", "may_be"),
    [({}, True), ({"tall": 0.1}, False), ({"several": 0.1}, False), ({"variation": 0.2}, False)],
)
def test_a_level_tile_may_be_one_long_wave_unless_roofs_rise_out_of_it(known, may_be):
    squares, seen = squares_and_echoes(np.sin(np.arange(256) / 40)[:, None] + np.zeros(128))
    some = np.arange(len(squares.index)) % 8 == 0  # of the squares
    seen = replace(seen, **{name: np.where(some, value, seen.__dict__[name]) for name, value in known.items()})
    assert may_be_waves(squares, seen) == may_be


@pytest.mark.parametrize("moves", [False, True])
def test_what_stays_from_strip_to_strip_is_no_wave(moves):
    squares, seen = squares_and_echoes(np.sin(np.arange(256) / 40)[:, None] + np.zeros(128))
    change = np.roll(squares.level_m, 100) - squares.level_m if moves else np.full(len(squares.index), 0.004)
    assert may_be_waves(squares, replace(seen, change_m=change)) == moves


@pytest.mark.parametrize(("side", "may_be"), [(96, True), (112, False)])
def test_ground_in_a_small_tile_may_be_part_of_a_wave(side, may_be):
    """A ship may cover much of it."""
    squares, seen = squares_and_echoes(np.sin(np.arange(side) / 40)[:, None] + np.zeros(side))
    some = np.full(len(squares.index), 0.2)
    assert may_be_waves(squares, replace(seen, variation=some, tall=some)) == may_be


@pytest.mark.parametrize(("share", "is_town"), [(0.25, True), (0.1, False)])
def test_roofs_on_a_quarter_of_the_squares_are_a_town(share, is_town):
    squares, seen = squares_and_echoes(np.zeros((160, 160)))
    tall = np.where(np.arange(len(squares.index)) % 20 < 20 * share, 0.6, 0.0)
    assert are_woods(squares, replace(seen, tall=tall), np.ones(len(tall), np.bool_)) == is_town


@pytest.mark.parametrize("seed", [1, 2])
def test_a_town_at_one_moment_is_land(seed):
    """Its streets rise and fall, and nothing but the roofs distinguishes them from waves."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 300, (2, 250_000))
    phase = rng.uniform(0, 7)
    ground = 0.5 * np.sin(2 * np.pi * (x + y / 2) / 130 + phase) * np.cos(2 * np.pi * (y - x / 3) / 150)
    house = (x % 40 > 14) & (y % 25 > 13)
    xyz = np.stack((x, y, np.where(house, 7.0, 0) + ground + rng.normal(0, 0.03, len(x))))
    assert shares(xyz, np.ones(len(x), np.bool_), {})[0] == 1
