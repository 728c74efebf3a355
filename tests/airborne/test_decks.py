"""Decks and other even surfaces in rough water."""

import numpy as np
import pytest

from seaclutter_cli.airborne.decks import _unevenness, decks
from seaclutter_cli.airborne.separation import OTHER, separate
from seaclutter_cli.airborne.surface import SeparationParams
from seaclutter_cli.airborne.waves import Waves
from seaclutter_cli.grids.elevation import ElevationGrid

X, Y = (side.ravel() + 0.5 for side in np.mgrid[:200, :160].astype(float))
DEVIATION_M = 0.35


def wind_sea(seed=1):
    """Return waves of 1.4 m: a narrow peak at 30 m and a tail of short waves, as wind makes them."""
    rng = np.random.default_rng(seed)
    total = np.zeros(len(X))
    for length in np.geomspace(2.5, 40, 80):
        k, angle = 2 * np.pi / (length * rng.normal(1, 0.05)), rng.normal(0.6, 0.4)
        weight = (length / 30) ** 1.2 if length < 30 else 1.0
        total += weight * np.sin(k * (np.cos(angle) * X + np.sin(angle) * Y) + rng.uniform(0, 7))
    return total * DEVIATION_M / total.std() + rng.normal(0, 0.02, len(X))


def on_deck(width, height, z):
    """Return water with a boat: its deck, with a wheelhouse in the middle; and whether points are on the deck."""
    rng = np.random.default_rng(5)
    deck = (np.abs(X - 100) < width) & (np.abs(Y - 80) < width / 2)
    house = deck & (np.abs(X - 100) < 2) & (np.abs(Y - 80) < 2)
    return np.where(house, height + 3, np.where(deck, height + rng.normal(0, 0.01, len(X)), z)), deck


def found(z, known=slice(None)):
    grid = ElevationGrid(1.0)
    grid.add(np.stack((X, Y, z))[:, known])
    waves = Waves([], 0.0, DEVIATION_M, 30.0, 1.0)
    mask = decks(grid, grid.lowest, np.isfinite(grid.lowest), waves).reshape(-1)
    return mask[grid.locate(X, Y)]


def test_unevenness_is_that_of_three_by_three_cells():
    rng = np.random.default_rng(6)
    grid = ElevationGrid(1.0)
    grid.add(np.stack((X, Y, wind_sea()))[:, rng.random(len(X)) < 0.8])
    deviation, curvature = _unevenness(grid, grid.lowest)
    for i, j in zip(rng.integers(1, 199, 500), rng.integers(1, 159, 500), strict=True):
        own = grid.lowest[0, i - 1 : i + 2, j - 1 : j + 2]
        known = np.isfinite(own)
        lines = [line for way in (own, own.T) for line in way if np.isfinite(line).all()]
        bends = [line[0] - 2 * line[1] + line[2] for line in lines]
        expected = own[known].std() if known.sum() >= 6 else np.inf
        assert deviation[0, i, j] == pytest.approx(expected, abs=1e-7)
        assert curvature[0, i, j] == pytest.approx(np.sqrt(np.mean(np.square(bends))) if len(bends) > 2 else np.inf)


def test_a_deck_as_high_as_the_crests():
    z, deck = on_deck(11.0, 1.0, wind_sea())
    mask = found(z)
    assert mask[deck].mean() > 0.8
    assert not mask[~deck].any()


@pytest.mark.parametrize("seed", range(4))
def test_wind_sea_has_no_decks(seed):
    assert not found(wind_sea(seed)).any()


@pytest.mark.parametrize("length", [20.0, 40.0, 80.0])
@pytest.mark.parametrize("noise", [0.0, 0.002, 0.02])
def test_crests_of_smooth_swell_are_no_decks(length, noise):
    swell = DEVIATION_M * np.sqrt(2) * np.sin(2 * np.pi * (0.8 * X + 0.6 * Y) / length)
    assert not found(swell + np.random.default_rng(1).normal(0, noise, len(X))).any()


def test_a_sparse_grid_shows_no_decks():
    z, _ = on_deck(11.0, 1.0, wind_sea())
    assert not found(z, np.random.default_rng(2).random(len(X)) < 0.1).any()


@pytest.mark.parametrize("echoes", [1, 5])
def test_the_deck_of_a_boat_in_a_rough_sea_is_an_object(echoes):
    rng = np.random.default_rng(3)
    z, deck = on_deck(11.0, 1.0, wind_sea())
    xyz = np.concatenate([np.stack((X, Y, z + rng.normal(0, 0.01, len(X)))) for _ in range(echoes)], axis=1)
    other = (separate([xyz], SeparationParams()).classification == OTHER).reshape(echoes, -1)
    assert other[:, deck].mean() > 0.9
    assert other[:, ~deck].mean() < 0.005
